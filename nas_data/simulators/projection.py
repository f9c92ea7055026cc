"""Projection of states onto a model's equality constraints, for engines that do not solve these constraints."""

from collections.abc import Callable

import mujoco
import numpy as np

from nas_data.simulators.followers import (
    evaluate_in_joint_space,
    evaluate_with_kinematics,
    is_joint_space,
    keep_equalities,
)

CUTOFF = 1e-9  # relative singular value below which constraints are redundant


class Projection:
    """Projects positions and velocities onto the equality constraints c(q) = 0, in the metric of the mass matrix.

    With J = ∂c/∂q and the mass matrix M, velocities become q̇ − M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹ J q̇, the effect of constraint
    impulses. Positions become q − M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹ c(q), one step of Newton's method.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Prepare the constraints of a compiled model."""
        self.model = keep_equalities(model)
        self._evaluate: Callable[[mujoco.MjModel, np.ndarray], tuple[np.ndarray, np.ndarray]] = (
            evaluate_in_joint_space if is_joint_space(self.model) else evaluate_with_kinematics
        )

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "Projection | None":
        """Return the projection of a model; None if no equality constraint is active."""
        disabled = model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        return cls(model) if model.eq_active0.any() and not disabled else None

    def __call__(self, qpos: np.ndarray, qvel: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return projected positions (nq,) and velocities (nv,).

        Args:
            qpos: Positions of hinges and slides near the constraints, shape (nq,).
            qvel: Velocities, shape (nv,).
            mass: Mass matrix, shape (nv, nv).
        """
        residual, jacobian = (values[0] for values in self._evaluate(self.model, qpos[None]))
        pulled = np.linalg.solve(mass, jacobian.T)
        back = pulled @ np.linalg.pinv(jacobian @ pulled, rcond=CUTOFF, hermitian=True)
        return qpos - back @ residual, qvel - back @ (jacobian @ qvel)
