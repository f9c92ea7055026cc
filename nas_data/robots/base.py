"""Interface of robots: an MJCF with named joints, and constants for recording and control."""

import codecs
import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias, TypedDict

import mujoco

from nas_data import registry
from nas_data.count_of import join_items
from nas_data.errors import ModelFileError, UnknownName
from nas_data.log import warn_once
from nas_data.mjcf.actuator_lookup import find_driven_joint, list_indirect_actuators
from nas_data.mjcf.base_contacts import exclude_base_contacts, find_base_contacts
from nas_data.mjcf.check_angle_units import check_angle_units
from nas_data.mjcf.check_rest import check_rest
from nas_data.mjcf.default_servos import add_position_servos, add_torque_motors, find_motor_joints
from nas_data.mjcf.engine_warnings import collect_warnings, log_warnings
from nas_data.mjcf.floating_base import find_floating_bases, fix_bases
from nas_data.mjcf.measured_joints import MEASURED, read_measured_joints
from nas_data.mjcf.shared_drives import add_shared_drives, find_shared_drives
from nas_data.visible_files import list_visible_files

FOLDER = Path(__file__).parent
MISSING = re.compile(r"Error opening file '([^']+)'")  # MuJoCo's error for meshes, textures and included files
URDF = ".urdf"
KNOWN = (".xml", URDF)  # file suffixes that MuJoCo reads
XACRO = b"<xacro:"  # macros and properties of a template
TORQUES = ":torque"  # suffix of a URDF's path for torque motors instead of position servos
PREFIX = "nas_"  # prefix of the constants of this package in <custom>
TEXTS = ("nas_tip", "nas_mirror", "nas_cyclic", MEASURED)  # models/symmetry.py reads two of them
WEIGHTLESS = re.compile(r"mass and inertia of moving bodies must be larger.*?Element name '([^']*)'")
UNREADABLE = re.compile(r"no decoder found for mesh file '([^']+)'")
UNBALANCED = re.compile(r"inertia must satisfy A \+ B >= C.*?Element name '([^']*)'")
INDEFINITE = re.compile(r"inertia must have positive eigenvalues.*?Element name '([^']*)'")
NOT_A_NUMBER = "'NaN'"  # part of MuJoCo's warning about NaN, which it reads as a missing number

Edit: TypeAlias = Callable[[mujoco.MjSpec], None]


@dataclass(frozen=True)
class ConsecutiveEdits:
    """A model edit that applies two edits in order.

    Attributes:
        first: First edit; may be None.
        second: Second edit.
    """

    first: Edit | None
    second: Edit

    def __call__(self, spec: mujoco.MjSpec) -> None:
        """Edit a model."""
        if self.first is not None:
            self.first(spec)
        self.second(spec)


@dataclass(frozen=True)
class Robot:
    """A robot model.

    Attributes:
        name: Its name; LeRobot's `robot_type`.
        mjcf: Model file; its SHA-256 identifies the source in provenance.
        joints: Commanded joints in the order of state and action.
        rate: Usual control rate [Hz].
        rest: Rest position of each joint [rad]; empty for zero.
        position_quantum: Resolution of the position reading [rad]; 0 for none.
        velocity_quantum: Resolution of the velocity reading [rad/s]; 0 for none.
        tip: Name of the site at the end effector, or None.
        edit: Edit that completes the model (a tool, a table) after the file is read.
        bases: Floating bases that `edit` fixes to the world.
        registers: Servo registers for which the model holds, by name; a file states them in `<custom>`.
        adapted: Whether `simulators/lock_joints.py` has already locked the joints that a recording does not determine.
    """

    name: str
    mjcf: Path
    joints: tuple[str, ...]
    rate: float = 50.0
    rest: tuple[float, ...] = ()
    position_quantum: float = 0.0
    velocity_quantum: float = 0.0
    tip: str | None = None
    edit: Edit | None = None
    bases: tuple[str, ...] = ()
    registers: tuple[tuple[str, float], ...] = ()
    adapted: bool = False

    def spec(self) -> mujoco.MjSpec:
        """Return a fresh, editable model."""
        spec = read_spec(self.mjcf)
        if self.edit:
            self.edit(spec)
        return spec

    @property
    def sha256(self) -> str:
        """SHA-256 of the model file, or of the completed model if `edit` changes it."""
        content = self.mjcf.read_bytes() if self.edit is None else self.spec().to_xml().encode()
        return hashlib.sha256(content).hexdigest()


