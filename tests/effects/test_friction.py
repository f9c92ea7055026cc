"""Friction and dead bands move a servo as their equations do, sticking included, and hold still where they stick."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from support.effect_samples import SIGNALS, Lever, effect, rms_degrees, simulate, simulator

from nas_data.effects.base import add_effects, make_effect
from nas_data.effects.edits.hook import StepForces
from nas_data.robots.base import find_robot
from nas_data.simulators.hooks import find_hooks


def stribeck(torque: float, ratio: float, velocity: float):
    return lambda speed, _: torque * (ratio + (1 - ratio) * math.exp(-((speed / velocity) ** 2)))


@pytest.mark.parametrize("signal", ["triangle", "sine", "holds"])
@pytest.mark.parametrize(
    ("torque", "ratio", "velocity"), [(0.03, 0.5, 0.2), (0.05, 0.3, 0.1), (0.02, 0.6, 1.0), (0.1, 0.4, 0.3)]
)
def test_stribeck_friction_follows_its_equation(tmp_path, torque, ratio, velocity, signal):
    """Within what the 2 ms step costs the same servo without it; a single missed break-away may shift one stop."""
    friction = effect("stribeck_friction", torque=torque, kinetic_ratio=ratio, stribeck_velocity=velocity)
    expected = Lever().move(SIGNALS[signal], friction=stribeck(torque, ratio, velocity))
    found = simulate(tmp_path, Lever(), SIGNALS[signal], friction)
    assert rms_degrees(found - expected) < (0.5 if torque == 0.1 else 0.2)
    coulomb = Lever().move(SIGNALS[signal], friction=lambda speed, load: torque * ratio)
    assert rms_degrees(coulomb - expected) > 1.5 * rms_degrees(found - expected)


def test_a_slow_servo_sticks_and_slips(tmp_path):
    """Pulled by a weak servo at constant speed, an undamped joint moves in jumps as far apart as the equation says."""
    lever = Lever(damping=0.0, friction=0.0)
    friction = effect("stribeck_friction", torque=0.03, kinetic_ratio=0.5, stribeck_velocity=0.2)
    expected = lever.move(SIGNALS["ramp"], friction=stribeck(0.03, 0.5, 0.2))
    found = simulate(tmp_path, lever, SIGNALS["ramp"], friction)
    assert rms_degrees(found - expected) < 0.4
    stuck = [np.mean(np.diff(angles) < 1e-5) for angles in (found, expected)]
    assert stuck[1] > 0.3
    assert stuck[0] == pytest.approx(stuck[1], abs=0.1)


@settings(max_examples=25, deadline=None)
@example(torque=0.09375, ratio=0.21875, exponent=-3.625, share=0.890625)
@example(torque=2.4445, ratio=0.2196, exponent=-2.2827, share=0.8981)
@given(
    torque=st.floats(0.005, 0.5),
    ratio=st.floats(0.2, 0.95),
    exponent=st.floats(-4, -2),
    share=st.floats(0.1, 0.9),
)
def test_stribeck_friction_holds_without_creep_or_chatter(torque, ratio, exponent, share):
    """At 2 ms, for inertias from 1e-4 to 1e-2 kg·m², under any smaller load; a larger one moves it.

    Up to four times the acceleration of which an XL-320 is capable: beyond, a step does not resolve a break-away.
    """
    assume(torque < 500 * 10**exponent)
    spec = Lever(inertia=10**exponent, damping=0.0, friction=0.0, kp=1e-6).spec()
    add_effects(spec, [effect("stribeck_friction", torque=torque, kinetic_ratio=ratio, stribeck_velocity=0.3)])
    model = spec.compile()
    data = mujoco.MjData(model)
    for part in np.minimum(1, np.arange(500) / 100):
        data.qfrc_applied[0] = part * share * torque
        mujoco.mj_step(model, data)
    rested = data.qpos[0]
    mujoco.mj_step(model, data, 500)
    assert abs(data.qpos[0] - rested) < math.radians(0.05)
    assert abs(data.qvel[0]) < 2e-3
    data.qfrc_applied[0] = 1.1 * torque
    mujoco.mj_step(model, data, 500)
    assert data.qpos[0] > rested + 0.02


def test_two_stribeck_frictions_in_one_joint_add_up(tmp_path):
    halves = [effect("stribeck_friction", torque=0.02, kinetic_ratio=0.5, stribeck_velocity=0.3)] * 2
    whole = effect("stribeck_friction", torque=0.04, kinetic_ratio=0.5, stribeck_velocity=0.3)
    both, one = (simulate(tmp_path, Lever(), SIGNALS["triangle"], *effects) for effects in (halves, [whole]))
    assert rms_degrees(both - one) < 0.1


@pytest.mark.parametrize("signal", ["triangle", "sine", "holds"])
@pytest.mark.parametrize("ratio", [0.1, 0.3])
def test_load_friction_follows_its_equation(tmp_path, ratio, signal):
    """The budget goes with the servo's torque, under any load."""
    expected = Lever().move(SIGNALS[signal], friction=lambda speed, torque: ratio * abs(torque))
    found = simulate(tmp_path, Lever(), SIGNALS[signal], effect("load_friction", ratio=ratio))
    assert rms_degrees(found - expected) < 0.3
    assert rms_degrees(Lever().move(SIGNALS[signal]) - expected) > 3 * rms_degrees(found - expected)


