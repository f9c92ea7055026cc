"""PyBullet is the same robot on another engine: it agrees with MuJoCo where physics decides, and keeps the contract."""

import gc
import json
import math
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as Xml

import mujoco
import numpy as np
import pytest
from support.simulator_samples import damped_ergojr
from support.typical_effects import NAMES, OF_OBJECTS, typical

from nas_data.effects.base import Effect, parse
from nas_data.errors import JointMismatch, ModelFileError
from nas_data.robots.base import Robot, find_robot, list_robot_names
from nas_data.simulators.engines import load_simulator
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.simulators.urdf import roll_pitch_yaw, to_urdf

PERIOD = 0.01


@pytest.fixture(scope="module")
def bullet():
    return load_simulator("ergojr", PERIOD, engine="bullet")


@pytest.fixture(scope="module")
def mujoco_arm() -> MujocoSimulator:
    return MujocoSimulator.load("ergojr", PERIOD, threads=1)


def random_holds(seed=1, holds=4, size=0.8, episodes=1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-size, size, (episodes, holds, 6)), 60, axis=1)


def rms_degrees(difference: np.ndarray) -> np.ndarray:
    return np.degrees(np.sqrt(np.mean(difference[..., :6] ** 2, axis=(0, 1))))


# ---- the export, which needs no PyBullet ------------------------------------------------------------------------


@pytest.mark.parametrize("name", list_robot_names())
def test_the_urdf_is_the_same_machine_when_mujoco_reads_it(name):
    """Masses, inertias and gravity torques survive the way through URDF; flywheels sit on the base."""
    model = find_robot(name).spec().compile()
    text = to_urdf(model).text
    back = mujoco.MjSpec.from_string(text).compile()
    back.opt.gravity = model.opt.gravity  # which no URDF holds
    own = [model.joint(joint).dofadr[0] for joint in find_robot(name).joints]
    data, copied = mujoco.MjData(model), mujoco.MjData(back)
    rng = np.random.default_rng(0)
    for _ in range(5):
        for joint in find_robot(name).joints:
            angle = rng.uniform(-1, 1)
            data.joint(joint).qpos[0] = copied.joint(joint).qpos[0] = angle
        mujoco.mj_forward(model, data)
        mujoco.mj_forward(back, copied)
        inertia, other = np.zeros((model.nv, model.nv)), np.zeros((back.nv, back.nv))
        mujoco.mj_fullM(model, data, inertia)
        mujoco.mj_fullM(back, copied, other)
        rows = [back.joint(joint).dofadr[0] for joint in find_robot(name).joints]
        assert copied.qfrc_bias[rows] == pytest.approx(data.qfrc_bias[own], abs=1e-9)
        bare = inertia - np.diag(model.dof_armature)
        assert other[np.ix_(rows, rows)] == pytest.approx(bare[np.ix_(own, own)], abs=1e-10)
    for joint in find_robot(name).joints:
        rotor = back.joint(f"{joint}_rotor").dofadr[0]
        assert other[rotor, rotor] == pytest.approx(model.dof_armature[model.joint(joint).dofadr[0]])


def test_angles_of_urdf_turn_back_into_the_same_rotation():
    rng = np.random.default_rng(0)
    quaternions = [*rng.normal(size=(50, 4)), [1, 0, 1, 0], [1, 0, -1, 0], [0.5, 0.5, 0.5, 0.5], [1, 0, 0, 0]]
    for raw in quaternions:
        quaternion = np.array(raw, float) / np.linalg.norm(raw)
        roll, pitch, yaw = roll_pitch_yaw(quaternion)
        back = np.array([1.0, 0, 0, 0])
        for angle, axis in ((roll, 0), (pitch, 1), (yaw, 2)):
            turn = np.zeros(4)
            turn[0], turn[1 + axis] = math.cos(angle / 2), math.sin(angle / 2)
            product = np.empty(4)
            mujoco.mju_mulQuat(product, turn, back)
            back = product
        assert abs(back @ quaternion) == pytest.approx(1, abs=1e-9)


def test_play_becomes_a_joint_of_its_own_in_the_urdf():
    spec = find_robot("ergojr").spec()
    parse("backlash:joint=m3,half_width=0.02").edit(spec)
    robot = Xml.fromstring(to_urdf(spec.compile()).text)
    joints = {joint.get("name"): joint for joint in robot.iter("joint")}
    assert joints["m3"].find("child").get("link") == joints["m3_play"].find("parent").get("link")
    assert float(joints["m3_play"].find("limit").get("upper")) == pytest.approx(0.02)


# ---- the engine -------------------------------------------------------------------------------------------------


@pytest.mark.bullet
def test_step_responses_agree_within_half_a_degree(bullet, mujoco_arm):
    commands = random_holds()
    start = np.zeros((1, 12))
    difference = bullet.rollout(start, commands) - mujoco_arm.rollout(start, commands)
    assert rms_degrees(difference).max() < 0.5
    assert np.degrees(np.abs(difference[..., :6])).max() < 3


