"""Mark of the joints that a recording measures, in models that have other actuated joints, such as a second arm."""

from collections.abc import Sequence

import mujoco

MEASURED = "measured_joints"  # name of the `<text>` in `<custom>`, which lists them


def mark_measured_joints(spec: mujoco.MjSpec, joints: Sequence[str], actuated: Sequence[str]) -> None:
    """Store the measured joints in a model, unless it has them already or they are all that actuators drive.

    Args:
        spec: Model.
        joints: Measured joints.
        actuated: Joints that actuators drive.
    """
    if spec.text(MEASURED) is None and set(actuated) - set(joints):
        text = spec.add_text()
        text.name, text.data = MEASURED, " ".join(joints)


def read_measured_joints(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Return the measured joints of a marked model; empty if it has no mark."""
    text = spec.text(MEASURED)
    return () if text is None else tuple(joint for joint in text.data.split() if spec.joint(joint) is not None)
