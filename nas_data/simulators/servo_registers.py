"""Servo registers that a recording holds, as changes of the model: what is known is not inferred."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import mujoco

from nas_data.count_of import join_items
from nas_data.dataset.provenance import Provenance
from nas_data.effects.base import find_joint_actuator
from nas_data.effects.edits.servo import find_position_servo, scale_limit, scale_stiffness
from nas_data.effects.speed_limit import SpeedLimit
from nas_data.errors import ModelFileError
from nas_data.robots.base import ConsecutiveEdits, Robot
from nas_data.robots.ergojr import VELOCITY_QUANTUM

GAIN, TORQUE, SPEED = "p_gain", "torque_limit", "moving_speed"
# Names of each register in the control tables: XL-320, then LeRobot's names for Feetech and Dynamixel X. A servo's
# limit is the lowest of those it has.
NAMES: Mapping[str, tuple[str, ...]] = {
    GAIN: ("p_gain", "P_Coefficient", "Position_P_Gain"),
    TORQUE: ("torque_limit", "max_torque", "Torque_Limit"),
    SPEED: ("moving_speed",),
}
WORDS = {GAIN: "position gain", TORQUE: "torque limit", SPEED: "speed of the goal"}
SPEED_UNIT = VELOCITY_QUANTUM  # [rad/s] of the register moving_speed; 0 is no limit; XL-320 e-manual
SPEED_BITS = 1023  # part of moving_speed that is the speed, XL-320 e-manual

Values = Mapping[str, Mapping[str, float]]  # by register and joint


@dataclass(frozen=True)
class ServoRegisters:
    """Registers of the servos during a recording.

    Attributes:
        values: Value by register (`NAMES`) and joint.
        changing: Registers that differ between episodes; they have no value.
    """

    values: Values = field(default_factory=dict)
    changing: tuple[str, ...] = ()

    @classmethod
    def read(cls, provenance: Provenance | None, joints: Sequence[str]) -> "ServoRegisters":
        """Return the registers of a recording's joints from its provenance; empty if it holds none."""
        stored = ((provenance.target if provenance else None) or {}).get("registers")
        entries = [_normalise(entry["joints"], joints) for entry in stored] if isinstance(stored, list) else []
        first, *others = entries or [{}]
        changing = tuple(name for name in NAMES if any(other.get(name) != first.get(name) for other in others))
        return cls({name: values for name, values in first.items() if name not in changing}, changing)

    def without(self, register: str) -> "ServoRegisters":
        """Return the registers without one that the recording holds in another way."""
        values = {name: values for name, values in self.values.items() if name != register}
        return ServoRegisters(values, tuple(name for name in self.changing if name != register))

    def set_in(self, robot: Robot) -> Robot:
        """Return a robot whose model has these registers, as far as it states those of its own.

        The new model states these registers, so that a second call changes nothing.

        Raises:
            ModelFileError: the model states the position gain of a joint that has no position servo.
        """
        stated = self.select_stated(robot)
        if not stated.values:
            return robot
        return replace(robot, edit=ConsecutiveEdits(robot.edit, RegisterEdit(stated, robot)))

    def describe(self, robot: Robot) -> tuple[str, ...]:
        """Return sentences: what `set_in` changes in a robot's model, and which registers it cannot use."""
        if not self.values and not self.changing:
            return ()
        spec = robot.spec()
        changes: dict[str, list[str]] = {}
        unknown: dict[str, None] = {}
        filtered: list[str] = []
        for name, joint, value in self:
            own = read_stated(spec, robot, name, joint)
            if own is None:
                unknown[name] = None
            elif value != own and not can_set(spec, name, joint):
                filtered.append(joint)
            elif value != own:
                changes.setdefault(_describe_change(name, value, own), []).append(joint)
        sentences = [f"As the recording's registers say, {text} in {', '.join(its)}." for text, its in changes.items()]
        if unknown:
            sentences.append(
                f"The recording's registers {join_items(list(unknown))} are not used, because the model does not state "
                f'those of its own: add <custom><numeric name="{next(iter(unknown))}" data="…"/></custom> to it.'
            )
        if filtered:
            sentences.append(
                f"The recording's register {SPEED} is not used in {', '.join(filtered)}, because the model's servo "
                "filters its command."
            )
        if self.changing:
            sentences.append(
                f"The recording's registers {join_items(self.changing)} differ between episodes and are not used: "
                "record each setting by itself."
            )
        return tuple(sentences)

    def select_stated(self, robot: Robot) -> "ServoRegisters":
        """Return the registers that can be set in a robot's model, because it states its own values."""
        if not self.values:
            return ServoRegisters()
        spec, found = robot.spec(), dict[str, dict[str, float]]()
        for name, joint, value in self:
            own = read_stated(spec, robot, name, joint)
            if own is not None and (value == own or can_set(spec, name, joint)):
                found.setdefault(name, {})[joint] = value
        return ServoRegisters(found)

    def __iter__(self) -> Iterator[tuple[str, str, float]]:
        """Yield register, joint and value."""
        for name, values in self.values.items():
            for joint, value in values.items():
                yield name, joint, value


