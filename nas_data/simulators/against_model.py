"""Comparison of a dataset with a model: joints whose sign or zero contradicts limits or gravity.

A servo with a position gain holds a posture with a position error: gain · (command − position) equals the gravity
torque at rest. A joint with the wrong sign in the map shows the opposite sign. A wrong zero changes the loads of its
joint and of the joints before it in the chain.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.dataset import Dataset
from nas_data.errors import JointMismatch
from nas_data.joint_units import compute_angle_scales, group_by_kind
from nas_data.robots.base import find_robot
from nas_data.simulators.followers import Followers
from nas_data.simulators.initial_states import WEIGHTLESS
from nas_data.simulators.integrals import compute_weight
from nas_data.simulators.poses import complete_poses

# For slides the lengths below are multiplied by the equivalent of a radian; see `find_radian_equivalent`.
MARGIN = 0.1  # [rad] tolerated difference between the calibration of a real arm and its model
CENTRE_MARGIN = 0.35  # [rad] tolerated difference between the middles of their ranges: 20°
RESTING_SPEED = 0.02  # [rad/s] and [rad per row] below which a servo holds its position
MIN_RESTING_ROWS = 30  # such rows needed to compare with gravity
MIN_TORQUE_SPREAD = 0.2  # least gravity torque in a loaded row over the joint's largest one; slides: gravity force
MIN_LOAD_SHARE = 0.05  # least such maximum of a loaded joint over that of all joints
MIN_ERROR_STEPS = 2.0  # least ratio of position errors to the step of a servo
CONTRADICTION = -0.5  # correlation below which a joint contradicts gravity
MOST, FEW = 2000, 200  # rows for which loads are computed: for signs, and for each tried zero
OFFSET, SMALLEST = np.pi / 36, 0.2  # [rad] step between tried zeros, and smallest reported change
MISFIT = 0.2  # unexplained share of the servos' errors that suggests a wrong zero; friction may cause as much …
MISFIT_RATIO = 0.25  # … but then no other zero reduces it to this share
MAP_ERRORS = ("command_sign", "joints_swapped")  # checks without a model that tell wrong signs and columns
HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
TICK = 2 * np.pi / 4096  # [rad]


def check(
    dataset: Dataset,
    model: str | Path,
    middles: Mapping[str, float] | None = None,
    known: Sequence[AuditFinding] = (),
) -> list[AuditFinding]:
    """Compare an imported dataset with a model.

    Args:
        dataset: Transitions with 2n-states.
        model: An MJCF or URDF file, or a robot's name.
        middles: Position of the middle of joints' calibrated ranges in the map, if known [rad; m].
        known: Findings of audits without a model. If they include wrong signs or columns, limits and gravity are not
            compared: they would suggest other causes.

    Raises:
        JointMismatch: the model lacks a joint of the dataset.
        ModelFileError, UnknownName: the model cannot be used.
    """
    compiled, joints = find_robot(model).spec().compile(), dataset.joints
    names = list(filter(None, (compiled.joint(index).name for index in range(compiled.njnt))))
    missing = [joint for joint in joints if joint not in names]
    if missing:
        raise JointMismatch(
            f"{model} has no joint '{missing[0]}'; it has: {', '.join(names)}. Name the joints in 'joints' of the map "
            "as the model does, or give the model of this robot."
        )
    found = [finding for joint in joints for finding in _check_kind(dataset, compiled, joint)]
    if any(finding.check in MAP_ERRORS for finding in known):
        return found
    found += [finding for joint in joints for finding in _check_limits(dataset, compiled, joint)]
    found += [
        finding for joint in joints for finding in _check_middle(dataset, compiled, joint, (middles or {}).get(joint))
    ]
    if not dataset.positional.any():
        return found
    resting = _RestingRows.of(dataset, compiled)
    if resting is not None:
        found += resting.check_signs(dataset.joints) or resting.check_zeros(dataset.joints)
    return found


def find_hinge_centres(model: str | Path) -> dict[str, float]:
    """Return the middle of the range [rad] of the hinges of a model that have one."""
    compiled = find_robot(model).spec().compile()
    joints = [compiled.joint(index) for index in range(compiled.njnt)]
    return {joint.name: float(joint.range.mean()) for joint in joints if joint.type[0] == HINGE and joint.limited[0]}


def find_radian_equivalent(dataset: Dataset, model: mujoco.MjModel, joint: str) -> float:
    """Return the travel that counts as one radian: 1 for a hinge, a share of its range [m] for a slide."""
    index = model.joint(joint).id
    travel = np.ptp(dataset.states[:, dataset.joints.index(joint)])
    reach = np.ptp(model.jnt_range[index]) if model.jnt_limited[index] else travel
    return float(compute_angle_scales([joint], dataset.slides, np.array([reach]))[0])


def _check_kind(dataset: Dataset, model: mujoco.MjModel, joint: str) -> list[AuditFinding]:
    """Report a slide that was read as an angle, or a hinge that was read as a length."""
    turns = int(model.jnt_type[model.joint(joint).id]) == HINGE
    if turns != (joint in dataset.slides):
        return []
    read, is_one, units = ("a length", "hinge", "rad, deg") if turns else ("an angle", "slide", "m, cm, mm")
    what = f"{joint} was read as {read}, but is a {is_one}"
    remedy = f"give it {'an angle' if turns else 'a length'} for a unit in the map ({units})"
    remedy += ", or take it out of 'slides'" if turns else ", or name it in 'slides' if its unit is 'normalised'"
    return [_make_finding("model_kind", f"{what} in the model", remedy)]


def _make_finding(check: str, what: str, remedy: str) -> AuditFinding:
    """Return a finding that contradicts the model."""
    return AuditFinding(check, "the dataset", what, remedy)


def _check_limits(dataset: Dataset, model: mujoco.MjModel, joint: str) -> list[AuditFinding]:
    """Report a joint that leaves its model's range, and whether another sign, zero or column would fit."""
    if _is_within_range(dataset, model, joint, joint):
        return []
    low, high = (float(end) for end in model.joint(joint).range)
    positions = dataset.states[:, dataset.joints.index(joint)].astype(float)
    first, last = float(positions.min()), float(positions.max())
    margin = MARGIN * find_radian_equivalent(dataset, model, joint)
    if -last >= low - margin and -first <= high + margin:
        reason, remedy = "with the opposite sign it would be inside", f"check sign = -1 of {joint} in the map"
    elif last - first <= high - low + 2 * margin:
        reason, remedy = "with another zero it would be inside", f"check 'offset' or 'zero' of {joint} in the map"
    else:
        reason, remedy = "it turns farther than the model does", f"check the unit and scale of {joint} in the map"
    other = _find_exchanged(dataset, model, joint)
    if other is not None:
        reason += f", and so would {other}, if both were exchanged"
        remedy += f", or whether the map exchanges {joint} and {other}"
    what = f"{joint} goes from {first:.3g} to {last:.3g}, beyond the model's range {low:.3g} … {high:.3g}; {reason}"
    return [_make_finding("model_limits", what, remedy)]


