"""Actuators that reach joints through tendons, sites and bodies are told of, and what is said of them helps."""

import logging
import re

import mujoco
import numpy as np
import pytest

from nas_data.errors import JointMismatch, ModelFileError
from nas_data.robots.base import find_robot
from nas_data.simulators.engines import load_simulator

# A hand as Menagerie has it: one actuator opens both fingers through a tendon, and an equality ties them.
HAND = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody><site name="world"/><body pos="0 0 0.5">
<joint name="shoulder" axis="0 1 0" range="-1.5 1.5" damping="0.05" armature="0.01"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" mass="0.1"/><site name="palm" pos="0.2 0 0"/>
<body pos="0.2 0 0"><joint name="left" type="slide" axis="0 1 0" range="0 0.04" damping="2" armature="0.05"/>
<geom size="0.01" mass="0.02"/></body>
<body name="finger" pos="0.2 0 0"><joint name="right" type="slide" axis="0 -1 0" range="0 0.04" damping="2"/>
<geom size="0.01" mass="0.02"/></body></body></worldbody>
<tendon><fixed name="split"><joint joint="left" coef="0.5"/><joint joint="right" coef="0.5"/></fixed></tendon>
<equality><joint joint1="right" joint2="left"/></equality>
<actuator><position joint="shoulder" kp="20" kv="1"/>{}</actuator></mujoco>"""
TIE = '<equality><joint joint1="right" joint2="left"/></equality>'
GRIP = '<general name="grip" tendon="split" gainprm="0.0157" biastype="affine" biasprm="0 -100 -10"/>'
OWN = '<position joint="left" kp="100" kv="10"/>'
JOINTS = ("shoulder", "left")


@pytest.fixture
def hand(tmp_path):
    """Return a writer of the hand with some actuators."""

    def write(actuators: str, tie: str = TIE):
        path = tmp_path / f"hand{len(list(tmp_path.iterdir()))}.xml"
        path.write_text(HAND.format(actuators).replace(TIE, tie))
        return path

    return write


class Told(logging.Handler):
    """Collects warnings."""

    def __init__(self) -> None:
        super().__init__()
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.getMessage())


@pytest.fixture
def told():
    """What the package warns of, whatever an earlier test did to its log."""
    handler, logger = Told(), logging.getLogger("nas_data")
    logger.addHandler(handler)
    yield handler
    logger.removeHandler(handler)


def test_a_hand_of_two_tied_fingers_takes_the_position_of_one(hand, told):
    path = hand(GRIP)
    assert find_robot(path).joints == JOINTS
    motion = load_simulator(path, 0.02, JOINTS).rollout(np.zeros((1, 4)), np.full((1, 100, 2), [0.1, 0.02]))
    assert abs(motion[0, -1, 1] - 0.02) < 0.002 and not told.messages


def test_a_joint_that_a_tendon_drives_is_commanded_once_its_actuator_is_replaced_as_is_said(hand, told):
    with pytest.raises(JointMismatch, match=r"'left' of .* is moved through the tendon 'split' .* 'grip'") as raised:
        load_simulator(hand(GRIP, tie=""), 0.02, JOINTS)
    (remedy,) = re.findall(r"replace it by (<position [^>]*/>)", str(raised.value))
    told.messages.clear()
    path = hand(remedy.replace("…", "100"), tie="")
    motion = load_simulator(path, 0.02, JOINTS).rollout(np.zeros((1, 4)), np.full((1, 25, 2), [0.1, 0.02]))
    assert abs(motion[0, -1, 1] - 0.02) < 0.002 and not told.messages


@pytest.mark.parametrize(
    ("actuator", "said"),
    [
        (GRIP, "'grip' on the tendon 'split'"),
        ('<position site="palm" refsite="world" gear="0 0 0 0 1 0"/>', "one on the site 'palm'"),
        ('<adhesion name="suck" body="finger" ctrlrange="0 1"/>', "'suck' on the body 'finger'"),
    ],
)
def test_actuators_that_are_left_out_are_told_once(hand, told, actuator, said):
    path = hand(actuator, tie="")
    for _ in range(2):
        assert find_robot(path).joints == ("shoulder",)
    assert [said in message for message in told.messages] == [True]


def test_a_model_whose_actuators_drive_no_joint_names_them(tmp_path):
    (tmp_path / "m.xml").write_text(
        HAND.format(GRIP).replace('<position joint="shoulder" kp="20" kv="1"/>', "").replace(TIE, "")
    )
    with pytest.raises(ModelFileError, match=r"in place of 'grip' on the tendon 'split' write <position joint=…>"):
        find_robot(tmp_path / "m.xml")


ON_FOLLOWER = '<position joint="right" kp="50"/>'
HARMLESS = '<motor joint="left"/>', '<velocity joint="left" kv="3"/>', '<motor tendon="split"/>'


@pytest.mark.parametrize("actuator", [GRIP, '<position name="grip" joint="left" kp="50"/>', ON_FOLLOWER, *HARMLESS])
def test_an_actuator_that_pulls_a_commanded_joint_to_its_reference_is_told_of(hand, told, actuator):
    load_simulator(hand(OWN + actuator), 0.02, JOINTS)
    pulled = [message for message in told.messages if "works against the joint's own actuator" in message]
    assert len(pulled) == (actuator not in HARMLESS)
    assert all(("'right'" if actuator == ON_FOLLOWER else "'grip'") in message for message in pulled)


def test_an_actuator_of_joints_that_are_not_commanded_pulls_nothing_that_counts(hand, told):
    load_simulator(hand(GRIP), 0.02, ("shoulder",))
    assert not any("works against" in message for message in told.messages)


TIES = {
    "joints": '<joint joint1="{one}" joint2="{two}"/>',
    "tendons": '<tendon tendon1="{one}" tendon2="{two}"/>',
}


@pytest.mark.parametrize("tie", TIES)
def test_a_follower_is_to_be_left_out(tmp_path, tie):
    tendons = "".join(f'<fixed name="{j}"><joint joint="{j}" coef="1"/></fixed>' for j in ("left", "right"))
    text = HAND.format(OWN).replace("</tendon>", f"{tendons}</tendon>")
    text = text.replace('<joint joint1="right" joint2="left"/>', TIES[tie].format(one="right", two="left"))
    (tmp_path / "m.xml").write_text(text)
    with pytest.raises(JointMismatch, match=r"'right' of .* follows 'left' .* leave it out of 'joints' of the map"):
        load_simulator(tmp_path / "m.xml", 0.02, ("shoulder", "left", "right"))
    simulator = load_simulator(tmp_path / "m.xml", 0.02, JOINTS)
    position = mujoco.MjModel.from_xml_path(str(tmp_path / "m.xml")).joint("right").qposadr[0]
    assert position not in simulator.layout.qpos
