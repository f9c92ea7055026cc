"""Every robot is the machine that its sources describe, and survives what a recording does to it."""

import math
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from nas_data.dataset.features import EFFORT, POSITION
from nas_data.errors import ModelFileError, UnknownName
from nas_data.robots.base import Robot, find_robot, list_robot_names
from nas_data.simulators.layout import Layout
from nas_data.simulators.limits import command_limits, find_excitable_limits
from nas_data.simulators.mujoco import MujocoSimulator

ROBOTS = list_robot_names()
ERGOJRS = [name for name in ROBOTS if name.startswith("ergojr")]


@pytest.fixture(params=ROBOTS)
def robot(request) -> Robot:
    return find_robot(request.param)


def simulator(name: str) -> MujocoSimulator:
    return MujocoSimulator.load(name, 1 / find_robot(name).rate, threads=1)


def zero_posture(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = find_robot(name).spec().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_names_joints_sensors_and_tip_are_as_the_file_says(robot):
    model = robot.spec().compile()
    layout = Layout.of(model, robot.joints, robot.name)
    assert layout.joints == robot.joints
    sensors = {model.sensor(i).name: int(model.sensor_objid[i]) for i in range(model.nsensor)}
    missing = [joint for joint in robot.joints if sensors.get(f"{joint}.pos") != model.joint(joint).id]
    assert not missing, f'add <jointpos name="JOINT.pos" joint="JOINT"/> to <sensor>, for each JOINT of {missing}'
    assert robot.tip is None or model.site(robot.tip).id >= 0
    assert (robot.position_quantum > 0) == (robot.velocity_quantum > 0), "give both resolutions or none"


@pytest.mark.parametrize("name", ["pusher", "striker"])
def test_robots_that_exist_only_in_simulation_take_torques_and_read_exactly(name):
    robot = find_robot(name)
    assert set(simulator(name).kinds) == {EFFORT}
    assert robot.position_quantum == robot.velocity_quantum == 0


@pytest.mark.parametrize("name", ["ergo_shield", "ergojr", "ergojr_penholder", "pendulum", "so101_follower"])
def test_robots_that_exist_read_in_whole_units_of_their_encoders(name):
    robot = find_robot(name)
    assert set(simulator(name).kinds) == {POSITION}
    assert robot.position_quantum > 0 < robot.velocity_quantum


FLAG = """<mujoco>
  <custom>
    <numeric name="nas_rate" data="40"/><numeric name="nas_rest" data="0.3"/><text name="nas_tip" data="top"/>{more}
  </custom>
  <worldbody><body><joint name="hoist" axis="0 1 0"/><geom size="0.1"/><site name="top"/></body></worldbody>
  <actuator><position name="hoist" joint="hoist" kp="1"/></actuator>
</mujoco>"""


def test_a_model_may_hold_the_constants_of_its_robot(tmp_path):
    (tmp_path / "flag.xml").write_text(FLAG.format(more=""))
    robot = find_robot(tmp_path / "flag.xml")
    assert (robot.rate, robot.rest, robot.tip, robot.position_quantum) == (40.0, (0.3,), "top", 0.0)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ('<numeric name="nas_velocity_quantum" data="-1"/>', "nas_velocity_quantum as -1; allowed are nas_rate"),
        ('<numeric name="nas_speed" data="1"/>', "nas_speed as 1"),
        (
            '<text name="nas_top" data="top"/>',
            "the text nas_top; allowed are nas_tip, nas_mirror, nas_cyclic and nas_measured_joints",
        ),
    ],
)
def test_constants_that_cannot_be_are_refused(tmp_path, more, words):
    (tmp_path / "flag.xml").write_text(FLAG.format(more=more))
    with pytest.raises(ModelFileError, match=words):
        find_robot(tmp_path / "flag.xml")


