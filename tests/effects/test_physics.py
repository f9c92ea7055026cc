"""Each effect is what its name says: known widths, torques, speeds and delays are found again in the motion."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nas_data.effects.base import Effect, add_effects, make_effect, parse
from nas_data.robots.base import find_robot
from nas_data.simulators.mujoco import MujocoSimulator

SERVO = """<mujoco><compiler angle="{angle}"/>
<option timestep="0.002" integrator="implicitfast" gravity="0 0 -9.81"/>
<default><joint damping="0.05" stiffness="0.001" frictionloss="0.001"/></default>
<worldbody><body><joint name="j" axis="{axis}" armature="0.002"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="0.1"/></body></worldbody>
<actuator><position name="j" joint="j" kp="3" kv="0.02" forcerange="-2 2"/></actuator></mujoco>"""

MOTOR = """<mujoco><compiler angle="{angle}"/><option timestep="{timestep}" gravity="0 0 0"/>
<worldbody><body><joint name="j" axis="0 0 1" armature="0.04" damping="0.1" range="{low} {high}"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="{mass}"/></body></worldbody>
<actuator><motor name="j" joint="j" ctrlrange="-3 3"/></actuator></mujoco>"""


def lever(*effects: Effect, axis: str = "0 0 1", angle: str = "radian") -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(SERVO.format(axis=axis, angle=angle))
    add_effects(spec, effects)
    return spec.compile()


def run(model: mujoco.MjModel, commands: np.ndarray) -> np.ndarray:
    """Return the link's angle after each physics step."""
    data = mujoco.MjData(model)
    angles = []
    for command in commands:
        data.ctrl[0] = command
        mujoco.mj_step(model, data)
        angles.append(data.qpos.sum())
    return np.array(angles)


def settled(model: mujoco.MjModel, command: float) -> float:
    return float(run(model, np.full(3000, command))[-1])


@pytest.mark.parametrize("angle", ["radian", "degree"])
@settings(max_examples=8, deadline=None)
@given(half_width=st.floats(0.005, 0.1))
def test_play_is_as_wide_as_it_says(angle, half_width):
    """Pushed from both sides, a link with play moves by twice the half width while the servo stands still."""
    model = lever(parse(f"backlash:joint=j,half_width={half_width}"), angle=angle)
    assert model.sensor("j.pos").type[0] == mujoco.mjtSensor.mjSENS_TENDONPOS
    data = mujoco.MjData(model)
    ends = []
    for push in (0.05, -0.05):
        data.qfrc_applied[1] = push
        mujoco.mj_step(model, data, 1500)
        mujoco.mj_forward(model, data)
        ends.append(data.qpos[1])
        assert data.sensordata[0] == pytest.approx(data.qpos.sum())
    assert ends[0] - ends[1] == pytest.approx(2 * half_width, rel=0.01, abs=2e-4)


def test_two_plays_in_one_joint_add_up():
    model = lever(parse("backlash:joint=j,half_width=0.02"), parse("backlash:joint=j,half_width=0.03"))
    assert model.joint("j_play").range == pytest.approx([-0.05, 0.05])


@pytest.mark.parametrize("angle", ["radian", "degree"])
@pytest.mark.parametrize("mass", [0.002, 0.5])
@pytest.mark.parametrize("timestep", [0.002, 0.01])
def test_a_motor_s_link_stays_within_its_stops_and_the_motor_turns_on_through_the_play(angle, mass, timestep):
    low, high = (-1.0, 0.5) if angle == "radian" else np.degrees([-1.0, 0.5])
    spec = mujoco.MjSpec.from_string(MOTOR.format(angle=angle, mass=mass, timestep=timestep, low=low, high=high))
    add_effects(spec, [parse("backlash:joint=j,half_width=0.1")])
    model = spec.compile()
    data = mujoco.MjData(model)
    for torque, stop in ((3.0, 0.5), (-3.0, -1.0)):
        data.ctrl[0] = torque
        mujoco.mj_step(model, data, round(4 / timestep))
        assert data.qpos.sum() == pytest.approx(stop, abs=0.01)
        # the play's own stops give way a little where so much torque comes to so light a link
        assert data.qpos[0] - stop == pytest.approx(np.copysign(0.1, torque), abs=0.05)


def test_the_range_of_a_servo_stays_the_servo_s():
    spec = mujoco.MjSpec.from_string(SERVO.format(axis="0 0 1", angle="radian"))
    spec.joint("j").limited, spec.joint("j").range = mujoco.mjtLimited.mjLIMITED_TRUE, [-1.0, 0.5]
    add_effects(spec, [parse("backlash:joint=j,half_width=0.1")])
    model = spec.compile()
    assert model.jnt_limited[0] and model.joint("j").range == pytest.approx([-1.0, 0.5])
    assert not model.tendon_limited.any()


