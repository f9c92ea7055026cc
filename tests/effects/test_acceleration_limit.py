"""The goal of a servo with an acceleration limit follows the profile with that acceleration."""

import mujoco
import numpy as np
import pytest

from nas_data.effects.base import add_effects, parse
from nas_data.effects.edits.servo import read_servo_damping, scale_stiffness
from nas_data.errors import ModelFileError
from nas_data.robots.base import Robot
from nas_data.simulators.initial_states import InitialLoad
from nas_data.simulators.mujoco import MujocoSimulator

ARM = """<mujoco><compiler angle="radian"/><option timestep="{timestep}" integrator="{integrator}" gravity="0 0 0"/>
<worldbody><body><joint name="j" type="{kind}" axis="0 0 1" armature="0.02"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="0.1"/></body></worldbody>
<actuator>{actuator}</actuator></mujoco>"""
POSITION = '<position name="j" joint="j" kp="30" kv="1.5" forcerange="-20 20"/>'
LIMIT = "acceleration_limit:joint=j,acceleration=10"


def make_spec(
    actuator: str = POSITION, kind: str = "hinge", timestep: float = 0.002, integrator: str = "implicitfast"
) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(ARM.format(actuator=actuator, kind=kind, timestep=timestep, integrator=integrator))


def compile_with(spec: mujoco.MjSpec, *effects: str) -> mujoco.MjModel:
    add_effects(spec, [parse(effect) for effect in effects])
    return mujoco.MjModel.from_xml_string(spec.to_xml())


def run(model: mujoco.MjModel, control: float, seconds: float = 1.2) -> np.ndarray:
    """Return joint and goal after each physics step, shape (T, 2)."""
    data, rows = mujoco.MjData(model), []
    for _ in range(round(seconds / model.opt.timestep)):
        data.ctrl[0] = control
        mujoco.mj_step(model, data)
        rows.append((data.joint("j").qpos[0], data.joint("j_deadband_goal").qpos[0]))
    return np.array(rows)


def profile(times: np.ndarray, step: float, acceleration: float) -> np.ndarray:
    """Return the fastest motion over a step with a bounded acceleration, at rest at both ends."""
    half = np.sqrt(step / acceleration)
    left = np.clip(2 * half - times, 0, None)
    return np.where(times < half, acceleration * times**2 / 2, step - acceleration * left**2 / 2)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("kind", ["hinge", "slide"])
@pytest.mark.parametrize("step", [0.1, 1.0])
@pytest.mark.parametrize("acceleration", [4.0, 30.0])
def test_a_step_becomes_the_fastest_profile_with_that_acceleration(integrator, kind, step, acceleration):
    model = compile_with(
        make_spec(kind=kind, integrator=integrator), f"acceleration_limit:joint=j,acceleration={acceleration}"
    )
    goal = run(model, step)[:, 1]
    expected = profile(0.002 * np.arange(1, len(goal) + 1), step, acceleration)
    assert np.sqrt(np.mean((goal - expected) ** 2)) < 0.03 * step
    assert np.abs(np.diff(goal, 2)).max() < 1.001 * acceleration * 0.002**2
    assert goal.max() < 1.01 * step
    assert goal[-1] == pytest.approx(step, abs=1e-3)


@pytest.mark.parametrize(
    ("actuator", "control"),
    [
        ('<position name="j" joint="j" kp="7.5" kv="0.375" gear="-2"/>', -2.0),
        ('<general name="j" joint="j" biastype="affine" gainprm="3" biasprm="0 -30 -1.5"/>', 10.0),
        ('<pid name="j" joint="j" kp="30" kv="1.5" input="pos"/>', 1.0),
    ],
)
def test_servos_in_other_forms_move_alike(actuator, control):
    expected = run(compile_with(make_spec(), LIMIT), 1.0)
    assert run(compile_with(make_spec(actuator), LIMIT), control) == pytest.approx(expected, abs=1e-4)


def test_with_a_speed_limit_the_profile_is_a_trapezoid():
    goal = run(compile_with(make_spec(), LIMIT, "speed_limit:joint=j,speed=1.5"), 1.0)[:, 1]
    speed = np.diff(goal) / 0.002
    assert speed.max() < 1.04 * 1.5
    assert np.median(speed[150:250]) == pytest.approx(1.5, rel=0.03)
    assert np.abs(np.diff(goal, 2)).max() < 1.001 * 10 * 0.002**2


