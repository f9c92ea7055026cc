"""Joints and servos of the Poppy Ergo Jr.

Source: Poppy's poppy_ergo_jr.json: IDs 1 to 6, m1 and m4 direct, the others indirect.
"""

from functools import cache

from nas_data.hardware.xl320.joints import Joints

DIRECT = {"m1": True, "m2": False, "m3": False, "m4": True, "m5": False, "m6": False}


@cache
def make_ergojr_joints(offsets: tuple[int, ...] = ()) -> Joints:
    """Return the joints of the ErgoJr, with the limits of its model.

    Args:
        offsets: Zero offsets [ticks]; zero if empty.
    """
    from nas_data.robots.ergojr import ROBOT
    from nas_data.simulators.limits import command_limits

    low, high = command_limits(ROBOT.spec().compile(), ROBOT.joints, ROBOT.name)
    return Joints(
        names=ROBOT.joints,
        ids=tuple(range(1, len(ROBOT.joints) + 1)),
        direct=tuple(DIRECT[joint] for joint in ROBOT.joints),
        low=tuple(low.tolist()),
        high=tuple(high.tolist()),
        offsets=offsets,
    )