@pytest.mark.parametrize(
    ("rest", "words"),
    [
        ("0.3 0", "nas_rest with 2 numbers; give one for each commanded joint: hoist"),
        ("30", r"nas_rest as 30 at the joint 'hoist', whose range is -1.047 … 1.047 rad; .* in radians"),
    ],
)
def test_a_rest_position_that_the_robot_does_not_have_is_refused(tmp_path, rest, words):
    limited = FLAG.replace('axis="0 1 0"', 'axis="0 1 0" range="-60 60" limited="true"').replace(
        'nas_rest" data="0.3"', 'nas_rest" data="{rest}"'
    )
    file = tmp_path / "flag.xml"
    file.write_text(limited.format(more="", rest="1.0472"))  # 60°, rounded up
    assert find_robot(file).rest == (1.0472,)
    file.write_text(limited.format(more="", rest=rest))
    with pytest.raises(ModelFileError, match=words):
        find_robot(file)


def test_stays_finite_and_within_limits_under_random_commands(robot):
    arm = MujocoSimulator(robot, 1 / robot.rate, threads=1)
    low, high = command_limits(arm.model, arm.joints, robot.name)
    low, high = find_excitable_limits(low, high, arm.joints, arm.kinds)
    rng = np.random.default_rng(0)
    commands = np.repeat(rng.uniform(low, high, (3, 20, len(low))), 10, axis=1)
    states = arm.rollout(np.zeros((3, 2 * len(low))), commands)
    if EFFORT in arm.kinds:
        low, high = arm.model.jnt_range[: len(low)].T
    assert np.isfinite(states).all()
    assert (states[..., : len(low)] > 1.1 * low - 0.5).all()
    assert (states[..., : len(low)] < 1.1 * high + 0.5).all()


def test_settles_when_a_command_is_held(robot):
    arm = MujocoSimulator(robot, 1 / robot.rate, threads=1)
    n = len(arm.joints)
    held = np.where([kind == POSITION for kind in arm.kinds], 0.3, 0.0)  # speeds and torques of zero
    commands = np.tile(held, (1, round(6 * robot.rate), 1))
    states = arm.rollout(np.zeros((1, 2 * n)), commands)[0]
    last = states[-round(robot.rate / 2) :]
    assert np.abs(last[:, n:]).max() < 5e-3
    assert np.ptp(last[:, :n], axis=0).max() < 1e-3


def test_the_ergojr_weighs_what_poppys_description_says():
    model, _ = zero_posture("ergojr")
    masses = [model.body(f"link{i}").mass[0] for i in range(1, 7)]
    assert masses == pytest.approx([0.0042, 0.0201, 0.0178, 0.0201, 0.0201, 0.0165])
    assert model.body("base").mass[0] == pytest.approx(0.0802)
    assert sum(masses) == pytest.approx(0.0988)
    heavier, _ = zero_posture("ergojr_penholder")
    assert heavier.body_mass.sum() - model.body_mass.sum() == pytest.approx(0.004)


def test_link_inertias_are_those_of_a_small_servo():
    model, _ = zero_posture("ergojr")
    inertias = np.array([model.body(f"link{i}").inertia for i in range(2, 7)])
    assert (inertias > 1e-6).all()
    assert (inertias < 7e-6).all()  # Poppy's description: about 2e-6 to 7e-6 kg m²


def test_joints_lie_where_the_authors_chain_puts_them():
    _, data = zero_posture("ergojr")
    anchors = {joint: data.joint(joint).xanchor for joint in ("m1", "m2", "m3", "m4", "m5", "m6")}
    expected = {
        "m1": (0, 0.0375, 0.035),
        "m2": (0, 0.0375, 0.059),
        "m3": (0, 0.0375, 0.113),
        "m4": (0, 0.0375, 0.141),
        "m5": (0, 0.0855, 0.156),
        "m6": (0, 0.1395, 0.156),
    }
    for joint, place in expected.items():
        assert anchors[joint] == pytest.approx(place, abs=1e-9)


def test_the_penholder_is_where_the_paper_measures_it():
    _, data = zero_posture("ergojr_penholder")
    assert data.body("penholder").xpos == pytest.approx((0, 0.1695, 0.156), abs=1e-9)
    assert data.site("tip").xpos == pytest.approx((0, 0.1695, 0.156), abs=1e-9)


