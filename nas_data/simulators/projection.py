"""A state put onto a model's equality constraints, for engines that do not solve for them: gears, followers, loops."""

from collections.abc import Callable

import mujoco
import numpy as np

from nas_data.simulators.followers import evaluate_constraints, flat_constraints, is_flat, only_equalities

CUTOFF = 1e-9  # singular value, relative to the largest, below which constraints say the same twice


class Projection:
    """Projects positions and speeds onto the equality constraints c(q) = 0 of a model, the shortest way by its inertia.

    With J = ∂c/∂q and the mass matrix M, speeds become q̇ − M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹ J q̇, which is what impulses of the
    constraints do, and positions q − M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹ c(q), one step of Newton's method.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Prepare the constraints of a compiled model."""
        self.model = only_equalities(model)
        self._evaluate: Callable[[mujoco.MjModel, np.ndarray], tuple[np.ndarray, np.ndarray]] = (
            flat_constraints if is_flat(self.model) else evaluate_constraints
        )

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "Projection | None":
        """Return the projection of a model; None where no constraint acts."""
        disabled = model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        return cls(model) if model.eq_active0.any() and not disabled else None

    def __call__(self, qpos: np.ndarray, qvel: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (nq,) and speeds (nv,) on the constraints.

        Args:
            qpos: Positions of hinges and slides, shape (nq,), near the constraints.
            qvel: Speeds, shape (nv,).
            mass: Mass matrix, shape (nv, nv).
        """
        residual, jacobian = (values[0] for values in self._evaluate(self.model, qpos[None]))
        pulled = np.linalg.solve(mass, jacobian.T)
        back = pulled @ np.linalg.pinv(jacobian @ pulled, rcond=CUTOFF, hermitian=True)
        return qpos - back @ residual, qvel - back @ (jacobian @ qvel)
