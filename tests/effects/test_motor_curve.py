"""The torque limit that falls with speed, against the same servo written down at a fine step."""

import math

import mujoco
import numpy as np
import pytest

from nas_data.effects.base import Scales, add_effects, parse

TIMESTEP, FINE, INERTIA = 0.002, 2e-5, 0.01
ARM = """<mujoco><compiler angle="radian" autolimits="true"/>
<option timestep="0.002" integrator="{integrator}" gravity="0 0 0"/>
<worldbody><body><joint name="j" type="{kind}" axis="0 0 1"/>
<inertial pos="0 0 0" mass="0.01" diaginertia="0.01 0.01 0.01"/></body></worldbody>
<actuator>{actuator}</actuator></mujoco>"""
STALL, NO_LOAD = 0.3, 4.0
CURVE = f"motor_curve:joint=j,stall_torque={STALL},no_load_speed={NO_LOAD}"
BAND = "deadband:joint=j,half_width=0.01"
SERVOS = {
    "position": ('<position joint="j" kp="3" kv="0.02" forcerange="-9 9"/>', lambda u, q, v: 3 * (u - q) - 0.02 * v),
    "geared": ('<position joint="j" kp="0.75" gear="-2"/>', lambda u, q, v: -2 * 0.75 * (u + 2 * q)),
    "pid": ('<pid joint="j" kp="3" kv="0.1" input="pos"/>', lambda u, q, v: 3 * (u - q) - 0.1 * v),
    "velocity": ('<velocity joint="j" kv="0.5"/>', lambda u, q, v: 0.5 * (u - v)),
    "motor": ('<motor joint="j"/>', lambda u, q, v: u),
}


def model_of(servo: str, *effects: str, integrator: str = "implicitfast", kind: str = "hinge") -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(ARM.format(actuator=SERVOS[servo][0], integrator=integrator, kind=kind))
    add_effects(spec, [parse(effect) for effect in effects])
    spec.compile()
    return mujoco.MjModel.from_xml_string(spec.to_xml())


def move(model: mujoco.MjModel, controls: np.ndarray) -> np.ndarray:
    """Return positions [rad; m] after each physics step."""
    data, places = mujoco.MjData(model), []
    for control in controls:
        data.ctrl[0] = control
        mujoco.mj_step(model, data)
        places.append(data.qpos[0])
    return np.array(places)


def move_written_down(servo: str, controls: np.ndarray, highest: float = math.inf) -> np.ndarray:
    """Return the same from the equation of the effect, with a torque limit below the stall torque [N·m]."""
    q, v, slope, places = 0.0, 0.0, STALL / NO_LOAD, []
    for control in controls:
        for _ in range(round(TIMESTEP / FINE)):
            torque = SERVOS[servo][1](control, q, v)
            low, high = -STALL - slope * min(v, 0.0), STALL - slope * max(v, 0.0)
            v += FINE * min(max(torque, low, -highest), high, highest) / INERTIA
            q += FINE * v
        places.append(q)
    return np.array(places)


def steps(servo: str, size: float) -> np.ndarray:
    """Return a command that reverses while the joint is fast, so that the servo also brakes at its limit."""
    gear = -2.0 if servo == "geared" else 1.0
    return gear * size * np.repeat([1.0, -1.0, 0.3], 200)


@pytest.mark.parametrize("kind", ["hinge", "slide"])
@pytest.mark.parametrize("integrator", ["implicitfast", "Euler"])
@pytest.mark.parametrize("servo", SERVOS)
def test_the_torque_falls_with_speed_and_brakes_in_full(servo, integrator, kind):
    controls = steps(servo, 3.0)
    written = move_written_down(servo, controls)
    free = move(model_of(servo, integrator=integrator, kind=kind), controls)
    curved = move(model_of(servo, CURVE, integrator=integrator, kind=kind), controls)
    assert np.abs(free - written).max() > 0.2
    assert np.abs(curved - written).max() < 0.02 * np.ptp(written)


@pytest.mark.parametrize("integrator", ["implicitfast", "implicit", "Euler", "RK4"])
@pytest.mark.parametrize("servo", SERVOS)
def test_below_the_limit_the_servo_is_unchanged(servo, integrator):
    controls = steps(servo, 0.02)
    plain, curved = (move(model_of(servo, *effects, integrator=integrator), controls) for effects in ((), (CURVE,)))
    assert np.abs(plain).max() > 0.005
    assert curved == pytest.approx(plain, abs=1e-12)


@pytest.mark.parametrize("order", [1, -1])
def test_a_torque_limit_below_the_stall_torque_cuts_the_curve(order):
    effects = (CURVE, "torque_limit:joint=j,torque=0.2")[::order]
    controls = steps("position", 3.0)
    written = move_written_down("position", controls, highest=0.2)
    assert np.abs(move(model_of("position", *effects), controls) - written).max() < 0.02 * np.ptp(written)


def test_the_curve_of_a_model_is_replaced():
    other = "motor_curve:joint=j,stall_torque=0.1,no_load_speed=9"
    once, twice = model_of("position", CURVE), model_of("position", other, CURVE)
    assert twice.nactuator == once.nactuator == 2
    for field in ("actuator_forcerange", "actuator_biasprm", "jnt_actfrcrange", "tendon_damping"):
        assert np.array_equal(getattr(once, field), getattr(twice, field))


def test_a_servo_with_a_dead_band_has_the_curve_in_either_order():
    ends = []
    for effects in ((CURVE, BAND), (BAND, CURVE)):
        spec = mujoco.MjSpec.from_string(ARM.format(actuator=SERVOS["position"][0], integrator="Euler", kind="hinge"))
        for effect in effects:
            add_effects(spec, [parse(effect)])
        ends.append(move(spec.compile(), np.full(400, 30.0)))
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    assert np.diff(ends[0])[-1] / TIMESTEP == pytest.approx(NO_LOAD, rel=0.01)


def test_guesses_and_vanishing_sizes_follow_the_joint():
    scales = Scales(*np.ones(4), torque=2.0, speed=3.0)
    guesses = parse(CURVE).guesses(scales)
    assert {guess["stall_torque"] for guess in guesses} == {1.0, 2.0}
    assert min(guess["no_load_speed"] for guess in guesses) > 3
