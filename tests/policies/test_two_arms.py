"""Two arms: slow ways on which neither goes into the other, and out of a touch where they are in one."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from support.xl320_samples import torques, virtual

from nas_data.envs.base import find_task
from nas_data.errors import PathBlocked
from nas_data.hardware.arms.base import Reading
from nas_data.hardware.xl320.arm import Configuration, Xl320
from nas_data.hardware.xl320.control_table import TICK
from nas_data.hardware.xl320.joints import make_ergojr_joints
from nas_data.policies.rollouts.arm_setup import CLEARANCE, ArmSetup, make_path_planner
from nas_data.policies.rollouts.robot_stepper import RobotStepper, RolloutTally
from nas_data.policies.rollouts.two_arm_planner import TwoArmPlanner, make_two_arm_planner
from nas_data.recorders.arm_motion import ArmMotion
from nas_data.recorders.guarded import Setup
from nas_data.recorders.path_planner import PathPlanner
from nas_data.recorders.schedule import SteppedClock

JOINTS = make_ergojr_joints()
ZERO = np.zeros(6)
ACROSS = np.array([0.0, 0.6, 0.0, 0.0, 0.0, 0.0])  # leans over the middle of the table
FRICTION = (
    0.16  # [rad] by which a joint may stay off: 0.08 of friction loss over the servo's stiffness, more if it leans
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("nas_data.recorders.arm_motion.APPROACH", 1.5)  # [rad/s] tests have no time
    return tmp_path


def seeking(edges: bool) -> TwoArmPlanner:
    return TwoArmPlanner(make_path_planner(), (make_two_arm_planner(edges, CLEARANCE), make_two_arm_planner(edges)))


def free_poses(edges: bool, count: int) -> list[np.ndarray]:
    """Draw poses of both arms in which neither touches anything."""
    rng, together, alone = np.random.default_rng(0), make_two_arm_planner(edges), make_path_planner()
    drawn = rng.uniform(-1, 1, (20 * count, 12)) * np.repeat([1.0, 0.7], 6)
    return [pose for pose in drawn if not (together.touches(pose) or alone.touches(pose[6:]))][:count]


# Ways


@pytest.mark.parametrize("edges", [False, True])
def test_on_a_way_of_two_arms_one_moves_at_a_time_and_nothing_touches(edges):
    together, alone, sought = make_two_arm_planner(edges), make_path_planner(), seeking(edges)
    poses = free_poses(edges, 25)
    corners = []
    for begin, end in pairwise(poses):
        path = np.stack([begin, *sought.find(begin, end)])
        assert np.array_equal(path[-1], end)
        for a, b in pairwise(path):
            assert np.array_equal(a[:6], b[:6]) or np.array_equal(a[6:], b[6:])
            assert not any(together.touches(pose) or alone.touches(pose[6:]) for pose in np.linspace(a, b, 30))
        corners.append(len(path) - 1)
    assert len(corners) == 24
    assert min(corners) == 2
    assert max(corners) > 2


def test_an_arm_makes_room_for_the_other():
    together = make_two_arm_planner()
    left, right = (ACROSS + np.eye(6)[0] * side for side in (0.4, -0.4))  # as each arm sees it, face to face
    begin, end = np.concatenate([left, left]), np.concatenate([right, right])
    assert not together.touches(begin) and not together.touches(end)
    assert together.touches(np.concatenate([left, right])) and together.touches(np.concatenate([right, left]))
    assert len(seeking(edges=False).find(begin, end)) > 2, "neither can go first"


def test_where_no_way_is_free_the_sentence_names_what_is_in_it():
    with pytest.raises(PathBlocked, match=r"the arms would touch: \w+ with \w+; move both upright by hand"):
        seeking(edges=False).find(np.zeros(12), np.concatenate([ACROSS, ACROSS]))


def test_what_comes_near_is_a_touch_where_room_is_wanted():
    close, roomy = make_two_arm_planner(), make_two_arm_planner(clearance=CLEARANCE)
    touching = [
        (close.touches(pose), roomy.touches(pose)) for pose in np.linspace(0, 1, 80)[:, None] * np.tile(ACROSS, 2)
    ]
    assert touching == sorted(touching)
    assert (False, True) in touching


def test_out_of_a_touch_is_where_the_clearance_grows():
    together = make_two_arm_planner()
    poses = [np.concatenate([share * ACROSS, share * ACROSS]) for share in np.linspace(0, 1, 60)]
    first = next(number for number, pose in enumerate(poses) if together.touches(pose))
    free, touching, deeper = poses[first - 1 : first + 2]
    assert together.leaves_contact(deeper, touching)
    assert together.leaves_contact(touching, free)
    assert not together.leaves_contact(touching, deeper)
    assert not together.leaves_contact(touching, touching)
    assert not together.leaves_contact(free, poses[0]), "there is no touch to lead out of"
    lying = np.concatenate([[0, 1.5, 0.8, 0, 0, 0], ZERO])
    assert together.touches(lying)
    assert not together.leaves_contact(touching, lying), "into another touch"


# On virtual arms


@contextmanager
def duel(*ports: str) -> Iterator[RobotStepper]:
    """Yield what moves two virtual arms."""
    drivers = [Xl320(port=port, joints=JOINTS, configuration=Configuration(speed=1.745)) for port in ports]
    setups = [Setup(driver=driver, planner=make_path_planner()) for driver in drivers]
    bench = ArmSetup(attacker=setups[0], defender=setups[1], clock=SteppedClock())
    with bench.open(find_task("ErgoShield"), RolloutTally()) as (_, stepper):
        yield stepper


def at_rest(attacker: np.ndarray, defender: np.ndarray) -> np.ndarray:
    return np.concatenate([attacker, ZERO, defender, ZERO])[None]


def poses_of(stepper: RobotStepper) -> np.ndarray:
    return np.concatenate([stepper.states[0, :6], stepper.objects[0, :6]])


def test_arms_get_to_their_first_poses_one_after_the_other_without_a_touch(monkeypatch):
    together, seen, sense = make_two_arm_planner(), [], ArmMotion.sense

    def sensing(motion: ArmMotion, *arguments: object) -> Reading:
        seen.append((found := sense(motion, *arguments)).positions)
        return found

    monkeypatch.setattr(ArmMotion, "sense", sensing)
    with virtual() as attacker, virtual() as defender, duel(attacker.port, defender.port) as stepper:
        for pose in (np.concatenate([ZERO, ACROSS]), np.concatenate([ACROSS, ZERO])):
            stepper.reset(at_rest(*np.split(pose, 2)))
            assert np.abs(poses_of(stepper) - pose).max() < FRICTION, "sag is made up for"
    assert together.touches(np.concatenate([ACROSS, ACROSS])), "the attacker must not go first"
    assert len(seen) > 300
    assert not any(together.touches(np.concatenate(pose)) for pose in zip(seen[::2], seen[1::2], strict=True))


def test_an_arm_in_a_touch_may_leave_it_and_is_sent_back_where_it_does_not(monkeypatch):
    together, touches = make_two_arm_planner(), PathPlanner.touches
    with virtual() as attacker, virtual() as defender, duel(attacker.port, defender.port) as stepper:
        stepper.reset(at_rest(ZERO, 0.6 * ACROSS))

        def sent(command: np.ndarray) -> np.ndarray:
            stepper.step(command[None])
            return stepper.pop_attempts()[-1].commands[-1]

        with monkeypatch.context() as patch:
            patch.setattr(PathPlanner, "enters_contact", lambda *_: False)
            patch.setattr(PathPlanner, "touches", lambda *_: True)
            while not touches(together, poses_of(stepper)):
                sent(2 * ACROSS)
        assert np.abs(sent(ZERO) - ZERO).max() < TICK, "out of the touch, although the arm still moves into it"
        assert np.abs(sent(2 * ACROSS) - 2 * ACROSS).max() > 0.1
        for _ in range(50):
            sent(2 * ACROSS)
        assert not together.touches(poses_of(stepper))


def test_a_first_pose_in_a_touch_ends_in_a_sentence_and_without_torque():
    with virtual() as attacker, virtual() as defender:
        with (
            pytest.raises(PathBlocked, match="On their slow motions to the next poses the arms would touch"),
            duel(attacker.port, defender.port) as stepper,
        ):
            stepper.reset(at_rest(ACROSS, ACROSS))
        assert torques(attacker.port) == torques(defender.port) == [0] * 6
