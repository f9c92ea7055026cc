"""What was imported against a model of the robot: a joint whose sign or zero contradicts its limits or its gravity.

A servo with a position gain holds a posture by an error of position: command − position has the sign of the torque with
which gravity pulls the joint down (gain · (command − position) = bias torque at rest). A joint that is turned round in
the map shows the opposite.
"""

from pathlib import Path

import mujoco
import numpy as np

from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.dataset import Dataset
from nas_data.joint_units import kinds_of, radians_at
from nas_data.robots.base import find_robot

# At a slide a share of its range stands for a radian; see `radian_at`.
MARGIN = 0.1  # [rad] by which calibrations of real arms and their models differ
STILL = 0.02  # [rad/s] and [rad a row] below which a servo only holds
FEWEST = 30  # such rows from which gravity can be told
SPREAD = 0.2  # share of the largest gravity torque (or force, of slides) that must vary, or there is nothing to compare
LOADED = 2.0  # times as large the errors must be as the step of a servo
AGAINST = -0.5  # correlation from which a joint contradicts gravity
TICK = 2 * np.pi / 4096  # [rad]


def check(dataset: Dataset, model: str | Path) -> list[AuditFinding]:
    """Compare an imported dataset with a model.

    Args:
        dataset: Transitions with 2n-states.
        model: An MJCF or URDF file, or a robot's name.

    Raises:
        ModelFileError, UnknownName: the model cannot be used.
    """
    compiled = find_robot(model).spec().compile()
    names = [compiled.joint(index).name for index in range(compiled.njnt)]
    joints = [joint for joint in dataset.joints if joint in names]
    found = [
        AuditFinding(
            "model_joint", "the dataset", f"its joint '{joint}' is not in {model}, which has: {', '.join(names)}"
        )
        for joint in dataset.joints
        if joint not in names
    ]
    found += [finding for joint in joints for finding in _limits(dataset, compiled, joint)]
    if (not dataset.commands_positions) or len(joints) < len(dataset.joints):
        return found
    return found + _gravity(dataset, compiled)


def radian_at(dataset: Dataset, model: mujoco.MjModel, joint: str) -> float:
    """Return what stands for a radian at a joint: 1 at a hinge; at a slide so many metres [m] of its range."""
    place = model.joint(joint).id
    travel = np.ptp(dataset.states[:, dataset.joints.index(joint)])
    reach = np.ptp(model.jnt_range[place]) if model.jnt_limited[place] else travel
    return float(radians_at([joint], dataset.slides, np.array([reach]))[0])


def _limits(dataset: Dataset, model: mujoco.MjModel, joint: str) -> list[AuditFinding]:
    """Report a joint that leaves its model's range, and whether the other sign or another zero would not."""
    if not model.jnt_limited[model.joint(joint).id]:
        return []
    low, high = (float(end) for end in model.joint(joint).range)
    positions = dataset.states[:, dataset.joints.index(joint)].astype(float)
    first, last = float(positions.min()), float(positions.max())
    margin = MARGIN * radian_at(dataset, model, joint)
    if first >= low - margin and last <= high + margin:
        return []
    if -last >= low - margin and -first <= high + margin:
        reason, remedy = "with the opposite sign it would not", f"check sign = -1 of {joint} in the map"
    elif last - first <= high - low + 2 * margin:
        reason, remedy = "with another zero it would not", f"check 'offset' or 'zero' of {joint} in the map"
    else:
        reason, remedy = "it turns farther than the model does", f"check the unit and scale of {joint} in the map"
    what = f"{joint} goes from {first:.3g} to {last:.3g}, beyond the model's range {low:.3g} … {high:.3g}; {reason}"
    return [AuditFinding("model_limits", "the dataset", what, remedy)]


def _gravity(dataset: Dataset, model: mujoco.MjModel) -> list[AuditFinding]:
    """Report joints that hang on their servos against the model's gravity."""
    n = len(dataset.joints)
    positions, velocities = dataset.states[:, :n].astype(float), dataset.states[:, n:].astype(float)
    steps = np.abs(np.diff(dataset.commands, axis=0, prepend=dataset.commands[:1]))
    radians = np.array([radian_at(dataset, model, joint) for joint in dataset.joints])
    still = (np.abs(velocities) < STILL * radians).all(axis=1) & (steps < STILL * radians).all(axis=1)
    rows = np.flatnonzero(still)
    if len(rows) < FEWEST:
        return []
    rows = rows[:: max(1, len(rows) // 2000)]
    places = [model.joint(joint).qposadr[0] for joint in dataset.joints]
    speeds = [model.joint(joint).dofadr[0] for joint in dataset.joints]
    data, pull = mujoco.MjData(model), np.zeros((len(rows), n))
    for number, row in enumerate(rows):
        data.qpos[places], data.qvel[:] = positions[row], 0
        mujoco.mj_forward(model, data)
        pull[number] = data.qfrc_bias[speeds]
    held = dataset.commands[rows] - positions[rows]
    found = []
    largest = np.empty(n)
    for _, alike in kinds_of(dataset.joints, dataset.slides):
        largest[alike] = np.abs(pull[:, alike]).max(initial=0.0)
    for index, joint in enumerate(dataset.joints):
        loaded = np.abs(pull[:, index]) > SPREAD * largest[index]
        if loaded.sum() < FEWEST or np.abs(held[loaded, index]).mean() < LOADED * TICK * radians[index]:
            continue
        product = float(pull[loaded, index] @ held[loaded, index])
        likeness = product / float(np.linalg.norm(pull[loaded, index]) * np.linalg.norm(held[loaded, index]))
        if likeness <= AGAINST:
            what = (
                f"{joint} hangs upwards: where it rests, its command lies on the side to which the model's gravity "
                f"pulls (correlation {likeness:.2f})"
            )
            remedy = f"check sign and zero of {joint} in the map"
            found.append(AuditFinding("model_gravity", "the dataset", what, remedy))
    return found