def read_spec(path: Path) -> mujoco.MjSpec:
    """Read an MJCF or URDF file.

    Raises:
        ModelFileError: the file or a file that it refers to is missing, or MuJoCo cannot read it.
    """
    if path.is_dir():
        raise ModelFileError(f"{path} is a folder; give a model file{_suggest_models(path)}.")
    if not path.is_file():
        raise ModelFileError(f"There is no model file {path}; give an MJCF or URDF file, or a robot's name.")
    if XACRO in path.read_bytes():
        whole = path.with_name(path.name.split(".")[0] + URDF)
        raise ModelFileError(f"{path} is a template; expand it, and give the result: xacro {path} > {whole}")
    try:
        with collect_warnings() as warnings:
            spec = _parse(path)
            spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ModelFileError(_explain_error(path, " ".join(str(error).split()).rstrip("."))) from None
    if any(NOT_A_NUMBER in warning for warning in warnings):
        raise ModelFileError(f"{path} has NaN in the place of a number{_locate_nan(path)}; write a number there.")
    log_warnings(warnings)
    return spec


def _parse(path: Path) -> mujoco.MjSpec:
    """Read a model by its content, because MuJoCo only reads files with suffix `.xml` or `.urdf`."""
    # MuJoCo doubles the folder of a relative path for files that an included file refers to
    content, absolute = path.read_bytes(), path.absolute()
    if path.suffix in KNOWN or not content.removeprefix(codecs.BOM_UTF8).lstrip().startswith(b"<"):
        return mujoco.MjSpec.from_file(str(absolute))
    known = absolute.with_name(path.name + KNOWN[0])
    return mujoco.MjSpec.from_file(str(known), include={known.name: content})


def _suggest_models(folder: Path) -> str:
    """Return a phrase with a model file of a folder; empty if there is none."""
    files = [file.name for file in list_visible_files(folder) if file.suffix in (*KNOWN, ".mjcf")]
    return f" in it, such as {folder / files[0]}" if files else ""


def _explain_error(path: Path, reason: str) -> str:
    """Return the error message for a model that MuJoCo cannot read."""
    missing = MISSING.search(reason)
    if missing:
        file = missing[1].removeprefix(f"{path.parent.absolute()}/")
        if file.startswith("package:"):
            inside = file.removeprefix("package:").lstrip("/")
            return (
                f"{path} needs the file '{inside}' of a ROS package: put the package's folder beside the model, and "
                "remove 'package://' from the model."
            )
        return f"{path} needs the file '{file}', which is missing: put it beside the model, at {path.parent / file}."
    if (light := WEIGHTLESS.search(reason)) is not None:
        return (
            f"{path} has a moving link without mass, '{light[1]}'; give it mass and inertia (<inertial>), "
            "small ones if it stands for no part."
        )
    if (mesh := UNREADABLE.search(reason)) is not None:
        return (
            f"{path} has a mesh that MuJoCo cannot read, '{mesh[1]}': convert it to .stl or .obj, or take the elements "
            "that name it out of the model."
        )
    if (link := UNBALANCED.search(reason)) is not None:
        balance = '<compiler balanceinertia="true"/>'
        where = f"<mujoco>{balance}</mujoco> inside <robot>" if path.suffix == URDF else balance
        return (
            f"{path} has a link with an inertia that no body has, '{link[1]}': of its principal moments one is larger "
            f"than the sum of the others; correct it, or write {where}, which makes them equal."
        )
    if (link := INDEFINITE.search(reason)) is not None:
        return (
            f"{path} has a link with an inertia that no body has, '{link[1]}': a principal moment is not above 0; "
            "correct it, or take the link's <inertial> out where its shapes are given."
        )
    return f"{path} cannot be used as a robot model: {reason}; give an MJCF or URDF file."


def _locate_nan(path: Path) -> str:
    """Return a phrase with the line of the first NaN in a file; empty if it is in an included file."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    found = [number for number, line in enumerate(lines, 1) if re.search(r"[\s\"']nan[\s\"']", line, re.IGNORECASE)]
    return f" (line {found[0]})" if found else ""


def list_actuated_joints(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Return the names of the joints that actuators drive, each once, in the order of the actuators."""
    driven = (find_driven_joint(spec, actuator) for actuator in spec.actuators)
    return tuple(dict.fromkeys(joint for joint in driven if joint is not None))


