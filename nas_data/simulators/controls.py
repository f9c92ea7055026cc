"""What an actuator is asked for: a position, a velocity or a torque, and what the engine's control is for it."""

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.dataset.features import EFFORT, POSITION, VELOCITY
from nas_data.effects.edits.servo import ALIKE, rest_shift
from nas_data.errors import JointMismatch, ModelFileError
from nas_data.mjcf.actuator_lookup import driving_actuators

POSITION_INPUT, VELOCITY_INPUT, FEEDFORWARD_INPUT = 1, 2, 4  # bits of MuJoCo's `mjtCtrlInput`
UNTOLD_INPUTS = {
    int(mujoco.mjtCtrlInput.mjINPUT_VOLTAGE): "volts",
    int(mujoco.mjtCtrlInput.mjINPUT_PRESSURE): "a pressure",
}
FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
CONTROLLERS = (int(mujoco.mjtGain.mjGAIN_PID), int(mujoco.mjtGain.mjGAIN_DCMOTOR))
CONTROLLER_GAIN = 4  # where in `gainprm` the proportional gain of a dcmotor's controller stands
REMEDY = "give a model with <position>, <velocity> or <motor> there"


@dataclass(frozen=True)
class Control:
    """How an actuator's control is computed: scale · command + zero.

    Attributes:
        kind: What is commanded: `.pos` [rad; m], `.vel` [rad/s; m/s] or `.effort` [N·m; N].
        scale: Control per command.
        zero: Control at the command 0.
    """

    kind: str
    scale: float
    zero: float = 0.0

    def commands(self, controls: np.ndarray) -> np.ndarray:
        """Return the commands that controls stand for."""
        return np.asarray((controls - self.zero) / self.scale)


@dataclass(frozen=True)
class Controls:
    """The controls of n joints.

    Attributes:
        kinds: What each joint is commanded (see `Control`).
        actuators: Index of the actuator that commands each joint, shape (n,).
        index: Index of each joint's actuator in `ctrl`, shape (n,).
        scale: Control per command, shape (n,).
        zero: Control at the command 0, shape (n,).
    """

    kinds: tuple[str, ...]
    actuators: np.ndarray
    index: np.ndarray
    scale: np.ndarray
    zero: np.ndarray

    @classmethod
    def of(cls, model: mujoco.MjModel, joints: Iterable[int], name: str) -> "Controls":
        """Find the controls of some joints of a compiled model; errors as of `find_command`."""
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
        """Which joints are commanded positions, shape (n,)."""
        return np.array([kind == POSITION for kind in self.kinds], dtype=bool)

    @property
    def plain(self) -> bool:
        """Whether the controls are the commands themselves."""
        return bool((self.scale == 1).all() and not self.zero.any())

    def of_commands(self, commands: np.ndarray) -> np.ndarray:
        """Return the controls (…, n) for commands (…, n)."""
        return commands if self.plain else commands * self.scale + self.zero


def find_command(model: mujoco.MjModel, joint: int, name: str) -> tuple[int, Control]:
    """Return the actuator that commands a joint, and how; of several a position servo, else the first that can be told.

    Args:
        model: Compiled model.
        joint: Index of the joint.
        name: What to call the model in an error.

    Raises:
        JointMismatch: no actuator drives the joint.
        ModelFileError: it cannot be told what the joint's actuator is asked for.
    """
    told, reasons = [], []
    for actuator in driving_actuators(model, joint).tolist():
        try:
            told.append((actuator, joint_control(model, actuator, joint)))
        except UntoldControl as reason:
            reasons.append(f"The actuator {label(model, actuator)} of {name} {reason}; {REMEDY}.")
    if told:
        return min(told, key=lambda found: found[1].kind != POSITION)
    if reasons:
        raise ModelFileError(reasons[0])
    raise JointMismatch(
        f"No actuator of {name} drives the joint '{model.joint(joint).name}'; "
        'add one, for example <position joint="…" kp="…"/>.'
    )


def label(model: mujoco.MjModel, actuator: int) -> str:
    """Return an actuator's name, or that of the joint that it drives where it has none."""
    if own := model.actuator(actuator).name:
        return f"'{own}'"
    return f"of the joint '{model.joint(int(model.actuator_trnid[actuator, 0])).name}'"


class UntoldControl(Exception):
    """It cannot be told what an actuator's control asks of a joint; says why, after the actuator's name."""


def joint_control(model: mujoco.MjModel, actuator: int, joint: int) -> Control:
    """Return the control of an actuator that drives a joint: what `length_control` says, through its gear.

    Raises:
        UntoldControl: a control of this kind is no position, velocity or torque, or the gear is zero.
    """
    shift = rest_shift(model, model.joint(joint).name)
    control, gear = length_control(model, actuator, shift), float(model.actuator_gear[actuator, 0])
    if not gear:
        raise UntoldControl("has a gear of 0, so that it moves nothing")
    return Control(control.kind, control.scale / gear if control.kind == EFFORT else control.scale * gear, control.zero)