SIZES = (
    "backlash:joint=m3,half_width=0.03",
    "joint_compliance:joint=m3,stiffness=1",
    "coulomb_friction:joint=m3,torque=0.02",
    "stribeck_friction:joint=m3,torque=0.03,kinetic_ratio=0.5,stribeck_velocity=0.3",
    "load_friction:joint=m3,ratio=0.2",
    "viscous_friction:joint=m3,coefficient=0.03",
    "rotor_inertia:joint=m3,inertia=0.002",
    "servo_stiffness:joint=m3,factor=0.6",
    "torque_limit:joint=m3,torque=0.1",
    "speed_limit:joint=m3,speed=1.5",
    "command_delay:delay=0.03",
    "joint_offset:joint=m3,offset=0.05",
    "deadband:joint=m3,half_width=0.03",
    "payload:mass=0.02",
    "base_tilt:roll=0.2,pitch=0.1",
    "gravity_compensation:share=0.5",
    "backlash:joint=m3,half_width=0.05,stiffness=1.5",
)
ELSEWHERE = {*OF_OBJECTS, "servo_damping", "floor_contact"}  # the arm has no objects, velocity gains and shapes
SIZED = [parse(text) for text in SIZES]
EFFECTS = SIZED + [typical(name) for name in NAMES if name not in ELSEWHERE | {effect.name() for effect in SIZED}]


@pytest.mark.bullet
@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name())
def test_every_effect_acts_in_both_engines_alike(effect):
    acts_alike(effect, "ergojr")


@pytest.mark.bullet
def test_less_servo_damping_acts_in_both_engines_alike():
    acts_alike(parse("servo_damping:joint=m3,factor=0.2"), str(damped_ergojr()))


def acts_alike(effect: Effect, model: str) -> None:
    """An effect moves the arm, and by the same in both engines."""
    commands, start = random_holds(holds=3), np.zeros((1, 12))
    plain = MujocoSimulator.load(model, PERIOD, threads=1).rollout(start, commands)
    one = MujocoSimulator.load(model, PERIOD, effects=[effect], threads=1).rollout(start, commands)
    other = load_simulator(model, PERIOD, effects=[effect], engine="bullet").rollout(start, commands)
    moved, apart = rms_degrees(one - plain).max(), rms_degrees(other - one).max()
    assert moved > 0.5
    assert apart < max(0.5, 0.1 * moved)


@pytest.mark.bullet
def test_the_arm_comes_to_rest_where_servo_and_gravity_balance():
    """Without friction, kp · (command − q) is the gravity torque at rest, by PyBullet's own dynamics."""

    def frictionless(spec: mujoco.MjSpec) -> None:
        for joint in spec.joints:
            joint.frictionloss = 0

    base = find_robot("ergojr")
    robot = Robot(name="smooth", mjcf=base.mjcf, joints=base.joints, edit=frictionless)
    from nas_data.simulators.bullet import BulletSimulator

    arm = BulletSimulator(robot, PERIOD)
    commands = np.repeat(np.array([[[0.2, 0.4, -0.3, 0.5, 0.2, -0.4]]]), 400, axis=1)
    reached = arm.rollout(np.zeros((1, 12)), commands)[0, -1]
    data = mujoco.MjData(arm.model)
    data.qpos[:] = reached[:6]
    mujoco.mj_forward(arm.model, data)
    stiffness = arm.model.actuator_gainprm[:, 0]
    assert np.abs(reached[6:]).max() < 1e-3
    assert stiffness * (commands[0, -1] - reached[:6]) == pytest.approx(data.qfrc_bias, abs=2e-5)
    assert np.abs(data.qfrc_bias).max() > 0.01


@pytest.mark.bullet
def test_predictions_depend_on_their_row_alone(bullet):
    rng = np.random.default_rng(0)
    states = np.concatenate([rng.uniform(-0.5, 0.5, (12, 6)), rng.uniform(-2, 2, (12, 6))], axis=1)
    commands = rng.uniform(-1, 1, (12, 6))
    order = rng.permutation(12)
    assert np.array_equal(bullet.predict(states, commands)[order], bullet.predict(states[order], commands[order]))


@pytest.mark.bullet
def test_predictions_are_near_mujoco_s(bullet, mujoco_arm):
    rng = np.random.default_rng(0)
    states = np.concatenate([rng.uniform(-0.5, 0.5, (30, 6)), rng.uniform(-2, 2, (30, 6))], axis=1)
    commands = rng.uniform(-1, 1, (30, 6))
    difference = bullet.predict(states, commands) - mujoco_arm.predict(states, commands)
    assert np.abs(difference[:, :6]).max() < math.radians(0.3)


