"""Effects in models that say the same in different ways: what is derived, switched off or limited elsewhere."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from nas_data.effects.base import Effect, parse
from nas_data.errors import ModelFileError
from nas_data.gap.nominal_parameters import find_moved_bodies
from nas_data.mjcf.bake_inertia import bake_inertia
from nas_data.mjcf.timestep import set_timestep
from nas_data.robots.base import find_robot, read_spec
from nas_data.simulators.mujoco import MujocoSimulator

PERIOD, ROWS = 0.02, 60
ARM = """<mujoco><compiler {compiler} angle="radian"/><option timestep="0.002" integrator="implicitfast" {option}>
<flag {flag}/></option><worldbody><body><joint name="a" axis="0 1 0" armature=".02" {first}/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".01" mass=".4" contype="0" conaffinity="0"/>
<body pos=".2 0 0"><joint name="b" axis="0 1 0" {joint}/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".01" mass=".2" contype="0" conaffinity="0"/></body></body></worldbody>
<actuator><position name="a" joint="a" kp="20" kv=".6"/>{before}<position name="b" joint="b" kp="12" kv=".6" {servo}/>
</actuator></mujoco>"""
BLANK = dict.fromkeys(("compiler", "option", "flag", "joint", "before", "servo"), "") | {"first": 'damping=".1"'}
PLAIN = 'damping=".1" armature=".02"'
OFF = '<position name="off" joint="b" kp="500" group="3"/>'
SAME = {  # name: what a model says, and the same in other words
    "inertia of the motor": ({"joint": 'damping=".06" armature=".004"', "servo": 'damping=".04" armature=".016"'}, {}),
    "friction off": ({"flag": 'frictionloss="disable"', "joint": PLAIN + ' frictionloss=".5"'}, {}),
    "limits off": ({"flag": 'limit="disable"', "joint": PLAIN + ' range="-.01 .01" limited="true"'}, {}),
    "springs off": ({"flag": 'spring="disable"', "joint": PLAIN + ' stiffness="9"'}, {}),
    "dampers off": ({"flag": 'damper="disable"', "joint": PLAIN}, {"first": "", "joint": 'armature=".02"'}),
    "constraints off": ({"flag": 'constraint="disable"', "joint": PLAIN + ' frictionloss=".5"'}, {}),
    "actuator off": ({"option": 'actuatorgroupdisable="3"', "before": OFF}, {}),
    "limit of the joint": ({"joint": PLAIN + ' actuatorfrcrange="-.8 .8"'}, {"servo": 'forcerange="-.8 .8"'}),
}
EFFECTS = (
    "servo_stiffness:factor=0.5",
    "viscous_friction:coefficient=0.4",
    "coulomb_friction:torque=0.2",
    "stribeck_friction:torque=0.6,kinetic_ratio=0.2,stribeck_velocity=5",
    "asymmetric_friction:torque=0.3,difference=0.2",
    "backlash:half_width=0.05",
    "torque_limit:torque=0.5",
    "deadband:half_width=0.03",
)


def simulate(folder: Path, words: dict[str, str], *effects: Effect) -> np.ndarray:
    """Return the positions [rad] of both joints after each command, shape (T, 2)."""
    path = folder / "arm.xml"
    path.write_text(ARM.format(**(BLANK | {"joint": PLAIN} | words)))
    simulator = MujocoSimulator(find_robot(path), PERIOD, effects=effects, threads=1)
    commands = np.repeat(np.array([[0.0, 1.2], [0.3, -0.4], [0.0, 0.5]]), ROWS // 3, axis=0)
    return simulator.rollout(np.zeros((1, 4)), commands[None])[0, :, :2]


@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("name", SAME)
def test_an_effect_acts_alike_in_models_that_say_the_same(name: str, effect: str, tmp_path: Path):
    kind, _, parameters = effect.partition(":")
    added = parse(f"{kind}:joint=b,{parameters}")
    one, other = SAME[name]
    assert simulate(tmp_path, one) == pytest.approx(simulate(tmp_path, other), abs=1e-9)
    moved = simulate(tmp_path, other, added)
    assert simulate(tmp_path, one, added) == pytest.approx(moved, abs=1e-6)
    assert np.abs(moved - simulate(tmp_path, other)).max() > 0.01


def test_what_a_spring_and_damper_are_derived_from_may_change(tmp_path: Path):
    derived = {"joint": 'armature=".02" springdamper=".3 .7"'}
    simulate(tmp_path, derived)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    numbers = f'armature=".02" stiffness="{model.jnt_stiffness[1]}" damping="{model.dof_damping[1]}"'
    for effect in ("viscous_friction:joint=b,coefficient=0.5", "rotor_inertia:joint=b,inertia=0.03"):
        added = parse(effect)
        assert simulate(tmp_path, derived, added) == pytest.approx(
            simulate(tmp_path, {"joint": numbers}, added), abs=1e-5
        )


@pytest.mark.filterwarnings("ignore:compiler attribute")
def test_a_payload_keeps_its_mass_where_the_compiler_sets_the_total(tmp_path: Path):
    payload = parse("payload:mass=0.3")
    total = {"compiler": 'settotalmass="0.6"'}  # what the arm has anyway
    assert simulate(tmp_path, total, payload) == pytest.approx(simulate(tmp_path, {}, payload), abs=1e-6)


@pytest.mark.parametrize("timestep", [0.0005, 0.0015, 0.002])
def test_a_delay_of_the_model_lasts_as_long_at_any_timestep(timestep: float):
    spec = mujoco.MjSpec.from_string(ARM.format(**BLANK | {"servo": 'delay=".04" nsample="20"'}))
    set_timestep(spec, timestep)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.0, 1.0
    forces = []
    for _ in range(round(0.06 / timestep)):
        mujoco.mj_step(model, data)
        forces.append(float(data.actuator_force[1]))
    begin = next(row for row, force in enumerate(forces) if force > 5)
    assert begin * timestep == pytest.approx(0.04, abs=1.01 * timestep)


def test_an_integral_is_refused_where_a_speed_limit_took_the_control_s_own_zero(tmp_path: Path):
    own = '<general name="b" joint="b" gainprm=".1" biastype="affine" biasprm="-12 -12 -.6" ctrlrange="0 255"/>'
    text = ARM.format(**BLANK | {"joint": PLAIN}).replace('<position name="b" joint="b" kp="12" kv=".6" />', own)
    path = tmp_path / "unit.xml"
    path.write_text(text)
    limit, integral = parse("speed_limit:joint=b,speed=1"), parse("integral_gain:joint=b,gain=20")
    for effects in ([integral], [limit, integral], [integral, limit]):
        with pytest.raises(ModelFileError, match="zero of its own"):
            MujocoSimulator(find_robot(path), PERIOD, effects=effects, threads=1)


def test_of_two_joints_of_one_body_the_last_one_has_its_mass():
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body><joint name="a"/><geom size=".1"/>
<body name="hand" pos=".5 0 0"><joint name="b"/><joint name="c" axis="0 1 0"/><geom size=".1"/></body></body>
</worldbody></mujoco>""")
    names = ["c", "b", "a"]
    assert find_moved_bodies(model, "c", names) == ("hand",) and find_moved_bodies(model, "b", names) == ()
    assert find_moved_bodies(model, "b", ["a", "b"]) == ("hand",)


def test_links_of_a_urdf_that_are_fused_need_no_inertia_of_their_own(tmp_path: Path):
    path = tmp_path / "arm.urdf"
    inertial = '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'
    path.write_text(f"""<robot name="arm"><link name="base"/><link name="l1">{inertial}</link>
<link name="l2">{inertial}</link><joint name="f" type="floating"><parent link="base"/><child link="l1"/></joint>
<joint name="j" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="5" velocity="5"/></joint></robot>""")
    spec = bake_inertia(find_robot(path).spec())
    assert spec.compile().nq == 1


def test_files_of_an_included_file_are_found_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    parts = tmp_path / "project" / "robot"
    parts.mkdir(parents=True)
    (parts / "part.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    (parts / "robot.xml").write_text(
        '<mujoco><asset><mesh name="part" file="part.obj"/></asset><worldbody><body><joint/>'
        '<geom type="mesh" mesh="part"/></body></worldbody></mujoco>'
    )
    (tmp_path / "project/scene.xml").write_text('<mujoco><include file="robot/robot.xml"/></mujoco>')
    monkeypatch.chdir(tmp_path)
    assert len(read_spec(Path("project/scene.xml")).meshes) == 1