def length_control(model: mujoco.MjModel, actuator: int, shift: float | None = None) -> Control:
    """Return what an actuator's first control asks of its transmission: a length, its speed, or the force along it.

    A servo gives force = k · control + b₀ + b₁ · length + b₂ · speed, so that it asks for the length
    −k / b₁ · control. Where k is the servo's own feedback −b₁, b₀ is an offset of the servo, which rests beside what it
    is asked for. Where not, the control has a unit of its own (0 … 255), and b₀ is where that unit begins, but for the
    `shift` that an effect added (see `rest_shift`). A velocity servo asks for the speed −k / b₂ · control. The speed at
    which an integrator moves the length that its servo holds is one, too.

    Raises:
        UntoldControl: it is none of these.
    """
    gain_type, dynamics = int(model.actuator_gaintype[actuator]), int(model.actuator_dyntype[actuator])
    inputs = int(model.actuator_ctrlspec[actuator])
    if unit := next((unit for bit, unit in UNTOLD_INPUTS.items() if inputs & bit), None):
        raise UntoldControl(f"({kind_of(model, actuator)}) takes {unit} instead of a position, a velocity or a torque")
    if gain_type in CONTROLLERS:
        control = controller_input(inputs)
        if shift is None or control.kind != POSITION:
            return control
        constant, slope = model.actuator_biasprm[actuator, :2].tolist()
        return Control(POSITION, control.scale, (constant - shift) / slope)
    bias = model.actuator_biasprm[actuator, :3] * (model.actuator_biastype[actuator] != int(mujoco.mjtBias.mjBIAS_NONE))
    gain = float(model.actuator_gainprm[actuator, 0])
    if not is_linear(model, actuator) or not gain or bias[1] > 0 or bias[2] > 0:
        raise UntoldControl(f"({kind_of(model, actuator)}) has a control that is no position, velocity or torque")
    if bias[1] < 0:
        scale = -float(bias[1]) / gain
        if dynamics == int(mujoco.mjtDyn.mjDYN_INTEGRATOR):
            return Control(VELOCITY, 1.0 if alike(scale, 1) else scale)
        if alike(scale, 1):
            return Control(POSITION, 1.0)
        return Control(POSITION, scale, ((shift or 0.0) - float(bias[0])) / gain)
    if dynamics == int(mujoco.mjtDyn.mjDYN_INTEGRATOR):
        raise UntoldControl("(integrator) takes the rate of a force instead of a position, a velocity or a torque")
    if inputs & VELOCITY_INPUT or (bias[2] < 0 and alike(gain, -float(bias[2]))):
        return Control(VELOCITY, -float(bias[2]) / gain)
    if bias[2] and not alike(gain, 1):
        raise UntoldControl(
            "(general) has a gain beside velocity feedback: its control may be a torque, a speed or volts"
        )
    return Control(EFFORT, 1 / gain)


def length_feedback(model: mujoco.MjModel, actuator: int) -> float:
    """Return an actuator's force per error of its length; 0 without position feedback."""
    if int(model.actuator_gaintype[actuator]) == int(mujoco.mjtGain.mjGAIN_DCMOTOR):
        return float(model.actuator_gainprm[actuator, CONTROLLER_GAIN])
    return -float(model.actuator_biasprm[actuator, 1])


def controller_input(inputs: int) -> Control:
    """Return what the first input of a `pid`, or of a `dcmotor` with a controller, asks for; others stay at 0."""
    if inputs & POSITION_INPUT:
        return Control(POSITION, 1.0)
    if inputs & VELOCITY_INPUT:
        return Control(VELOCITY, 1.0)
    if inputs & FEEDFORWARD_INPUT:
        return Control(EFFORT, 1.0)
    raise UntoldControl("(dcmotor) has no input for a position, a velocity or a torque")


def is_linear(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether a force is linear in control, length and speed, the control at most filtered or integrated."""
    gain, bias = int(model.actuator_gaintype[actuator]), int(model.actuator_biastype[actuator])
    fixed = gain == int(mujoco.mjtGain.mjGAIN_FIXED) or (
        gain == int(mujoco.mjtGain.mjGAIN_AFFINE) and not model.actuator_gainprm[actuator, 1:3].any()
    )
    linear = bias in (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))
    simple = (int(mujoco.mjtDyn.mjDYN_NONE), int(mujoco.mjtDyn.mjDYN_INTEGRATOR), *FILTERS)
    return bool(fixed and linear and int(model.actuator_dyntype[actuator]) in simple)


def kind_of(model: mujoco.MjModel, actuator: int) -> str:
    """Return what an actuator is called in a model file, as well as its compiled numbers tell."""
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


def alike(one: float, other: float) -> bool:
    """Whether two gains are the same but for how they were written down."""
    return abs(one - other) <= ALIKE * abs(other)


def control_range(model: mujoco.MjModel, actuator: int, control: Control) -> tuple[float, float]:
    """Return the lowest and highest command that an actuator takes, infinite where its control has no range."""
    first = int(model.actuator_ctrladr[actuator])
    if not model.actuator_ctrllimited[first]:
        return -np.inf, np.inf
    low, high = np.sort(control.commands(model.actuator_ctrlrange[first]))
    return float(low), float(high)
