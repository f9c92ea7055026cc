"""Last joint of each arm of a robot with several."""

from collections.abc import Iterator, Sequence

import mujoco

SHORTEST_ARM = 2  # joints; a shorter branch is a finger of the arm that carries it


def list_arm_ends(spec: mujoco.MjSpec, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the last joint of each arm of a robot with several, in the order of `joints`; empty for one arm.

    A leg is an arm here.

    An arm is a chain of at least two joints, from the world or from where it branches off. The fingers of a gripper are
    shorter branches and belong to the arm that carries them, whose last joint is then the one before the fingers.

    Args:
        spec: Model.
        joints: Joints that are considered, such as the measured ones.
    """
    parents = {joint: find_previous_joint(spec, joint, joints) for joint in joints}
    children = {joint: [other for other in joints if parents[other] == joint] for joint in joints}

    def go_back(joint: str) -> Iterator[str]:
        yield joint
        while (previous := parents[joint]) is not None and len(children[previous]) == 1:
            joint = previous
            yield joint

    ends = set()
    for joint in joints:
        if not children[joint]:
            chain = list(go_back(joint))
            carrier = parents[chain[-1]]
            ends.add(joint if len(chain) >= SHORTEST_ARM or carrier is None else carrier)
    carrying = {joint for end in ends for joint in list_previous_joints(parents, end)}
    found = tuple(joint for joint in joints if joint in ends - carrying)
    return found if len(found) > 1 else ()


def list_previous_joints(parents: dict[str, str | None], joint: str) -> list[str]:
    """Return the joints before one, from its parent on."""
    found, previous = [], parents[joint]
    while previous is not None:
        found.append(previous)
        previous = parents[previous]
    return found


def find_previous_joint(spec: mujoco.MjSpec, joint: str, joints: Sequence[str]) -> str | None:
    """Return the nearest of `joints` that moves a joint; None for the first one of a chain."""
    body = spec.joint(joint).parent
    own = [other.name for other in body.joints]
    before = own[: own.index(joint)]
    while True:
        found = [name for name in before if name in joints]
        if found:
            return found[-1]
        body = body.parent
        if body is None:
            return None
        before = [other.name for other in body.joints]
