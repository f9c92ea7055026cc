"""Check whether a model's angles are in another unit than the one in which they are read."""

import math
import re
from pathlib import Path

import mujoco

# [rad or °] arm joints have a range of more than 2π degrees and at most two turns; files round 2π to 6.28319 or 6.3
TURN = 1.01 * 2 * math.pi
STATED = re.compile(rb"<compiler[^>]*\bangle\s*=")
INCLUDED = re.compile(rb"<include[^>]*\bfile\s*=\s*[\"']([^\"']+)")


def check_angle_units(path: Path, model: mujoco.MjModel, degree: bool) -> list[str]:
    """Return warnings if the ranges of a model's hinges suggest another angle unit.

    Args:
        path: Model file.
        model: Its compiled model.
        degree: Whether its angles were read as degrees.
    """
    hinges = (model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)) & (model.jnt_limited != 0)
    if not hinges.any():
        return []
    widest = int(hinges.nonzero()[0][abs(model.jnt_range[hinges]).max(axis=1).argmax()])
    low, high = (math.degrees(limit) if degree else float(limit) for limit in model.jnt_range[widest])
    limits = f"{path}: the range of {model.joint(widest).name}, {low:.4g} to {high:.4g},"
    if degree and max(-low, high) <= TURN and not states_unit(path):
        remedy = 'if radians are meant, write <compiler angle="radian"/>, else <compiler angle="degree"/>'
        return [f"{limits} is read in degrees, because the file gives no unit: {remedy}"]
    if not degree and high - low > 2 * TURN:
        return [f'{limits} is read in radians: if degrees are meant, write <compiler angle="degree"/>']
    return []


def states_unit(path: Path) -> bool:
    """Whether a model file, or one that it includes, states the unit of its angles."""
    content = path.read_bytes()
    included = [path.parent / name.decode(errors="replace") for name in INCLUDED.findall(content)]
    return bool(STATED.search(content)) or any(states_unit(file) for file in included if file.is_file())
