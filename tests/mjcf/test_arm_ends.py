"""The last joint of each arm of a robot."""

import mujoco
import pytest

from nas_data.mjcf.arm_ends import list_arm_ends
from nas_data.robots.base import find_robot, list_actuated_joints


def body(joints: str, *others: str) -> str:
    """Return a body with hinges, and others on it."""
    own = "".join(f'<joint name="{name}"/>' for name in joints.split())
    return f'<body>{own}<geom size=".1"/>{"".join(others)}</body>'


FINGERS = body("thumb"), body("finger")
ROBOTS = {
    "one joint": (body("a"), ["a"]),
    "one arm": (body("a", body("b", body("c"))), ["c"]),
    "an arm with fingers": (body("a", body("b", *FINGERS)), ["b"]),
    "two arms": (body("a", body("b")) + body("c", body("d", body("e"))), ["b", "e"]),
    "two joints in one body": (body("a b") + body("c d"), ["b", "d"]),
    "arms of one joint": (body("a") + body("b"), ["a", "b"]),
    "two arms, one with fingers": (body("a", body("b")) + body("c", body("d", *FINGERS)), ["b", "d"]),
    "a torso with arms and a head": (
        body("waist", body("a", body("b")), body("c", body("d")), body("head")),
        ["b", "d"],
    ),
    "an unmeasured joint between": (body("a", body("loose", body("b"))) + body("c", body("d")), ["b", "d"]),
    "an arm on wheels": (body("a", body("b")) + body("left") + body("right"), ["b"]),
}


@pytest.mark.parametrize(("bodies", "ends"), ROBOTS.values(), ids=ROBOTS)
def test_each_arm_has_a_last_joint(bodies, ends):
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    joints = [joint.name for joint in spec.joints if joint.name != "loose"]
    assert list(list_arm_ends(spec, joints)) == ends


@pytest.mark.parametrize("robot", ["ergojr", "so101_follower"])
def test_a_robot_with_one_arm_has_one(robot):
    spec = find_robot(robot).spec()
    joints = list_actuated_joints(spec)
    assert list_arm_ends(spec, joints) == (joints[-1],)
