"""Joints that follow others in PyBullet: `<mimic>`, equalities, tendons, loops; what it is not given is refused."""

import json

import numpy as np
import pytest
from support.model_features import ARM, EXTRA, HINGE, SERVO, WAYS
from support.model_features import played as played_way

from nas_data.cli import main
from nas_data.errors import ModelFileError
from nas_data.simulators.engines import load_simulator

pytestmark = pytest.mark.bullet

PERIOD = 0.02
LINK = """<link name="{name}"><inertial><mass value="{mass}"/>
<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINTS = """<joint name="wrist" type="revolute"><parent link="base"/><child link="palm"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" effort="5" velocity="9"/></joint>
<joint name="finger" type="prismatic"><parent link="palm"/><child link="left"/>
<origin xyz="0.1 0 0"/><axis xyz="0 0 1"/><limit lower="0" upper="0.04" effort="20" velocity="1"/></joint>
<joint name="other" type="prismatic"><parent link="palm"/><child link="right"/>
<origin xyz="0.1 0 0"/><axis xyz="0 0 1"/><limit lower="-0.1" upper="0.1" effort="20" velocity="1"/>
<mimic joint="finger" multiplier="-1.5" offset="0.01"/></joint>"""
LINKS = (("palm", 0.2, 1e-3), ("left", 0.05, 1e-4), ("right", 0.05, 1e-4))
BODIES = "".join(LINK.format(name=name, mass=mass, inertia=inertia) for name, mass, inertia in LINKS)
GRIPPER = f'<robot name="g"><link name="base"/>{BODIES}{JOINTS}</robot>'


@pytest.fixture
def gripper(tmp_path):
    path = tmp_path / "gripper.urdf"
    path.write_text(GRIPPER)
    return path


def played(path, engine, joints, commands):
    simulator = load_simulator(path, PERIOD, joints, engine=engine, threads=1)
    return simulator, simulator.rollout(np.zeros((1, 2 * len(joints))), commands[None])[0]


def follower(simulator, name="other"):
    """Return where a joint of PyBullet's own world stands."""
    return simulator._arm.world.read()[0][simulator.model.joint(name).qposadr[0]]


def test_a_mimicking_finger_follows_as_in_mujoco(gripper):
    commands = np.repeat([[0.5, 0.03], [-0.3, 0.01], [0.2, 0.035]], 15, axis=0)
    bullet, ours = played(gripper, "bullet", ("wrist", "finger"), commands)
    _, truth = played(gripper, "mujoco", ("wrist", "finger"), commands)
    np.testing.assert_allclose(ours[:, 0], truth[:, 0], atol=0.04)
    np.testing.assert_allclose(ours[:, 1], truth[:, 1], atol=3e-3)
    assert np.ptp(ours[:, 1]) > 0.02
    assert follower(bullet) == pytest.approx(0.01 - 1.5 * ours[-1, 1], abs=1e-9)


def test_a_finger_that_is_put_somewhere_takes_its_follower_along(gripper):
    simulator = load_simulator(gripper, PERIOD, ("wrist", "finger"), engine="bullet")
    stepper = simulator.stepper(1)
    stepper.set_states(np.array([[0.0, 0.02, 0.0, 0.0]]))
    place = simulator.model.joint("other").qposadr[0]
    assert stepper._arms[0].world.read()[0][place] == pytest.approx(0.01 - 1.5 * 0.02, abs=1e-6)
    np.testing.assert_allclose(stepper.states, [[0.0, 0.02, 0.0, 0.0]], atol=1e-9)


def test_a_joint_that_the_recording_lacks_stays_where_it_is(tmp_path):
    arm = ARM.format(
        joint=HINGE, actuators=SERVO.format(j="a") + SERVO.format(j="b"), inside=EXTRA, beside="", after=""
    )
    path = tmp_path / "arm.xml"
    path.write_text(arm)
    simulator, _ = played(path, "bullet", ("a", "b"), np.full((50, 2), 0.6))
    assert follower(simulator, "c") == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", ["by a curve", "equality/tendon", "connect"])
def test_what_constraints_let_follow_moves_as_in_mujoco(name):
    way = next(way for way in WAYS if name in way.name)
    ours, truth = played_way(way, "bullet"), played_way(way, "mujoco")
    assert np.ptp(truth, axis=0).min() > 0.03
    np.testing.assert_allclose(ours, truth, atol=0.05)


def test_what_pybullet_is_not_given_is_refused_and_the_other_engine_takes_it(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    after = '<tendon><fixed frictionloss="0.01"><joint joint="b" coef="1"/></fixed></tendon>'
    actuators = SERVO.format(j="a") + SERVO.format(j="b")
    path = tmp_path / "tendon.xml"
    path.write_text(ARM.format(joint=HINGE, actuators=actuators, inside="", beside="", after=after))
    with pytest.raises(ModelFileError, match=r"tendon\.xml has tendons with limits .*; use --engine mujoco"):
        load_simulator(path, PERIOD, ("a", "b"), engine="bullet")
    record = ["record", "sim", "--robot", str(path), "--episodes", "1", "--seconds", "0.2", "--out", "d", "--json"]
    assert main([*record, "--engine", "bullet"]) == 2
    assert "use --engine mujoco" in capsys.readouterr().err
    assert main([*record, "--engine", "mujoco"]) == 0
    assert json.loads(capsys.readouterr().out)
