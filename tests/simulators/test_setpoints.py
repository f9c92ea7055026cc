"""Servos whose setpoint moves at the commanded speed: where it begins is not measured."""

import mujoco
import numpy as np
import pytest

import nas_data as nas
from nas_data.open_loop import roll_out_source
from nas_data.simulators.mujoco import MujocoSimulator

ARM = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body pos="0 0 .5"><joint name="j" axis="0 1 0" damping=".05" armature=".004"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".01" mass=".15" contype="0" conaffinity="0"/><body pos=".2 0 0">
<joint name="g" type="slide" axis="0 0 1" damping="2"/>
<geom type="box" size=".02 .02 .02" mass=".1" contype="0" conaffinity="0"/></body></body></worldbody><actuator>
<intvelocity name="j" joint="j" kp="4" kv=".1" gear="-2" actrange="-9 9"/>
<intvelocity name="g" joint="g" kp="300" kv="6" actrange="-1 1"/></actuator></mujoco>"""


@pytest.fixture
def simulator(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    return MujocoSimulator.load(tmp_path / "arm.xml", 0.02)


def test_an_arm_that_has_settled_stays_where_it_is_and_a_fresh_one_sinks(simulator):
    initial = np.array([[0.0, 0.0, 0.0, 0.0], [0.8, 0.02, 0.0, 0.0], [-1.0, -0.03, 0.0, 0.0]])
    still = np.zeros((3, 100, 2))
    settled, fresh = simulator.rollout_settled(initial, still), simulator.rollout(initial, still)
    assert np.abs(settled - initial[:, None])[..., :2].max() < 1e-4
    assert (np.abs(fresh[:, -1] - initial)[:, :2] > [5e-3, 1e-3]).all()


def test_at_a_constant_speed_the_setpoint_leads_by_the_damping(simulator):
    speed = np.array([0.5, 0.05])
    initial, commands = np.array([[0.0, 0.0, *speed]]), np.broadcast_to(speed, (1, 10, 2))
    travelled = simulator.rollout_settled(initial, commands)[0, :, :2] / (0.02 * np.arange(1, 11))[:, None]
    assert travelled == pytest.approx(np.broadcast_to(speed, (10, 2)), rel=0.05)


@pytest.mark.parametrize("wait", [0, 400])
def test_the_recording_shows_where_setpoints_began(wait, simulator):
    model, positions = simulator.model, []
    rows = np.sin(0.1 * np.arange(100))[:, None] * [0.4, 0.05] * (np.arange(100) > 20)[:, None]
    for start in (0.0, 0.5):
        data = mujoco.MjData(model)
        data.qpos[:] = start, 0.02 * start
        data.act[:] = -2 * start, 0.02 * start
        mujoco.mj_step(model, data, wait)
        begun = [data.qpos.copy()]
        for row in rows:
            data.ctrl[:] = simulator.layout.controls(row)
            mujoco.mj_step(model, data, 10)
            begun.append(data.qpos.copy())
        positions.append(np.array(begun))
    made = nas.Dataset.from_arrays(positions, [rows, rows], rate=50, joints=("j", "g"), slides=("g",), kind="velocity")
    for states, measured in zip(roll_out_source(made, simulator), positions, strict=True):
        assert np.abs(states[20:, :2] - measured[21:]).max() < 1e-4  # derived initial velocities have faded