@settings(max_examples=8, deadline=None)
@given(stiffness=st.floats(0.5, 20))
def test_a_spring_in_the_joint_yields_in_proportion_to_the_load(stiffness):
    model = lever(parse(f"joint_compliance:joint=j,stiffness={stiffness}"))
    data = mujoco.MjData(model)
    data.qfrc_applied[1] = 0.1
    mujoco.mj_step(model, data, 3000)
    assert data.qpos[1] == pytest.approx(0.1 / stiffness, rel=0.01)


@pytest.mark.parametrize("inertia", [2e-4, 7e-5, 4e-5])
def test_a_light_link_swings_on_its_spring_at_its_own_frequency(inertia):
    """Inertia that only serves the integration must not be felt where the link has enough of its own."""
    stiffness, rotor = 0.25, 0.01
    xml = (
        '<mujoco><option timestep="0.0005" integrator="implicitfast" gravity="0 0 0"/><worldbody><body>'
        f'<joint name="j" axis="0 0 1" armature="{rotor}"/><inertial pos="0 0 0" mass="0.01" diaginertia="{inertia} '
        f'{inertia} {inertia}"/></body></worldbody><actuator><position name="j" joint="j" kp="1"/></actuator></mujoco>'
    )
    spec = mujoco.MjSpec.from_string(xml)
    add_effects(spec, [parse(f"joint_compliance:joint=j,stiffness={stiffness}")])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.joint("j_flex").qpos[0] = 0.1
    stretch = []
    for _ in range(2000):
        mujoco.mj_step(model, data)
        stretch.append(data.joint("j_flex").qpos[0])
    turns = np.flatnonzero(np.diff(np.sign(stretch)) != 0)
    period = 2 * np.mean(np.diff(turns)) * 0.0005
    reduced = 1 / (1 / inertia + 1 / rotor)
    assert period == pytest.approx(2 * np.pi * np.sqrt(reduced / stiffness), rel=0.01)


def test_a_stiff_spring_stays_stable_on_the_lightest_link():
    arm = MujocoSimulator.load("ergojr", 0.01, effects=[parse("joint_compliance:joint=m6,stiffness=100")], threads=1)
    commands = np.repeat(np.random.default_rng(0).uniform(-0.9, 0.9, (1, 6, 6)), 50, axis=1)
    states = arm.rollout(np.zeros((1, 12)), commands)
    assert np.abs(states[..., 6:]).max() < 30


@settings(max_examples=8, deadline=None)
@given(speed=st.floats(0.3, 2.5))
def test_a_speed_limit_bounds_the_speed_of_big_steps_and_not_of_slow_moves(speed):
    limited, free = lever(parse(f"speed_limit:joint=j,speed={speed}")), lever()
    angles = run(limited, np.full(400, 3.0))
    cruise = np.diff(angles[150:300]) / 0.002
    assert np.median(cruise) == pytest.approx(speed, rel=0.05)
    slow = 0.5 * speed * 0.002 * np.arange(800)
    assert np.abs(run(limited, slow) - run(free, slow)).max() < 1e-12


def test_a_speed_limit_keeps_gains_limits_and_offset_of_the_servo():
    offset = parse("joint_offset:joint=j,offset=0.1")
    limited = lever(offset, parse("speed_limit:joint=j,speed=1"))
    assert settled(limited, 0.4) == pytest.approx(settled(lever(offset), 0.4), abs=1e-6)
    assert limited.actuator_forcerange[0] == pytest.approx([-2, 2])
    assert limited.actuator_biasprm[0, :3] == pytest.approx([0.3, -3, -0.02])


@settings(max_examples=8, deadline=None)
@given(steps=st.integers(1, 60))
def test_a_delay_shifts_the_motion_and_nothing_else(steps):
    commands = np.concatenate([np.full(200, 0.5), np.full(200, -0.3)])
    delayed = run(lever(parse(f"command_delay:joint=j,delay={steps * 0.002}")), commands)
    assert delayed[steps:] == pytest.approx(run(lever(), commands)[:-steps], abs=1e-9)


def test_delays_of_bus_and_joint_add_up():
    both = lever(parse("command_delay:delay=0.01"), parse("command_delay:joint=j,delay=0.02"))
    one = lever(parse("command_delay:delay=0.03"))
    commands = np.full(200, 0.5)
    assert run(both, commands) == pytest.approx(run(one, commands), abs=1e-9)


@settings(max_examples=8, deadline=None)
@given(torque=st.floats(0.005, 0.5))
def test_coulomb_friction_holds_any_smaller_torque_and_no_larger_one(torque):
    model = lever(parse(f"coulomb_friction:joint=j,torque={torque}"))
    own = 0.001 + torque
    for share, moves in ((0.9, False), (1.2, True)):
        data = mujoco.MjData(model)
        model.actuator_gainprm[:], model.actuator_biasprm[:] = 0, 0
        data.qfrc_applied[0] = share * own
        mujoco.mj_step(model, data, 500)
        assert (abs(data.qpos[0]) > 0.01) == moves


