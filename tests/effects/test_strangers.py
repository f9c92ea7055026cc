"""Effects in models that strangers made: with default classes, names and joints that nobody here thought of."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import pytest
from support.effect_samples import PERIOD
from support.typical_effects import OF_OBJECTS, ON_ANY_ARM, typical

from nas_data.effects.base import Effect, add_effects, find_effect
from nas_data.errors import ModelFileError
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.nominal import Nominal
from nas_data.gap.nominal_parameters import list_base_parameters
from nas_data.gap.search.scales import estimate_scales
from nas_data.mjcf.bake_inertia import bake_inertia
from nas_data.mjcf.measured_joints import mark_measured_joints, read_measured_joints
from nas_data.robots.base import find_robot
from nas_data.simulators.mujoco import MujocoSimulator

DEFAULTS = """
<tendon stiffness="3" damping="0.5" frictionloss="0.2" armature="0.05" limited="true" range="0 0.1" margin="0.02"
        springlength="0.2" actuatorfrclimited="true" actuatorfrcrange="-0.01 0.01"/>
<joint stiffness="2" damping="0.4" frictionloss="0.3" armature="0.02" range="0.1 0.2" limited="true" margin="0.01"
       springdamper="0.1 1" springref="0.5" ref="0.2" actuatorfrcrange="-0.01 0.01" actuatorgravcomp="true"/>
<pair condim="1" margin="0.02" gap="0.01" solref="0.1 1" solimp="0.5 0.5 0.01" friction="3 3 3 3 3"/>
<equality solref="0.5 1"/>
<geom margin="0.1" density="7"/>
<site group="4"/>
"""
OWN = 'class="own" pos="0 0 0" type="hinge" axis="0 1 0" damping="0.03" armature="0.001" range="-2 2"'
ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    {defaults}
    <default class="own">
      <joint stiffness="0" frictionloss="0" margin="0" springdamper="0 0" springref="0" ref="0"
             actuatorfrclimited="false" actuatorgravcomp="false"/>
      <geom type="capsule" size="0.01" margin="0" density="1000"/>
    </default>
  </default>
  <worldbody>
    <geom class="own" type="plane" size="1 1 1" condim="4"/>
    <body pos="0 0 0.3">
      <joint name="j1" {own}/>
      <geom class="own" fromto="0 0 0 0.08 0 0" mass="0.03"/>
      <body name="body1" pos="0.08 0 0">
        <joint name="j2" {own}/>
        <geom class="own" fromto="0 0 0 0.07 0 0" mass="0.02"/>
        {bodies}
      </body>
    </body>
    <body name="puck" pos="0.3 0 0.02">
      <freejoint/>
      <geom class="own" type="cylinder" size="0.02 0.02" mass="0.1" condim="6"/>
    </body>
  </worldbody>
  {tendons}
  <actuator>
    <position name="a1" joint="j1" kp="0.5" kv="0.01" forcerange="-0.3 0.3" ctrlrange="-1.5 1.5"/>
    <position joint="j2" kp="0.5" kv="0.01" forcerange="-0.3 0.3" ctrlrange="-1.5 1.5"/>
    {actuators}
  </actuator>
</mujoco>
"""
TAKEN = (
    *("link", "play", "flex", "gain", "band", "damping", "drive", "goal", "error", "turn", "stribeck"),
    *("play_2", "payload", "payload_2"),
)
BODIES = "".join(
    f'<body name="{name}"><geom name="{name}" size="0.001" mass="1e-4"/></body>'
    for name in ("payload", "payload_2", "geom0", "geom1", *(f"j2_{part}" for part in TAKEN))
)
JOINTS = "".join(
    f'<body><joint name="j2_{part}" {OWN} stiffness="10"/><geom type="sphere" size="0.01" mass="0.01"/></body>'
    for part in TAKEN
)
TENDONS = "<tendon>{}</tendon>".format(
    "".join(f'<fixed name="j2_{part}"><joint joint="j1" coef="1"/></fixed>' for part in TAKEN)
)
ACTUATORS = "".join(f'<motor name="j2_{part}" joint="j1"/>' for part in TAKEN)


