"""Command quantities of actuators (position, velocity or torque) and their conversion to MuJoCo controls."""

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.dataset.features import EFFORT, POSITION, VELOCITY
from nas_data.effects.edits.servo import GAIN_TOLERANCE, read_rest_shift
from nas_data.errors import JointMismatch, ModelFileError
from nas_data.mjcf.actuator_lookup import find_driving_actuators, is_switched_off
from nas_data.simulators.other_actuators import explain_missing_actuator

POSITION_INPUT, VELOCITY_INPUT = 1, 2  # bits of MuJoCo's `mjtCtrlInput`
UNSUPPORTED_INPUTS = {
    int(mujoco.mjtCtrlInput.mjINPUT_VOLTAGE): "volts",
    int(mujoco.mjtCtrlInput.mjINPUT_PRESSURE): "a pressure",
}
FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
CONTROLLERS = (int(mujoco.mjtGain.mjGAIN_PID), int(mujoco.mjtGain.mjGAIN_DCMOTOR))
CONTROLLER_GAIN = 4  # index of the proportional gain of a dcmotor's controller in `gainprm`
REMEDY = "give a model with <position>, <velocity> or <motor> there"


@dataclass(frozen=True)
class Control:
    """Conversion of a command to an actuator's control: control = scale · command + zero.

    Attributes:
        kind: Command quantity: `.pos` [rad; m], `.vel` [rad/s; m/s] or `.effort` [N·m; N].
        scale: Control per command.
        zero: Control for the command 0.
    """

    kind: str
    scale: float
    zero: float = 0.0

    def to_commands(self, controls: np.ndarray) -> np.ndarray:
        """Return the commands for controls, any shape."""
        return np.asarray((controls - self.zero) / self.scale)


@dataclass(frozen=True)
class Controls:
    """Conversions for n joints; see `Control`.

    Attributes:
        kinds: Command quantity of each joint.
        actuators: Index of the actuator that each joint is commanded by, shape (n,).
        index: Index of each joint's actuator in `ctrl`, shape (n,).
        scale: Control per command, shape (n,).
        zero: Control for the command 0, shape (n,).
    """

    kinds: tuple[str, ...]
    actuators: np.ndarray
    index: np.ndarray
    scale: np.ndarray
    zero: np.ndarray

    @classmethod
    def of(cls, model: mujoco.MjModel, joints: Iterable[int], name: str) -> "Controls":
        """Find the conversions for joints, by index, of a compiled model; errors as of `find_command`."""
        found = [find_command(model, int(joint), name) for joint in joints]
        controls = [control for _, control in found]
        return cls(
            kinds=tuple(control.kind for control in controls),
            actuators=np.array([actuator for actuator, _ in found], dtype=int),
            index=np.array([model.actuator_ctrladr[actuator] for actuator, _ in found], dtype=int),
            scale=np.array([control.scale for control in controls]),
            zero=np.array([control.zero for control in controls]),
        )

    @property
    def positional(self) -> np.ndarray:
        """Whether each joint is commanded a position, shape (n,)."""
        return np.array([kind == POSITION for kind in self.kinds], dtype=bool)

    @property
    def are_commands(self) -> bool:
        """Whether the controls equal the commands."""
        return bool((self.scale == 1).all() and not self.zero.any())

    def from_commands(self, commands: np.ndarray) -> np.ndarray:
        """Return the controls (…, n) for commands (…, n)."""
        return commands if self.are_commands else commands * self.scale + self.zero


