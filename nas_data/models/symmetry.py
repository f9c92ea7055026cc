"""What leaves a robot's motion as it is: turns about some joints, and its mirror image; as its model file says.

A MuJoCo model says so in two texts, by the names of its joints:

    <custom>
      <text name="nas_cyclic" data="j1"/>
      <text name="nas_mirror" data="j1=0 j2=0.785 j3=1.57"/>
    </custom>

Cyclic joints are those whose angle makes no difference. The mirror image turns each joint that is listed to the other
side of an angle [rad]; joints that are not listed keep theirs. Both hold where no limit and no contact is felt.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import torch
from torch import Tensor

from nas_data.errors import ModelFileError, OptionError
from nas_data.simulators.base import Simulator
from nas_data.simulators.controls import Controls

CYCLIC, MIRROR = "nas_cyclic", "nas_mirror"
PROBES, REACH = 64, 1.0  # states in which a symmetry is tried; [rad], [rad/s] and [N·m] of their spread
SAME = 1e-3  # of the accelerations: a symmetry that holds is off by rounding


@dataclass(frozen=True)
class Symmetry:
    """A robot's symmetry, in the order of its n joints.

    Attributes:
        cyclic: Whether a joint's angle makes no difference.
        centres: Angles [rad] about which the mirror image turns joints; 0 for those that it does not.
        signs: −1 for the joints that it turns, 1 for others; all 1 where there is no mirror image.
    """

    cyclic: tuple[bool, ...]
    centres: tuple[float, ...]
    signs: tuple[int, ...]

    @classmethod
    def named(cls, joints: Sequence[str], cyclic: Sequence[str], mirror: Mapping[str, float]) -> "Symmetry":
        """Return the symmetry of joints, of which some are cyclic and some turned about an angle [rad]."""
        return cls(
            tuple(joint in cyclic for joint in joints),
            tuple(mirror.get(joint, 0.0) for joint in joints),
            tuple(-1 if joint in mirror else 1 for joint in joints),
        )

    @property
    def width(self) -> int:
        """Number of what `read` returns."""
        return 2 * (len(self.cyclic) - sum(self.cyclic)) + 2 * len(self.cyclic)

    def read(self, states: Tensor, commands: Tensor) -> Tensor:
        """Return what the symmetry leaves of states (…, 2n) and torques (…, n), shape (…, width).

        That is cosines and sines of the angles that make a difference, each from its centre, speeds and torques.
        """
        n = len(self.cyclic)
        kept = [index for index, cyclic in enumerate(self.cyclic) if not cyclic]
        angles = states[..., kept] - states.new_tensor(self.centres)[kept]
        return torch.cat([torch.cos(angles), torch.sin(angles), states[..., n:], commands], dim=-1)

    def fill(self, inputs: np.ndarray, states: np.ndarray, commands: np.ndarray) -> None:
        """Write what `read` returns into `inputs`, shape (B, width)."""
        n, kept = len(self.cyclic), [index for index, cyclic in enumerate(self.cyclic) if not cyclic]
        angles = states[:, kept] - np.array(self.centres)[kept]
        np.cos(angles, out=inputs[:, : len(kept)], casting="same_kind")
        np.sin(angles, out=inputs[:, len(kept) : 2 * len(kept)], casting="same_kind")
        inputs[:, 2 * len(kept) : -n] = states[:, n:]
        inputs[:, -n:] = commands

    def input_signs(self) -> list[int]:
        """Return by what the mirror image multiplies what `read` returns."""
        turned = [sign for sign, cyclic in zip(self.signs, self.cyclic, strict=True) if not cyclic]
        return [1] * len(turned) + turned + [*self.signs] * 2


def read_symmetry(model: mujoco.MjModel) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return the cyclic joints that a model lists, and the angle [rad] of each joint that its mirror image turns.

    Raises:
        ModelFileError: the mirror's text is not `joint=angle joint=angle …`.
    """
    cyclic = tuple(text(model, CYCLIC).split())
    try:
        pairs = [word.split("=") for word in text(model, MIRROR).split()]
        return cyclic, {joint: float(angle) for joint, angle in pairs}
    except ValueError:
        raise ModelFileError(
            f"The model's text '{MIRROR}' is '{text(model, MIRROR)}'; write joint=angle for each joint, with blanks."
        ) from None


def text(model: mujoco.MjModel, name: str) -> str:
    """Return a model's custom text; nothing where it has none of that name."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, name)
    if index < 0:
        return ""
    start, size = model.text_adr[index], model.text_size[index]
    return bytes(model.text_data[start : start + size]).rstrip(b"\0").decode()


def symmetry_of(simulator: Simulator) -> dict[str, Any]:
    """Return the symmetry that a source's model declares, `cyclic` and `mirror`, after trying it on the source.

    Raises:
        ModelFileError: what it declares cannot be read, names no joint of its, or does not hold.
        OptionError: it declares none.
    """
    model = getattr(simulator, "model", None)
    cyclic, mirror = read_symmetry(model) if isinstance(model, mujoco.MjModel) else ((), {})
    if not cyclic and not mirror:
        raise OptionError(
            f"The source's model declares no symmetry: add the texts {CYCLIC} and {MIRROR} to it, pair again, or take "
            "the preset few."
        )
    strangers = [joint for joint in (*cyclic, *mirror) if joint not in simulator.joints]
    if strangers:
        raise ModelFileError(f"The model's symmetry names the joint '{strangers[0]}', which is not a commanded one.")
    off = asymmetry(model, simulator.joints, Symmetry.named(simulator.joints, cyclic, mirror))
    if off > SAME:
        raise ModelFileError(
            f"The model is not as symmetric as its texts {CYCLIC} and {MIRROR} say: accelerations are {off:.1%} off; "
            "correct them, or take the preset few."
        )
    return {"cyclic": cyclic, "mirror": mirror}


def asymmetry(model: mujoco.MjModel, joints: Sequence[str], symmetry: Symmetry) -> float:
    """Return by how much a symmetry does not hold, as a share of the accelerations, without limits and contacts."""
    free = copy.deepcopy(model)
    free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    rng, n = np.random.default_rng(0), len(joints)
    angles, speeds, commands = rng.uniform(-REACH, REACH, (3, PROBES, n))
    shifts = rng.uniform(-REACH, REACH, (PROBES, n)) * np.array(symmetry.cyclic)
    signs, centres = np.array(symmetry.signs), np.array(symmetry.centres)
    there = centres + signs * (angles - centres) + shifts
    here = accelerations(free, joints, angles, speeds, commands)
    image = accelerations(free, joints, there, signs * speeds, signs * commands)
    return float(np.abs(image - signs * here).max() / np.abs(here).max())


def accelerations(
    model: mujoco.MjModel, joints: Sequence[str], angles: np.ndarray, speeds: np.ndarray, commands: np.ndarray
) -> np.ndarray:
    """Return the joints' accelerations [rad/s²] under torques; all arrays have the shape (N, n)."""
    data = mujoco.MjData(model)
    places = [model.joint(joint) for joint in joints]
    inputs = Controls.of(model, [place.id for place in places], "the model")
    found = np.empty_like(angles)
    for row in range(len(angles)):
        mujoco.mj_resetData(model, data)
        for column, place in enumerate(places):
            data.qpos[place.qposadr], data.qvel[place.dofadr] = angles[row, column], speeds[row, column]
        data.ctrl[inputs.index] = inputs.from_commands(commands[row])
        mujoco.mj_forward(model, data)
        found[row] = [data.qacc[place.dofadr].item() for place in places]
    return found