def _is_within_range(dataset: Dataset, model: mujoco.MjModel, joint: str, read: str) -> bool:
    """Whether the positions read for a joint lie within the model's range of this or another joint."""
    if not model.jnt_limited[model.joint(joint).id]:
        return True
    low, high = (float(end) for end in model.joint(joint).range)
    positions = dataset.states[:, dataset.joints.index(read)].astype(float)
    margin = MARGIN * find_radian_equivalent(dataset, model, joint)
    return float(positions.min()) >= low - margin and float(positions.max()) <= high + margin


def _find_exchanged(dataset: Dataset, model: mujoco.MjModel, joint: str) -> str | None:
    """Return the joint that a joint outside its range may have been exchanged with.

    Each leaves its own range but fits that of the other. Gravity cannot decide: with the friction and quantisation of a
    real arm, exchanged loads fit hardly worse.
    """
    others = [
        other
        for other in dataset.joints
        if other != joint
        and (other in dataset.slides) == (joint in dataset.slides)
        and not _is_within_range(dataset, model, other, other)
        and _is_within_range(dataset, model, joint, other)
        and _is_within_range(dataset, model, other, joint)
    ]
    return others[0] if len(others) == 1 else None


def _check_middle(dataset: Dataset, model: mujoco.MjModel, joint: str, middle: float | None) -> list[AuditFinding]:
    """Report a joint whose calibrated range and model range have different middles."""
    if middle is None or not model.jnt_limited[model.joint(joint).id]:
        return []
    wanted = float(model.joint(joint).range.mean())
    if abs(middle - wanted) <= CENTRE_MARGIN * find_radian_equivalent(dataset, model, joint):
        return []
    what = (
        f"the middle of the calibrated range of {joint}, which is LeRobot's zero, is converted to {middle:.3g}; the "
        f"middle of the model's range is {wanted:.3g}"
    )
    remedy = f"check 'offset' of {joint} in the map ({wanted:.3g} if arm and model have the same range)"
    return [_make_finding("model_zero", what, remedy)]


