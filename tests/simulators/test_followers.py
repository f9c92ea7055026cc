"""The state of a model is more than its measured joints: followers, bases that would fall, joints of no motor."""

import mujoco
import numpy as np
import pytest
from support.recording_samples import recorded_on
from support.simulator_samples import COUPLED_FINGERS
from support.truth_samples import FOLDER, PERIOD, record_truth, without_bases

from nas_data.errors import ModelFileError
from nas_data.log import warn_once
from nas_data.pairing import pair, read_initial_states
from nas_data.recorders.path_planner import PathPlanner
from nas_data.robots.base import find_robot
from nas_data.simulators.contact import count_contacts, find_contacts
from nas_data.simulators.mujoco import MujocoSimulator

MODELS = sorted(FOLDER.glob("*.*"))
ROUNDING = 2e-5  # [rad or m] states are stored in single precision, and some joints are stiff
FOLLOWING = [
    "finger_pair.xml",
    "slide_pair.xml",
    "four_bar.xml",
    "ball_linkage.xml",
    "tendon.xml",
    "wx250s.xml",
    "gripper.urdf",
]


def simulator_of(path):
    return MujocoSimulator.load(path, PERIOD, threads=1)


def truth_of(path):
    simulator = simulator_of(path)
    gear = 20.0 if path.stem == "torque_pendulum" else 1.0
    return simulator, record_truth(without_bases(path), simulator.joints, simulator.kinds, gear)


def worst(predicted, measured, n):
    return float(np.abs(predicted[..., :n] - measured[..., :n]).max())


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.name)
def test_a_model_predicts_its_own_noise_free_recording_to_rounding(path):
    simulator, truth = truth_of(path)
    n, predicted = len(truth.joints), pair(truth, simulator).sim_states
    hold = worst(truth.states, truth.next_states, n)
    assert worst(predicted, truth.next_states, n) < min(ROUNDING, hold / 100)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.name)
def test_a_model_rolls_out_its_own_recording(path):
    simulator, truth = truth_of(path)
    n = len(truth.joints)
    commands = truth.commands.reshape(truth.n_episodes, -1, n)
    rolled = simulator.rollout(read_initial_states(truth, simulator), commands)
    assert worst(rolled, truth.next_states.reshape(rolled.shape), n) < 10 * ROUNDING


@pytest.mark.parametrize("name", FOLLOWING)
def test_a_closed_loop_starts_and_is_put_where_the_constraints_allow(name):
    simulator, truth = truth_of(FOLDER / name)
    rows, n = truth.states[[20, 40]], len(truth.joints)
    stepper = simulator.stepper(2)
    stepper.reset(rows)
    assert residual(simulator, stepper) < 1e-9
    stepper.set_states(truth.states[[50, 55]])
    assert residual(simulator, stepper) < 1e-9
    np.testing.assert_allclose(stepper.states[:, :n], truth.states[[50, 55], :n], atol=1e-9)


def residual(simulator, stepper):
    """Return how far the constraints are from being met [rad or m]."""
    data, found = mujoco.MjData(simulator.model), []
    for qpos in stepper.batch.bind("qpos"):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(simulator.model, data)
        found.append(np.abs(data.efc_pos[data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)]).max())
    return max(found)


def test_a_finger_that_is_commanded_where_it_is_stays_there():
    simulator = simulator_of(FOLDER / "finger_pair.xml")
    stepper = simulator.stepper(1)
    stepper.reset(np.array([[0.0, 0.6, 0.0, 0.0]]))
    stayed = [stepper.step(np.array([[0.0, 0.6]]))[0, 1] for _ in range(5)]
    np.testing.assert_allclose(stayed, 0.6, atol=1e-3)


def test_what_sets_states_keeps_what_the_constraints_gave_way():
    """φ corrects the measured joints after every step: a correction of nothing changes nothing."""
    simulator, truth = truth_of(FOLDER / "tendon.xml")
    corrected, free = simulator.stepper(1), simulator.stepper(1)
    for command in truth.commands[:20]:
        corrected.set_states(corrected.states)
        np.testing.assert_allclose(corrected.step(command[None]), free.step(command[None]), atol=1e-9)


