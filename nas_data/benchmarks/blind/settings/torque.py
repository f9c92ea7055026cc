"""One to three hinges or slides under commanded torques, in episodes cut from continuous motions."""

from collections.abc import Mapping

import numpy as np

from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.case import Conditions, Identity, Sensor
from nas_data.benchmarks.blind.catalogue import (
    EffectDraw,
    Rng,
    Span,
    Values,
    make_scaled_draw,
    read_armature,
    read_torque_limits,
)
from nas_data.benchmarks.blind.designs import draw_log_uniform
from nas_data.benchmarks.blind.machines import USUAL, draw_machine, draw_references, find_reach
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.settings.base import CaseSetting

RATES = (200.0, 250.0, 500.0, 1000.0)  # [Hz]
PIECES = (3, 4)  # episodes cut from a motion
MOTIONS, FRESH = (2, 4), 1  # motions handed over, and kept back
SECONDS = (0.6, 1.5)  # of an episode
NOISE = (1e-4, 5e-4)  # [rad, m] standard deviation before rounding
QUANTA = (0.0, 1e-4, 4e-4)  # [rad, m] none, 16 and 14 bits a turn
FINER = (0.02, 0.2)  # noise of a measured speed relative to that of differenced positions, which is large here


def draw(identity: Identity) -> tuple[NominalArm, Conditions]:
    """Draw a machine and its recording conditions."""
    rng = identity.stream("conditions")
    rate, pieces = float(rng.choice(RATES)), int(rng.integers(PIECES[0], PIECES[1] + 1))
    conditions = Conditions(
        rate=rate,
        seconds=round(float(rng.uniform(*SECONDS)) * rate) / rate,
        episodes=pieces * int(rng.integers(MOTIONS[0], MOTIONS[1] + 1)),
        fresh=pieces * FRESH,
        settle=0.0,
        signal="following",
        sensor=draw_sensor(rng, rate),
        pieces=pieces,
    )
    return draw_machine(identity.stream("arm")), conditions


def draw_sensor(rng: Rng, rate: float) -> Sensor:
    """Draw the drives' sensor at a rate [Hz]; half of them measure speed."""
    noise, quantum = draw_log_uniform(rng, *NOISE), float(rng.choice(QUANTA))
    floor = float(np.hypot(noise, quantum / np.sqrt(12)))
    differenced, finer = np.sqrt(2) * floor * rate, draw_log_uniform(rng, *FINER)
    return Sensor(noise, quantum, floor, float(finer * differenced) if rng.random() < 0.5 else None)


def compute_saturating_friction(constants: Constants) -> np.ndarray:
    """Return the friction [N m s/rad] that takes the whole torque limit at a typical speed, shape (n,)."""
    return read_torque_limits(constants) / USUAL[constants.sliding.astype(int)]


def draw_payload_mass(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a mass of 1/3 to twice the mass that the last axis moves."""
    return {"mass": float(constants.masses[-1]) * Span(0.3, 2.0, 0.02).draw(rng, faint)}


def draw_uneven_friction(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw dry friction of which a direction has 1.5 to 9 times as much as the other."""
    torque = float(read_torque_limits(constants)[joint]) * Span(0.03, 0.25, 0.0005).draw(rng, faint)
    return {"torque": torque, "difference": float(rng.choice([-1, 1]) * rng.uniform(0.2, 0.8)) * torque}


def draw_motor_curve(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a stall torque of 50 to 90 % of the limit, and a no-load speed of 1 to 4 times the typical speed."""
    usual = float(USUAL[int(constants.sliding[joint])])
    return {
        "stall_torque": float(read_torque_limits(constants)[joint]) * float(rng.uniform(0.5, 0.9)),
        "no_load_speed": usual * Span(1.0, 4.0, 15.0).draw(rng, faint),
    }


def draw_cogging(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a torque with 8 to 30 periods per turn, or one per 1.5 to 6 cm."""
    torque = float(read_torque_limits(constants)[joint]) * Span(0.05, 0.3, 0.005).draw(rng, faint)
    count = rng.uniform(100, 400) if constants.sliding[joint] else rng.integers(8, 31)
    return {"torque": torque, "count": float(count), "phase": float(rng.uniform(0, 2 * np.pi))}


def draw_cable(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a cable that pulls with up to 1/3 of the torque limit, slack over part of the joint's range."""
    reach = float(find_reach(constants.sliding)[joint, 1])
    return {
        "stiffness": float(read_torque_limits(constants)[joint]) / reach * Span(0.05, 0.3, 0.005).draw(rng, faint),
        "angle": float(rng.uniform(-0.6, 0.6)) * reach,
        "side": float(rng.choice([-1, 1])),
    }


def draw_coupling(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw how far a joint moves with the one before it, relative to the ranges of both."""
    reach = find_reach(constants.sliding)[:, 1]
    scale = float(reach[joint] / reach[joint - 1])
    return {"ratio": scale * float(rng.choice([-1, 1])) * Span(0.02, 0.3, 0.001).draw(rng, faint)}


def draw_eccentric_gear(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a gear whose ratio changes by 2 to 20 %, one to three times per turn, or once per 6 to 20 cm."""
    count = rng.uniform(30, 100) if constants.sliding[joint] else rng.integers(1, 4)
    amplitude = Span(0.02, 0.2, 0.002).draw(rng, faint) / float(count)
    return {"amplitude": amplitude, "count": float(count), "phase": float(rng.uniform(0, 2 * np.pi))}


INSIDE: Mapping[str, EffectDraw] = {
    "coulomb_friction": EffectDraw(
        make_scaled_draw("torque", read_torque_limits, Span(0.03, 0.25, 0.0005)), apart=("asymmetric_friction",)
    ),
    "asymmetric_friction": EffectDraw(draw_uneven_friction),
    "viscous_friction": EffectDraw(
        make_scaled_draw("coefficient", compute_saturating_friction, Span(0.03, 0.25, 0.0005))
    ),
    "rotor_inertia": EffectDraw(make_scaled_draw("inertia", read_armature, Span(1.0, 4.0, 0.02))),
    "torque_limit": EffectDraw(
        make_scaled_draw("torque", read_torque_limits, Span(0.3, 0.8, 0.95)), apart=("motor_curve",)
    ),
    "motor_curve": EffectDraw(draw_motor_curve),
    "payload": EffectDraw(draw_payload_mass, per_joint=False, whole_arm=True),
}
# without heat and bending links, whose state goes on from episode to episode, and without a supply, because forces and
# torques share no unit of current
OUTSIDE: Mapping[str, EffectDraw] = {
    "cogging": EffectDraw(draw_cogging),
    "cable": EffectDraw(draw_cable),
    "coupling": EffectDraw(draw_coupling, before=1),
    "eccentric_gear": EffectDraw(draw_eccentric_gear),
}

SETTING = CaseSetting(draw, draw_references, INSIDE, OUTSIDE, least=4.0, most=np.inf, rounds=60)
