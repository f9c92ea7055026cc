"""An arm's links as URDF text: no shapes, no limits, rotor inertia left to the drives."""

import numpy as np

from nas_data.benchmarks.blind.plants.body import PlantBody


def to_urdf(body: PlantBody) -> str:
    """Write the chain: link 0 is the fixed base, link k is carried by joint k."""
    parts = ['<robot name="arm">', link(0, 0.0, np.zeros(3), np.zeros((3, 3)))]
    for row in range(len(body.masses)):
        parts.append(link(row + 1, body.masses[row], body.centres[row], body.inertias[row]))
        parts.append(joint(row + 1, body, row))
    return "\n".join([*parts, "</robot>"])


def link(number: int, mass: float, centre: np.ndarray, inertia: np.ndarray) -> str:
    """Write a link with its mass [kg], centre of mass [m] and inertia about it [kg m²], turned to principal axes."""
    moments, axes = np.linalg.eigh(inertia)
    axes = axes * np.sign(np.linalg.det(axes))  # a rotation, not a mirror
    ixx, iyy, izz = (repr(float(moment)) for moment in moments)
    return (
        f'<link name="l{number}"><inertial>{origin(centre, axes)}<mass value="{float(mass)!r}"/>'
        f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(number: int, body: PlantBody, row: int) -> str:
    """Write the hinge or slide that carries a link; a lower limit above the upper one is none."""
    kind = "prismatic" if body.sliding[row] else "continuous"
    limit = '<limit lower="1" upper="-1" effort="0" velocity="0"/>' if body.sliding[row] else ""
    return (
        f'<joint name="q{number}" type="{kind}"><parent link="l{number - 1}"/><child link="l{number}"/>'
        f'{origin(body.offsets[row], body.turns[row])}<axis xyz="{numbers(body.axes[row])}"/>{limit}</joint>'
    )


def origin(place: np.ndarray, turn: np.ndarray) -> str:
    """Write a place [m] and a rotation matrix as URDF's roll, pitch and yaw about fixed axes."""
    level = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = np.arctan2(-turn[2, 0], level)
    if level > 1e-9:
        roll, yaw = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    else:  # gimbal lock: only the difference of roll and yaw is determined
        roll, yaw = np.arctan2(-turn[1, 2], turn[1, 1]), 0.0
    return f'<origin xyz="{numbers(place)}" rpy="{numbers(np.array([roll, pitch, yaw]))}"/>'


def numbers(values: np.ndarray) -> str:
    """Return numbers that read back as the same doubles."""
    return " ".join(repr(float(value)) for value in values)
