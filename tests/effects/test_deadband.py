"""A dead band does what its equation says, saturated or not, and what changes the servo changes the band's servo."""

import dataclasses

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.effect_samples import SIGNALS, Lever, effect, rms_degrees, simulate, simulator

from nas_data.effects.base import add_effects, parse
from nas_data.effects.edits.servo import scale_damping, scale_stiffness
from nas_data.envs.loop.randomised import RandomisedStepper, compute_largest_torque, make_delay_line
from nas_data.envs.loop.ranges import NOMINAL
from nas_data.errors import ModelFileError
from nas_data.simulators.initial_states import InitialLoad
from nas_data.simulators.mujoco import MujocoSimulator

BAND = effect("deadband", half_width=0.03)


@pytest.mark.parametrize("signal", SIGNALS)
@pytest.mark.parametrize("half_width", [0.005, 0.02, 0.06])
def test_a_dead_band_follows_its_equation(tmp_path, half_width, signal):
    expected = Lever().move(SIGNALS[signal], ignored=half_width)
    found = simulate(tmp_path, Lever(), SIGNALS[signal], effect("deadband", half_width=half_width))
    assert rms_degrees(found - expected) < 0.2
    assert rms_degrees(Lever().move(SIGNALS[signal]) - expected) > 3 * rms_degrees(found - expected)


def test_a_dead_band_leaves_the_servo_its_damping(tmp_path):
    """Inside and outside the band, as long as the servo does not saturate."""
    lever = Lever(damping=0.003, friction=0.005, kv=0.0277, limit=1.0)
    expected = lever.move(SIGNALS["holds"], ignored=0.03)
    found = simulate(tmp_path, lever, SIGNALS["holds"], effect("deadband", half_width=0.03))
    assert rms_degrees(found - expected) < 0.4
    undamped = Lever(damping=0.003, friction=0.005, limit=1.0).move(SIGNALS["holds"], ignored=0.03)
    assert rms_degrees(undamped - expected) > 5 * rms_degrees(found - expected)


@settings(max_examples=10, deadline=None)
@given(half_width=st.floats(0.005, 0.1), start=st.floats(-0.9, 0.9))
def test_errors_within_the_dead_band_move_nothing(half_width, start):
    """A link without friction stays where it is for any error up to the half width, and not beyond."""
    spec = Lever(friction=0.0).spec()
    add_effects(spec, [effect("deadband", half_width=half_width)])
    model = spec.compile()
    assert model.actuator(0).name == "j"
    for command, moves in ((start * half_width, False), (half_width + 0.1, True)):
        data = mujoco.MjData(model)
        data.ctrl[0] = command
        mujoco.mj_step(model, data, 2000)
        assert (abs(data.qpos[0]) > 0.05) == moves
        if moves:
            assert 0.098 < data.qpos[0] < 0.102 + 2 * half_width
        else:
            assert abs(data.qpos[0]) < 0.3 * half_width


def test_two_dead_bands_in_one_servo_add_up():
    spec = Lever().spec()
    add_effects(spec, [effect("deadband", half_width=0.02), effect("deadband", half_width=0.03)])
    whole = Lever().spec()
    add_effects(whole, [effect("deadband", half_width=0.05)])
    ranges = [each.compile().actuator("j_deadband").forcerange for each in (spec, whole)]
    assert ranges[0] == pytest.approx(ranges[1])


def test_a_dead_band_keeps_a_damping_ratio():
    spec = Lever().spec()
    spec.actuators[0].set_to_position(kp=0.336, dampratio=1.0)
    expected = spec.compile().actuator("j").biasprm[:3]
    add_effects(spec, [effect("deadband", half_width=0.02)])
    model = spec.compile()
    assert model.actuator("j_deadband_gain").biasprm[:3] == pytest.approx([0.0, expected[1], 0.0])
    assert model.actuator("j_deadband_damping").biasprm[:3] == pytest.approx([0.0, 0.0, expected[2]])


@pytest.mark.parametrize("limit", [0.5, 5])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_a_dead_band_does_what_its_equation_says_where_the_servo_damps(integrator, limit):
    """torque = kp · dz(command − q) − kv · dq/dt, computed here before every physics step."""
    xml = (
        f'<mujoco><option timestep="0.002" integrator="{integrator}"/><worldbody><body><joint name="j" axis="0 0 1" '
        'damping="0.05"/><geom type="box" size="0.1 0.01 0.01" pos="0.1 0 0" mass="0.5"/></body></worldbody><actuator>'
        f'<position name="j" joint="j" kp="8" kv="0.35" forcerange="-{limit} {limit}"/></actuator></mujoco>'
    )
    spec = mujoco.MjSpec.from_string(xml)
    add_effects(spec, [parse("deadband:joint=j,half_width=0.05")])
    plain, native = mujoco.MjModel.from_xml_string(xml), spec.compile()
    runs = []
    for model, width in ((plain, 0.0), (plain, 0.05), (native, 0.0)):
        data, positions = mujoco.MjData(model), []
        for step in range(3000):
            error = np.sin(4 * step * 0.002) - data.joint("j").qpos[0]
            zone = np.sign(error) * max(abs(error) - width, 0.0)
            data.ctrl[0] = data.joint("j").qpos[0] + zone if width else np.sin(4 * step * 0.002)
            mujoco.mj_step(model, data)
            positions.append(data.joint("j").qpos[0])
        runs.append(np.array(positions))
    without, exact, edited = runs
    assert np.sqrt(np.mean((edited - exact) ** 2)) < 0.04 * np.sqrt(np.mean((without - exact) ** 2))


