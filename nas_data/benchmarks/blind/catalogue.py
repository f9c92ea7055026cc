"""Effects that can be hidden: where, and their parameters drawn over physically sensible ranges."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from nas_data.benchmarks.blind.plants.constants import Constants

Rng = np.random.Generator
Values = dict[str, float]
Draw = Callable[[Rng, Constants, int, bool], Values]


@dataclass(frozen=True)
class Span:
    """A log-uniform range."""

    low: float  # its lower end
    high: float  # its upper end
    faint: float  # replaces the low (or high) end where effects too small to be named are wanted, too

    def draw(self, rng: Rng, faint: bool) -> float:
        """Draw a value."""
        low, high = (min(self.low, self.faint), max(self.high, self.faint)) if faint else (self.low, self.high)
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))


@dataclass(frozen=True)
class EffectDraw:
    """How an effect is drawn."""

    draw: Draw  # returns its parameters for a joint (by index); the last argument: whether faint effects are wanted
    per_joint: bool = True  # whether it can act in one joint
    whole_arm: bool = False  # whether it can act on the whole arm
    before: int = 0  # number of joints before its own on which it acts, too; it needs as many
    apart: tuple[str, ...] = ()  # effects that never share a joint with it, because few data distinguish them


def make_draw(name: str, span: Span) -> Draw:
    """Return a function that draws a single positive parameter."""
    return lambda rng, constants, joint, faint: {name: span.draw(rng, faint)}


def make_scaled_draw(name: str, of: Callable[[Constants], np.ndarray], span: Span) -> Draw:
    """Return a function that draws a parameter as a multiple of a property of the joint."""
    return lambda rng, constants, joint, faint: {name: float(of(constants)[joint]) * span.draw(rng, faint)}


def draw_offset(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw an offset of 0.5° to 6° in either direction."""
    return {"offset": float(rng.choice([-1, 1])) * Span(0.009, 0.1, 0.0008).draw(rng, faint)}