def model(defaults: str = "", bodies: str = "", tendons: str = "", actuators: str = "") -> str:
    return ARM.format(defaults=defaults, own=OWN, bodies=bodies, tendons=tendons, actuators=actuators)


def moved(tmp_path: Path, xml: str, *effects: Effect, written: bool = False) -> np.ndarray:
    """Return what joints and puck do, in a file that may be written anew with the effects in it."""
    path = tmp_path / "arm.xml"
    path.write_text(xml)
    if written:
        spec = find_robot(path).spec()
        add_effects(spec, effects)
        spec.compile()
        path.write_text(spec.to_xml())
        effects = tuple(effect for effect in effects if not effect.in_model)
    commands = np.repeat(np.random.default_rng(0).uniform(-0.9, 0.9, (1, 5, 2)), 50, axis=1)
    simulator = MujocoSimulator.load(path, PERIOD, ("j1", "j2"), effects, threads=1)
    return simulator.rollout(np.zeros((1, 4)), commands)[..., :2]


@cache
def moved_alone(xml: str) -> np.ndarray:
    """Return what joints and puck do without effects."""
    with TemporaryDirectory() as folder:
        return moved(Path(folder), xml)


def test_default_classes_change_no_model_by_themselves():
    assert np.array_equal(moved_alone(model(DEFAULTS)), moved_alone(model()))


@pytest.mark.parametrize("written", [False, True])
@pytest.mark.parametrize("name", ON_ANY_ARM)
def test_default_classes_do_not_leak_into_what_an_effect_adds(name: str, written: bool, tmp_path):
    effects = (typical(name, joint="j2"),)
    plain, hostile = (moved(tmp_path, model(defaults), *effects, written=written) for defaults in ("", DEFAULTS))
    assert hostile == pytest.approx(plain, abs=1e-5 if written else 1e-12)


@pytest.mark.parametrize("name", ON_ANY_ARM)
def test_names_that_a_model_has_already_are_left_to_it(name: str, tmp_path):
    effect = typical(name, joint="j2")
    for xml in (model(bodies=BODIES, tendons=TENDONS, actuators=ACTUATORS), model(bodies=JOINTS)):
        with_effect = moved(tmp_path, xml, effect, effect)
        assert np.isfinite(with_effect).all()
        assert name in OF_OBJECTS or np.abs(with_effect - moved_alone(xml)).max() > 1e-3


def test_a_name_that_marks_a_dead_band_is_refused_with_a_sentence(tmp_path):
    with pytest.raises(ModelFileError, match="something else named 'j2_deadband_goal'"):
        moved(tmp_path, model(bodies=JOINTS.replace("j2_goal", "j2_deadband_goal")), typical("deadband", joint="j2"))


def test_what_the_engine_refuses_while_an_effect_is_added_is_told_in_a_sentence(tmp_path, monkeypatch):
    def refuse(self: Effect, spec: mujoco.MjSpec) -> None:
        spec.worldbody.add_body(name="body1")

    monkeypatch.setattr(find_effect("payload"), "edit", refuse)
    with pytest.raises(ModelFileError, match=r"arm\.xml does not compile with its effects: .*repeated name 'body1'"):
        moved(tmp_path, model(), typical("payload"))


def test_unnamed_bodies_get_names_that_are_free():
    spec = bake_inertia(mujoco.MjSpec.from_string(model()))
    assert [body.name for body in spec.bodies] == ["world", "body1_2", "body1", "puck"]


@pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass'")
@pytest.mark.parametrize("compiler", ['settotalmass="3"', 'boundmass="0.05"', 'boundinertia="0.001"'])
def test_what_is_added_keeps_its_mass_whatever_the_compiler_does_to_masses(compiler: str):
    xml = model(bodies=JOINTS).replace('angle="radian"', f'angle="radian" {compiler}')
    before = mujoco.MjSpec.from_string(xml).compile()
    spec = bake_inertia(mujoco.MjSpec.from_string(xml))
    add_effects(spec, [typical("payload")])
    spec.body("puck").mass *= 2
    after = spec.compile()
    kept = [number for number in range(1, after.nbody) if after.body(number).name != "payload"]
    doubled = np.where(np.arange(before.nbody) == before.body("puck").id, 2.0, 1.0)
    assert after.body_mass[kept] == pytest.approx((doubled * before.body_mass)[1:], rel=1e-12)
    assert after.body_inertia[kept] == pytest.approx(before.body_inertia[1:], rel=1e-9)
    assert after.body("payload").mass[0] == pytest.approx(0.05)


@pytest.mark.parametrize("order", [("shoulder", "elbow", "wrist"), ("wrist", "shoulder", "elbow")])
def test_a_payload_is_at_the_outermost_joint_in_whatever_order_actuators_are_listed(order: tuple[str, ...]):
    link = '<body name="{0}_link" pos="0.1 0 0"><joint name="{0}"/><geom size="0.02"/>{1}</body>'
    arm = link.format("shoulder", link.format("elbow", link.format("wrist", "")))
    servos = "".join(f'<position joint="{joint}" kp="1"/>' for joint in order)
    text = f"<mujoco><worldbody>{arm}</worldbody><actuator>{servos}</actuator></mujoco>"
    spec = mujoco.MjSpec.from_string(text)
    add_effects(spec, [typical("payload")])
    assert spec.body("payload").parent.name == "wrist_link"
    spec.delete(spec.body("payload"))
    evidence = EpisodeBatch(
        order, 0.01, np.zeros((1, 3)), *np.zeros((2, 1, 20, 3)), np.ones((1, 20), bool), np.zeros(1)
    )
    spec.body("wrist_link").geoms[0].mass = 0.7
    full = bake_inertia(spec)
    nominal = Nominal(find_robot("ergojr"), full, full, order, 0.01, list_base_parameters(full, order))
    nominal = replace(nominal, robot=replace(nominal.robot, joints=order))
    assert {each.mass for each in estimate_scales(nominal, evidence, evidence.measured)} == {0.7}


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_payload_and_gravity_compensation_belong_to_the_measured_arm(side: str, tmp_path):
    link = '<body name="{0}_link" pos="{1} 0 0.1"><joint name="{0}" axis="0 1 0"/><geom size="0.02"/></body>'
    servos = "".join(f'<position joint="{each}" kp="1"/>' for each in ("left", "right"))
    arms = link.format("left", -1) + link.format("right", 1)
    path = tmp_path / "arms.xml"
    path.write_text(f"<mujoco><worldbody>{arms}</worldbody><actuator>{servos}</actuator></mujoco>")
    effects = [typical("payload"), typical("gravity_compensation")]
    model = MujocoSimulator(find_robot(path), 0.01, (side,), effects=effects).model
    assert model.body(int(model.body("payload").parentid[0])).name == f"{side}_link"
    carried = [model.body(body).name for body in np.flatnonzero(model.body_gravcomp)]
    assert carried == [f"{side}_link", "payload"]

    other = {"left": "right", "right": "left"}[side]
    spec = mujoco.MjSpec.from_file(str(path))
    mark_measured_joints(spec, (other,), ("left", "right"))
    path.write_text(spec.to_xml())  # as of a report about the other arm
    model = MujocoSimulator(find_robot(path), 0.01, (side,), effects=effects).model
    assert model.body(int(model.body("payload").parentid[0])).name == f"{side}_link"

    evidence = EpisodeBatch(
        (side,), 0.01, np.zeros((1, 1)), *np.zeros((2, 1, 20, 1)), np.ones((1, 20), bool), np.zeros(1)
    )
    spec = Nominal.load(path, evidence).make_spec({})
    assert read_measured_joints(mujoco.MjSpec.from_string(spec.to_xml())) == (side,)