def holds(model: mujoco.MjModel, seed: int = 0) -> np.ndarray:
    """Return the joint's angles while commands are held for 50 ms."""
    data, angles = mujoco.MjData(model), []
    for command in np.random.default_rng(seed).uniform(-1, 1, 40):
        data.ctrl[0] = command
        for _ in range(25):
            mujoco.mj_step(model, data)
            angles.append(data.joint("j").qpos[0])
    return np.array(angles)


@pytest.mark.parametrize("change", ["stiffness", "damping", "torque", "offset", "delay", "speed"])
def test_a_servo_with_a_dead_band_is_changed_as_one_without(change):
    """A model with a band, as a gap report writes it, can be explained and changed further."""
    change_of = {
        "stiffness": lambda spec: scale_stiffness(spec, "j", 1.7),
        "damping": lambda spec: scale_damping(spec, "j", 3.0),
        "torque": lambda spec: add_effects(spec, [effect("torque_limit", torque=0.05)]),
        "offset": lambda spec: add_effects(spec, [effect("joint_offset", offset=0.1)]),
        "delay": lambda spec: add_effects(spec, [effect("command_delay", delay=0.03)]),
        "speed": lambda spec: add_effects(spec, [effect("speed_limit", speed=1.0)]),
    }[change]
    before, after, never = (Lever(kv=0.02).spec() for _ in range(3))
    change_of(before)
    add_effects(before, [BAND])
    add_effects(after, [BAND])
    after = mujoco.MjSpec.from_string(after.to_xml())
    change_of(after)
    add_effects(never, [BAND])
    runs = [holds(spec.compile()) for spec in (before, after, never)]
    assert np.abs(runs[0] - runs[1]).max() < 1e-6
    assert np.abs(runs[0] - runs[2]).max() > 0.01


def test_nothing_of_a_models_default_class_gets_into_a_dead_band():
    spec = Lever(kv=0.02).spec()
    expected = Lever(kv=0.02).spec()
    spec.default.actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
    spec.default.actuator.forcerange = [-0.001, 0.001]
    spec.default.actuator.gear[0] = 5.0
    for each in (spec, expected):
        add_effects(each, [BAND])
    assert np.array_equal(holds(spec.compile()), holds(expected.compile()))


def test_a_servo_with_an_integral_gain_has_no_dead_band():
    spec = Lever().spec()
    spec.actuators[0].set_to_pid(kp=0.336, ki=0.1)
    with pytest.raises(ModelFileError, match="integral"):
        add_effects(spec, [BAND])


def test_load_friction_feels_the_torque_of_a_servo_with_a_dead_band(tmp_path):
    friction, narrow = effect("load_friction", ratio=0.4), effect("deadband", half_width=1e-6)
    plain = simulate(tmp_path, Lever(), SIGNALS["holds"])
    alone, both = (simulate(tmp_path, Lever(), SIGNALS["holds"], *found) for found in ([friction], [friction, narrow]))
    assert rms_degrees(both - alone) < 0.05 * rms_degrees(plain - alone)


def test_an_arm_that_leans_on_the_edge_of_a_dead_band_stays_there():
    band = parse("deadband:joint=m3,half_width=0.05")
    sim = MujocoSimulator.load("ergojr", 0.01, effects=[band])
    pose = np.array([0.2, 0.6, -0.4, 0.1, 0.5, -0.3])
    state = np.concatenate([pose, np.zeros(6)])[None]
    sim.settled(state, np.full((1, 6), InitialLoad.GRAVITY))
    data = mujoco.MjData(sim.model)
    data.qpos[sim.layout.qpos] = pose
    mujoco.mj_forward(sim.model, data)
    load = data.qfrc_bias[sim.layout.dof]
    held = pose + load / 0.336
    held[2] += np.sign(load[2]) * 0.05
    moved = sim.rollout(state, np.tile(held, (1, 50, 1)), np.full((1, 6), InitialLoad.GRAVITY))[0, :, :6]
    assert np.abs(moved - pose).max() < 2e-3


def test_randomised_gains_are_those_of_the_whole_servo(tmp_path):
    """Passive actuators of a servo share its draw, its band keeps its width, its goal is no part of the robot."""
    doubled = dataclasses.replace(NOMINAL, gain=(2.0, 2.0))
    stepper = RandomisedStepper(simulator(tmp_path, Lever(kv=0.02), BAND, make_delay_line()).stepper(1), doubled)
    stepper.redraw([np.random.default_rng(0)])
    stronger = Lever(kv=0.04, kp=0.672)
    expected = simulator(tmp_path, stronger, BAND).stepper(1)
    states = []
    for each in (stepper, expected):
        each.set_states(np.zeros((1, 2)))
        states.append(np.stack([each.step(np.array([[command]])).copy() for command in SIGNALS["triangle"]]))
    assert np.abs(states[0] - states[1])[..., 0].max() < 2e-3


def test_the_largest_torque_of_a_servo_with_a_dead_band_is_its_own(tmp_path):
    """What randomised drag is a share of."""
    plain, banded = (simulator(tmp_path, Lever(), *effects).model for effects in ((), (BAND,)))
    assert (
        compute_largest_torque(banded, "j") == pytest.approx(compute_largest_torque(plain, "j")) == pytest.approx(0.208)
    )
