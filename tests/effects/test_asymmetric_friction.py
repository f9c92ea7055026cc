"""Friction that differs by direction: what it holds, and how fast it stops a joint."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nas_data.effects.base import Scales, add_effects, parse

ARM = """<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast" gravity="0 0 0"/>
<worldbody><body><joint name="j" type="{kind}" axis="0 0 1"/>
<inertial pos="0 0 0" mass="0.01" diaginertia="0.01 0.01 0.01"/></body></worldbody>
<actuator>{actuator}</actuator></mujoco>"""
MOTOR = '<motor joint="j"/>'


def model_of(torque: float, difference: float, kind: str = "hinge", actuator: str = MOTOR) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(ARM.format(kind=kind, actuator=actuator))
    add_effects(spec, [parse(f"asymmetric_friction:joint=j,torque={torque},difference={difference}")])
    return spec.compile()


def speed_after(model: mujoco.MjModel, load: float, speed: float = 0.0, seconds: float = 0.1) -> float:
    """Return the speed [rad/s; m/s] some time after a speed, under a load [N·m; N]."""
    data = mujoco.MjData(model)
    data.qvel[0], data.qfrc_applied[0] = speed, load
    mujoco.mj_step(model, data, round(seconds / model.opt.timestep))
    return float(data.qvel[0])


@pytest.mark.parametrize("kind", ["hinge", "slide"])
@settings(max_examples=10, deadline=None)
@given(torque=st.floats(0.05, 0.5), share=st.floats(-0.9, 0.9))
def test_each_direction_has_its_own_friction(kind, torque, share):
    model = model_of(torque, share * torque, kind)
    highest, lowest = torque * (1 + share), -torque * (1 - share)
    for load, moves in ((0.0, False), (0.95 * highest, False), (0.95 * lowest, False)):
        assert (abs(speed_after(model, load)) > 0.01) == moves
    # beyond its friction the joint accelerates by the excess over the inertia, 0.01
    assert speed_after(model, highest + 0.1) == pytest.approx(1.0, rel=0.05)
    assert speed_after(model, lowest - 0.1) == pytest.approx(-1.0, rel=0.05)


def test_the_slower_direction_is_the_one_of_more_friction():
    model = model_of(0.1, 0.05)
    assert speed_after(model, 0.0, 3.0) == pytest.approx(3 - 0.15 * 0.1 / 0.01, rel=0.02)
    assert speed_after(model, 0.0, -3.0) == pytest.approx(-3 + 0.05 * 0.1 / 0.01, rel=0.02)


@pytest.mark.parametrize("difference", [-0.5, 0.5])
def test_a_joint_at_rest_is_never_pushed(difference):
    assert speed_after(model_of(0.1, difference), 0.0, seconds=1.0) == pytest.approx(0.0, abs=1e-3)


def test_it_is_named_only_where_no_offset_is_its_equal():
    friction = parse("asymmetric_friction:joint=j,torque=0.1,difference=0.05")
    assert friction.has_preferred_equivalent(Scales(*np.ones(6), position_servo=True))
    assert not friction.has_preferred_equivalent(Scales(*np.ones(6)))


def test_at_a_position_servo_it_is_dry_friction_and_an_offset():
    servo = '<position joint="j" kp="2" kv="0.05"/>'
    spec = mujoco.MjSpec.from_string(ARM.format(kind="hinge", actuator=servo))
    add_effects(spec, [parse("coulomb_friction:joint=j,torque=0.1"), parse("joint_offset:joint=j,offset=-0.02")])
    ends = []
    for model in (model_of(0.1, 0.04, actuator=servo), spec.compile()):
        data, places = mujoco.MjData(model), []
        for command in np.repeat([0.5, -0.4, 0.1], 300):
            data.ctrl[0] = command
            mujoco.mj_step(model, data)
            places.append(data.qpos[0])
        ends.append(places)
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)


def test_an_offset_lists_it_as_an_equal_of_the_same_torque():
    (twin,) = parse("joint_offset:joint=j,offset=-0.02").equivalents(Scales(2.0, *np.ones(5)))
    assert (twin.name(), twin.joint, twin.difference) == ("asymmetric_friction", "j", 0.04)
    assert twin.torque > twin.difference
    assert not parse("joint_offset:joint=j,offset=0").equivalents(Scales(*np.ones(6)))
