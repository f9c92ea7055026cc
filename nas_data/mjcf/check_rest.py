"""Check of the rest position that a model defines: one number for each commanded joint, within its range."""

from collections.abc import Sequence
from pathlib import Path

import mujoco

from nas_data.count_of import count_of
from nas_data.errors import ModelFileError

ROUNDING = 1e-3  # [rad; m] by which a rest position at a limit may exceed it: files keep few digits


def check_rest(path: Path, model: mujoco.MjModel, joints: Sequence[str], rest: Sequence[float]) -> None:
    """Check the rest position that a model defines.

    Args:
        path: Model file, for errors.
        model: Compiled model.
        joints: Commanded joints.
        rest: Rest positions [rad; m].

    Raises:
        ModelFileError: there is not one number per joint, or one lies outside its joint's range.
    """
    if len(rest) != len(joints):
        raise ModelFileError(
            f"{path} gives nas_rest with {count_of(len(rest), 'number')}; give one for each commanded joint: "
            f"{', '.join(joints)}."
        )
    for joint, value in zip(joints, rest, strict=True):
        index = model.joint(joint).id
        low, high = model.jnt_range[index]
        if model.jnt_limited[index] and not low - ROUNDING <= value <= high + ROUNDING:
            slide = model.jnt_type[index] == mujoco.mjtJoint.mjJNT_SLIDE
            raise ModelFileError(
                f"{path} gives nas_rest as {value:g} at the joint '{joint}', whose range is {low:.4g} … {high:.4g} "
                f"{'m' if slide else 'rad'}; give a position within it, in {'metres' if slide else 'radians'}."
            )
