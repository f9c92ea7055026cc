"""What a robot is: an MJCF with named joints, and the constants that recording and control need."""

import codecs
import hashlib
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypedDict

import mujoco

from nas_data import registry
from nas_data.errors import ModelFileError, UnknownName
from nas_data.mjcf.actuator_lookup import driven_joint
from nas_data.mjcf.check_angle_units import check_angle_units
from nas_data.mjcf.default_servos import add_position_servos, add_torque_motors, motor_joints
from nas_data.mjcf.engine_warnings import collect_warnings, print_warnings
from nas_data.mjcf.floating_base import find_floating_bases, fix_bases
from nas_data.visible_files import visible
from nas_data.warn_once import say_once

FOLDER = Path(__file__).parent
MISSING = re.compile(r"Error opening file '([^']+)'")  # how MuJoCo speaks of meshes, textures and included files
URDF = ".urdf"
KNOWN = (".xml", URDF)  # endings by which MuJoCo knows a model
TORQUES = ":torque"  # after a URDF's name: its joints have motors, which take torques
PREFIX = "nas_"  # of a model's own constants, in its <custom>
NOT_A_NUMBER = "'NaN'"  # in MuJoCo's warning, after which it reads the number as not given


@dataclass(frozen=True)
class Robot:
    """A robot model.

    Attributes:
        name: Its name; LeRobot's `robot_type`.
        mjcf: File with the model; its SHA-256 identifies the source in provenance.
        joints: Commanded joints in the order of state and action.
        rate: Usual control rate [Hz].
        rest: Rest positions [rad], one a joint; empty for zero.
        position_quantum: Resolution of the position reading [rad]; 0 for none.
        velocity_quantum: Resolution of the velocity reading [rad/s]; 0 for none.
        tip: Name of the site at the end effector, or None.
        edit: Completes the model (a tool, a table); applied after the file is read.
        bases: Bodies that would fall and are fastened to the world by `edit`.
        adapted: Whether the model holds already what a recording does not tell (see `simulators/held.py`).
    """

    name: str
    mjcf: Path
    joints: tuple[str, ...]
    rate: float = 50.0
    rest: tuple[float, ...] = ()
    position_quantum: float = 0.0
    velocity_quantum: float = 0.0
    tip: str | None = None
    edit: Callable[[mujoco.MjSpec], None] | None = None
    bases: tuple[str, ...] = ()
    adapted: bool = False

    def spec(self) -> mujoco.MjSpec:
        """Return a fresh, editable model."""
        spec = read_spec(self.mjcf)
        if self.edit:
            self.edit(spec)
        return spec

    @property
    def sha256(self) -> str:
        """SHA-256 of the model: of the file as it is, or of the completed model where `edit` changes it."""
        content = self.mjcf.read_bytes() if self.edit is None else self.spec().to_xml().encode()
        return hashlib.sha256(content).hexdigest()


def read_spec(path: Path) -> mujoco.MjSpec:
    """Read an MJCF or URDF file.

    Raises:
        ModelFileError: there is no such file, one that it names is missing, or MuJoCo cannot use it as a model.
    """
    if path.is_dir():
        raise ModelFileError(f"{path} is a folder; give a model file{_models_in(path)}.")
    if not path.is_file():
        raise ModelFileError(f"There is no model file {path}; give an MJCF or URDF file, or a robot's name.")
    try:
        with collect_warnings() as heard:
            spec = _parsed(path)
            spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ModelFileError(_explained(path, " ".join(str(error).split()).rstrip("."))) from None
    if any(NOT_A_NUMBER in warning for warning in heard):
        raise ModelFileError(f"{path} gives NaN where a number should stand{_line_of_nan(path)}; put a number there.")
    print_warnings(heard)
    return spec


def _parsed(path: Path) -> mujoco.MjSpec:
    """Read a model by what it holds: the engine goes by a file's ending, and knows `.xml` and `.urdf` only."""
    content = path.read_bytes()
    if path.suffix in KNOWN or not content.removeprefix(codecs.BOM_UTF8).lstrip().startswith(b"<"):
        return mujoco.MjSpec.from_file(str(path))
    known = path.with_name(path.name + KNOWN[0])
    return mujoco.MjSpec.from_file(str(known), include={known.name: content})


def _models_in(folder: Path) -> str:
    """Name a few model files of a folder, where there are some."""
    files = [file.name for file in visible(folder) if file.suffix in (*KNOWN, ".mjcf")]
    return f" in it, such as {folder / files[0]}" if files else ""


def _explained(path: Path, reason: str) -> str:
    """Say why a model cannot be used, and what to do about it."""
    missing = MISSING.search(reason)
    if missing:
        wanted = path.parent / missing[1]
        return f"{path} needs the file '{missing[1]}', which is missing: put it beside the model, at {wanted}."
    return f"{path} cannot be used as a robot model: {reason}; give an MJCF or URDF file."