@pytest.mark.parametrize("name", ["finger_pair.xml", "four_bar.xml"])
def test_a_simulation_that_diverged_stays_so_while_the_others_are_set(name):
    stepper = simulator_of(FOLDER / name).stepper(2)
    n = len(stepper.joints)
    states = stepper.step(np.zeros((2, n)))
    states[0, n:] = 1e12
    stepper.set_states(states)
    assert np.isnan(stepper.step(np.zeros((2, n)))[0]).all()
    wanted = np.tile([0.1] * n + [0.0] * n, (2, 1))
    stepper.set_states(wanted)
    np.testing.assert_allclose(stepper.states, [[np.nan] * 2 * n, wanted[1]], atol=1e-12)
    after = stepper.step(wanted[:, :n])
    assert np.isnan(after[0]).all() and np.isfinite(after[1]).all()


def test_a_finger_that_follows_is_seen_to_touch(tmp_path):
    (tmp_path / "fingers.xml").write_text(COUPLED_FINGERS)
    simulator = simulator_of(tmp_path / "fingers.xml")
    poses = np.array([[0.0], [0.055], [0.03]])
    assert count_contacts(simulator, poses).tolist() == [0, 1, 0]
    assert [set(find_contacts(simulator, pose)) for pose in poses] == [set(), {("second", "post")}, set()]
    planner = PathPlanner(find_robot(tmp_path / "fingers.xml"))
    assert planner.exists(poses[0], poses[2]) and not planner.exists(poses[0], poses[1])


def test_a_servo_holds_the_weight_of_the_finger_that_follows(tmp_path):
    (tmp_path / "fingers.xml").write_text(COUPLED_FINGERS)
    simulator, planner = simulator_of(tmp_path / "fingers.xml"), PathPlanner(find_robot(tmp_path / "fingers.xml"))
    pose = np.array([0.02])
    sag = planner.sag(pose)
    planner.touches(np.array([0.05]))
    assert planner.sag(pose) == sag, "no pose that was looked at before matters"
    at_rest = np.array([[*pose, 0.0]])
    held, sagging = (simulator.rollout(at_rest, np.tile(c, (1, 200, 1)))[0, -1, 0] for c in (pose - sag, pose))
    assert held == pytest.approx(pose[0], abs=1e-6)
    assert abs(sagging - pose[0]) > 0.005


def test_a_mimicking_joint_is_neither_given_a_servo_nor_commanded():
    robot = find_robot(FOLDER / "gripper.urdf")
    assert robot.joints == ("wrist", "finger")
    assert [actuator.target for actuator in robot.spec().actuators] == ["wrist", "finger"]
    stepper = simulator_of(FOLDER / "gripper.urdf").stepper(1)
    stepper.reset(np.array([[0.2, 0.5, 0.0, 0.0]]))
    mirror = stepper.simulator.model.joint("mirror").qposadr[0]
    assert stepper.batch.bind("qpos")[0, mirror] == pytest.approx(0.8 * 0.5 + 0.05)


def test_models_without_followers_have_none_to_solve_for():
    for path in MODELS:
        simulator = simulator_of(path)
        assert simulator.rest.carries_state == (path.name in {*FOLLOWING, "hung_by_weld.xml"})