def list_arm_joints(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Return the measured joints of a marked model, else all joints that actuators drive."""
    return read_measured_joints(spec) or list_actuated_joints(spec)


def find_deepest_joint(spec: mujoco.MjSpec, joints: Sequence[str]) -> str:
    """Return the joint with the most bodies between it and the world; of several, the last in `joints`."""

    def depth(joint: str) -> int:
        body, count = spec.joint(joint).parent, 0
        while body.parent is not None:
            body, count = body.parent, count + 1
        return count

    return max(reversed(joints), key=depth)


def list_slide_joints(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Return the names of the slides."""
    return tuple(joint.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_SLIDE)


def list_robot_names() -> tuple[str, ...]:
    """Return the names of the included robots: Python files, and models with their own constants."""
    return tuple(sorted({*registry.list_names("robots"), *(path.stem for path in list_visible_files(FOLDER, "*.xml"))}))


class RobotConstants(TypedDict, total=False):
    """Constants of a robot that its model can define; see `Robot`."""

    rate: float
    position_quantum: float
    velocity_quantum: float
    rest: tuple[float, ...]
    tip: str


def read_constants(spec: mujoco.MjSpec, path: Path) -> RobotConstants:
    """Return the constants of a robot that its model defines in `<custom>`.

    They are `<numeric name="nas_rate" data="50"/>`, the control rate [Hz], likewise `nas_position_quantum` [rad],
    `nas_velocity_quantum` [rad/s] and `nas_rest` [rad], and `<text name="nas_tip" data="SITE"/>`.

    Args:
        spec: The model.
        path: Model file, for errors.

    Raises:
        ModelFileError: a constant or text is unknown or invalid, or the site does not exist.
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
                f"{path} gives {number.name} as {' '.join(f'{value:g}' for value in values)}; allowed are nas_rate, "
                "nas_position_quantum and nas_velocity_quantum, with one number above 0 each, and nas_rest, with one "
                "number per joint."
            )
    for text in spec.texts:
        if text.name == f"{PREFIX}tip":
            if spec.site(text.data) is None:
                raise ModelFileError(f"{path} gives nas_tip as '{text.data}', which is not a site of the model.")
            own["tip"] = text.data
        elif text.name.startswith(PREFIX) and text.name not in TEXTS:
            raise ModelFileError(f"{path} has the text {text.name}; allowed are {join_items(TEXTS)}.")
    return own


def find_robot(name_or_path: str | Path) -> Robot:
    """Return an included robot by its name, or the robot of a model file.

    A URDF has no actuators and gets position servos; `arm.urdf:torque` gets torque motors instead.

    Raises:
        UnknownName: the argument is neither a robot's name nor a path.
        ModelFileError: the file is no valid model, or `:torque` is given for a model with actuators.
    """
    given = str(name_or_path).removesuffix(TORQUES)
    path, named = Path(given), given in list_robot_names()
    add_actuators = add_position_servos if given == str(name_or_path) else add_torque_motors
    if add_actuators is add_torque_motors and path.suffix != URDF:
        raise ModelFileError(f"{given} defines its own actuators; leave out --actuators, which is for a URDF.")
    if named and given in registry.list_names("robots") and not path.is_file():
        return registry.import_plugin("robots", given, "robot", "ROBOT").ROBOT
    if named and not path.is_file():
        path = FOLDER / f"{given}.xml"
    if path.suffix or path.is_file() or path.is_dir():
        spec = read_spec(path)
        own = read_constants(spec, path)
        for doubt in check_angle_units(path, spec.compile(), bool(spec.compiler.degree)):
            warn_once(doubt)
        edit: Edit | None = add_actuators if path.suffix == URDF and find_motor_joints(spec) else None
        if edit:
            edit(spec)
        if path.suffix == URDF and find_base_contacts(spec.compile()):
            edit = ConsecutiveEdits(edit, exclude_base_contacts)
        if find_shared_drives(spec):
            add_shared_drives(spec)
            edit = ConsecutiveEdits(edit, add_shared_drives)
        joints, indirect = list_actuated_joints(spec), ", ".join(list_indirect_actuators(spec))
        if not joints:
            remedy = (
                f"in place of {indirect} write <position joint=…>" if indirect else "add <position joint=…> actuators"
            )
            raise ModelFileError(f"{path} has no actuator that drives a joint directly; {remedy}.")
        if "rest" in own:
            check_rest(path, spec.compile(), joints, own["rest"])
        if indirect:
            warn_once(
                f"actuators of {path} drive no joint directly: {indirect}; they get no commands, and their controls "
                "stay at the reference. To command a joint that such an actuator moves, replace it by <position "
                "joint=…>."
            )
        if bases := find_floating_bases(spec):
            names = ", ".join(f"'{base}'" for base in bases)
            warn_once(
                f"the base {names} of {path} has a free joint, and its pose is not measured: it is "
                "fixed at its pose in the model."
            )
            edit = ConsecutiveEdits(edit, fix_bases)
        return Robot(name=path.stem, mjcf=path, joints=joints, edit=edit, bases=bases, **own)
    raise UnknownName("robot", given, list_robot_names())
