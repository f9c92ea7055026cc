"""Symmetries of a robot's dynamics: rotations about cyclic joints, and a mirror image.

A MuJoCo model declares them in two custom texts:

    <custom>
      <text name="nas_cyclic" data="j1"/>
      <text name="nas_mirror" data="j1=0 j2=0.785 j3=1.57"/>
    </custom>

The angle of a cyclic joint does not affect the dynamics. The mirror image reflects each listed joint at an angle [rad];
other joints keep their angles. Both symmetries hold without joint limits and contacts.
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
PROBES, REACH = 64, 1.0  # number of random states of a check, and their range [rad], [rad/s] and [N·m]
MAX_RELATIVE_ERROR = 1e-3  # largest relative error of accelerations of a valid symmetry


@dataclass(frozen=True)
class Symmetry:
    """A robot's symmetry, in the order of its n joints.

    Attributes:
        cyclic: Whether each joint is cyclic.
        centres: Angles at which joints are mirrored [rad]; 0 for other joints.
        signs: −1 for mirrored joints, 1 for others.
    """

    cyclic: tuple[bool, ...]
    centres: tuple[float, ...]
    signs: tuple[int, ...]

    @classmethod
    def from_names(cls, joints: Sequence[str], cyclic: Sequence[str], mirror: Mapping[str, float]) -> "Symmetry":
        """Return the symmetry with the given cyclic joints, and mirror angles [rad] by joint."""
        return cls(
            tuple(joint in cyclic for joint in joints),
            tuple(mirror.get(joint, 0.0) for joint in joints),
            tuple(-1 if joint in mirror else 1 for joint in joints),
        )

    @property
    def width(self) -> int:
        """Number of components that `read` returns."""
        return 2 * (len(self.cyclic) - sum(self.cyclic)) + 2 * len(self.cyclic)

    def read(self, states: Tensor, commands: Tensor) -> Tensor:
        """Return the network inputs for states (…, 2n) and torques (…, n), shape (…, width).

        They are cosines and sines of the angles of joints that are not cyclic, relative to their centres, then
        velocities and torques.
        """
        n = len(self.cyclic)
        kept = [index for index, cyclic in enumerate(self.cyclic) if not cyclic]
        angles = states[..., kept] - states.new_tensor(self.centres)[kept]
        return torch.cat([torch.cos(angles), torch.sin(angles), states[..., n:], commands], dim=-1)

    def fill_inputs(self, inputs: np.ndarray, states: np.ndarray, commands: np.ndarray) -> None:
        """Write the result of `read` for states (B, 2n) and torques (B, n) into `inputs`, shape (B, width)."""
        n, kept = len(self.cyclic), [index for index, cyclic in enumerate(self.cyclic) if not cyclic]
        angles = states[:, kept] - np.array(self.centres)[kept]
        np.cos(angles, out=inputs[:, : len(kept)], casting="same_kind")
        np.sin(angles, out=inputs[:, len(kept) : 2 * len(kept)], casting="same_kind")
        inputs[:, 2 * len(kept) : -n] = states[:, n:]
        inputs[:, -n:] = commands

    def input_signs(self) -> list[int]:
        """Return the signs, shape (width,), by which mirroring multiplies the components of `read`."""
        mirrored = [sign for sign, cyclic in zip(self.signs, self.cyclic, strict=True) if not cyclic]
        return [1] * len(mirrored) + mirrored + [*self.signs] * 2


def read_symmetry(model: mujoco.MjModel) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return the cyclic joints of a model, and the mirror angle [rad] by joint.

    Raises:
        ModelFileError: the text of the mirror image is not `joint=angle joint=angle …`.
    """
    cyclic, mirror = read_text(model, CYCLIC), read_text(model, MIRROR)
    try:
        pairs = [word.split("=") for word in mirror.split()]
        return tuple(cyclic.split()), {joint: float(angle) for joint, angle in pairs}
    except ValueError:
        raise ModelFileError(
            f"The model's text '{MIRROR}' is '{mirror}'; write joint=angle for each joint, separated by spaces."
        ) from None


def read_text(model: mujoco.MjModel, name: str) -> str:
    """Return a custom text of a model; empty if there is none of that name."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, name)
    if index < 0:
        return ""
    start, size = model.text_adr[index], model.text_size[index]
    return bytes(model.text_data[start : start + size]).rstrip(b"\0").decode()


def find_symmetry(simulator: Simulator) -> dict[str, Any]:
    """Return the symmetry (`cyclic` and `mirror`) that a source's model declares, after checking it.

    Raises:
        ModelFileError: the declaration is malformed, names an unknown joint, or does not hold.
        OptionError: the model declares no symmetry.
    """
    model = getattr(simulator, "model", None)
    cyclic, mirror = read_symmetry(model) if isinstance(model, mujoco.MjModel) else ((), {})
    if not cyclic and not mirror:
        raise OptionError(
            f"The source's model declares no symmetry: add the texts {CYCLIC} and {MIRROR} to it, pair again, or use "
            "the preset few."
        )
    unknown = [joint for joint in (*cyclic, *mirror) if joint not in simulator.joints]
    if unknown:
        raise ModelFileError(f"The model's symmetry names the joint '{unknown[0]}', which is not a commanded one.")
    error = measure_asymmetry(model, simulator.joints, Symmetry.from_names(simulator.joints, cyclic, mirror))
    if error > MAX_RELATIVE_ERROR:
        raise ModelFileError(
            f"The model is not as symmetric as its texts {CYCLIC} and {MIRROR} say: accelerations are {error:.1%} off; "
            "correct them, or use the preset few."
        )
    return {"cyclic": cyclic, "mirror": mirror}


def measure_asymmetry(model: mujoco.MjModel, joints: Sequence[str], symmetry: Symmetry) -> float:
    """Return the largest relative error of a symmetry's accelerations, without limits and contacts."""
    free = copy.deepcopy(model)
    free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    rng, n = np.random.default_rng(0), len(joints)
    angles, speeds, commands = rng.uniform(-REACH, REACH, (3, PROBES, n))
    shifts = rng.uniform(-REACH, REACH, (PROBES, n)) * np.array(symmetry.cyclic)
    signs, centres = np.array(symmetry.signs), np.array(symmetry.centres)
    mirrored = centres + signs * (angles - centres) + shifts
    original = compute_accelerations(free, joints, angles, speeds, commands)
    image = compute_accelerations(free, joints, mirrored, signs * speeds, signs * commands)
    return float(np.abs(image - signs * original).max() / np.abs(original).max())


def compute_accelerations(
    model: mujoco.MjModel, joints: Sequence[str], angles: np.ndarray, speeds: np.ndarray, commands: np.ndarray
) -> np.ndarray:
    """Return accelerations [rad/s²] for angles [rad], speeds [rad/s] and torques [N·m]; all have shape (N, n)."""
    data = mujoco.MjData(model)
    elements = [model.joint(joint) for joint in joints]
    inputs = Controls.of(model, [element.id for element in elements], "the model")
    result = np.empty_like(angles)
    for row in range(len(angles)):
        mujoco.mj_resetData(model, data)
        for column, element in enumerate(elements):
            data.qpos[element.qposadr], data.qvel[element.dofadr] = angles[row, column], speeds[row, column]
        data.ctrl[inputs.index] = inputs.from_commands(commands[row])
        mujoco.mj_forward(model, data)
        result[row] = [data.qacc[element.dofadr].item() for element in elements]
    return result