def test_a_base_that_would_fall_is_held_and_said_to_be(capsys):
    warn_once.cache_clear()
    robot = find_robot(FOLDER / "legged.xml")
    find_robot(FOLDER / "legged.xml")
    assert capsys.readouterr().err.count("the base 'trunk'") == 1
    assert not [joint for joint in robot.spec().joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    assert robot.spec().compile().key_qpos[0].tolist() == [0.5, -1, 0.5, -1]


def test_a_base_that_the_model_itself_holds_is_left_alone():
    assert find_robot(FOLDER / "hung_by_weld.xml").edit is None


def test_a_robot_that_stands_on_the_ground_is_refused(tmp_path):
    text = (FOLDER / "legged.xml").read_text()
    (tmp_path / "standing.xml").write_text(text.replace('pos="0 0 0.8"', 'pos="0 0 0.41"'))
    with pytest.raises(ModelFileError, match=r"standing\.xml stands on the ground with its 'front_shin'"):
        simulator_of(tmp_path / "standing.xml")


def test_a_robot_that_stood_on_the_ground_in_the_recording_is_refused(tmp_path):
    truth = truth_of(FOLDER / "legged.xml")[1]
    low = (FOLDER / "legged.xml").read_text().replace('pos="0 0 0.8"', 'pos="0 0 0.4"')
    (tmp_path / "low.xml").write_text(low.replace('_thigh" pos', '_thigh" euler="0 0.6 0" pos'))
    with pytest.raises(ModelFileError, match=r"stands on the ground"):
        pair(truth, simulator_of(tmp_path / "low.xml"))


CROUCHING = """<mujoco><option gravity="0 0 0" integrator="implicitfast"/><worldbody>
<body name="trunk" pos="0 0 1">{free}<geom name="back" type="box" size="0.2 0.1 0.05" mass="5"/>
<body name="head" pos="0.2 0 0"><geom size="0.06" mass="0.1"/></body>
<body pos="0.2 0 0"><joint name="hip" axis="0 1 0" damping="1"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.04" mass="0.5"/><body name="shin" pos="0 0 -0.3">
<joint name="knee" axis="0 1 0" damping="1"/><geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="0.3"/>
</body></body></body></worldbody><actuator><position joint="hip" kp="50" kv="2"/><position joint="knee" kp="50" kv="2"/>
</actuator></mujoco>"""


def test_a_held_base_collides_as_the_floating_one_does(tmp_path):
    """Not with thighs, which overlap it at the hips, but with a shin that comes near, which then stands on nothing."""
    (tmp_path / "dog.xml").write_text(CROUCHING.format(free="<freejoint/>"))
    floating = mujoco.MjModel.from_xml_path(str(tmp_path / "dog.xml"))
    held = find_robot(tmp_path / "dog.xml").spec().compile()
    contacts = []
    for model in (floating, held):
        data = mujoco.MjData(model)
        contacts.append([])
        for hip, knee in ((0.0, 0.0), (1.5, -2.9), (-0.5, 0.0)):
            data.joint("hip").qpos, data.joint("knee").qpos = hip, knee
            mujoco.mj_forward(model, data)
            contacts[-1].append(sorted(round(contact.dist, 6) for contact in data.contact))
    assert contacts[0] == contacts[1] and contacts[0][0] == [] and contacts[0][1]
    dog = MujocoSimulator.load(tmp_path / "dog.xml", PERIOD, threads=1)
    crouching = recorded_on(dog, np.tile([[1.5, -2.9]], (1, 40, 1)))
    assert np.isfinite(pair(crouching, dog).sim_states).all()


WHEELS = """
<mujoco>
  <worldbody>
    <geom type="plane" size="2 2 0.1"/>
    <body name="cart" pos="0 0 0.049">
      <freejoint/>
      <geom type="box" size="0.1 0.05 0.01" mass="1"/>
      <body name="wheel" pos="0 0.06 0">
        <joint name="wheel" axis="0 1 0"/>
        <geom type="sphere" size="0.05" mass="0.1"/>
      </body>
      <body pos="0 0 0.02">
        <joint name="arm" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.01" mass="0.1"/>
      </body>
    </body>
  </worldbody>
  <actuator><velocity joint="wheel" kv="1"/><position joint="arm" kp="5"/></actuator>
</mujoco>
"""


def test_a_mobile_base_is_refused_where_its_wheels_are_measured_and_held_where_not(tmp_path):
    (tmp_path / "rover.xml").write_text(WHEELS)
    with pytest.raises(ModelFileError, match=r"stands on the ground with its 'wheel'"):
        simulator_of(tmp_path / "rover.xml")
    MujocoSimulator.load(tmp_path / "rover.xml", PERIOD, ("arm",))


def test_joints_that_a_dataset_lacks_and_nothing_holds_stay_at_their_reference(tmp_path):
    two = (
        (FOLDER / "torque_pendulum.xml")
        .read_text()
        .replace(
            "    </body>\n  </worldbody>",
            '      <body pos="0 0 -0.2"><joint name="loose" axis="0 1 0"/>'
            '<geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.1"/></body>\n    </body>\n  </worldbody>',
        )
    )
    (tmp_path / "two.xml").write_text(two)
    simulator = MujocoSimulator.load(tmp_path / "two.xml", PERIOD, ("pendulum",), threads=1)
    stepper = simulator.stepper(1)
    for _ in range(50):
        stepper.step(np.array([[0.1]]))
    loose = simulator.model.joint("loose").qposadr[0]
    assert abs(stepper.batch.bind("qpos")[0, loose]) < 1e-3