@pytest.mark.parametrize("signal", ["triangle", "sine", "holds"])
@pytest.mark.parametrize(("kinetic", "velocity"), [(0.4, 0.3), (0.6, 1.0)])
def test_load_friction_that_falls_with_speed_follows_its_equation(tmp_path, kinetic, velocity, signal):
    """Within half of what the same friction without the fall, or with all of it at once, would be off."""
    ratio = 0.4
    falls = stribeck(ratio, kinetic, velocity)
    expected = Lever().move(SIGNALS[signal], friction=lambda speed, torque: falls(speed, torque) * abs(torque))
    friction = effect("load_friction", ratio=ratio, kinetic_ratio=kinetic, stribeck_velocity=velocity)
    found = simulate(tmp_path, Lever(), SIGNALS[signal], friction)
    assert rms_degrees(found - expected) < 0.3
    for other in (ratio, kinetic * ratio):
        constant = simulate(tmp_path, Lever(), SIGNALS[signal], effect("load_friction", ratio=other))
        assert rms_degrees(constant - expected) > 2 * rms_degrees(found - expected)


@pytest.mark.parametrize("load", [0.02, 0.1, 0.18])
def test_load_friction_holds_without_creep_or_chatter(tmp_path, load):
    """A loaded joint that came to rest stays at rest while the load changes by less than the friction."""
    arm = simulator(tmp_path, Lever(friction=0.0, damping=0.005), effect("load_friction", ratio=0.2))
    stepper = arm.stepper(1)
    applied = stepper.batch.bind("qfrc_applied")
    angles = []
    for step in range(500):
        applied[:] = -load * (1.0 if step < 300 else 0.95)
        angles.append(stepper.step(np.zeros((1, 1)))[0])
    angles = np.array(angles)
    assert np.abs(angles[250:, 0] - angles[250, 0]).max() < math.radians(0.02)
    assert np.abs(angles[250:, 1]).max() < 0.01
    assert angles[250, 0] < -0.8 * load / 0.336 / 1.2


def test_many_simulations_with_a_hook_equal_one_by_one(tmp_path):
    """In rollouts, predictions and closed loops, at any number of threads and after any reset."""
    arm = simulator(tmp_path, Lever(), effect("load_friction", ratio=0.3))
    rng = np.random.default_rng(0)
    states, commands = rng.uniform(-0.3, 0.3, (5, 2)), rng.uniform(-0.9, 0.9, (5, 40, 1))
    together = arm.rollout(states, commands)
    for row in range(5):
        assert np.array_equal(arm.rollout(states[[row]], commands[[row]])[0], together[row])
    assert np.array_equal(arm.predict(states, commands[:, 0]), together[:, 0])
    arm.threads = 2
    assert np.array_equal(arm.rollout(states, commands), together)
    stepper = arm.stepper(5)
    stepper.step(np.ones((5, 1)))
    for rows in (np.array([4, 0]), np.array([1, 2, 3])):
        stepper.reset(states[rows], rows)
    closed = np.stack([stepper.step(commands[:, step]) for step in range(40)], axis=1)
    assert np.array_equal(closed, together)


FRICTIONS = (("m5", 0.1, 1.0), ("m2", 0.3, 1.0), ("m5", 0.2, 0.5))  # one of them twice


def test_joints_share_a_hook_and_keep_their_own_friction():
    """Powered or not, each joint gets from the one hook of its kind what a hook of its own would add."""
    robot = find_robot("ergojr")
    effects = [
        make_effect("load_friction", joint, {"ratio": ratio, "kinetic_ratio": kinetic, "stribeck_velocity": 0.3})
        for joint, ratio, kinetic in FRICTIONS
    ]
    spec = mujoco.MjSpec.from_file(str(robot.mjcf))
    add_effects(spec, effects)
    model = spec.compile()
    rng = np.random.default_rng(0)
    force, bias = rng.uniform(-0.5, 0.5, (4, model.nout)), rng.uniform(-0.5, 0.5, (4, model.nv))
    velocity = rng.uniform(-0.5, 0.5, (4, model.nv))
    for released in (np.zeros(4, bool), np.array([True, False, False, True])):
        (shared,) = find_hooks(effects, model)
        alone = [hook for effect in effects for hook in find_hooks([effect], model)]
        forces = StepForces(force, bias, velocity, released)
        together = shared(forces)()
        assert together == pytest.approx(sum(hook(forces)() for hook in alone), rel=1e-12)
        assert (together > 0).sum() == 8


def test_an_empty_rollout_with_a_hook_is_empty(tmp_path):
    arm = simulator(tmp_path, Lever(), effect("load_friction", ratio=0.3))
    assert arm.rollout(np.zeros((0, 2)), np.zeros((0, 5, 1))).shape == (0, 5, 2)
    assert arm.predict(np.zeros((0, 2)), np.zeros((0, 1))).shape == (0, 2)