def puck_contact(spec: mujoco.MjSpec) -> tuple[float, ...]:
    """Everything about the contact of puck and floor but its sliding friction."""
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    mujoco.mj_forward(compiled, data)
    contact = next(each for each in data.contact if compiled.ngeom - 1 in each.geom)
    return (contact.dim, contact.includemargin, *contact.solref, *contact.solimp, *contact.friction[2:])


@pytest.mark.parametrize("floor", ['condim="4"', 'condim="4" priority="1"', 'solmix="3" margin="0.01" gap="0.002"'])
def test_written_out_contacts_keep_what_the_geoms_say(floor: str):
    xml = model().replace('condim="4"', f'{floor} solref="0.05 1" solimp="0.8 0.9 0.01" friction="1 0.01 0.02"')
    plain, edited = (mujoco.MjSpec.from_string(xml) for _ in range(2))
    add_effects(edited, [typical("object_friction")])
    assert puck_contact(edited) == pytest.approx(puck_contact(plain))


CARDAN = """
<mujoco>
  <compiler angle="radian"/>
  <default><default class="soft"><joint damping="0.7" armature="0.01"/></default></default>
  <worldbody>
    <body name="link">
      <joint name="j1" axis="0 1 0" armature="0.01"/>
      {later}
      <geom size="0.1" pos="0.1 0 0"/>
    </body>
  </worldbody>
  <tendon><fixed name="t"><joint joint="j2" coef="2"/></fixed></tendon>
  <equality><joint joint1="j2" active="false"/></equality>
  <actuator><position name="j1" joint="j1" kp="20"/><position name="j2" joint="j2" kp="20"/></actuator>
  <sensor><jointpos name="j2.pos" joint="j2"/></sensor>
</mujoco>
"""
SECOND = '<joint name="j2" axis="1 0 0" class="soft" range="-1 1" ref="0.1" pos="0 0 0.02"/>'


@pytest.mark.parametrize("later", [SECOND, f'<frame pos="0 0 0.1" euler="0.3 0 0">{SECOND}</frame>'])
@pytest.mark.parametrize("name", ["backlash", "joint_compliance"])
def test_a_second_hinge_turns_about_the_servo_s_axis_where_others_follow_on_the_body(name: str, later: str):
    spec = mujoco.MjSpec.from_string(CARDAN.format(later=later))
    before = spec.compile()
    add_effects(spec, [typical(name, joint="j1"), typical(name, joint="j2")])
    suffix = {"backlash": "play", "joint_compliance": "flex"}[name]
    for after in (spec.compile(), mujoco.MjModel.from_xml_string(spec.to_xml())):
        names = [after.joint(number).name for number in range(after.njnt)]
        assert names == ["j1", f"j1_{suffix}", "j2", f"j2_{suffix}"]
        one, two = mujoco.MjData(before), mujoco.MjData(after)
        one.qpos[:], two.qpos[:] = [0.4, 0.5], [0.3, 0.1, 0.7, -0.2]
        for compiled, data in ((before, one), (after, two)):
            mujoco.mj_forward(compiled, data)
        assert two.body("link").xquat == pytest.approx(one.body("link").xquat, abs=1e-6)
        assert two.body("link").xpos == pytest.approx(one.body("link").xpos, abs=1e-6)
        assert [two.sensor(f"{joint}.pos").data[0] for joint in ("j1", "j2")] == pytest.approx([0.4, 0.5])
        for field in ("damping", "armature", "range", "qpos0", "limited"):
            assert getattr(after.joint("j2"), field) == pytest.approx(getattr(before.joint("j2"), field))
        assert after.tendon_length0[0] == pytest.approx(before.tendon_length0[0])
        assert after.eq_obj1id[0] == after.joint("j2").id == after.actuator("j2").trnid[0]