def find_command(model: mujoco.MjModel, joint: int, name: str) -> tuple[int, Control]:
    """Return the actuator that a joint is commanded by, and its conversion.

    Of several actuators that are not switched off a position servo is preferred, then the first whose command quantity
    is known.

    Args:
        model: Compiled model.
        joint: Index of the joint.
        name: Name of the model in errors.

    Raises:
        JointMismatch: no actuator drives the joint.
        ModelFileError: the command quantity of the joint's actuator is unknown.
    """
    found, reasons = [], []
    for actuator in find_driving_actuators(model, joint).tolist():
        try:
            found.append((actuator, find_joint_control(model, actuator, joint)))
        except UnknownControl as reason:
            reasons.append(f"The actuator {describe_actuator(model, actuator)} of {name} {reason}; {REMEDY}.")
    if found:
        return min(found, key=lambda pair: (is_switched_off(model, pair[0]), pair[1].kind != POSITION))
    if reasons:
        raise ModelFileError(reasons[0])
    raise JointMismatch(explain_missing_actuator(model, joint, name))


def describe_actuator(model: mujoco.MjModel, actuator: int) -> str:
    """Return a phrase for error messages: an actuator's name, or its joint's if it has none."""
    if own := model.actuator(actuator).name:
        return f"'{own}'"
    return f"of the joint '{model.joint(int(model.actuator_trnid[actuator, 0])).name}'"


class UnknownControl(Exception):
    """The command quantity of an actuator is unknown; the message continues a sentence about the actuator."""


def find_joint_control(model: mujoco.MjModel, actuator: int, joint: int) -> Control:
    """Return the conversion for an actuator that drives a joint: `find_length_control` combined with the gear.

    Raises:
        UnknownControl: the control is no position, velocity or torque, or the gear is zero.
    """
    shift = read_rest_shift(model, model.joint(joint).name)
    control, gear = find_length_control(model, actuator, shift), float(model.actuator_gear[actuator, 0])
    if not gear:
        raise UnknownControl("has a gear of 0, so that it moves nothing")
    return Control(control.kind, control.scale / gear if control.kind == EFFORT else control.scale * gear, control.zero)


def find_length_control(model: mujoco.MjModel, actuator: int, shift: float | None = None) -> Control:
    """Return the conversion for an actuator's first control, in terms of its transmission: length, speed or force.

    A servo gives force = k · control + b₀ + b₁ · length + b₂ · speed. Its target length is −k / b₁ · control. If k
    equals the feedback −b₁, the constant b₀ is an offset of the rest position. Otherwise the control has its own unit
    (0 … 255), and b₀ defines the zero of that unit, except for the part `shift` that an effect added (see
    `read_rest_shift`). The target speed of a velocity servo is −k / b₂ · control. The control of an integrated position
    servo is the speed of its setpoint.

    Args:
        model: Compiled model.
        actuator: Index of the actuator.
        shift: Part of b₀ that an effect added; None if no effect did.

    Raises:
        UnknownControl: the control is none of these.
    """
    gain_type, dynamics = int(model.actuator_gaintype[actuator]), int(model.actuator_dyntype[actuator])
    inputs = int(model.actuator_ctrlspec[actuator])
    if unit := next((unit for bit, unit in UNSUPPORTED_INPUTS.items() if inputs & bit), None):
        raise UnknownControl(
            f"({find_actuator_type(model, actuator)}) takes {unit} instead of a position, a velocity or a torque"
        )
    if gain_type in CONTROLLERS:
        control = find_controller_input(inputs)
        if shift is None or control.kind != POSITION:
            return control
        constant, slope = model.actuator_biasprm[actuator, :2].tolist()
        return Control(POSITION, control.scale, (constant - shift) / slope)
    bias = model.actuator_biasprm[actuator, :3] * (model.actuator_biastype[actuator] != int(mujoco.mjtBias.mjBIAS_NONE))
    gain = float(model.actuator_gainprm[actuator, 0])
    if not is_linear(model, actuator) or not gain or bias[1] > 0 or bias[2] > 0:
        raise UnknownControl(
            f"({find_actuator_type(model, actuator)}) has a control that is not a position, velocity or torque"
        )
    if bias[1] < 0:
        scale = -float(bias[1]) / gain
        if dynamics == int(mujoco.mjtDyn.mjDYN_INTEGRATOR):
            return Control(VELOCITY, 1.0 if is_nearly_equal(scale, 1) else scale)
        if is_nearly_equal(scale, 1):
            return Control(POSITION, 1.0)
        return Control(POSITION, scale, ((shift or 0.0) - float(bias[0])) / gain)
    if dynamics == int(mujoco.mjtDyn.mjDYN_INTEGRATOR):
        raise UnknownControl("(integrator) takes the rate of a force instead of a position, a velocity or a torque")
    if inputs & VELOCITY_INPUT or (bias[2] < 0 and is_nearly_equal(gain, -float(bias[2]))):
        return Control(VELOCITY, -float(bias[2]) / gain)
    if bias[2] and not is_nearly_equal(gain, 1):
        raise UnknownControl(
            "(general) has a gain beside velocity feedback: its control may be a torque, a speed or volts"
        )
    return Control(EFFORT, 1 / gain)


