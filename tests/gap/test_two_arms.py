"""A load on one arm of a robot with two."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.mujoco_loop import play

import nas_data as nas
from nas_data.effects.base import add_effects, parse
from nas_data.errors import JointMismatch
from nas_data.gap.name import name
from nas_data.gap.problem import Problem

ARM = """<body pos="0 {place} .5"><joint name="{side}_shoulder" axis="0 1 0" damping=".05" armature=".01"/>
<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".25" contype="0" conaffinity="0"/>
<body pos="0 0 -.2"><joint name="{side}_elbow" axis="0 1 0" damping=".05" armature=".01"/>
<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".2" contype="0" conaffinity="0"/>{load}</body></body>"""
LOAD = '<geom type="sphere" size=".02" pos="0 0 -.15" mass="{}" contype="0" conaffinity="0"/>'
JOINTS = "left_shoulder", "left_elbow", "right_shoulder", "right_elbow"
RATE, ROWS, EPISODES, NOISE = 50, 105, 5, 3e-4


def make_robot(left: float = 0.0, right: float = 0.0) -> str:
    """Return a model whose hands hold masses [kg]."""
    arms = [
        ARM.format(side=side, place=place, load=LOAD.format(mass) if mass else "")
        for side, place, mass in (("left", 0.2, left), ("right", -0.2, right))
    ]
    servos = "".join(f'<position name="{joint}" joint="{joint}" kp="15" kv=".3"/>' for joint in JOINTS)
    option = '<option timestep="0.002" integrator="implicitfast"/>'
    return f"<mujoco>{option}<worldbody>{''.join(arms)}</worldbody><actuator>{servos}</actuator></mujoco>"


def record(robot: str) -> nas.Dataset:
    """Record a robot by a loop of its own."""
    model, rng = mujoco.MjModel.from_xml_string(robot), np.random.default_rng(0)
    positions, commands = [], []
    for _ in range(EPISODES):
        asked = rng.uniform(-0.8, 0.8, (ROWS // 15, model.nu)).repeat(15, axis=0)
        asked[:5] = 0.0
        positions.append(play(model, asked, 500) + rng.normal(0, NOISE, (ROWS + 1, model.nu)))
        commands.append(asked)
    return nas.Dataset.from_arrays(positions, commands, rate=RATE, joints=JOINTS)


@pytest.mark.parametrize(
    "loads",
    [pytest.param((0.3, 0.0), id="left"), pytest.param((0.2, 0.4), id="both", marks=pytest.mark.slow)],
)
def test_the_load_of_each_hand_is_named(loads: tuple[float, float], tmp_path: Path):
    (tmp_path / "robot.xml").write_text(make_robot())
    problem = Problem.of(record(make_robot(*loads)), tmp_path / "robot.xml", tmp_path)
    findings = name(problem.train, problem.held).findings
    expected = {f"{side}_elbow": mass for side, mass in zip(("left", "right"), loads, strict=True) if mass}
    assert {(one.effect.name(), one.effect.joint) for one in findings} == {("payload", joint) for joint in expected}
    for finding in findings:
        assert finding.effect.mass == pytest.approx(expected[finding.effect.joint], rel=0.15)
        assert finding.confidence > 0.8


@pytest.mark.parametrize("joint", ["left_elbow", "right_elbow"])
def test_a_load_hangs_on_the_arm_of_its_joint(joint: str):
    spec = mujoco.MjSpec.from_string(make_robot())
    parse(f"payload:joint={joint},mass=0.1").edit(spec)
    (load,) = spec.joint(joint).parent.bodies
    assert load.mass == pytest.approx(0.1)
    assert load.pos == pytest.approx([0, 0, -0.1])


def test_a_load_of_an_arm_with_fingers_hangs_on_the_link_before_them():
    finger = '<body><joint name="{}" type="slide"/><geom size=".01" mass=".01"/></body>'
    links = ARM.format(side="left", place=0, load=finger.format("thumb") + finger.format("finger"))
    joints = "left_shoulder", "left_elbow", "thumb", "finger"
    servos = "".join(f'<position joint="{joint}"/>' for joint in joints)
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{links}</worldbody><actuator>{servos}</actuator></mujoco>")
    parse("payload:mass=0.1").edit(spec)
    assert [body.mass for body in spec.joint("left_elbow").parent.bodies][-1] == pytest.approx(0.1)


def test_a_joint_that_the_robot_lacks_is_refused():
    with pytest.raises(JointMismatch, match="names the joint 'wrist'"):
        add_effects(mujoco.MjSpec.from_string(make_robot()), [parse("payload:joint=wrist,mass=0.1")])
