"""What the recording lacks stays where it is, in the search and in the delivered file; what must move still does."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.delivery_samples import nominal

from nas_data.gap.write_model import write_model

ARM = """
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default><joint axis="0 1 0" armature="0.001" damping="0.01"/><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="upper" pos="0 0 0.3">
      <joint name="j1"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0.1 0 0" mass="0.05"/>
      <body name="lower" pos="0.1 0 0">
        <joint name="j2"/>
        <geom type="capsule" size="0.01" fromto="0 0 0 0.1 0 0" mass="0.05"/>
        {hand}
      </body>
    </body>
    <body name="puck" pos="1 0 0"><joint name="puck" type="slide" axis="1 0 0"/><geom size="0.02"/></body>
    <body name="ball" pos="1 1 0"><freejoint/><geom size="0.02"/></body>
  </worldbody>
  {coupling}
  <actuator>
    <position name="j1" joint="j1" kp="5" kv="0.1"/>
    <position name="j2" joint="j2" kp="5" kv="0.1"/>
    {drive}
  </actuator>
</mujoco>
"""
FINGER = """
<body name="{0}" pos="0.1 0 {1}">
  <joint name="{0}" {2}/>
  <geom type="capsule" size="0.01" fromto="0 0 0 0.05 0 0" mass="0.02"/>
</body>
"""
ONE, TWO = FINGER.format("f1", 0.02, ""), FINGER.format("f2", -0.02, "")
MIMIC = '<equality><joint joint1="f2" joint2="f1" polycoef="0 -1 0 0 0"/></equality>'
SPLIT = '<tendon><fixed name="split"><joint joint="f1" coef="0.5"/><joint joint="f2" coef="-0.5"/></fixed></tendon>'
HANDS = {
    "undriven": (ONE, "", "", ["f1"]),
    "motor": (ONE, "", '<motor joint="f1"/>', ["f1"]),
    "velocity": (ONE, "", '<velocity joint="f1" kv="1"/>', ["f1"]),
    "servo": (ONE, "", '<position joint="f1" kp="5"/>', []),
    "servo with another reference": (
        FINGER.format("f1", 0, 'ref="0.5"'),
        "",
        '<position joint="f1" kp="5"/>',
        ["f1"],
    ),
    "servo whose range leaves out its reference": (
        ONE,
        "",
        '<position joint="f1" kp="5" ctrlrange="0.2 1"/>',
        ["f1"],
    ),
    "coupled to a servo": (ONE + TWO, MIMIC, '<position joint="f1" kp="5"/>', []),
    "coupled to a measured joint": (ONE, MIMIC.replace("f1", "j2").replace("f2", "f1"), "", []),
    "coupled to a motor": (ONE + TWO, MIMIC, '<motor joint="f2"/>', ["f2"]),
    "coupled and undriven": (ONE + TWO, MIMIC, "", ["f1"]),
    "coupled by a constraint that is off": (
        ONE + TWO,
        MIMIC.replace("<joint ", '<joint active="false" '),
        "",
        ["f1", "f2"],
    ),
    "servo on a tendon": (ONE + TWO, SPLIT + MIMIC, '<position tendon="split" kp="5"/>', []),
    "servo on a tendon alone": (ONE + TWO, SPLIT, '<position tendon="split" kp="5"/>', ["f1"]),
    "spring": (FINGER.format("f1", 0, 'stiffness="1"'), "", "", []),
    "play": (FINGER.format("f1", 0, 'range="-0.02 0.02"'), "", "", []),
    "held by its author": (ONE, '<equality><joint joint1="f1"/></equality>', "", []),
    "linkage": (ONE + TWO, '<equality><weld body1="f1" body2="f2"/></equality>', '<position joint="f1" kp="5"/>', []),
}


@pytest.mark.parametrize("kind", HANDS)
def test_only_what_nothing_else_determines_is_held(kind: str, tmp_path: Path):
    hand, coupling, drive, held = HANDS[kind]
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(hand=hand, coupling=coupling, drive=drive))
    given = nominal(path)
    before = mujoco.MjModel.from_xml_path(str(path))
    after = given.spec.copy().compile()
    added = [after.equality(number).name for number in range(before.neq, after.neq)]
    assert added == [f"{joint}_held" for joint in held]
    assert given.notes == (
        (f"Held at their reference, because the recording lacks them: {', '.join(held)}.",) if held else ()
    )


@pytest.mark.parametrize("kind", ["undriven", "motor", "servo with another reference", "coupled to a motor"])
def test_a_plain_checker_of_the_file_sees_what_is_held_stand_still(kind: str, tmp_path: Path):
    """It sets the measured joints and their commands only."""
    hand, coupling, drive, held = HANDS[kind]
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(hand=hand, coupling=coupling, drive=drive))
    given = nominal(path)
    write_model(tmp_path, given, (), {})
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    data = mujoco.MjData(model)
    commands = np.repeat(np.random.default_rng(0).uniform(-0.6, 0.6, (1, 4, 2)), 50, axis=1)
    measured, away = [], 0.0
    for command in commands[0]:
        data.ctrl[:2] = command
        mujoco.mj_step(model, data, round(0.01 / model.opt.timestep))
        measured.append([data.joint(joint).qpos[0] for joint in ("j1", "j2")])
        away = max(away, *(abs(data.joint(j).qpos[0] - model.qpos0[model.joint(j).qposadr[0]]) for j in held))
    assert away < 1e-4
    assert data.joint("puck").qpos[0] == 0 and data.qpos[-5] < -1  # the ball falls
    rolled = nominal(tmp_path / "model.xml").simulator().rollout(np.zeros((1, 4)), commands)
    assert rolled[0, :, :2] == pytest.approx(np.array(measured), abs=1e-6)
    assert nominal(tmp_path / "model.xml").notes == ()