@pytest.mark.parametrize(("joint", "direction"), [("m1", 1), ("m2", -1), ("m3", -1), ("m4", 1), ("m5", -1), ("m6", -1)])
def test_axes_turn_as_poppys_user_angles(joint, direction):
    _, data = zero_posture("ergojr")
    axis = (0, 0, 1) if joint in {"m1", "m4"} else (1, 0, 0)
    assert data.joint(joint).xaxis == pytest.approx(direction * np.array(axis), abs=1e-9)


def test_the_servo_is_bams_xl320():
    kt, resistance, volts = 0.987, 35.6, 7.5
    model, _ = zero_posture("ergojr")
    gain = 32 * 0.0505 * volts * kt / resistance
    assert model.actuator_gainprm[:, 0] == pytest.approx(gain, rel=1e-3)
    assert -model.actuator_biasprm[:, 1] == pytest.approx(gain, rel=1e-3)
    assert model.actuator_forcerange[:, 1] == pytest.approx(volts * kt / resistance, rel=1e-3)
    assert model.dof_damping == pytest.approx(kt**2 / resistance + 0.00332, rel=1e-3)
    assert model.dof_armature == pytest.approx(0.00112)
    assert model.dof_frictionloss == pytest.approx(0.0275)
    assert model.jnt_range == pytest.approx(np.tile([-math.pi / 2, math.pi / 2], (6, 1)), abs=1e-6)


def test_friction_holds_instead_of_creeping():
    # stretched out sideways and commanded half the dead zone away, gravity and servo pull; friction must win
    arm = simulator("ergojr")
    start = np.zeros((1, 12))
    commands = np.full((1, 300, 6), 0.03)
    states = arm.rollout(start, commands)[0]
    assert np.abs(states[-1, :6] - states[99, :6]).max() < math.radians(0.1)


def test_the_ergojr_stands_on_a_floor():
    arm = simulator("ergojr")
    reach_down = np.array([0, 1.5, 0.9, 0, 0.4, 0])
    for sign in (1, -1):
        stepper = arm.stepper(1)
        for _ in range(200):
            stepper.step(sign * reach_down[None])
        assert stepper.site_positions("tip")[0, 2] > -0.02


def test_the_pusher_weighs_and_measures_what_the_authors_file_says():
    model, data = zero_posture("pusher")
    assert [model.body(name).mass[0] for name in ("link1", "link2", "link3")] == pytest.approx([1.63] * 3, abs=0.005)
    assert model.body("fork").mass[0] == pytest.approx(1.45, abs=0.005)
    assert model.dof_damping == pytest.approx([1, 1, 1, 0.5, 0.5])
    assert model.dof_armature == pytest.approx([0.04, 0.04, 0.04, 0, 0])
    assert model.body("puck").mass[0] == pytest.approx(0.04)  # what the authors' slides have as motor inertia
    assert model.jnt_range[:3] == pytest.approx(np.array([[-2.5, 2.5], [-2.3213, 2.3], [-2.3213, 2.3]]))
    elbow = 0.4 * np.array([np.cos(0.785), np.sin(0.785)])
    reached = elbow + np.array([0.4, 0]) + (0.4 + 0.0528) * np.array([np.cos(1.57), -np.sin(1.57)])
    assert data.site("gripper").xpos[:2] == pytest.approx(reached, abs=1e-3)


def test_the_striker_has_the_ranges_and_losses_of_its_sources():
    model, data = zero_posture("striker")
    low = [-2.2854, -0.5236, -1.5, -2.3213, -1.5, -1.094, -1.5]
    high = [1.7146, 1.3963, 1.7, 0, 1.5, 0, 1.5]
    assert model.jnt_range[:7] == pytest.approx(np.column_stack([low, high]))
    assert model.dof_damping == pytest.approx([1, 1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.5, 0.5])
    assert model.dof_armature == pytest.approx([0.04] * 7 + [0, 0])
    assert model.actuator_ctrlrange == pytest.approx(np.tile([-3, 3], (7, 1)))
    assert data.site("tip").xpos == pytest.approx([0.1 + 0.4 + 0.321 + 0.017, -0.6, 0])
    assert data.body("ball").xpos == pytest.approx([0.5, -0.175, -0.27])


