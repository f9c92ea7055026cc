"""Joints that constraints make follow the measured ones: where they are, and how fast they move."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

EXACT = 1e-12  # [m or rad] residual of the constraints at which a solution counts as found
ITERATIONS = 30  # of Newton's method, which takes 2 to 6
STRIDES = 4  # parts of the way from the reference posture, so that a loop stays on the side on which it was assembled
GENERIC = 0.05  # [rad or m] off the reference, where no lever happens to be zero
LEVER = 1e-9  # entry of a constraint's Jacobian below which it does not feel a degree of freedom
CUTOFF = 1e-9  # singular value, relative to the largest, below which constraints leave a direction free
# what a model in which only its equalities are solved for can do without
OTHERS = (
    mujoco.mjtDisableBit.mjDSBL_CONTACT,
    mujoco.mjtDisableBit.mjDSBL_LIMIT,
    mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS,
    mujoco.mjtDisableBit.mjDSBL_SENSOR,
)


@dataclass(frozen=True)
class Slack:
    """How far f followers are off where the constraints have them.

    Attributes:
        near: Where the constraints have them, shape (B, positions).
        apart: How far they are off that, shape (B, f).
        speeds: How fast that grows, shape (B, f).
    """

    near: np.ndarray
    apart: np.ndarray
    speeds: np.ndarray

    def of_rows(self, rows: np.ndarray) -> "Slack":
        """Return that of some rows."""
        return Slack(self.near[rows], self.apart[rows], self.speeds[rows])


@dataclass(frozen=True)
class Followers:
    """Degrees of freedom that active equality constraints tie to measured ones.

    The constraints c(q) = 0 are solved for the followers' positions q_f by Newton's method, all other positions as they
    are; with J = ∂c/∂q, their velocities solve J_f q̇_f = −J_o q̇_o. What constraints leave free stays near where it was.

    Attributes:
        model: The model with nothing but its equality constraints.
        dofs: Indices in `qvel`, shape (f,).
        qpos: Indices in `qpos`; more than f where a follower is a ball or free joint.
        joints: Indices of the joints.
        rows: Which constraint rows tie them, shape (rows,).
        flat: Whether the constraints are joints' and fixed tendons', which need no kinematics.
    """

    model: mujoco.MjModel
    dofs: np.ndarray
    qpos: np.ndarray
    joints: np.ndarray
    rows: np.ndarray
    flat: bool

    @classmethod
    def of(cls, model: mujoco.MjModel, measured: np.ndarray) -> "Followers | None":
        """Find the followers of a compiled model; None where there are none.

        Args:
            model: Compiled model.
            measured: Indices in `qvel` of what is measured.
        """
        if not model.neq or model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY):
            return None
        equalities = only_equalities(model)
        flat = is_flat(model)
        evaluate = flat_constraints if flat else evaluate_constraints
        _, jacobian = (values[0] for values in evaluate(equalities, generic_posture(equalities)[None]))
        tied = np.abs(jacobian) > LEVER
        reached = np.zeros(model.nv, bool)
        trees = np.isin(model.dof_treeid, model.dof_treeid[measured])
        reached[measured] = True
        reached |= trees & tied.any(axis=0)
        while (grown := reached | tied[tied[:, reached].any(axis=1)].any(axis=0)).sum() > reached.sum():
            reached = grown
        reached[measured] = False
        # a joint is put as a whole: of a ball joint, a constraint may feel one axis only
        joints = np.unique(model.dof_jntid[np.flatnonzero(reached)])
        if not len(joints):
            return None
        dofs = np.flatnonzero(np.isin(model.dof_jntid, joints))
        return cls(
            model=equalities,
            dofs=dofs,
            qpos=np.concatenate([position_indices(model, int(joint)) for joint in joints]),
            joints=joints,
            rows=np.flatnonzero(tied[:, dofs].any(axis=1)),
            flat=flat,
        )

    def place(self, qpos: np.ndarray, qvel: np.ndarray, far: bool = False) -> None:
        """Put the followers where the other joints have them, in place.

        Args:
            qpos: Positions, the followers' near their solution, shape (B, nq).
            qvel: Speeds, shape (B, nv).
            far: Whether the followers are at their reference, which may be far from the solution.
        """
        if far and not self.flat:
            there = qpos.copy()
            for stride in range(STRIDES):
                qpos[:] = self.between(there, qpos, stride / STRIDES)
                self.solve(qpos)
            followers = qpos[:, self.qpos].copy()
            qpos[:] = there
            qpos[:, self.qpos] = followers
        jacobian = self.solve(qpos)
        qvel[:, self.dofs] = self.speeds(jacobian, qvel)

    def between(self, there: np.ndarray, followers: np.ndarray, share: float) -> np.ndarray:
        """Return positions a share of the way from the reference to `there`, the followers as given, shape (B, nq)."""
        reference = self.model.qpos0
        moved = np.array([self.moved(reference, share * self.difference(reference, row)) for row in there])
        moved[:, self.qpos] = followers[:, self.qpos]
        return moved

    def solve(self, qpos: np.ndarray) -> np.ndarray:
        """Solve the constraints for the followers' positions (B, nq), in place; return the Jacobian (B, rows, nv)."""
        for _ in range(ITERATIONS):
            residual, jacobian = self.constraints(qpos)
            open_rows = np.abs(residual).max(axis=1, initial=0.0) > EXACT
            if not open_rows.any():
                break
            change = least_change(jacobian[open_rows][..., self.dofs], -residual[open_rows])
            self.shift(qpos, open_rows, change)
            if np.abs(change).max() < EXACT:
                break
        return jacobian

    def speeds(self, jacobian: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Return the followers' speeds (B, f) at the others' speeds, in qvel (B, nv)."""
        others = qvel.copy()
        others[:, self.dofs] = 0.0
        return least_change(jacobian[..., self.dofs], -np.einsum("bij,bj->bi", jacobian, others))

    def slopes(self, qpos: np.ndarray) -> np.ndarray:
        """Return how the followers' speeds depend on all others, at one posture (nq,): shape (f, nv)."""
        _, jacobian = self.constraints(qpos[None])
        result = -np.linalg.pinv(jacobian[0][:, self.dofs], rcond=CUTOFF) @ jacobian[0]
        result[:, self.dofs] = 0.0
        return np.asarray(result)

    def slack(self, qpos: np.ndarray, qvel: np.ndarray) -> "Slack":
        """Return how far the followers are off where the constraints have them, at positions (B, nq), speeds (B, nv).

        The engine's constraints give way under load, like springs.
        """
        placed, speeds = qpos.copy(), qvel.copy()
        self.place(placed, speeds)
        if len(self.qpos) == len(self.dofs):
            apart = qpos[:, self.qpos] - placed[:, self.qpos]
        else:
            both = zip(placed, qpos, strict=True)
            apart = np.array([self.difference(one, other) for one, other in both]).reshape(-1, self.model.nv)[
                :, self.dofs
            ]
        return Slack(placed[:, self.qpos], apart, qvel[:, self.dofs] - speeds[:, self.dofs])

    def place_with(self, slack: "Slack", qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Do as `place`, from where the followers were, and as far off where the constraints have them."""
        qpos[:, self.qpos] = slack.near
        self.place(qpos, qvel)
        self.shift(qpos, np.ones(len(qpos), bool), slack.apart)
        qvel[:, self.dofs] += slack.speeds

    def shift(self, qpos: np.ndarray, rows: np.ndarray, change: np.ndarray) -> None:
        """Move the followers of some rows of positions (B, nq), in place, by (rows, f)."""
        if len(self.qpos) == len(self.dofs):
            qpos[np.ix_(rows, self.qpos)] += change
            return
        step = np.zeros(self.model.nv)
        for row, own in zip(np.flatnonzero(rows), change, strict=True):
            step[self.dofs] = own
            qpos[row] = self.moved(qpos[row], step)

    def moved(self, qpos: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return positions (nq,) moved by a step (nv,)."""
        result = qpos.copy()
        mujoco.mj_integratePos(self.model, result, step, 1.0)
        return result

    def difference(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return the step (nv,) between two positions (nq,)."""
        step = np.empty(self.model.nv)
        mujoco.mj_differentiatePos(self.model, step, 1.0, start, end)
        return step

    def constraints(self, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals (B, rows) and Jacobians (B, rows, nv) of the constraints at positions (B, nq)."""
        residual, jacobian = (flat_constraints if self.flat else evaluate_constraints)(self.model, qpos)
        return residual[:, self.rows], jacobian[:, self.rows]


def least_change(jacobian: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the least changes (B, f) that bring about what is wanted (B, rows), as well as can be."""
    return np.asarray((np.linalg.pinv(jacobian, rcond=CUTOFF) @ wanted[..., None])[..., 0])


def only_equalities(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a model with dense Jacobians, in which equality constraints are all that is solved for."""
    copied = copy.copy(model)
    copied.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
    copied.opt.disableflags |= sum(int(flag) for flag in OTHERS)
    return copied


def generic_posture(model: mujoco.MjModel) -> np.ndarray:
    """Return positions (nq,) a little off the reference posture."""
    qpos = model.qpos0.copy()
    mujoco.mj_integratePos(model, qpos, GENERIC * np.random.default_rng(0).normal(size=model.nv), 1.0)
    return qpos


def position_indices(model: mujoco.MjModel, joint: int) -> np.ndarray:
    """Return the indices of a joint's positions in `qpos`."""
    width = {int(mujoco.mjtJoint.mjJNT_FREE): 7, int(mujoco.mjtJoint.mjJNT_BALL): 4}.get(int(model.jnt_type[joint]), 1)
    return int(model.jnt_qposadr[joint]) + np.arange(width)


def fixed_tendons(model: mujoco.MjModel) -> bool:
    """Whether all tendons are sums of joints."""
    return bool((model.wrap_type == int(mujoco.mjtWrap.mjWRAP_JOINT)).all())


def is_flat(model: mujoco.MjModel) -> bool:
    """Whether all constraints are joints' and fixed tendons', which need no kinematics."""
    kinds = (int(mujoco.mjtEq.mjEQ_JOINT), int(mujoco.mjtEq.mjEQ_TENDON))
    return bool(np.isin(model.eq_type[model.eq_active0.astype(bool)], kinds).all() and fixed_tendons(model))


def evaluate_constraints(model: mujoco.MjModel, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Let the engine evaluate the constraints, posture by posture; see `Followers.constraints`."""
    data, residuals, jacobians = mujoco.MjData(model), [], []
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_fwdPosition(model, data)
        residuals.append(data.efc_pos.copy())
        jacobians.append(data.efc_J.reshape(-1, model.nv).copy())
    return np.array(residuals), np.array(jacobians)


def flat_constraints(model: mujoco.MjModel, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate joints' and fixed tendons' constraints in all postures at once; see `Followers.constraints`.

    A constraint of two joints or tendons with lengths x and y is x − x₀ = Σ cₖ (y − y₀)ᵏ, k = 0 … 4; of one it is
    x − x₀ = c₀ (MuJoCo documentation, XML reference, equality/joint and equality/tendon).
    """
    active = np.flatnonzero(model.eq_active0)
    residuals, jacobians = np.zeros((len(qpos), len(active))), np.zeros((len(qpos), len(active), model.nv))
    for place, equality in enumerate(active):
        first, second = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
        tendons = int(model.eq_type[equality]) == int(mujoco.mjtEq.mjEQ_TENDON)
        coefficients = model.eq_data[equality, :5]
        x, along = measure(model, qpos, first, tendons)
        residuals[:, place], jacobians[:, place] = x - coefficients[0], along
        if second >= 0:
            y, beside = measure(model, qpos, second, tendons)
            residuals[:, place] -= sum(coefficients[k] * y**k for k in range(1, 5))
            slope = sum(k * coefficients[k] * y ** (k - 1) for k in range(1, 5))
            jacobians[:, place] -= np.asarray(slope)[:, None] * beside
    return residuals, jacobians


def measure(model: mujoco.MjModel, qpos: np.ndarray, index: int, tendons: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return a joint's or fixed tendon's distance from its reference (B,), and its Jacobian (nv,)."""
    parts = [(index, 1.0)]
    if tendons:
        wraps = range(model.tendon_adr[index], model.tendon_adr[index] + model.tendon_num[index])
        parts = [(int(model.wrap_objid[wrap]), float(model.wrap_prm[wrap])) for wrap in wraps]
    length, along = np.zeros(len(qpos)), np.zeros(model.nv)
    for joint, share in parts:
        address = model.jnt_qposadr[joint]
        length += share * (qpos[:, address] - model.qpos0[address])
        along[model.jnt_dofadr[joint]] += share
    return length, along