def test_offset_dead_band_and_limit_of_the_servo_stay():
    effects = (LIMIT, "joint_offset:joint=j,offset=0.1", "deadband:joint=j,half_width=0.03")
    for order in (effects, effects[::-1]):
        model = compile_with(make_spec(), *order)
        data = mujoco.MjData(model)
        data.ctrl[0] = 1.0
        mujoco.mj_step(model, data, 2000)
        assert data.joint("j_deadband_goal").qpos[0] == pytest.approx(1.1, abs=1e-3)
        assert data.joint("j").qpos[0] == pytest.approx(1.1, abs=0.031)
        assert model.jnt_actfrcrange[0] == pytest.approx([-20, 20])


def test_the_lower_of_two_limits_holds_and_another_gain_keeps_it():
    one = run(compile_with(make_spec(), "acceleration_limit:joint=j,acceleration=4"), 1.0)
    for order in ((4, 10), (10, 4)):
        model = compile_with(make_spec(), *(f"acceleration_limit:joint=j,acceleration={a}" for a in order))
        assert run(model, 1.0) == pytest.approx(one, abs=1e-5)
    spec = make_spec()
    add_effects(spec, [parse("acceleration_limit:joint=j,acceleration=4")])
    scale_stiffness(spec, "j", 0.5)
    assert run(spec.compile(), 1.0)[:, 1] == pytest.approx(one[:, 1], abs=1e-4)


@pytest.mark.parametrize(
    ("actuator", "control"),
    [
        ('<velocity name="j" joint="j" kv="0.5" gear="-2"/>', -4.0),
        ('<pid name="j" joint="j" kp="0" kv="2" input="vel"/>', 2.0),
        ('<general name="j" joint="j" biastype="affine" gainprm="2" biasprm="0 0 -2" forcerange="-3 3"/>', 2.0),
    ],
)
def test_the_command_of_a_velocity_servo_becomes_a_ramp(actuator, control):
    for limits in ((4.0,), (4.0, 9.0), (9.0, 4.0)):
        model = compile_with(make_spec(actuator), *(f"acceleration_limit:joint=j,acceleration={a}" for a in limits))
        data, speeds = mujoco.MjData(model), []
        data.ctrl[0] = control
        for _ in range(400):
            mujoco.mj_step(model, data)
            speeds.append(data.qvel[0])
        assert np.diff(speeds[100:200]).mean() / 0.002 == pytest.approx(4.0, rel=0.01)
        assert speeds[-1] == pytest.approx(2.0, rel=0.01)


def test_the_gain_of_a_velocity_servo_with_a_ramp_can_be_changed():
    spec = make_spec('<velocity name="j" joint="j" kv="2" gear="-2"/>')
    add_effects(spec, [parse(LIMIT), parse("servo_damping:joint=j,factor=0.25")])
    changed = mujoco.MjSpec.from_string(spec.to_xml())
    add_effects(changed, [parse("servo_damping:joint=j,factor=2")])
    assert read_servo_damping(spec, "j") == pytest.approx(2.0)
    assert read_servo_damping(changed, "j") == pytest.approx(4.0)
    data = mujoco.MjData(changed.compile())
    data.ctrl[0], data.qfrc_applied[0] = -2.0, 0.4
    mujoco.mj_step(data.model, data, 1000)
    assert data.qvel[0] == pytest.approx(1.0 + 0.4 / 4.0, rel=0.01)


@pytest.mark.parametrize("actuator", [POSITION, '<velocity name="j" joint="j" kv="2"/>'])
def test_an_arm_in_motion_starts_with_its_speed(tmp_path, actuator):
    """The goal, or the commanded speed, begins at the measured speed."""
    file = tmp_path / "arm.xml"
    file.write_text(make_spec(actuator).to_xml())
    robot = Robot(name="arm", mjcf=file, joints=("j",))
    simulator = MujocoSimulator(robot, 0.01, effects=[parse(LIMIT)], threads=1)
    state, command = np.array([[0.3, 1.0]]), np.array([[[0.8 if "position" in actuator else 1.0]]])
    settled = simulator.rollout(state, command, np.full((1, 1), InitialLoad.GRAVITY))[0, 0]
    for ends in (settled, simulator.rollout(state, command)[0, 0], simulator.predict(state, command[:, 0])[0]):
        assert ends == pytest.approx([0.31, 1.0], abs=0.06)


@pytest.mark.parametrize(
    ("actuator", "said"),
    [
        ('<motor name="j" joint="j"/>', "acceleration_limit needs a position servo"),
        ('<intvelocity name="j" joint="j" kp="20" actrange="-9 9"/>', "acceleration_limit needs a position servo"),
        ('<pid name="j" joint="j" kp="3" ki="1"/>', "integral gain"),
    ],
)
def test_other_actuators_are_refused_with_a_sentence(actuator, said):
    with pytest.raises(ModelFileError, match=said):
        compile_with(make_spec(actuator), LIMIT)
