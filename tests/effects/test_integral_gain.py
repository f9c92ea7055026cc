"""The integral part of a servo: what it adds, where it is refused, and where it starts."""

import mujoco
import numpy as np
import pytest

from nas_data.effects.base import add_effects, parse
from nas_data.errors import ModelFileError
from nas_data.simulators.initial_states import InitialLoad
from nas_data.simulators.mujoco import MujocoSimulator

TIMESTEP, FINE, INERTIA, LOAD = 0.002, 2e-5, 0.01, 0.4
ARM = """<mujoco><compiler angle="radian" autolimits="true"/>
<option timestep="0.002" integrator="implicitfast" gravity="0 0 {gravity}"/>
<worldbody><body><joint name="j" type="{kind}" axis="0 -1 0" damping="0.05"/>
<inertial pos="0.1 0 0" mass="0.4" diaginertia="0.006 0.006 0.006"/></body></worldbody>
<actuator>{actuator}</actuator><sensor><jointpos name="j.pos" joint="j"/></sensor></mujoco>"""
CURVE = "motor_curve:joint=j,stall_torque=0.5,no_load_speed=5"
SERVO = '<position name="j" joint="j" kp="2" kv="0.1"/>'
SERVOS = {
    "position": SERVO,
    "geared": '<position name="j" joint="j" kp="0.5" kv="0.025" gear="2"/>',
    "pid": '<pid name="j" joint="j" kp="2" kv="0.1" input="pos"/>',
    "slewed": '<pid name="j" joint="j" kp="2" kv="0.1" slewmax="1000" input="pos"/>',
    "own unit": '<general name="j" joint="j" gainprm="0.2" biastype="affine" biasprm="0 -2 -0.1"/>',
    "half of it": '<pid name="j" joint="j" kp="2" kv="0.1" ki="1.5" input="pos"/>',
}
PER_RADIAN = {"geared": 2.0, "own unit": 10.0}  # control per command


def spec_of(actuator: str, *effects: str, gravity: float = 0.0, kind: str = "hinge") -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(ARM.format(actuator=actuator, gravity=gravity, kind=kind))
    add_effects(spec, [parse(effect) for effect in effects])
    spec.compile()
    return spec


def move(model: mujoco.MjModel, commands: np.ndarray, load: float = 0.0) -> np.ndarray:
    data, places = mujoco.MjData(model), []
    data.qfrc_applied[0] = load
    for command in commands:
        data.ctrl[0] = command
        mujoco.mj_step(model, data)
        places.append(data.qpos[0])
    return np.array(places)


def move_written_down(commands: np.ndarray, gain: float, load: float) -> np.ndarray:
    """Return positions from the equation of the effect."""
    q, v, integral, places = 0.0, 0.0, 0.0, []
    for command in commands:
        for _ in range(round(TIMESTEP / FINE)):
            error = command - q
            integral += FINE * error
            v += FINE * (2 * error + gain * integral - 0.15 * v + load) / INERTIA
            q += FINE * v
        places.append(q)
    return np.array(places)


@pytest.mark.parametrize("name", SERVOS)
def test_the_integral_of_the_error_is_added(name):
    commands = np.repeat([0.5, -0.2], 500)
    gain = 1.5 if name == "half of it" else 3.0
    model = mujoco.MjModel.from_xml_string(spec_of(SERVOS[name], f"integral_gain:joint=j,gain={gain}").to_xml())
    moved = move(model, PER_RADIAN.get(name, 1.0) * commands, LOAD)
    written = move_written_down(commands, 3.0, LOAD)
    assert np.abs(moved - move_written_down(commands, 0.0, LOAD)).max() > 0.1
    assert moved == pytest.approx(written, abs=0.01)


@pytest.mark.parametrize(
    "effect", ["torque_limit:joint=j,torque=0.5", "motor_curve:joint=j,stall_torque=0.5,no_load_speed=5"]
)
@pytest.mark.parametrize("order", [1, -1])
def test_the_integral_stops_at_the_torque_limit(effect, order):
    model = spec_of(SERVO, *(effect, "integral_gain:joint=j,gain=3")[::order]).compile()
    data = mujoco.MjData(model)
    data.ctrl[0], data.qfrc_applied[0] = 0.0, 5.0
    mujoco.mj_step(model, data, 2000)
    assert 3 * abs(data.act[0]) == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("order", [1, -1])