def test_sword_and_shield_are_where_and_as_large_as_the_authors_made_them():
    model, data = zero_posture("ergo_shield")
    assert data.site("sword_top").xpos == pytest.approx([0, 0.1695, 0.156 + 0.135])
    assert data.site("sword_bottom").xpos == pytest.approx([0, 0.1695, 0.156 - 0.015])
    assert data.site("defender_shield_centre").xpos == pytest.approx([0, 0.37 - 0.1695, 0.156])
    assert data.site("defender_shield_front").xpos[1] < data.site("defender_shield_centre").xpos[1]
    sword, shield = (model.geom(name).size for name in ("sword", "defender_shield"))
    assert sword[:2] == pytest.approx([0.0035, 0.075]) and shield[:2] == pytest.approx([0.0235, 0.0025])
    own = [model.body(f"link{i}").mass[0] for i in range(1, 7)]
    assert own == pytest.approx([model.body(f"defender_link{i}").mass[0] for i in range(1, 7)])


def test_the_pendulum_feels_m_g_l_sin_q():
    model, data = zero_posture("pendulum")
    for q in np.linspace(-3, 3, 13):
        data.qpos[0] = q
        mujoco.mj_forward(model, data)
        assert data.qfrc_bias[0] == pytest.approx(0.49 * 9.81 * 0.1 * math.sin(q), rel=1e-3, abs=1e-9)
    data.qpos[0] = 0
    mujoco.mj_forward(model, data)
    inertia = np.zeros((1, 1))
    mujoco.mj_fullM(model, data, inertia)
    assert inertia[0, 0] == pytest.approx(0.49 * 0.1**2 + 0.00181, rel=1e-3)
    assert model.dof_frictionloss[0] == 0


def test_the_pendulum_swings_a_recorded_command_as_the_rig_does_within_its_known_gap():
    folder = Path(__file__).parents[3] / "shared/realdata/bam_xl330"
    log = folder / "2026-01-15_10h29m14.json"
    if not log.is_file():
        pytest.skip("the real recordings are not in ../shared/realdata")
    import json

    entries = json.loads(log.read_text())["entries"]
    time = np.array([entry["timestamp"] for entry in entries])
    grid = np.arange(time[0], time[-1], 0.005)
    command, measured = (
        np.interp(grid, time, [entry[key] for entry in entries]) for key in ("goal_position", "position")
    )
    arm = simulator("pendulum")
    states = arm.rollout(np.array([[measured[0], 0.0]]), command[None, :, None])[0]
    error = np.sqrt(np.mean((states[:, 0] - measured) ** 2))
    # a frictionless model is 10 to 35° off on this rig; a wrong sign, gain or inertia is off by far more
    assert error < math.radians(20)
    assert error < np.sqrt(np.mean((command - measured) ** 2))


def test_a_user_s_urdf_gets_servos_that_hold_it(tmp_path):
    file = tmp_path / "lever.urdf"
    file.write_text(
        """<robot name="lever"><link name="base"/>
        <link name="arm"><inertial><origin xyz="0 0 0.1"/><mass value="0.3"/>
        <inertia ixx="0.001" iyy="0.001" izz="0.0002" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="1 0 0"/>
        <limit lower="-1.5" upper="1.5" effort="3" velocity="5"/></joint></robot>"""
    )
    robot = find_robot(file)
    arm = MujocoSimulator(robot, 0.02, threads=1)
    assert robot.joints == ("shoulder",)
    reached = arm.rollout(np.zeros((1, 2)), np.full((1, 50, 1), 0.5))[0, -1]
    assert reached == pytest.approx([0.5, 0], abs=0.03)


def test_what_is_no_robot_is_refused(tmp_path):
    with pytest.raises(UnknownName, match="ergojr, ergojr_penholder"):
        find_robot("r2d2")
    with pytest.raises(ModelFileError, match="no model file"):
        find_robot(tmp_path / "absent.xml")
    free = tmp_path / "free.xml"
    free.write_text('<mujoco><worldbody><body><joint/><geom size="0.1"/></body></worldbody></mujoco>')
    with pytest.raises(ModelFileError, match="no actuator"):
        find_robot(free)