def _line_of_nan(path: Path) -> str:
    """Say in which line of a file the first NaN stands, where it is not in a file that this one includes."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    found = [number for number, line in enumerate(lines, 1) if re.search(r"[\s\"']nan[\s\"']", line, re.IGNORECASE)]
    return f" (line {found[0]})" if found else ""


def actuated_joints(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Return the names of the joints that actuators drive, in the order of the actuators."""
    driven = (driven_joint(spec, actuator) for actuator in spec.actuators)
    return tuple(joint for joint in driven if joint is not None)


def deepest_joint(spec: mujoco.MjSpec, joints: Sequence[str]) -> str:
    """Return the joint with the most bodies between it and the world; of several the last one listed."""

    def depth(joint: str) -> int:
        body, above = spec.joint(joint).parent, 0
        while body.parent is not None:
            body, above = body.parent, above + 1
        return above

    return max(reversed(joints), key=depth)


@cache
def note_fixed_bases(path: Path, bases: tuple[str, ...]) -> None:
    """Say once that bases are held which would fall."""
    named = ", ".join(f"'{base}'" for base in bases)
    print(
        f"nas: note: the base {named} of {path} is free to fall, and no joint tells where it is: it is held where the "
        "model has it, as if the robot hung there.",
        file=sys.stderr,
    )


def slide_joints(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Return the names of the slides."""
    return tuple(joint.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_SLIDE)


def robot_names() -> tuple[str, ...]:
    """Return the robots that come with the program: files of constants, and models that hold their own."""
    return tuple(sorted({*registry.names("robots"), *(path.stem for path in visible(FOLDER, "*.xml"))}))


class RobotConstants(TypedDict, total=False):
    """What a model may say of its robot beside physics; see `Robot`."""

    rate: float
    position_quantum: float
    velocity_quantum: float
    rest: tuple[float, ...]
    tip: str


def read_constants(spec: mujoco.MjSpec, path: Path) -> RobotConstants:
    """Return the constants of a robot that its model holds in `<custom>`.

    These are `<numeric name="nas_rate" data="50"/>`, the control rate [Hz], likewise `nas_position_quantum` [rad],
    `nas_velocity_quantum` [rad/s] and `nas_rest` [rad], and `<text name="nas_tip" data="SITE"/>`.

    Args:
        spec: The model.
        path: Its file, for errors.

    Raises:
        ModelFileError: a number is none of these or cannot be, or there is no such site.
    """
    own: RobotConstants = {}
    for number in spec.numerics:
        name, values = number.name.removeprefix(PREFIX), tuple(map(float, number.data))
        if name == number.name:
            continue
        if name == "rest":
            own["rest"] = values
        elif name in ("rate", "position_quantum", "velocity_quantum") and len(values) == 1 and values[0] > 0:
            own[name] = values[0]  # type: ignore[literal-required]  # one of the three
        else:
            raise ModelFileError(
                f"{path} gives {number.name} as {' '.join(f'{value:g}' for value in values)}; it may give nas_rate, "
                "nas_position_quantum and nas_velocity_quantum, a number above 0 each, and nas_rest, one a joint."
            )
    for text in spec.texts:
        if text.name == f"{PREFIX}tip":
            if spec.site(text.data) is None:
                raise ModelFileError(f"{path} gives nas_tip as '{text.data}', which is no site of the model.")
            own["tip"] = text.data
    return own


def find_robot(name_or_path: str | Path) -> Robot:
    """Return a robot of ours by name, or any user's model by its file.

    A URDF, which names no actuators, is given position servos; `arm.urdf:torque` is one with motors instead.

    Raises:
        UnknownName: neither a robot's name nor a path.
        ModelFileError: the file cannot be used as a model, or names its actuators itself.
    """
    given = str(name_or_path).removesuffix(TORQUES)
    path, named = Path(given), given in robot_names()
    add_actuators = add_position_servos if given == str(name_or_path) else add_torque_motors
    if add_actuators is add_torque_motors and path.suffix != URDF:
        raise ModelFileError(f"{given} says itself what moves its joints; leave out --actuators, which is for a URDF.")
    if named and given in registry.names("robots") and not path.is_file():
        return registry.module("robots", given, "robot").ROBOT
    if named and not path.is_file():
        path = FOLDER / f"{given}.xml"
    if path.suffix or path.is_file() or path.is_dir():
        spec = read_spec(path)
        own = read_constants(spec, path)
        for doubt in check_angle_units(path, spec.compile(), bool(spec.compiler.degree)):
            say_once(doubt)
        if path.suffix == URDF and (joints := motor_joints(spec)):
            return Robot(name=path.stem, mjcf=path, joints=joints, edit=add_actuators, **own)
        joints = actuated_joints(spec)
        if not joints:
            raise ModelFileError(f"{path} has no actuator that drives a joint; add <position joint=…> actuators.")
        if bases := find_floating_bases(spec):
            note_fixed_bases(path, bases)
            return Robot(name=path.stem, mjcf=path, joints=joints, edit=fix_bases, bases=bases, **own)
        return Robot(name=path.stem, mjcf=path, joints=joints, **own)
    raise UnknownName("robot", given, robot_names())
