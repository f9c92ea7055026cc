"""Last joint of each arm of a robot."""

from collections.abc import Sequence

import mujoco


def list_arm_ends(spec: mujoco.MjSpec, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the last joint of each arm of a robot, in the order of `joints`; a leg is an arm here.

    An arm is a chain of at least two joints, from the world or from where it branches off. Branches of one joint, such
    as the fingers of a gripper, belong to the arm that carries them, whose last joint is then the one before them.
    Joints on the world alone, such as wheels, are arms only if there are no others.

    Args:
        spec: Model.
        joints: Joints that are considered, such as the measured ones.
    """
    before = {joint: list_previous_joints(spec, joint, joints) for joint in joints}
    parents = [previous[0] for previous in before.values() if previous]
    ends = set()
    for joint in set(joints) - set(parents):
        if before[joint]:
            carrier = before[joint][0]
            ends.add(joint if parents.count(carrier) == 1 else carrier)
    carrying = {previous for end in ends for previous in before[end]}
    return tuple(joint for joint in joints if joint in ends - carrying or not ends)


def list_previous_joints(spec: mujoco.MjSpec, joint: str, joints: Sequence[str]) -> list[str]:
    """Return those of `joints` that move a joint, nearest first."""
    body = spec.joint(joint).parent
    own = [other.name for other in body.joints]
    found = own[: own.index(joint)][::-1]
    while (body := body.parent) is not None:
        found += [other.name for other in reversed(body.joints)]
    return [name for name in found if name in joints]