def check_signs(dataset: Dataset, model: mujoco.MjModel) -> list[AuditFinding]:
    """Report joints whose position errors at rest contradict the model's gravity.

    Args:
        dataset: Transitions with 2n-states; joints that are not commanded positions are left out.
        model: Compiled model with all of its joints.
    """
    resting = _RestingRows.of(dataset, model)
    return [] if resting is None else resting.check_signs(dataset.joints)


def _find_resting_rows(dataset: Dataset, radians: np.ndarray) -> np.ndarray:
    """Return the rows in which all joints hold their position; `radians` as in `find_radian_equivalent`, shape (n,)."""
    velocities = dataset.states[:, len(dataset.joints) :].astype(float)
    # Torques and speeds may change while nothing moves.
    commands = dataset.commands * dataset.positional
    steps = np.abs(np.diff(commands, axis=0, prepend=commands[:1]))
    still = (np.abs(velocities) < RESTING_SPEED * radians).all(axis=1) & (steps < RESTING_SPEED * radians).all(axis=1)
    return np.flatnonzero(still)


@dataclass(frozen=True)
class _RestingRows:
    """N rows in which the servos hold n joints at rest.

    Attributes:
        model: Compiled model.
        qpos: Index of each joint in `qpos`, shape (n,).
        dofs: Index of each joint in `qvel`, shape (n,).
        positions: Measured positions [rad; m], shape (N, n).
        held: Commands minus positions [rad; m], shape (N, n); zero at joints without a position servo.
        pull: Gravity torque that each joint's servo holds [N·m; N], shape (N, n).
        loaded: Indices of joints with enough load in these rows.
    """

    model: mujoco.MjModel
    qpos: np.ndarray
    dofs: np.ndarray
    positions: np.ndarray
    held: np.ndarray
    pull: np.ndarray
    loaded: tuple[int, ...]

    @classmethod
    def of(cls, dataset: Dataset, model: mujoco.MjModel) -> "_RestingRows | None":
        """Compute the loads in the resting rows of a dataset; None if there are too few."""
        rows = _find_resting_rows(
            dataset, np.array([find_radian_equivalent(dataset, model, joint) for joint in dataset.joints])
        )
        if len(rows) < MIN_RESTING_ROWS:
            return None
        rows = rows[:: max(1, len(rows) // MOST)]
        qpos = np.array([model.joint(joint).qposadr[0] for joint in dataset.joints])
        dofs = np.array([model.joint(joint).dofadr[0] for joint in dataset.joints])
        positions = dataset.states[rows, : len(dataset.joints)].astype(float)
        held = (dataset.commands[rows] - positions) * dataset.positional
        pull = compute_gravity_torques(model, qpos, dofs, positions)
        own = np.abs(pull).max(axis=0)
        largest = np.empty(len(dataset.joints))
        for _, members in group_by_kind(dataset.joints, dataset.slides):
            largest[members] = own[members].max(initial=0.0)
        loaded = []
        for index, joint in enumerate(dataset.joints):
            # without `WEIGHTLESS`, the rounding of a compensated weight would be a load
            least = max(MIN_TORQUE_SPREAD * own[index], MIN_LOAD_SHARE * largest[index], WEIGHTLESS)
            loaded_rows = np.abs(pull[:, index]) > least
            step = TICK * find_radian_equivalent(dataset, model, joint)
            if (
                loaded_rows.sum() >= MIN_RESTING_ROWS
                and np.abs(held[loaded_rows, index]).mean() >= MIN_ERROR_STEPS * step
            ):
                loaded.append(index)
        return cls(model, qpos, dofs, positions, held, pull, tuple(loaded))

    def correlation(self, pull: np.ndarray) -> np.ndarray:
        """Return the correlation of the servos' errors with loads of shape (N, n), for each joint, shape (n,)."""
        lengths = np.linalg.norm(pull, axis=0) * np.linalg.norm(self.held, axis=0)
        return np.asarray((pull * self.held).sum(axis=0) / np.maximum(lengths, 1e-300))

    def check_signs(self, joints: Sequence[str]) -> list[AuditFinding]:
        """Report joints whose position errors have the opposite sign of the loads."""
        found, correlations = [], self.correlation(self.pull)
        for index in self.loaded:
            if correlations[index] <= CONTRADICTION:
                what = (
                    f"{joints[index]} has the wrong sign for the model's gravity: at rest, its command is on the side "
                    f"to which gravity pulls (correlation {correlations[index]:.2f})"
                )
                remedy = f"check sign and zero of {joints[index]} in the map"
                found.append(_make_finding("model_gravity", what, remedy))
        return found

    def check_zeros(self, joints: Sequence[str]) -> list[AuditFinding]:
        """Report a joint whose zero, if changed, would explain position errors that the loads leave unexplained."""
        chosen = slice(None, None, max(1, len(self.positions) // FEW))
        resting = replace(self, positions=self.positions[chosen], held=self.held[chosen], pull=self.pull[chosen])
        misfit = resting.misfit(resting.pull) if self.loaded else 0.0
        if misfit < MISFIT:
            return []
        offsets = np.arange(-np.pi, np.pi, OFFSET)[1:]
        hinges = [i for i, dof in enumerate(self.dofs) if self.model.jnt_type[self.model.dof_jntid[dof]] == HINGE]
        trials = [(index, float(offset)) for index in hinges for offset in offsets]
        misfits = [resting.misfit(resting.compute_moved_loads(index, offset)) for index, offset in trials]
        index, offset = trials[int(np.argmin(misfits))]
        if min(misfits) > MISFIT_RATIO * misfit or abs(offset) < SMALLEST:
            return []
        what = (
            f"the servo loads at rest do not fit the model's gravity, but they do if {joints[index]} is moved by "
            f"{offset:+.2g} rad"
        )
        remedy = f"check 'offset' or 'zero' of {joints[index]} in the map"
        return [_make_finding("model_gravity", what, remedy)]

    def misfit(self, pull: np.ndarray) -> float:
        """Return the mean share of the loaded joints' error variance that loads of shape (N, n) leave unexplained."""
        loads, errors = pull - pull.mean(axis=0), self.held - self.held.mean(axis=0)
        lengths = np.linalg.norm(loads, axis=0) * np.linalg.norm(errors, axis=0)
        correlation = (loads * errors).sum(axis=0) / np.maximum(lengths, 1e-300)
        return float((1 - np.maximum(correlation[list(self.loaded)], 0) ** 2).mean())

    def compute_moved_loads(self, index: int, offset: float) -> np.ndarray:
        """Return the loads after one joint is moved by an offset [rad], shape (N, n)."""
        positions = self.positions.copy()
        positions[:, index] += offset
        return compute_gravity_torques(self.model, self.qpos, self.dofs, positions)


def compute_gravity_torques(
    model: mujoco.MjModel, qpos: np.ndarray, dofs: np.ndarray, positions: np.ndarray
) -> np.ndarray:
    """Return the gravity torque that each joint's servo holds [N·m; N] in postures (N, n), shape (N, n)."""
    light, followers = copy.copy(model), Followers.of(model, dofs)
    # contacts and limits cost time, and do not change the weight
    light.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    poses = complete_poses(model, qpos, followers, positions)
    return compute_weight(light, mujoco.MjData(light), poses, followers)[:, dofs]
