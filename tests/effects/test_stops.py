"""Stops of play yield as their stiffness says, and are rigid without one."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nas_data.effects.base import add_effects, make_effect, parse
from nas_data.mjcf.stop_stiffness import compute_stop_stiffness
from nas_data.simulators.initial_states import InitialLoad
from nas_data.simulators.mujoco import MujocoSimulator

HINGE = '<joint name="j" axis="0 0 1" armature="0.002" damping="0.05"/>'
SLIDE = '<joint name="j" type="slide" axis="0 0 1" armature="0.02" damping="0.5"/>'
ARM = """<mujoco><compiler angle="radian"/><option timestep="{timestep}" integrator="implicitfast" gravity="0 0 0"/>
<worldbody><body>{joint}<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="0.1"/></body></worldbody>
<actuator><position name="j" joint="j" kp="3" kv="0.02"/></actuator></mujoco>"""


def compile_with(*effects: str, joint: str = HINGE, timestep: float = 0.002) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(ARM.format(joint=joint, timestep=timestep))
    add_effects(spec, [parse(effect) for effect in effects])
    return mujoco.MjModel.from_xml_string(spec.to_xml())


def measure_stop(model: mujoco.MjModel, deflection: float) -> float:
    """Return the torque of the stops at a deflection of the play at rest [N·m; N]."""
    data = mujoco.MjData(model)
    data.joint("j_play").qpos[0] = deflection
    mujoco.mj_inverse(model, data)
    return float(data.qfrc_constraint[1])


@pytest.mark.parametrize("joint", [HINGE, SLIDE])
@pytest.mark.parametrize("timestep", [0.0005, 0.002])
@settings(max_examples=6, deadline=None)
@given(stiffness=st.floats(0.5, 2000), half_width=st.floats(0.0, 0.1))
def test_stops_push_back_in_proportion_beyond_the_play(joint, timestep, stiffness, half_width):
    play = f"backlash:joint=j,half_width={half_width},stiffness={stiffness}"
    model = compile_with(play, joint=joint, timestep=timestep)
    for sign in (-1, 1):
        assert measure_stop(model, sign * 0.9 * half_width) == 0
        assert measure_stop(model, sign * (half_width + 0.01)) == pytest.approx(-sign * 0.01 * stiffness, rel=1e-3)
    assert compute_stop_stiffness(model, 1) == pytest.approx(stiffness, rel=1e-4)


def test_stops_are_rigid_without_a_stiffness_and_with_the_largest():
    plain = compile_with("backlash:joint=j,half_width=0.02")
    assert plain.jnt_solref[1] == pytest.approx([0.004, 1.0])
    assert compute_stop_stiffness(plain, 1) == math.inf
    assert np.array_equal(compile_with("backlash:joint=j,half_width=0.02,stiffness=1e6").jnt_solref, plain.jnt_solref)


def test_stops_of_two_plays_yield_in_series():
    one, other = "backlash:joint=j,half_width=0.01,stiffness=3", "backlash:joint=j,half_width=0.02,stiffness=6"
    for order in ((one, other), (other, one)):
        model = compile_with(*order)
        assert model.joint("j_play").range == pytest.approx([-0.03, 0.03])
        assert compute_stop_stiffness(model, 1) == pytest.approx(2.0, rel=1e-3)


def test_the_stiffness_is_optional():
    assert make_effect("backlash", "j", {"half_width": 0.02}).to_json()["parameters"].keys() == {"half_width"}
    yielding = parse("backlash:joint=j,half_width=0.02,stiffness=3")
    assert yielding.to_json()["parameters"].keys() == {"half_width", "stiffness"}


def move(model: mujoco.MjModel, stiffness: float = 0.0, half_width: float = 0.0) -> np.ndarray:
    """Return the link's angle every 2 ms under a sine, with a stop's torque that is computed here."""
    data, angles = mujoco.MjData(model), []
    damping = 2 * np.sqrt(stiffness / model.dof_invweight0[1])
    play, substeps = data.joint("j_play"), round(0.002 / model.opt.timestep)
    for step in range(2000):
        data.ctrl[0] = 0.5 * np.sin(2 * np.pi * step / 1000)
        for _ in range(substeps):
            beyond = play.qpos - np.clip(play.qpos, -half_width, half_width)
            push = np.sign(beyond) * (stiffness * beyond + damping * play.qvel)
            data.qfrc_applied[1] = -(np.sign(beyond) * np.maximum(push, 0))[0]  # a stop never pulls
            mujoco.mj_step(model, data)
        angles.append(data.qpos.sum())
    return np.array(angles)


@pytest.mark.parametrize("stiffness", [6.0, 60.0])
def test_yielding_stops_move_as_their_equation_says(stiffness):
    """Torque = stiffness · deflection beyond the play + critical damping · its speed."""
    yielding = compile_with(f"backlash:joint=j,half_width=0.03,stiffness={stiffness}", timestep=0.0001)
    rigid, free = (compile_with("backlash:joint=j,half_width=0.03", timestep=0.0001) for _ in range(2))
    free.jnt_limited[1] = False
    expected = move(free, stiffness, 0.03)
    errors = [np.sqrt(np.mean((move(model) - expected) ** 2)) for model in (yielding, rigid)]
    assert errors[0] < 0.01 * errors[1]


def test_an_arm_that_leans_on_yielding_stops_stays_there():
    play = parse("backlash:joint=m3,half_width=0.05,stiffness=1.5")
    sim = MujocoSimulator.load("ergojr", 0.01, effects=[play])
    pose = np.array([0.2, 0.6, -0.4, 0.1, 0.5, -0.3])
    state = np.concatenate([pose, np.zeros(6)])[None]
    data = mujoco.MjData(sim.model)
    data.qpos[sim.layout.qpos] = pose
    mujoco.mj_forward(sim.model, data)
    load = data.qfrc_bias[sim.layout.dof]
    held = pose + load / 0.336
    held[2] += np.sign(load[2]) * (0.05 + abs(load[2]) / 1.5)
    moved = sim.rollout(state, np.tile(held, (1, 50, 1)), np.full((1, 6), InitialLoad.GRAVITY))[0, :, :6]
    assert np.abs(moved - pose).max() < 2e-3