def draw_stribeck(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a break-away torque that the servo can overcome, and a kinetic friction of 20 to 70 % of it."""
    return {
        "torque": float(read_torque_limits(constants)[joint]) * Span(0.08, 0.4, 0.01).draw(rng, faint),
        "kinetic_ratio": float(rng.uniform(0.2, 0.7)),
        "stribeck_velocity": Span(0.05, 0.8, 0.05).draw(rng, False),
    }


def draw_play(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a play of 0.3° to 3.4°; in half of the cases its flanks yield, 10 to 100 times as stiff as the servo."""
    values = {"half_width": Span(0.006, 0.06, 0.0008).draw(rng, faint)}
    if rng.random() < 0.5:
        values["stiffness"] = float(constants.gain[joint]) * Span(10.0, 100.0, 100.0).draw(rng, faint)
    return values


def draw_motor_curve(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a stall torque of 60 to 100 % of the servo's limit, and a no-load speed up to the damped top speed."""
    return {
        "stall_torque": float(read_torque_limits(constants)[joint]) * float(rng.uniform(0.6, 1.0)),
        "no_load_speed": float(compute_top_speeds(constants)[joint]) * Span(0.25, 1.0, 3.0).draw(rng, faint),
    }


def draw_gain_factor(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a gain factor further from 1 than the ±25 % that base errors explain."""
    weaker = rng.random() < 0.5
    return {"factor": (Span(0.3, 0.7, 0.7) if weaker else Span(1.4, 2.5, 1.4)).draw(rng, faint)}


def draw_tilt(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a tilt of 1° to 15° in a random direction."""
    angle, direction = Span(0.02, 0.26, 0.002).draw(rng, faint), rng.uniform(0, 2 * np.pi)
    return {"roll": float(angle * np.cos(direction)), "pitch": float(angle * np.sin(direction))}


def draw_payload_mass(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a mass of 1/20 to 1/2 of the arm's moving mass."""
    return {"mass": float(constants.masses.sum()) * Span(0.05, 0.5, 0.004).draw(rng, faint)}


def draw_cogging(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a torque with 8 to 30 periods per turn."""
    torque = float(read_torque_limits(constants)[joint]) * Span(0.1, 0.5, 0.01).draw(rng, faint)
    return {"torque": torque, "count": float(rng.integers(8, 31)), "phase": float(rng.uniform(0, 2 * np.pi))}


def draw_cable(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a stiffness below the servo's gain, slack over part of the joint's range."""
    return {
        "stiffness": float(constants.gain[joint]) * Span(0.08, 0.6, 0.01).draw(rng, faint),
        "angle": float(rng.uniform(-0.6, 0.6)),
        "side": float(rng.choice([-1, 1])),
    }


def draw_swinging_load(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a weight of 1/10 to 1/2 of the arm's moving mass on 3 to 10 cm of string."""
    return {
        "mass": float(constants.masses.sum()) * Span(0.1, 0.5, 0.01).draw(rng, faint),
        "length": float(rng.uniform(0.03, 0.1)),
        "heading": float(rng.uniform(0, 2 * np.pi)),
    }


def draw_heat(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw how far a lasting largest torque weakens the servo, to 1/2 … 1/9, and a time constant of 3 to 30 s."""
    return {"rise": Span(1.0, 8.0, 0.1).draw(rng, faint), "time": Span(3.0, 30.0, 3.0).draw(rng, False)}


def draw_coupling(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw the share of the motion of the joint before, in either direction, by which a joint moves."""
    return {"ratio": float(rng.choice([-1, 1])) * Span(0.02, 0.3, 0.001).draw(rng, faint)}


def draw_bending_link(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a link, by its row, that bends by 3° to 23° under the weight of the stretched arm beyond its joint."""
    link, droop = int(rng.integers(len(constants.joints))), Span(0.05, 0.4, 0.005).draw(rng, faint)
    stiffness = compute_weight_torque(constants, link) / droop
    return {"link": float(link), "stiffness": stiffness, "heading": float(rng.uniform(0, 2 * np.pi))}


def draw_eccentric_gear(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw an error of 0.6° to 6° with one to three periods per turn."""
    amplitude, count = Span(0.01, 0.1, 0.001).draw(rng, faint), float(rng.integers(1, 4))
    return {"amplitude": amplitude, "count": count, "phase": float(rng.uniform(0, 2 * np.pi))}


def draw_supply_sag(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a source resistance at which the largest torques of all joints weaken them to 20/21 … 5/9."""
    return {"resistance": Span(0.05, 0.8, 0.005).draw(rng, faint) / float(read_torque_limits(constants).sum())}


def compute_weight_torque(constants: Constants, joint: int) -> float:
    """Return the torque [N m] of the stretched arm's weight about a joint."""
    steps = np.linalg.norm(constants.offsets[joint + 1 :], axis=1)
    reach = np.concatenate([[0.0], np.cumsum(steps)]) + np.linalg.norm(constants.centres[joint:], axis=1)
    return float(np.linalg.norm(constants.gravity) * (constants.masses[joint:] @ reach))


def read_torque_limits(constants: Constants) -> np.ndarray:
    """Return the servos' largest torques [N m], shape (n,)."""
    return constants.force[:, 1]


def compute_top_speeds(constants: Constants) -> np.ndarray:
    """Return the speeds [rad/s] at which damping takes the whole torque limit, shape (n,)."""
    return read_torque_limits(constants) / (constants.damping + constants.servo_damping)


def read_gain(constants: Constants) -> np.ndarray:
    """Return the servos' position gains [N m/rad], shape (n,)."""
    return constants.gain


def read_armature(constants: Constants) -> np.ndarray:
    """Return the rotors' inertia [kg m²], shape (n,)."""
    return constants.armature


INSIDE: Mapping[str, EffectDraw] = {
    "backlash": EffectDraw(draw_play, apart=("joint_compliance",)),
    "joint_compliance": EffectDraw(make_scaled_draw("stiffness", read_gain, Span(0.6, 20.0, 100.0))),
    "coulomb_friction": EffectDraw(
        make_scaled_draw("torque", read_torque_limits, Span(0.05, 0.35, 0.005)),
        apart=("stribeck_friction", "load_friction"),
    ),
    "stribeck_friction": EffectDraw(draw_stribeck, apart=("load_friction",)),
    "viscous_friction": EffectDraw(
        make_scaled_draw("coefficient", lambda own: own.damping + own.servo_damping, Span(0.5, 4.0, 0.5))
    ),
    "load_friction": EffectDraw(make_draw("ratio", Span(0.1, 0.6, 0.01))),
    "rotor_inertia": EffectDraw(make_scaled_draw("inertia", read_armature, Span(0.5, 6.0, 0.5))),
    "servo_stiffness": EffectDraw(draw_gain_factor),
    "torque_limit": EffectDraw(
        make_scaled_draw("torque", read_torque_limits, Span(0.5, 0.9, 0.98)),
        apart=("motor_curve",),
    ),
    "motor_curve": EffectDraw(draw_motor_curve),
    "speed_limit": EffectDraw(make_draw("speed", Span(0.5, 6.0, 12.0))),
    "acceleration_limit": EffectDraw(
        # reached within 1/20 to half a second
        make_scaled_draw("acceleration", compute_top_speeds, Span(2.0, 20.0, 80.0))
    ),
    "command_delay": EffectDraw(make_draw("delay", Span(0.008, 0.12, 0.001)), whole_arm=True),
    "joint_offset": EffectDraw(draw_offset),
    "deadband": EffectDraw(make_draw("half_width", Span(0.008, 0.07, 0.001))),
    "start_torque": EffectDraw(make_scaled_draw("torque", read_torque_limits, Span(0.05, 0.35, 0.005))),
    "integral_gain": EffectDraw(
        make_scaled_draw("gain", read_gain, Span(0.5, 6.0, 0.02)),
        apart=("acceleration_limit", "deadband", "joint_offset", "start_torque"),
    ),
    "payload": EffectDraw(draw_payload_mass, per_joint=False, whole_arm=True),
    "base_tilt": EffectDraw(draw_tilt, per_joint=False, whole_arm=True),
}
# effects that all joints can have in common: a model without friction, or servos of another make
EVERYWHERE = (
    "acceleration_limit", "backlash", "coulomb_friction", "deadband", "integral_gain", "load_friction", "motor_curve",
    "rotor_inertia", "servo_stiffness", "start_torque", "viscous_friction",
)  # fmt: skip
OUTSIDE: Mapping[str, EffectDraw] = {
    "cogging": EffectDraw(draw_cogging),
    "cable": EffectDraw(draw_cable),
    "swinging_load": EffectDraw(draw_swinging_load, per_joint=False, whole_arm=True),
    "heat": EffectDraw(draw_heat),
    "coupling": EffectDraw(draw_coupling, before=1),
    "bending_link": EffectDraw(draw_bending_link, per_joint=False, whole_arm=True),
    "eccentric_gear": EffectDraw(draw_eccentric_gear),
    "supply_sag": EffectDraw(draw_supply_sag, per_joint=False, whole_arm=True),
}
