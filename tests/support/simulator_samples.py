"""Small models for the tests, and the plain Python loop over `mj_step` that batched simulation must equal."""

import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from nas_data.robots.base import find_robot
from nas_data.simulators.engines import ENGINES

SO101 = Path(__file__).parents[3] / "shared/realdata/sage_so101/model/so101_new_calib_nomesh.xml"
needs_so101 = pytest.mark.skipif(not SO101.is_file(), reason="the SO-101 model of ../shared/realdata is absent")
EACH_ENGINE = [pytest.param(name, marks=[pytest.mark.bullet] if name == "bullet" else []) for name in ENGINES]


@cache
def damped_ergojr() -> Path:
    """The ErgoJr with servos that have velocity feedback."""
    text = find_robot("ergojr").mjcf.read_text(encoding="utf-8")
    path = Path(tempfile.mkdtemp()) / "damped.xml"
    path.write_text(text.replace('kp="0.3360"', 'kp="0.3360" kv="0.05"'), encoding="utf-8")
    return path


@cache
def so101_without_floor() -> Path:
    """The SO-101 of the package, which can reach below its base."""
    spec = find_robot("so101_follower").spec()
    spec.delete(spec.geom("floor"))
    path = Path(tempfile.mkdtemp()) / "so101.xml"
    spec.compile()
    path.write_text(spec.to_xml(), encoding="utf-8")
    return path


# an arm that falls onto the floor and pushes a free ball
CONTACTS = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <body pos="0 0 0.12">
      <joint name="shoulder" axis="0 1 0" damping="0.01"/>
      <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.02" mass="0.1"/>
      <body pos="0.1 0 0">
        <joint name="elbow" axis="0 1 0" damping="0.01"/>
        <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.02" mass="0.1"/>
      </body>
    </body>
    <body pos="0.2 0 0.02"><freejoint/><geom type="sphere" size="0.02" mass="0.02"/></body>
  </worldbody>
  <actuator>
    <position name="servo1" joint="shoulder" kp="2" kv="0.05"/>
    <position name="servo2" joint="elbow" kp="2" kv="0.05"/>
  </actuator>
</mujoco>
"""

# the sum of a servo's joint and its play is measured, as the effect of backlash leaves it
PLAY = """
<mujoco>
  <compiler angle="radian"/>
  <option integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="j" axis="0 1 0" armature="0.001" damping="0.02"/>
      <joint name="j_play" axis="0 1 0" range="-0.05 0.05" limited="true" armature="0.0001" damping="0.001"/>
      <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.1"/>
      <site name="end" pos="0.1 0 0"/>
    </body>
  </worldbody>
  <tendon><fixed name="link"><joint joint="j" coef="1"/><joint joint="j_play" coef="1"/></fixed></tendon>
  <actuator><position name="servo" joint="j" kp="2"/></actuator>
  <sensor><tendonpos name="j.pos" tendon="link"/></sensor>
</mujoco>
"""

# no gravity: a servo whose goal slews at 1 rad/s and hears its commands 30 ms late
SLOW_DEAF = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 0" integrator="implicitfast" timestep="0.002"/>
  <worldbody>
    <body>
      <joint name="a" axis="0 1 0" armature="0.001"/>
      <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.02"/>
      <body pos="0.1 0 0">
        <joint name="b" axis="0 0 1" armature="0.001"/>
        <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.02"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <pid name="a" joint="a" kp="4" kv="0.15" slewmax="1" input="pos" delay="0.03" nsample="16" interp="linear"/>
    <position name="b" joint="b" kp="4" kv="0.15" delay="0.03" nsample="16" interp="linear"/>
  </actuator>
</mujoco>
"""

# three joints in one plane; the gripper rests at 0.4 rad and no dataset need know it
GRIPPER = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 0" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="a" axis="0 1 0" armature="0.01"/>
      <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.1"/>
      <body pos="0.1 0 0">
        <joint name="b" axis="0 0 1" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.1"/>
        <body pos="0.1 0 0">
          <joint name="gripper" axis="1 0 0" armature="0.01" ref="0.4"/>
          <geom type="capsule" fromto="0 0 0 0.03 0 0" size="0.01" mass="0.01"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a" joint="a" kp="2" kv="0.1"/>
    <position name="gripper" joint="gripper" kp="2" kv="0.1"/>
    <position name="b" joint="b" kp="2" kv="0.1"/>
  </actuator>