NO_REGISTERS = ServoRegisters()


@dataclass(frozen=True)
class RegisterEdit:
    """A model edit that sets registers.

    Attributes:
        registers: Registers that the model states.
        robot: Robot of the model before the edit.
    """

    registers: ServoRegisters
    robot: Robot

    def __call__(self, spec: mujoco.MjSpec) -> None:
        """Edit a model."""
        for name, joint, value in self.registers:
            own = read_stated(spec, self.robot, name, joint)
            if own is not None and value != own:
                CHANGES[name](spec, joint, value, own)
            state(spec, name, joint, value)


def read_stated(spec: mujoco.MjSpec, robot: Robot, register: str, joint: str) -> float | None:
    """Return the value of a joint's register for which a model holds; None if neither model nor robot states it.

    Raises:
        ModelFileError: the model states a gain or torque that is not a positive number.
    """
    if spec.joint(joint) is None:
        return None
    found = (spec.numeric(f"{joint}_{register}"), spec.numeric(register))
    number = next((each for each in found if each is not None), None)
    if number is None:
        return dict(robot.registers).get(register)
    value = float(number.data[0])
    if not 0 < value < math.inf and register != SPEED:
        raise ModelFileError(
            f"{robot.mjcf} gives the numeric '{number.name}' as {value:g}; a {WORDS[register]} is above 0."
        )
    return value


def state(spec: mujoco.MjSpec, register: str, joint: str, value: float) -> None:
    """State in a model the value of a joint's register for which it holds."""
    name = f"{joint}_{register}"
    number = spec.numeric(name) or spec.add_numeric(name=name, size=1, data=[0.0])
    number.data = [value]


def can_set(spec: mujoco.MjSpec, register: str, joint: str) -> bool:
    """Whether a joint's servo can have another value of a register: one that filters commands has no speed limit."""
    plain = (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_PID)
    return register != SPEED or find_joint_actuator(spec, joint).dyntype in plain


def scale_gain(spec: mujoco.MjSpec, joint: str, value: float, own: float) -> None:
    """Multiply the position gain, which is proportional to its register; damping and limits stay."""
    find_position_servo(spec, joint, f"The register {GAIN} of the recording", may_integrate=True)
    scale_stiffness(spec, joint, value / own)


def scale_torque(spec: mujoco.MjSpec, joint: str, value: float, own: float) -> None:
    """Multiply the torque limit, which is proportional to its register."""
    scale_limit(spec, joint, value / own)


def limit_speed(spec: mujoco.MjSpec, joint: str, value: float, own: float) -> None:
    """Set the speed limit of the servo's goal."""
    servo = find_position_servo(spec, joint, f"The register {SPEED} of the recording")
    if servo.dyntype == mujoco.mjtDyn.mjDYN_PID:
        parameters = servo.dynprm.copy()
        parameters[1] = 0.0  # of two limits the lower one would hold
        servo.dynprm = parameters
        if not servo.gainprm[0]:  # without an integral, nothing is left to remember, which MuJoCo refuses
            servo.dyntype = mujoco.mjtDyn.mjDYN_NONE
    if speed := decode_speed(value):
        SpeedLimit(joint=joint, speed=speed).edit(spec)


CHANGES = {GAIN: scale_gain, TORQUE: scale_torque, SPEED: limit_speed}


def decode_speed(value: float) -> float:
    """Return the speed limit [rad/s] of a register value; 0 for none."""
    return (int(value) & SPEED_BITS) * SPEED_UNIT


def _describe_change(register: str, value: float, own: float) -> str:
    """Return a phrase for a change of a register."""
    origin = f"({register} {value:g}, in the model {own:g})"
    if register != SPEED:
        return f"the {WORDS[register]} is multiplied by {value / own:.3g} {origin}"
    speed = decode_speed(value)
    return f"the {WORDS[register]} is {f'limited to {speed:.3g} rad/s' if speed else 'not limited'} {origin}"


def _normalise(registers: Mapping[str, Mapping[str, float]], joints: Iterable[str]) -> dict[str, dict[str, float]]:
    """Return the registers of a control table by their common names; those of a gain or torque of 0 are left out."""
    found: dict[str, dict[str, float]] = {}
    for joint in joints:
        for register, names in NAMES.items():
            known = [float(registers[joint][name]) for name in names if name in registers.get(joint, {})]
            if known and (min(known) > 0 or register == SPEED):
                found.setdefault(register, {})[joint] = min(known)
    return found