LINK = '<inertial><mass value="{}"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>'
FLOATING = f"""<robot name="r"><link name="w"/><link name="b">{LINK.format(1)}</link>
<link name="l">{LINK.format(0.1)}</link>
<joint name="f" type="floating"><parent link="w"/><child link="b"/></joint><joint name="j" type="revolute">
<parent link="b"/>
<child link="l"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="9"/></joint></robot>"""


def test_the_floating_base_of_a_urdf_is_held_as_that_of_an_mjcf(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(FLOATING)
    robot = find_robot(path)
    model = robot.spec().compile()
    assert robot.joints == ("j",) and robot.bases == ("b",) and model.njnt == model.nu == 1


def test_what_a_urdf_lacks_is_said_with_a_remedy_that_works(tmp_path):
    path = tmp_path / "arm.urdf"
    mesh = '<collision><geometry><mesh filename="package://arm/meshes/l.obj"/></geometry></collision>'
    path.write_text(FLOATING.replace('</link>\n<joint name="f"', mesh + '</link>\n<joint name="f"'))
    with pytest.raises(ModelFileError, match=r"'arm/meshes/l\.obj' of a ROS package: put the package's folder beside"):
        find_robot(path)
    (tmp_path / "arm/meshes").mkdir(parents=True)
    (tmp_path / "arm/meshes/l.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    path.write_text(path.read_text().replace("package://", ""))
    assert find_robot(path).joints == ("j",)
    path.write_text(path.read_text().replace("l.obj", "l.dae"))
    with pytest.raises(ModelFileError, match=r"a mesh that MuJoCo cannot read, '.*/l\.dae': convert it to"):
        (tmp_path / "arm/meshes/l.obj").rename(tmp_path / "arm/meshes/l.dae")
        find_robot(path)
    path.write_text(FLOATING.replace(LINK.format(0.1), ""))
    with pytest.raises(ModelFileError, match="a moving link without mass, 'l'; give it mass and inertia"):
        find_robot(path)


def test_a_warning_of_the_engine_is_shown_once_however_often_a_model_is_read(tmp_path, capsys):
    path = tmp_path / "arm.urdf"
    path.write_text(
        FLOATING.replace('name="j"', 'name="unlimited"').replace('lower="-1" upper="1"', 'lower="0" upper="0"')
    )
    for _ in range(2):
        find_robot(path).spec()
    assert capsys.readouterr().err.count("'unlimited' has equal lower and upper limits") == 1


def test_an_inertia_that_no_body_has_is_said_with_a_remedy_that_works(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(FLOATING.replace('izz="1e-3"', 'izz="3e-3"'))
    with pytest.raises(ModelFileError, match=r"that no body has, '[bl]': .* than the sum of the others") as said:
        find_robot(path)
    remedy = re.search(r"write (<mujoco>.*</mujoco>) inside <robot>", str(said.value))[1]
    path.write_text(path.read_text().replace("</robot>", remedy + "</robot>"))
    assert find_robot(path).joints == ("j",)
    path.write_text(FLOATING.replace('izz="1e-3"', 'izz="-1e-3"'))
    with pytest.raises(ModelFileError, match=r"that no body has, '[bl]': a principal moment is not above 0"):
        find_robot(path)


BOX = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
FIXED = FLOATING.replace('"floating"', '"fixed"').replace("</link>\n", BOX + "</link>\n")


def test_the_base_of_a_urdf_does_not_push_its_first_link(tmp_path):
    """MuJoCo excludes contacts of links that a joint connects, except those of a base that is fixed to the world."""
    path = tmp_path / "arm.urdf"
    for text, contacts in ((FIXED, True), (FLOATING.replace("</link>\n", BOX + "</link>\n"), False)):
        path.write_text(text)
        given, taken = (
            mujoco.MjData(model)
            for model in (mujoco.MjModel.from_xml_path(str(path)), find_robot(path).spec().compile())
        )
        for data in (given, taken):
            mujoco.mj_forward(data.model, data)
        assert (given.ncon > 0) == contacts and taken.ncon == 0