</mujoco>
"""

# two fingers that close on each other; only the second one, which follows the first, meets the post
COUPLED_FINGERS = """
<mujoco>
  <compiler autolimits="true"/>
  <option integrator="implicitfast"/>
  <default><joint type="slide" range="0 0.08" damping="2"/></default>
  <worldbody>
    <geom name="post" type="box" pos="0 0 -0.03" size="0.01 0.01 0.01"/>
    <body name="first" pos="0 0 0.1"><joint name="finger" axis="0 0 -1"/><geom size="0.01" mass="0.1"/></body>
    <body name="second" pos="0 0 -0.1"><joint name="other" axis="0 0 1"/><geom size="0.01" mass="0.3"/></body>
  </worldbody>
  <equality><joint joint1="other" joint2="finger"/></equality>
  <actuator><position name="finger" joint="finger" kp="200" kv="5" inheritrange="1"/></actuator>
</mujoco>
"""

HINGE = """
<mujoco>
  <option timestep="{timestep}"/>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 1 0" damping="{damping}"/>
      <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.1"/>
    </body>
  </worldbody>
  <actuator><{actuator} name="hinge" joint="hinge" {options}/></actuator>
</mujoco>
"""


def hinge(actuator: str = "position", options: str = 'kp="1" kv="0.02"', timestep=0.002, damping=0.01) -> str:
    """Return one joint under gravity."""
    return HINGE.format(actuator=actuator, options=options, timestep=timestep, damping=damping)


def motors() -> str:
    """Return one joint driven by torque."""
    return hinge("motor", "")


def unstable(timestep: float = 0.01) -> str:
    """Return a joint whose servo is far too stiff for its timestep."""
    return hinge(options='kp="1e7"', timestep=timestep)


def model_at(path: Path | str, period: float) -> tuple[mujoco.MjModel, int]:
    """Return a model read by MuJoCo alone, its timestep shortened so that whole steps fill the period, and how many."""
    model = mujoco.MjModel.from_xml_path(str(path))
    steps = 1
    while period / steps > model.opt.timestep * (1 + 1e-9):
        steps += 1
    model.opt.timestep = period / steps
    return model, steps


def play_loop(
    path: Path | str, period: float, joints: Sequence[str], state: np.ndarray, commands: np.ndarray
) -> np.ndarray:
    """Set a state (2n,), zero the warm start, hold each command (T, n) one period; return the states (T, 2n)."""
    model, steps = model_at(path, period)
    data = mujoco.MjData(model)
    positions = [model.joint(joint).qposadr[0] for joint in joints]
    speeds = [model.joint(joint).dofadr[0] for joint in joints]
    driver = {model.actuator(i).trnid[0]: i for i in range(model.nu)}
    for joint in range(model.njnt):  # joints that the dataset lacks are held where the model has them
        if joint in driver:
            data.ctrl[driver[joint]] = model.qpos0[model.jnt_qposadr[joint]]
    data.qpos[positions], data.qvel[speeds] = state[: len(joints)], state[len(joints) :]
    data.qacc_warmstart[:] = 0
    states = np.empty((len(commands), 2 * len(joints)))
    for row, command in enumerate(commands):
        for joint, value in zip(joints, command, strict=True):
            data.ctrl[driver[model.joint(joint).id]] = value
        for _ in range(steps):
            mujoco.mj_step(model, data)
        states[row] = [*data.qpos[positions], *data.qvel[speeds]]
    return states


def predict_loop(
    path: Path | str, period: float, joints: Sequence[str], states: np.ndarray, commands: np.ndarray
) -> np.ndarray:
    """Predict transitions one after the other, each on fresh data; shapes (N, 2n), (N, n) → (N, 2n)."""
    rows = zip(states, commands, strict=True)
    return np.stack([play_loop(path, period, joints, state, command[None])[0] for state, command in rows])


def load_integrals(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Let the integral parts of servos hold the weight."""
    mujoco.mj_forward(model, data)
    for actuator in np.flatnonzero(model.actuator_gaintype == int(mujoco.mjtGain.mjGAIN_PID)):
        if gain := model.actuator_gainprm[actuator, 0]:
            weight = data.qfrc_bias[model.jnt_dofadr[model.actuator_trnid[actuator, 0]]]
            last = model.actuator_actadr[actuator] + model.actuator_actnum[actuator] - 1
            data.act[last] = weight / (gain * model.actuator_gear[actuator, 0])
