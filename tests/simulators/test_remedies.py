"""A model that is refused is simulated once it is changed, or the command run, as the sentence says."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.command_samples import refused
from support.model_features import PERIOD, SERVO, WAYS, Way
from support.simulator_samples import CONTACTS, GRIPPER, PLAY, hinge, unstable

from nas_data.cli import main
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, STATE, make_position_feature
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.write import write
from nas_data.errors import JointMismatch, ModelFileError, NasError, UnknownName
from nas_data.simulators.engines import load_simulator
from nas_data.simulators.mujoco import MujocoSimulator

GROUND = '<geom type="plane" size="2 2 0.1"/>'
LEG = f"""<mujoco><worldbody>{GROUND}<body name="trunk" pos="0 0 {{height}}"><freejoint/>
<geom type="box" size="0.2 0.1 0.05" mass="5"/><body name="shin" pos="0 0 -0.05"><joint name="knee" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="0.3"/></body></body></worldbody>
<actuator><position joint="knee" kp="50" kv="2"/></actuator></mujoco>"""
ON_GROUND = LEG.format(height=0.37)
THROUGH = PLAY.replace('<position name="servo" joint="j" kp="2"/>', '<position name="servo" tendon="link" kp="2"/>')
SENSOR = hinge().replace("</mujoco>", "<sensor>{}</sensor></mujoco>")
WRIST = GRIPPER.replace('"b"', '"wrist"')
BALL = CONTACTS.replace("<freejoint/>", '<freejoint name="ball"/>')
SERVOS = (SERVO, '<velocity joint="{j}" kv="1"/>', '<motor joint="{j}"/>')
UNTOLD = [way for way in WAYS if way.group == "untold"]
OF_JOINTS = [way for way in UNTOLD if way.actuator.partition("{j}")[0].endswith(' joint="')]
BY_TENDON, AT_SITE, FOLLOWING = (next(way for way in UNTOLD if word in way.name) for word in
                                 ("independent", "at a site", "follows by an `equality`"))  # fmt: skip
GEARLESS = Way("`position` with a gear of 0", "untold", '<position joint="{j}" kp="20" gear="0"/>')


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def dataset(*joints: str) -> None:
    """Write a dataset of joints at rest that are told to move."""
    features = {key: make_position_feature(joints) for key in (STATE, ACTION)}
    columns = {STATE: np.zeros((20, len(joints)), np.float32), ACTION: np.ones((20, len(joints)), np.float32)}
    write(Dataset(features, columns, np.array([20]), 20.0), Path("d"), Provenance(how="simulated", robot="arm"))


@pytest.mark.parametrize("way", [*OF_JOINTS, GEARLESS], ids=lambda way: way.name)
def test_an_actuator_whose_control_is_untold_is_replaced_as_is_said(here, way):
    Path("arm.xml").write_text(way.text)
    with pytest.raises(ModelFileError) as raised:
        MujocoSimulator.load("arm.xml", PERIOD, ("a", "b"))
    said = str(raised.value)
    assert re.match(r"The actuator of the joint 'a' of arm\.xml (\(|has )", said), said
    assert said.endswith("; give a model with <position>, <velocity> or <motor> there."), said
    for servo in SERVOS:
        Path("arm.xml").write_text(replace(way, actuator=servo).text)
        MujocoSimulator.load("arm.xml", PERIOD, ("a", "b"))


LOADED = {
    "no actuator": (
        GRIPPER.replace('<position name="b" joint="b" kp="2" kv="0.1"/>', ""),
        ("a", "b"),
        "No actuator of arm.xml drives the joint 'b'; add one, for example <position joint=\"…\" kp=\"…\"/>.",
        GRIPPER,
        ("a", "b"),
    ),
    "through a tendon": (
        BY_TENDON.text,
        ("a", "b"),
        "'b' of arm.xml is moved through the tendon 'w' by the actuator, but only an actuator of the joint itself "
        'takes its commands; replace it by <position joint="b" kp="…"/>.',
        replace(BY_TENDON, actuator=SERVO).text,
        ("a", "b"),
    ),
    "only a tendon": (
        THROUGH,
        ("j",),
        "arm.xml has no actuator that drives a joint directly; in place of 'servo' on the tendon 'link' write "
        "<position joint=…>.",
        PLAY,
        ("j",),
    ),
    "only sites": (
        AT_SITE.text,
        ("a", "b"),
        "in place of 'a' on the site 'end', 'b' on the site 'end' write <position joint=…>.",
        replace(AT_SITE, actuator=SERVO).text,
        ("a", "b"),
    ),
    "a follower": (
        FOLLOWING.text,
        ("a", "b"),
        "'b' of arm.xml follows 'a' (an equality or mimic of the model) and takes no commands; leave it out",
        FOLLOWING.text,
        ("a",),
    ),
    "other names": (
        WRIST,
        ("a", "b"),
        "arm.xml has no joint 'b'; it has: a, wrist, gripper. Joints are matched by name; use one name for both.",
        GRIPPER,
        ("a", "b"),
    ),
    "a ball": (
        BALL,
        ("shoulder", "ball"),
        "The joint 'ball' of arm.xml is neither hinge nor slide; only those are measured: leave it out.",
        BALL,
        ("shoulder", "elbow"),
    ),
    "sensor": (
        SENSOR.format('<jointvel name="hinge.pos" joint="hinge"/>'),
        ("hinge",),
        "The sensor 'hinge.pos' of arm.xml is not the position of a joint or of a fixed tendon; use <jointpos> or "
        "<tendonpos>, or remove it.",
        SENSOR.format('<jointpos name="hinge.pos" joint="hinge"/>'),
        ("hinge",),
    ),
    "ground": (
        ON_GROUND,
        ("knee",),
        "arm.xml stands on the ground with its 'shin', so its base can move",
        ON_GROUND.replace(GROUND, ""),
        ("knee",),
    ),
    "low base": (ON_GROUND, ("knee",), "or raise the base.", LEG.format(height=0.8), ("knee",)),
}  # fmt: skip


@pytest.mark.parametrize("name", LOADED)
def test_a_model_is_loaded_once_it_is_changed_as_is_said(here, name):
    model, joints, said, mended, others = LOADED[name]
    Path("arm.xml").write_text(model)
    with pytest.raises((JointMismatch, ModelFileError)) as raised:
        MujocoSimulator.load("arm.xml", 0.02, joints)
    assert said in str(raised.value)
    Path("arm.xml").write_text(mended)
    MujocoSimulator.load("arm.xml", 0.02, others)


def test_an_engine_is_chosen_among_those_that_are_named():
    with pytest.raises(UnknownName, match=r"There is no engine 'unity'; choose one of: bullet, mujoco\."):
        load_simulator("pendulum", 0.02, engine="unity")
    assert load_simulator("pendulum", 0.02, engine="mujoco").joints == ("pendulum",)


def test_arrays_of_the_widths_that_are_said_are_simulated():
    arm = load_simulator("pusher", 0.02)
    n, joints = len(arm.joints), ", ".join(arm.joints)
    with pytest.raises(JointMismatch, match="States of 2 and commands of 1 components do not fit") as raised:
        arm.predict(np.zeros((1, 2)), np.zeros((1, 1)))
    found = re.search(rf"\({joints}\): (\d+), or (\d+) with the objects, and (\d+) are needed", str(raised.value))
    assert found and int(found.group(1)) == 2 * n
    plain, scene, commands = map(int, found.groups())
    for width in (plain, scene):
        assert arm.predict(np.zeros((1, width)), np.zeros((1, commands))).shape[0] == 1


SOFTENED = {
    "timestep": hinge(options='kp="1e5"', timestep=1e-4),
    "gains": hinge(timestep=0.01),
    "inertia": unstable().replace('mass="0.1"', 'mass="1e7"'),
}


@pytest.mark.parametrize("name", SOFTENED)
def test_a_model_that_diverges_is_stable_once_it_is_changed_as_is_said(here, name):
    dataset("hinge")
    unsteady = hinge(options='kp="1e5"', timestep=0.01) if name == "timestep" else unstable()
    Path("arm.xml").write_text(unsteady)
    said = refused("pair", "d", "--model", "arm.xml")
    assert "arm.xml diverges in MuJoCo (" in said
    assert said.endswith("shorten its timestep, soften its gains or check its inertias."), said
    Path("arm.xml").write_text(SOFTENED[name])
    assert main(["pair", "d", "--model", "arm.xml", "--out", "done"]) == 0


@pytest.mark.bullet
def test_a_model_that_diverges_in_pybullet_is_stable_once_it_is_changed_as_is_said(here):
    dataset("hinge")
    Path("arm.xml").write_text(unstable())
    said = refused("pair", "d", "--model", "arm.xml", "--engine", "bullet")
    assert said.endswith("arm.xml diverges in PyBullet; shorten its timestep, soften its gains or check its inertias.")
    Path("arm.xml").write_text(hinge())
    assert main(["pair", "d", "--model", "arm.xml", "--engine", "bullet", "--out", "done"]) == 0


SITE = "<site name='tip'/>"


@pytest.mark.parametrize("engine", ["mujoco", pytest.param("bullet", marks=pytest.mark.bullet)])
@pytest.mark.parametrize("other", ["", "<site name='other'/>"], ids=["no site", "another"])
def test_a_site_is_added_as_is_said(here, engine, other):
    with_site = hinge().replace("</body>", f"{other}</body>", 1)
    Path("arm.xml").write_text(with_site)
    with pytest.raises(ModelFileError, match=re.escape(f"arm.xml has no site 'tip'; add {SITE}.")):
        load_simulator("arm.xml", 0.02, engine=engine).stepper(1).site_positions("tip")
    Path("arm.xml").write_text(with_site.replace("</body>", f"{SITE}</body>", 1))
    assert load_simulator("arm.xml", 0.02, engine=engine).stepper(1).site_positions("tip").shape == (1, 3)


FOREIGN = {
    "ball or free joints": (BALL, ("shoulder", "elbow")),
    "tendons with limits or friction": (
        PLAY.replace('<fixed name="link">', '<fixed name="link" limited="true" range="-1 1">'),
        ("j",),
    ),
    "soft equality constraints": (
        GRIPPER.replace(
            "</mujoco>", '<equality><joint joint1="a" joint2="b" solimp="0.1 0.2 0.1"/></equality></mujoco>'
        ),
        ("a", "b"),
    ),
}


@pytest.mark.bullet
@pytest.mark.parametrize("what", FOREIGN)
def test_a_model_that_pybullet_is_not_given_is_simulated_by_the_engine_that_is_named(here, what):
    model, joints = FOREIGN[what]
    dataset(*joints)
    Path("arm.xml").write_text(model)
    said = refused("pair", "d", "--model", "arm.xml", "--engine", "bullet")
    assert said.endswith(f"arm.xml has {what}, which PyBullet is not given; use --engine mujoco."), said
    assert main(["pair", "d", "--model", "arm.xml", "--engine", "mujoco", "--out", "done"]) == 0


@pytest.mark.bullet
def test_fewer_simulations_fit_where_pybullet_opens_no_more_worlds(monkeypatch):
    """Worlds are counted here, because 1024 of them would fill the memory."""
    import pybullet

    arm = load_simulator("pendulum", 0.02, engine="bullet")
    opened, connect = [], pybullet.connect

    def connect_few(mode: int) -> int:
        opened.append(mode)
        return -1 if len(opened) > 3 else connect(mode)

    monkeypatch.setattr(pybullet, "connect", connect_few)
    with pytest.raises(NasError, match="at most 1024 worlds in one process; use fewer simulations"):
        arm.stepper(5)
    opened.clear()
    assert arm.stepper(3).states.shape == (3, 2)
