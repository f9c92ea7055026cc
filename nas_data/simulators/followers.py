"""Positions and velocities of joints that equality constraints tie to the measured ones."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

TOLERANCE = 1e-12  # [m or rad] largest residual of a solved constraint
ITERATIONS = 30  # most iterations of Newton's method, which needs 2 to 6
CONTINUATION_STEPS = 4  # steps from the reference posture, so that a loop keeps its assembly mode
PERTURBATION = 0.05  # [rad or m] distance from the reference posture, where Jacobian entries may vanish by chance
LEVER = 1e-9  # smallest entry of a constraint's Jacobian that counts as a dependence
CUTOFF = 1e-9  # relative singular value below which constraints leave a direction free
DISABLED = (
    mujoco.mjtDisableBit.mjDSBL_CONTACT,
    mujoco.mjtDisableBit.mjDSBL_LIMIT,
    mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS,
    mujoco.mjtDisableBit.mjDSBL_SENSOR,
)


@dataclass(frozen=True)
class Slack:
    """Deviation of f followers from their constraints, which give way under load like springs.

    Attributes:
        solution: Positions that satisfy the constraints [rad or m], shape (B, positions).
        offsets: Deviation from the solution [rad or m], shape (B, f).
        speeds: Time derivative of the offsets, shape (B, f).
    """

    solution: np.ndarray
    offsets: np.ndarray
    speeds: np.ndarray

    def select(self, rows: np.ndarray) -> "Slack":
        """Return the slack of some rows."""
        return Slack(self.solution[rows], self.offsets[rows], self.speeds[rows])


@dataclass(frozen=True)
class Followers:
    """Degrees of freedom that active equality constraints tie to measured ones.

    Newton's method solves the constraints c(q) = 0 for the followers' positions q_f; the other positions q_o are given.
    With J = ∂c/∂q, the followers' velocities solve J_f q̇_f = −J_o q̇_o. Directions that the constraints leave free
    change as little as possible.

    Attributes:
        model: The model with equality constraints only.
        dofs: Indices of the followers in `qvel`, shape (f,).
        qpos: Their indices in `qpos`; more than f if a follower is a ball or free joint.
        joints: Indices of their joints.
        rows: Indices of the constraint rows that tie them, shape (rows,).
        joint_space: Whether all constraints are between joints or fixed tendons, so that no kinematics is needed.
    """

    model: mujoco.MjModel
    dofs: np.ndarray
    qpos: np.ndarray
    joints: np.ndarray
    rows: np.ndarray
    joint_space: bool

    @classmethod
    def of(cls, model: mujoco.MjModel, measured: np.ndarray) -> "Followers | None":
        """Find the followers of a compiled model; None if there are none.

        Args:
            model: Compiled model.
            measured: Indices of the measured joints in `qvel`.
        """
        if not model.neq or model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY):
            return None
        equalities, joint_space = keep_equalities(model), is_joint_space(model)
        tied, reached = find_ties(equalities, joint_space), np.zeros(model.nv, bool)
        trees = np.isin(model.dof_treeid, model.dof_treeid[measured])
        reached[measured] = True
        reached |= trees & tied.any(axis=0)
        reached = spread(tied, reached)
        reached[measured] = False
        # a joint follows as a whole, even if a constraint depends on one axis of a ball joint only
        joints = np.unique(model.dof_jntid[np.flatnonzero(reached)])
        if not len(joints):
            return None
        dofs = np.flatnonzero(np.isin(model.dof_jntid, joints))
        return cls(
            model=equalities,
            dofs=dofs,
            qpos=np.concatenate([find_position_indices(model, int(joint)) for joint in joints]),
            joints=joints,
            rows=np.flatnonzero(tied[:, dofs].any(axis=1)),
            joint_space=joint_space,
        )

    def place(self, qpos: np.ndarray, qvel: np.ndarray, from_reference: bool = False) -> None:
        """Set the followers' positions and velocities to those that satisfy the constraints, in place.

        Args:
            qpos: Positions, with the followers near their solution, shape (B, nq).
            qvel: Velocities, shape (B, nv).
            from_reference: Whether the followers are at their reference, which may be far from the solution.
        """
        if from_reference and not self.joint_space:
            target = qpos.copy()
            for step in range(CONTINUATION_STEPS):
                qpos[:] = self.interpolate(target, qpos, step / CONTINUATION_STEPS)
                self.solve(qpos)
            followers = qpos[:, self.qpos].copy()
            qpos[:] = target
            qpos[:, self.qpos] = followers
        jacobian = self.solve(qpos)
        qvel[:, self.dofs] = self.solve_velocities(jacobian, qvel)

    def interpolate(self, target: np.ndarray, followers: np.ndarray, share: float) -> np.ndarray:
        """Return positions at a share of the way from the reference to `target`, shape (B, nq).

        The followers' positions are taken from `followers`, shape (B, nq).
        """
        reference = self.model.qpos0
        moved = np.array([self.integrate(reference, share * self.difference(reference, row)) for row in target])
        moved[:, self.qpos] = followers[:, self.qpos]
        return moved

    def solve(self, qpos: np.ndarray) -> np.ndarray:
        """Solve the constraints for the followers in positions (B, nq), in place; return the Jacobian (B, rows, nv)."""
        for _ in range(ITERATIONS):
            residual, jacobian = self.constraints(qpos)
            open_rows = np.abs(residual).max(axis=1, initial=0.0) > TOLERANCE
            if not open_rows.any():
                break
            change = solve_least_norm(jacobian[open_rows][..., self.dofs], -residual[open_rows])
            self.shift(qpos, open_rows, change)
            if np.abs(change).max() < TOLERANCE:
                break
        return jacobian

    def solve_velocities(self, jacobian: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Return the followers' velocities (B, f) for the other velocities in qvel (B, nv)."""
        others = qvel.copy()
        others[:, self.dofs] = 0.0
        return solve_least_norm(jacobian[..., self.dofs], -np.einsum("bij,bj->bi", jacobian, others))

    def velocity_jacobian(self, qpos: np.ndarray) -> np.ndarray:
        """Return ∂q̇_f/∂q̇ at postures (…, nq), shape (…, f, nv); the followers' own columns are zero."""
        _, jacobian = self.constraints(qpos.reshape(-1, qpos.shape[-1]))
        result = -np.linalg.pinv(jacobian[..., self.dofs], rcond=CUTOFF) @ jacobian
        result[..., self.dofs] = 0.0
        return np.asarray(result.reshape(*qpos.shape[:-1], *result.shape[1:]))

    def measure_slack(self, qpos: np.ndarray, qvel: np.ndarray) -> Slack:
        """Return the followers' deviation from the constraints at positions (B, nq) and velocities (B, nv)."""
        solved, speeds = qpos.copy(), qvel.copy()
        self.place(solved, speeds)
        if len(self.qpos) == len(self.dofs):
            offsets = qpos[:, self.qpos] - solved[:, self.qpos]
        else:
            pairs = zip(solved, qpos, strict=True)
            steps = np.array([self.difference(start, end) for start, end in pairs]).reshape(-1, self.model.nv)
            offsets = steps[:, self.dofs]
        return Slack(solved[:, self.qpos], offsets, qvel[:, self.dofs] - speeds[:, self.dofs])

    def place_with_slack(self, slack: Slack, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Place the followers from an earlier solution, then add their deviation at that time."""
        qpos[:, self.qpos] = slack.solution
        self.place(qpos, qvel)
        self.shift(qpos, np.ones(len(qpos), bool), slack.offsets)
        qvel[:, self.dofs] += slack.speeds

    def shift(self, qpos: np.ndarray, rows: np.ndarray, change: np.ndarray) -> None:
        """Move the followers in some rows of positions (B, nq) by `change` (rows, f), in place."""
        if len(self.qpos) == len(self.dofs):
            qpos[np.ix_(rows, self.qpos)] += change
            return
        step = np.zeros(self.model.nv)
        for row, own in zip(np.flatnonzero(rows), change, strict=True):
            step[self.dofs] = own
            qpos[row] = self.integrate(qpos[row], step)

    def integrate(self, qpos: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return positions (nq,) after a step (nv,)."""
        result = qpos.copy()
        mujoco.mj_integratePos(self.model, result, step, 1.0)
        return result

    def difference(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return the step (nv,) from one position (nq,) to another."""
        step = np.empty(self.model.nv)
        mujoco.mj_differentiatePos(self.model, step, 1.0, start, end)
        return step

    def constraints(self, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals (B, rows) and Jacobians (B, rows, nv) of the constraints at positions (B, nq)."""
        residual, jacobian = (evaluate_in_joint_space if self.joint_space else evaluate_with_kinematics)(
            self.model, qpos
        )
        return residual[:, self.rows], jacobian[:, self.rows]


def solve_least_norm(jacobian: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the least-norm, least-squares solutions x (B, f) of jacobian (B, rows, f) · x = wanted (B, rows)."""
    return np.asarray((np.linalg.pinv(jacobian, rcond=CUTOFF) @ wanted[..., None])[..., 0])


def keep_equalities(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a model with dense Jacobians and no constraints other than equalities."""
    copied = copy.copy(model)
    copied.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
    copied.opt.disableflags |= sum(int(flag) for flag in DISABLED)
    return copied


def find_ties(equalities: mujoco.MjModel, joint_space: bool) -> np.ndarray:
    """Return a mask of the degrees of freedom that each constraint row depends on, shape (rows, nv).

    Args:
        equalities: The model with equality constraints only.
        joint_space: Whether all of them are between joints or fixed tendons.
    """
    evaluate = evaluate_in_joint_space if joint_space else evaluate_with_kinematics
    _, jacobian = (values[0] for values in evaluate(equalities, make_generic_posture(equalities)[None]))
    return np.asarray(np.abs(jacobian) > LEVER)


def spread(tied: np.ndarray, reached: np.ndarray) -> np.ndarray:
    """Return the degrees of freedom that constraints tie, directly or through others, to those reached, shape (nv,)."""
    while (grown := reached | tied[tied[:, reached].any(axis=1)].any(axis=0)).sum() > reached.sum():
        reached = grown
    return reached


def list_tied_dofs(model: mujoco.MjModel, dof: int) -> list[int]:
    """Return the other degrees of freedom that active equality constraints tie to one of a compiled model."""
    if not model.neq or model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY):
        return []
    reached = np.arange(model.nv) == dof
    tied = spread(find_ties(keep_equalities(model), is_joint_space(model)), reached)
    return np.flatnonzero(tied & ~reached).tolist()


def make_generic_posture(model: mujoco.MjModel) -> np.ndarray:
    """Return positions (nq,) a little off the reference posture."""
    qpos = model.qpos0.copy()
    mujoco.mj_integratePos(model, qpos, PERTURBATION * np.random.default_rng(0).normal(size=model.nv), 1.0)
    return qpos


def find_position_indices(model: mujoco.MjModel, joint: int) -> np.ndarray:
    """Return the indices of a joint's positions in `qpos`, shape (1,), (4,) or (7,)."""
    width = {int(mujoco.mjtJoint.mjJNT_FREE): 7, int(mujoco.mjtJoint.mjJNT_BALL): 4}.get(int(model.jnt_type[joint]), 1)
    return int(model.jnt_qposadr[joint]) + np.arange(width)


def has_only_fixed_tendons(model: mujoco.MjModel) -> bool:
    """Whether all tendons are fixed tendons, whose length is a weighted sum of joint positions."""
    return bool((model.wrap_type == int(mujoco.mjtWrap.mjWRAP_JOINT)).all())


def is_joint_space(model: mujoco.MjModel) -> bool:
    """Whether all active equality constraints are between joints or fixed tendons."""
    kinds = (int(mujoco.mjtEq.mjEQ_JOINT), int(mujoco.mjtEq.mjEQ_TENDON))
    return bool(np.isin(model.eq_type[model.eq_active0.astype(bool)], kinds).all() and has_only_fixed_tendons(model))


def evaluate_with_kinematics(model: mujoco.MjModel, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate the constraints by MuJoCo's kinematics, one posture at a time; see `Followers.constraints`."""
    data, residuals, jacobians = mujoco.MjData(model), [], []
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_fwdPosition(model, data)
        residuals.append(data.efc_pos.copy())
        jacobians.append(data.efc_J.reshape(-1, model.nv).copy())
    return np.array(residuals), np.array(jacobians)


def evaluate_in_joint_space(model: mujoco.MjModel, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate constraints of joints and fixed tendons in all postures at once; see `Followers.constraints`.

    A constraint of two joints or tendons of lengths x and y is x − x₀ = Σ cₖ (y − y₀)ᵏ, k = 0 … 4. A constraint of one
    is x − x₀ = c₀. Source: MuJoCo documentation, XML reference, equality/joint and equality/tendon.
    """
    active = np.flatnonzero(model.eq_active0)
    residuals, jacobians = np.zeros((len(qpos), len(active))), np.zeros((len(qpos), len(active), model.nv))
    for row, equality in enumerate(active):
        first, second = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
        tendons = int(model.eq_type[equality]) == int(mujoco.mjtEq.mjEQ_TENDON)
        coefficients = model.eq_data[equality, :5]
        x, x_jacobian = measure_length(model, qpos, first, tendons)
        residuals[:, row], jacobians[:, row] = x - coefficients[0], x_jacobian
        if second >= 0:
            y, y_jacobian = measure_length(model, qpos, second, tendons)
            residuals[:, row] -= sum(coefficients[k] * y**k for k in range(1, 5))
            slope = sum(k * coefficients[k] * y ** (k - 1) for k in range(1, 5))
            jacobians[:, row] -= np.asarray(slope)[:, None] * y_jacobian
    return residuals, jacobians


def measure_length(model: mujoco.MjModel, qpos: np.ndarray, index: int, tendon: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the length of a joint or fixed tendon relative to the reference (B,), and its Jacobian (nv,)."""
    parts = [(index, 1.0)]
    if tendon:
        wraps = range(model.tendon_adr[index], model.tendon_adr[index] + model.tendon_num[index])
        parts = [(int(model.wrap_objid[wrap]), float(model.wrap_prm[wrap])) for wrap in wraps]
    length, jacobian = np.zeros(len(qpos)), np.zeros(model.nv)
    for joint, share in parts:
        address = model.jnt_qposadr[joint]
        length += share * (qpos[:, address] - model.qpos0[address])
        jacobian[model.jnt_dofadr[joint]] += share
    return length, jacobian