@pytest.mark.bullet
def test_closed_loops_are_rollouts_taken_step_by_step(bullet):
    commands = random_holds(holds=1, episodes=2)[:, :20]
    stepper = bullet.stepper(2)
    start = np.concatenate([random_holds(seed=5, size=0.3, episodes=2)[:, 0], np.zeros((2, 6))], axis=1)
    stepper.reset(start)
    assert stepper.states == pytest.approx(start)
    stepped = np.stack([stepper.step(commands[:, step]) for step in range(20)], axis=1)
    assert np.array_equal(stepped, bullet.rollout(start, commands))
    stepper.reset(start[:1], rows=np.array([1]))
    assert stepper.states[1] == pytest.approx(start[0])
    assert stepper.states[0] == pytest.approx(stepped[0, -1])


@pytest.mark.bullet
def test_states_can_be_set_and_the_tip_goes_with_them(bullet, mujoco_arm):
    states = np.zeros((2, 12))
    states[1, :6] = [0.3, 0.2, -0.1, 0.4, 0.1, 0.2]
    ours, reference = bullet.stepper(2), mujoco_arm.stepper(2)
    for stepper in (ours, reference):
        stepper.set_states(states)
        assert stepper.states == pytest.approx(states, abs=1e-12)
    assert ours.site_positions("tip") == pytest.approx(reference.site_positions("tip"))
    with pytest.raises(ModelFileError, match="no site"):
        ours.site_positions("nose")


@pytest.mark.bullet
def test_looking_at_the_tip_changes_nothing():
    """A goal of limited acceleration goes on from where it is."""
    effects = [parse("acceleration_limit:joint=pendulum,acceleration=5")]
    simulator = load_simulator("pendulum", PERIOD, effects=effects, engine="bullet")
    watched, alone = simulator.stepper(1), simulator.stepper(1)
    for _ in range(60):
        after = [stepper.step(np.array([[0.6]])) for stepper in (watched, alone)]
        assert np.array_equal(*after)
        watched.site_positions("tip")
    assert alone.states[0, 0] > 0.3


@pytest.mark.bullet
def test_the_floor_carries_the_arm(bullet):
    """Commanded through the floor, the arm lies on it."""
    lowest = []
    for command in ([0, 1.5, 0.9, 0, 0.4, 0], [0, -1.5, -0.9, 0, -0.4, 0]):
        stepper = bullet.stepper(1)
        for _ in range(150):
            stepper.step(np.array([command]))
        lowest.append(stepper.site_positions("tip")[0, 2])
    assert min(lowest) > -0.02
    assert min(lowest) < 0.04


@pytest.mark.bullet
def test_neighbours_never_touch_and_distant_links_may():
    from nas_data.simulators.bullet_world import can_collide

    model = find_robot("ergojr").spec().compile()
    index = {model.body(i).name: i for i in range(model.nbody)}
    for first, second, expected in (
        ("link4", "link5", False),
        ("link2", "link4", False),
        ("base", "link2", False),
        ("link2", "link6", True),
        ("base", "link6", True),
    ):
        assert can_collide(model, *sorted((index[first], index[second]))) == expected


@pytest.mark.bullet
def test_worlds_are_closed_with_their_simulator():
    from nas_data.simulators.bullet import BulletSimulator

    arm = BulletSimulator.load("pendulum", PERIOD)
    library, client = arm._arm.world.bullet, arm._arm.world.client
    assert library.isConnected(client)
    del arm
    gc.collect()
    assert not library.isConnected(client)
    other = BulletSimulator.load("pendulum", PERIOD)
    other.close()
    other.close()
    assert not library.isConnected(other._arm.world.client)


@pytest.mark.bullet
def test_what_does_not_fit_is_refused(bullet):
    with pytest.raises(JointMismatch, match="6 joints"):
        bullet.predict(np.zeros((1, 10)), np.zeros((1, 5)))


@pytest.mark.bullet
def test_the_program_s_json_stays_clean_of_the_engine_s_chatter(tmp_path):
    words = "record sim --engine bullet --robot pendulum --episodes 1 --seconds 0.5 --out recorded --json"
    done = subprocess.run(
        [sys.executable, "-m", "nas_data", *words.split()], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert json.loads(done.stdout)["frames"] == 100
    provenance = json.loads(Path(tmp_path, "recorded/meta/nas.json").read_text())
    assert provenance["target"]["engine"] == "bullet"


def test_without_pybullet_the_remedy_is_named(monkeypatch):
    from nas_data.errors import MissingPackage

    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(MissingPackage, match=r"nas_data\[bullet\]"):
        load_simulator("pendulum", PERIOD, engine="bullet")


@pytest.mark.bullet
def test_a_simulation_of_a_batch_that_diverges_is_nan_and_the_others_go_on(bullet):
    stepper = bullet.stepper(2)
    states = stepper.states
    states[0, 6:] = 1e7
    stepper.set_states(states)
    after = stepper.step(np.zeros((2, 6)))
    assert np.isnan(after[0]).all()
    assert np.isfinite(after[1]).all()
    stepper.reset(np.zeros((1, 12)), np.array([0]))
    assert np.isfinite(stepper.step(np.zeros((2, 6)))).all()
