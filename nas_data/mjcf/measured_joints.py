"""Mark of the joints that a recording measures, in models that have other actuated joints, such as a second arm."""

import json
from collections.abc import Sequence

import mujoco

MEASURED = "nas_measured_joints"  # name of the `<text>` in `<custom>`, a JSON list of them


def mark_measured_joints(spec: mujoco.MjSpec, joints: Sequence[str], actuated: Sequence[str]) -> None:
    """Store the measured joints in a model if actuators drive others, too; else an earlier mark stays.

    Args:
        spec: Model.
        joints: Measured joints.
        actuated: Joints that actuators drive.
    """
    if set(actuated) <= set(joints):
        return
    text = spec.text(MEASURED) or spec.add_text()
    text.name, text.data = MEASURED, json.dumps(list(joints))


def read_measured_joints(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Return the measured joints of a marked model; empty if it has no mark."""
    text = spec.text(MEASURED)
    return () if text is None else tuple(joint for joint in json.loads(text.data) if spec.joint(joint) is not None)
