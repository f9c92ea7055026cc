"""Effects on servos that are commanded a speed."""

import mujoco
import numpy as np
import pytest

from nas_data.effects.base import Scales, add_effects, find_effect, parse
from nas_data.errors import ModelFileError

ARM = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body><joint name="j" axis="0 0 1" armature="0.01"/><geom size="0.05" pos="0.1 0 0"/></body></worldbody>
<actuator>{}</actuator></mujoco>"""
VELOCITY = '<velocity joint="j" kv="0.5" gear="-2"/>'
PID = '<pid joint="j" kp="0" kv="0.5" input="vel"/>'
SETPOINT = '<intvelocity joint="j" kp="20" kv="1" actrange="-9 9"/>'
MOTOR = '<motor joint="j"/>'


def model_of(actuator: str, *effects: str) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(ARM.format(actuator))
    add_effects(spec, [parse(effect) for effect in effects])
    return spec.compile()


def reached_speed(model: mujoco.MjModel, control: float, load: float = 0.0) -> float:
    """Return the speed [rad/s] after a second at a control, under a torque [N·m]."""
    data = mujoco.MjData(model)
    data.ctrl[0], data.qfrc_applied[0] = control, load
    mujoco.mj_step(model, data, 500)
    return float(data.qvel[0])


@pytest.mark.parametrize(("actuator", "gear"), [(VELOCITY, -2.0), (PID, 1.0)])
def test_the_gain_of_a_velocity_servo_changes_what_it_holds_and_not_its_target(actuator, gear):
    """The stationary speed under a load is command + load / gain."""
    weak = model_of(actuator, "servo_damping:joint=j,factor=0.25")
    gain = 0.25 * 0.5 * gear**2
    assert reached_speed(weak, gear * 0.8) == pytest.approx(0.8, rel=0.01)
    assert reached_speed(weak, gear * 0.8, load=0.05) == pytest.approx(0.8 + 0.05 / gain, rel=0.01)


def test_gain_and_damping_of_a_servo_that_integrates_its_command_are_factors():
    before, after = model_of(SETPOINT), model_of(SETPOINT, "servo_stiffness:joint=j,factor=0.3")
    damped = model_of(SETPOINT, "servo_damping:joint=j,factor=0.5")
    assert after.actuator_biasprm[0, 1] == pytest.approx(0.3 * before.actuator_biasprm[0, 1])
    assert after.actuator_gainprm[0, 0] == pytest.approx(0.3 * before.actuator_gainprm[0, 0])
    assert damped.actuator_biasprm[0, 2] == pytest.approx(0.5 * before.actuator_biasprm[0, 2])


@pytest.mark.parametrize(("actuator", "gear"), [(VELOCITY, -2.0), (PID, 1.0), (SETPOINT, 1.0)])
def test_a_speed_limit_clips_the_target_of_a_speed_command(actuator, gear):
    limited = model_of(actuator, "speed_limit:joint=j,speed=0.6")
    assert [reached_speed(limited, gear * asked) for asked in (0.3, 2.0, -2.0)] == pytest.approx(
        [0.3, 0.6, -0.6], rel=0.05
    )


def test_the_narrower_of_two_speed_limits_holds():
    ranged = VELOCITY.replace("/>", ' ctrlrange="-1 0.4"/>')
    assert model_of(ranged, "speed_limit:joint=j,speed=0.3").actuator_ctrlrange[0] == pytest.approx([-0.6, 0.4])
    twice = model_of(VELOCITY, "speed_limit:joint=j,speed=0.5", "speed_limit:joint=j,speed=0.3")
    assert twice.actuator_ctrlrange[0] == pytest.approx([-0.6, 0.6])


@pytest.mark.parametrize("name", ["servo_stiffness:joint=j,factor=0.5", "servo_damping:joint=j,factor=0.5"])
def test_a_motor_has_no_gain_to_change(name):
    with pytest.raises(ModelFileError, match=r"needs a position servo, but .*<intvelocity>"):
        model_of(MOTOR, name)


def test_a_larger_gain_is_viscous_friction_at_a_position_servo_only():
    damping = find_effect("servo_damping")
    position = Scales(*np.ones(7))
    velocity = Scales(*np.ones(7), velocity_servo=True)
    larger = parse("servo_damping:joint=j,factor=3")
    assert larger.has_preferred_equivalent(position) and not larger.has_preferred_equivalent(velocity)
    assert max(guess["factor"] for guess in damping.guesses(position)) < 1
    assert max(guess["factor"] for guess in damping.guesses(velocity)) > 3
