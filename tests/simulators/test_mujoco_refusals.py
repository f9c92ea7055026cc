"""Models that cannot be simulated are refused in one sentence, and MuJoCo itself prints and writes nothing."""

from pathlib import Path

import numpy as np
import pytest
from support.simulator_samples import (
    CONTACTS,
    GRIPPER,
    PLAY,
    hinge,
    motors,
    unstable,
)

from nas_data.dataset.features import EFFORT, POSITION
from nas_data.errors import JointMismatch, ModelFileError, UnknownName
from nas_data.simulators.engines import load_simulator
from nas_data.simulators.mujoco import MujocoSimulator


@pytest.fixture
def write(tmp_path):
    def write_model(text: str, name: str = "model.xml") -> Path:
        path = tmp_path / name
        path.write_text(text)
        return path

    return write_model


def test_a_missing_joint_names_joint_file_and_what_there_is(write):
    path = write(GRIPPER)
    with pytest.raises(JointMismatch) as error:
        MujocoSimulator.load(path, 0.02, ("a", "wrist"))
    for word in ("wrist", "model.xml", "a, b, gripper"):
        assert word in str(error.value)


def test_a_joint_without_actuator_is_refused(write):
    path = write(PLAY)
    with pytest.raises(JointMismatch, match=r"j_play") as error:
        MujocoSimulator.load(path, 0.02, ("j_play",))
    assert "model.xml" in str(error.value)
    assert "position" in str(error.value), "the remedy is an actuator"


def test_a_joint_that_is_no_hinge_is_refused(write):
    path = write(CONTACTS.replace("<freejoint/>", '<freejoint name="ball"/>'))
    with pytest.raises(JointMismatch, match="ball"):
        MujocoSimulator.load(path, 0.02, ("shoulder", "ball"))


def test_joints_of_one_arm_may_take_positions_and_torques(write):
    path = write(CONTACTS.replace('<position name="servo2" joint="elbow" kp="2" kv="0.05"/>', '<motor joint="elbow"/>'))
    assert MujocoSimulator.load(path, 0.02).kinds == (POSITION, EFFORT)


def test_kinds_of_command_are_told_apart(write):
    assert set(MujocoSimulator.load(write(hinge()), 0.02).kinds) == {POSITION}
    assert set(MujocoSimulator.load(write(motors()), 0.02).kinds) == {EFFORT}


@pytest.mark.parametrize("timestep", [0.01, 0.05], ids=["many steps", "one step"])
def test_a_diverging_model_is_refused_quietly(write, tmp_path, monkeypatch, capfd, timestep):
    monkeypatch.chdir(tmp_path)
    path = write(unstable(timestep))
    before = sorted(tmp_path.iterdir())
    simulator = MujocoSimulator.load(path, 0.05, threads=2)
    for act in (
        lambda: simulator.predict(np.zeros((3, 2)), np.ones((3, 1))),
        lambda: simulator.rollout(np.zeros((3, 2)), np.ones((3, 5, 1))),
    ):
        with pytest.raises(ModelFileError, match=r"model\.xml diverges") as error:
            act()
        assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")
    assert sorted(tmp_path.iterdir()) == before, "MuJoCo's log was written"


def test_a_closed_loop_that_diverges_says_so_by_nan_until_it_is_reset(write, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    simulator = MujocoSimulator.load(write(unstable()), 0.05)
    stepper = simulator.stepper(2)
    for _ in range(3):
        states = stepper.step(np.ones((2, 1)))
        assert np.isnan(states).all()
    stepper.reset(np.zeros((1, 2)), rows=np.array([1]))
    assert np.isnan(stepper.states[0]).all()
    assert np.array_equal(stepper.states[1], [0, 0])
    assert capfd.readouterr() == ("", "")
    assert not Path("MUJOCO_LOG.TXT").exists()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("photo.png", b"\x89PNG\r\n\x1a\n" + bytes(64)),
        ("photo.xml", b"\x89PNG\r\n\x1a\n" + bytes(64)),
        ("page.html", b"<!DOCTYPE html><html><body>Not found</body></html>"),
        ("page.xml", b"<!DOCTYPE html><html><body>Not found</body></html>"),
        ("empty.xml", b""),
        ("noextension", b"hello"),
        ("cut.xml", CONTACTS[: len(CONTACTS) // 2].encode()),
        ("passive.xml", CONTACTS[: CONTACTS.index("<actuator>")].encode() + b"</mujoco>"),
        ("folder.xml", None),
        ("arm.urdf.xacro", b'<robot name="arm"><xacro:property name="length" value="1"/></robot>'),
    ],
)
def test_a_wrong_file_given_as_model_is_refused_in_one_sentence(tmp_path, monkeypatch, capfd, name, content):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / name
    path.write_bytes(content) if content is not None else path.mkdir()
    with pytest.raises(ModelFileError) as error:
        MujocoSimulator.load(path, 0.02)
    assert name in str(error.value)
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")
    assert sorted(tmp_path.iterdir()) == [path]


def test_a_name_that_is_no_robot_lists_those_there_are():
    with pytest.raises(UnknownName, match=r"asimo.*ergojr.*pendulum"):
        load_simulator("asimo", 0.02)
    with pytest.raises(UnknownName, match=r"unity.*mujoco"):
        load_simulator("pendulum", 0.02, engine="unity")


def test_arrays_of_another_arm_are_refused():
    pendulum = MujocoSimulator.load("pendulum", 0.005)
    with pytest.raises(JointMismatch, match="pendulum"):
        pendulum.predict(np.zeros((3, 4)), np.zeros((3, 1)))
    with pytest.raises(JointMismatch, match="pendulum"):
        pendulum.rollout(np.zeros((3, 2)), np.zeros((3, 5, 2)))