def test_a_speed_limit_slows_the_setpoint_of_which_the_error_is_integrated(order):
    effects = ("speed_limit:joint=j,speed=0.5", "integral_gain:joint=j,gain=3")[::order]
    model = mujoco.MjModel.from_xml_string(spec_of(SERVO, *effects).to_xml())
    moved = move(model, np.full(2500, 1.0))
    assert np.diff(moved)[400:800] / TIMESTEP == pytest.approx(0.5, rel=0.1)
    assert moved[-1] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    ("actuator", "reason"),
    [
        ('<motor name="j" joint="j"/>', "needs a position servo"),
        ('<velocity name="j" joint="j" kv="1"/>', "needs a position servo"),
        ('<intvelocity name="j" joint="j" kp="2" actrange="-9 9"/>', "needs a position servo"),
        ('<position name="j" joint="j" kp="2" timeconst="0.1"/>', "filters its command"),
        (
            '<general name="j" joint="j" gainprm="0.2" biastype="affine" biasprm="-1 -2 -0.1"/>',
            "a zero of its own; give a model",
        ),
    ],
)
def test_servos_that_cannot_have_an_integral_are_refused_with_a_sentence(actuator, reason):
    with pytest.raises(ModelFileError, match=reason):
        spec_of(actuator, "integral_gain:joint=j,gain=1")


@pytest.mark.parametrize(
    ("goal", "reason"),
    [("deadband:joint=j,half_width=0.02", "has a dead band"), ("acceleration_limit:joint=j,acceleration=9", "profile")],
)
def test_a_goal_joint_and_an_integral_refuse_each_other(goal, reason):
    integral = "integral_gain:joint=j,gain=1"
    with pytest.raises(ModelFileError, match="integral gain"):
        spec_of(SERVO, integral, goal)
    with pytest.raises(ModelFileError, match=reason):
        add_effects(spec_of(SERVO, goal), [parse(integral)])


@pytest.mark.parametrize("kind", ["hinge", "slide"])
@pytest.mark.parametrize("start", ["rest", "settled"])
@pytest.mark.parametrize("actuator", [SERVOS["half of it"], SERVO, SERVOS["geared"]])
def test_an_arm_at_rest_stays_there(actuator, start, kind, tmp_path):
    """Its integral holds the weight from the start, in rollouts and in one-step predictions."""
    path = tmp_path / "arm.xml"
    path.write_text(spec_of(actuator, gravity=-9.81 if kind == "hinge" else 0.0, kind=kind).to_xml())
    arm = MujocoSimulator.load(path, 0.02, effects=[parse("integral_gain:joint=j,gain=4")], threads=1)
    states, commands = np.array([[0.3, 0.0], [-0.5, 0.0]]), np.repeat([[[0.3]], [[-0.5]]], 100, axis=1)
    loads = None if start == "rest" else np.full((2, 1), InitialLoad.GRAVITY)
    rolled = arm.rollout(states, commands, loads)
    assert rolled[..., 0] == pytest.approx(commands[..., 0], abs=1e-3)
    stepped = arm.predict(np.repeat(states, 5, axis=0), np.repeat(commands[:, 0], 5, axis=0), np.arange(10) % 5 > 0)
    assert stepped[:, 0] == pytest.approx(np.repeat([0.3, -0.5], 5), abs=1e-4)


def test_one_step_predictions_pass_the_integral_on(tmp_path):
    """From a motion's own states they follow the motion."""
    path = tmp_path / "arm.xml"
    path.write_text(spec_of(SERVOS["half of it"], gravity=-9.81).to_xml())
    arm = MujocoSimulator.load(path, 0.02, threads=1)
    commands = np.repeat([0.6, -0.3, 0.2], 50)[None, :, None]
    rolled = arm.rollout(np.zeros((1, 2)), commands)[0]
    before = np.concatenate([np.zeros((1, 2)), rolled[:-1]])
    stepped = arm.predict(before, commands[0], np.arange(len(before)) > 0)
    assert stepped == pytest.approx(rolled, abs=1e-9)