def test_viscous_friction_and_inertia_add_to_the_model_s_own():
    model = lever(parse("viscous_friction:joint=j,coefficient=0.02"), parse("rotor_inertia:joint=j,inertia=0.003"))
    assert model.dof_damping[0] == pytest.approx(0.07)
    assert model.dof_armature[0] == pytest.approx(0.005)


def test_a_stiffer_servo_droops_less_in_proportion():
    droops = [
        -settled(lever(parse(f"servo_stiffness:joint=j,factor={factor}"), axis="0 -1 0"), 0.0) * factor
        for factor in (1, 2, 4)
    ]
    assert droops[1] == pytest.approx(droops[0], rel=0.05)
    assert droops[2] == pytest.approx(droops[0], rel=0.05)


def test_a_torque_limit_bounds_the_torque():
    model = lever(parse("torque_limit:joint=j,torque=0.05"))
    data = mujoco.MjData(model)
    data.ctrl[0] = 3
    mujoco.mj_step(model, data)
    assert data.actuator_force[0] == pytest.approx(0.05)


@given(offset=st.floats(-0.5, 0.5))
@settings(max_examples=8, deadline=None)
def test_an_unloaded_joint_reaches_its_command_plus_the_offset(offset):
    spec = mujoco.MjSpec.from_string(SERVO.format(axis="0 0 1", angle="radian"))
    spec.joint("j").stiffness, spec.joint("j").frictionloss = [0.0] * 3, 0.0
    add_effects(spec, [parse(f"joint_offset:joint=j,offset={offset}")])
    assert settled(spec.compile(), 0.2) == pytest.approx(0.2 + offset, abs=1e-6)


def test_a_payload_adds_its_weight_at_the_last_link():
    still, loaded = (find_robot("ergojr").spec() for _ in range(2))
    add_effects(loaded, [parse("payload:mass=0.03"), parse("payload:mass=0.02")])
    torques = []
    for spec in (still, loaded):
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        torques.append((model.body_mass.sum(), data.qfrc_bias.copy(), data.body("link6").xipos, data))
    assert torques[1][0] - torques[0][0] == pytest.approx(0.05)
    centre = torques[0][2]
    arms = {joint: centre[1] - torques[0][3].joint(joint).xanchor[1] for joint in ("m2", "m3", "m5", "m6")}
    for index, joint in ((1, "m2"), (2, "m3"), (4, "m5"), (5, "m6")):
        added = torques[1][1][index] - torques[0][1][index]
        assert abs(added) == pytest.approx(0.05 * 9.81 * arms[joint], rel=1e-6)


def test_a_payload_sits_where_it_is_said_to():
    loaded = find_robot("ergojr").spec()
    add_effects(loaded, [parse("payload:mass=0.03"), parse("payload:mass=0.02,x=0.01,y=-0.02,z=0.03")])
    model = loaded.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    link = model.body(model.body("payload").parentid[0]).id
    apart = data.body("payload_2").xpos - data.body("payload").xpos
    assert data.xmat[link].reshape(3, 3).T @ apart == pytest.approx([0.01, -0.02, 0.03], abs=1e-9)


@given(roll=st.floats(-0.5, 0.5), pitch=st.floats(-0.5, 0.5))
def test_tilting_the_base_is_leaning_gravity_the_other_way(roll, pitch):
    """Statics of a tilted arm equal those of the level arm under leaning gravity, seen from the base."""
    effect = make_effect("base_tilt", None, {"roll": roll, "pitch": pitch})
    spec = mujoco.MjSpec.from_string(SERVO.format(axis="0 1 0", angle="radian"))
    add_effects(spec, [effect])
    half_roll = np.array([math.cos(roll / 2), math.sin(roll / 2), 0, 0])
    half_pitch = np.array([math.cos(pitch / 2), 0, math.sin(pitch / 2), 0])
    tilted = mujoco.MjSpec.from_string(SERVO.format(axis="0 1 0", angle="radian"))
    quaternion = np.empty(4)
    mujoco.mju_mulQuat(quaternion, half_pitch, half_roll)
    tilted.bodies[1].quat = quaternion
    torques = []
    for model in (spec.compile(), tilted.compile()):
        data = mujoco.MjData(model)
        data.qpos[0] = 0.4
        mujoco.mj_forward(model, data)
        torques.append(data.qfrc_bias[0])
    assert torques[0] == pytest.approx(torques[1], abs=1e-12)


def test_play_and_a_spring_in_one_joint_leave_no_piece_without_inertia():
    spec = mujoco.MjSpec.from_string(SERVO.format(angle="radian", axis="0 0 1"))
    add_effects(spec, [parse("backlash:joint=j,half_width=0.02"), parse("joint_compliance:joint=j,stiffness=5")])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.5
    mujoco.mj_step(model, data, 2000)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    assert np.linalg.eigvalsh(mass).min() > 1e-6
    assert data.qpos.sum() == pytest.approx(0.5, abs=0.05)
