"""Last joint of each arm of a robot."""

from collections.abc import Iterator, Sequence

import mujoco

SHORTEST_ARM = 2  # joints; a shorter branch is a finger of the arm that carries it


def list_arm_ends(spec: mujoco.MjSpec, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the last joint of each arm of a robot, in the order of `joints`; a leg is an arm here.

    An arm is a chain of at least two joints, from the world or from where it branches off. Branches of one joint, such
    as the fingers of a gripper, belong to the arm that carries them, whose last joint is then the one before them.
    Joints on the world alone, such as wheels, are arms only if there are no others.

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

    chains = [list(go_back(joint)) for joint in joints if not children[joint]]
    long = {chain[0] for chain in chains if len(chain) >= SHORTEST_ARM}
    short = [parents[chain[-1]] for chain in chains if len(chain) < SHORTEST_ARM]
    carriers = {joint for joint in short if joint is not None}
    ends = (long | carriers) or {chain[0] for chain in chains}
    carrying = {joint for end in ends for joint in list_previous_joints(parents, end)}
    return tuple(joint for joint in joints if joint in ends - carrying)


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