def read_length_feedback(model: mujoco.MjModel, actuator: int) -> float:
    """Return an actuator's force per length error; 0 without position feedback."""
    if int(model.actuator_gaintype[actuator]) == int(mujoco.mjtGain.mjGAIN_DCMOTOR):
        return float(model.actuator_gainprm[actuator, CONTROLLER_GAIN])
    return -float(model.actuator_biasprm[actuator, 1])


def find_controller_input(inputs: int) -> Control:
    """Return the conversion for the first input of a `pid`, or of a `dcmotor` with a controller; others stay at 0."""
    if inputs & POSITION_INPUT:
        return Control(POSITION, 1.0)
    if inputs & VELOCITY_INPUT:
        return Control(VELOCITY, 1.0)
    return Control(EFFORT, 1.0)  # the feed-forward


def is_linear(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator's force is linear in its length, speed and (possibly filtered or integrated) control."""
    gain, bias = int(model.actuator_gaintype[actuator]), int(model.actuator_biastype[actuator])
    fixed = gain == int(mujoco.mjtGain.mjGAIN_FIXED) or (
        gain == int(mujoco.mjtGain.mjGAIN_AFFINE) and not model.actuator_gainprm[actuator, 1:3].any()
    )
    linear = bias in (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))
    simple = (int(mujoco.mjtDyn.mjDYN_NONE), int(mujoco.mjtDyn.mjDYN_INTEGRATOR), *FILTERS)
    plugin = model.actuator_plugin[actuator] >= 0  # its force is its own
    return bool(fixed and linear and not plugin and int(model.actuator_dyntype[actuator]) in simple)


def find_actuator_type(model: mujoco.MjModel, actuator: int) -> str:
    """Return the MJCF element of an actuator, as far as the compiled model shows it."""
    if model.actuator_plugin[actuator] >= 0:
        return "plugin"
    if int(model.actuator_ctrlspec[actuator]) & int(mujoco.mjtCtrlInput.mjINPUT_PRESSURE):
        return "cylinder"
    gain, dynamics = mujoco.mjtGain(model.actuator_gaintype[actuator]), int(model.actuator_dyntype[actuator])
    if gain == mujoco.mjtGain.mjGAIN_AFFINE:
        return "damper" if not model.actuator_gainprm[actuator, :2].any() else "general, gain affine"
    if gain == mujoco.mjtGain.mjGAIN_FIXED:
        return "general" if dynamics != int(mujoco.mjtDyn.mjDYN_USER) else "general, dynamics user"
    return gain.name.removeprefix("mjGAIN_").lower()


def is_nearly_equal(one: float, other: float) -> bool:
    """Whether two gains are equal up to rounding in a file."""
    return abs(one - other) <= GAIN_TOLERANCE * abs(other)


def command_range(model: mujoco.MjModel, actuator: int, control: Control) -> tuple[float, float]:
    """Return the lowest and highest command of an actuator; infinite if its control has no range."""
    first = int(model.actuator_ctrladr[actuator])
    if not model.actuator_ctrllimited[first]:
        return -np.inf, np.inf
    low, high = np.sort(control.to_commands(model.actuator_ctrlrange[first]))
    return float(low), float(high)
