"""Slow ways of the ErgoJr: free of contact, round what is in the way, or refused."""

from itertools import pairwise

import numpy as np
import pytest

from nas_data.errors import PathBlocked
from nas_data.hardware.virtual_bus.arm import LYING
from nas_data.recorders.path_planner import PathPlanner
from nas_data.robots.base import find_robot
from nas_data.simulators.contact import count_contacts, find_contacts
from nas_data.simulators.mujoco import MujocoSimulator

ROBOT = find_robot("ergojr")
SIMULATOR = MujocoSimulator(ROBOT, 0.01, threads=1)
IN_THE_FLOOR = np.array([0, 1.5, 0.8, 0, 0, 0])


@pytest.fixture(scope="module")
def planner() -> PathPlanner:
    return PathPlanner(ROBOT)


def test_the_way_between_free_poses_is_free(planner):
    rng = np.random.default_rng(0)
    poses = [pose for pose in rng.uniform(-1.5, 1.5, (300, 6)) if not planner.touches(pose)]
    straight = detours = 0
    for begin, end in pairwise(poses):
        corners = np.stack([begin, *planner.find(begin, end)])
        path = np.concatenate([np.linspace(a, b, 400) for a, b in pairwise(corners)])
        assert count_contacts(SIMULATOR, path).max() == 0
        assert np.array_equal(corners[-1], end)
        assert planner.exists(begin, end)
        direct = count_contacts(SIMULATOR, np.linspace(begin, end, 400)).max() == 0
        straight += direct
        detours += len(corners) > 2
        assert len(corners) == 2 or not direct
    assert straight > 5
    assert detours > 5


def test_the_arm_gets_up_from_where_a_hand_left_it(planner):
    assert planner.find(LYING, np.zeros(6)).tolist() == [[0.0] * 6]


def test_what_touches_at_the_start_may_part_but_not_come_closer(planner):
    touching = find_contacts(SIMULATOR, IN_THE_FLOOR)
    assert all("floor" in pair for pair in touching)
    assert min(touching.values()) < 0
    assert planner.find(IN_THE_FLOOR, np.zeros(6))[-1].tolist() == [0.0] * 6
    with pytest.raises(PathBlocked):
        planner.find(IN_THE_FLOOR, IN_THE_FLOOR * 1.02)


def test_a_pose_that_nothing_leads_to_is_refused_with_what_is_in_the_way(planner):
    with pytest.raises(PathBlocked, match=r"the arm would touch link\d with floor; move it upright by hand"):
        planner.find(np.zeros(6), IN_THE_FLOOR)
    assert not planner.exists(np.zeros(6), IN_THE_FLOOR)
