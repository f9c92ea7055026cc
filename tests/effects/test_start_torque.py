"""A servo with a start torque gives the torque of its equation, with and without a dead band."""

import mujoco
import numpy as np
import pytest

from nas_data.effects.base import add_effects, parse
from nas_data.effects.edits.servo import read_band, scale_stiffness
from nas_data.errors import ModelFileError

ARM = """<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="{integrator}" gravity="0 0 0"/>
<worldbody><body><joint name="j" type="{kind}" axis="0 0 1" damping="0.05" frictionloss="{friction}" armature="0.002"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="0.1"/></body></worldbody>
<actuator>{actuator}</actuator></mujoco>"""
POSITION = '<position name="j" joint="j" kp="3" kv="0.02" forcerange="-1.5 1.5"/>'
START, BAND = "start_torque:joint=j,torque=0.2", "deadband:joint=j,half_width=0.02"


def make_spec(actuator: str = POSITION, kind: str = "hinge", integrator: str = "implicitfast", friction: float = 0.0):
    return mujoco.MjSpec.from_string(ARM.format(actuator=actuator, kind=kind, integrator=integrator, friction=friction))


def compile_with(spec: mujoco.MjSpec, *effects: str) -> mujoco.MjModel:
    add_effects(spec, [parse(effect) for effect in effects])
    return mujoco.MjModel.from_xml_string(spec.to_xml())


def measure_torque(model: mujoco.MjModel, error: float) -> float:
    """Return the servo's torque [N·m; N] at rest at a position error [rad; m], its goal at zero."""
    data = mujoco.MjData(model)
    data.joint("j").qpos[0] = -error
    mujoco.mj_forward(model, data)
    return float(data.joint("j").qfrc_actuator[0])


@pytest.mark.parametrize("kind", ["hinge", "slide"])
@pytest.mark.parametrize(
    "actuator",
    [
        POSITION,
        '<position name="j" joint="j" kp="0.75" kv="0.005" gear="-2" forcerange="-0.75 0.75"/>',
        '<general name="j" joint="j" biastype="affine" gainprm="0.3" biasprm="0 -3 -0.02" forcerange="-1.5 1.5"/>',
        '<pid name="j" joint="j" kp="3" kv="0.02" input="pos" forcerange="-1.5 1.5"/>',
    ],
)
@pytest.mark.parametrize("width", [0.0, 0.02])
def test_the_torque_at_rest_is_that_of_the_equation(actuator, kind, width):
    model = compile_with(make_spec(actuator, kind), START, *([BAND] if width else []))
    for error in (-0.9, -0.1, -0.01, 0.0, 0.03, 0.2, 0.8):
        beyond = np.sign(error) * max(abs(error) - width, 0.0)
        expected = np.sign(beyond) * min(max(3 * abs(beyond), 0.2), 1.5)
        assert measure_torque(model, error) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_a_start_torque_moves_as_its_equation_says(integrator):
    """torque = sign(e) · max(kp · |e|, torque) − kv · dq/dt, computed here before every physics step of 0.1 ms."""
    spec = make_spec(integrator=integrator, friction=0.05)
    plain, edited = spec.compile(), compile_with(spec, START)
    plain.opt.timestep = 1e-4
    runs = []
    for model, torque in ((plain, 0.0), (plain, 0.2), (edited, 0.0)):
        data, positions = mujoco.MjData(model), []
        for step in range(1500):
            goal = 0.4 * np.sin(4 * step * 0.002)
            for _ in range(round(0.002 / model.opt.timestep)):
                error = goal - data.joint("j").qpos[0]
                data.ctrl[0] = goal + np.sign(error) * max(torque / 3 - abs(error), 0.0) if torque else goal
                mujoco.mj_step(model, data)
            positions.append(data.joint("j").qpos[0])
        runs.append(np.array(positions))
    without, exact, found = runs
    assert np.sqrt(np.mean((found - exact) ** 2)) < 0.1 * np.sqrt(np.mean((without - exact) ** 2))


def test_effects_of_one_servo_are_the_same_in_any_order():
    models = [compile_with(make_spec(), *order) for order in ((START, BAND), (BAND, START))]
    for error in (0.01, 0.03, 0.2):
        assert measure_torque(models[0], error) == pytest.approx(measure_torque(models[1], error), abs=1e-6)
    twice = compile_with(make_spec(), START, "start_torque:joint=j,torque=0.1")
    assert measure_torque(twice, 0.01) == pytest.approx(0.2, abs=1e-3)


def test_another_gain_changes_neither_start_torque_nor_band():
    spec = make_spec()
    add_effects(spec, [parse(START), parse(BAND)])
    scale_stiffness(spec, "j", 2.0)
    assert read_band(spec, "j") == pytest.approx((0.02, 0.2))
    model = spec.compile()
    assert [measure_torque(model, error) for error in (0.01, 0.03, 0.12)] == pytest.approx([0.0, 0.2, 0.6], abs=1e-3)


@pytest.mark.parametrize(
    ("actuator", "said"),
    [
        ('<motor name="j" joint="j"/>', "start_torque needs a position servo"),
        ('<velocity name="j" joint="j" kv="1"/>', "start_torque needs a position servo"),
        ('<pid name="j" joint="j" kp="3" ki="1"/>', "integral gain"),
    ],
)
def test_other_actuators_are_refused_with_a_sentence(actuator, said):
    with pytest.raises(ModelFileError, match=said):
        compile_with(make_spec(actuator), START)
