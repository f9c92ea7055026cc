"""Initial states of episodes that begin in motion, which are uncertain."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

MAX_START_CHANGE = 3.0  # standard deviations by which an initial position or velocity may change


@dataclass(frozen=True)
class StartResponse:
    """Linear response of rollouts to the initial states x of their episodes, about x₀.

    For errors e, the most likely x minimises ½ Σ w² (e + S (x − x₀))² + ½ Σ ((x − x̂) / σ)². A fit in which every
    hypothesis has its own most likely x has a Hessian with the initial states eliminated (variable projection; Golub
    and Pereyra, 1973).

    Attributes:
        jacobian: S, derivatives of the positions by c initial coordinates, shape (c, E, T, n).
        weights: w, shape (E, 1, n).
        changes: x₀ − x̂, shape (E, c).
        deviations: σ, shape (E, c); 0 where the state is certain.
    """

    jacobian: np.ndarray
    weights: np.ndarray
    changes: np.ndarray
    deviations: np.ndarray

    def select(self, episodes: Sequence[int] | np.ndarray) -> "StartResponse":
        """Return the response of some episodes, by index."""
        chosen = list(episodes)
        return replace(
            self,
            jacobian=self.jacobian[:, chosen],
            weights=self.weights[chosen],
            changes=self.changes[chosen],
            deviations=self.deviations[chosen],
        )

    def absorb(self, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return errors (…, E, T, n) from the most likely initial states, and (x − x̂) / σ, shape (…, E, c)."""
        present = measure_deviations(self.changes, self.deviations)
        steps = self._solve(self._project(errors) + present)
        return self._move(errors, steps), present + steps

    def absorb_change(self, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what a change of the errors changes in both results of `absorb`."""
        steps = self._solve(self._project(change))
        return self._move(change, steps), steps

    @cached_property
    def _scaled(self) -> np.ndarray:
        """S σ, shape (c, E, T, n)."""
        return np.asarray(self.jacobian * self.deviations.T[:, :, None, None])

    @cached_property
    def _inverse(self) -> np.ndarray:
        """(σ Sᵀ W S σ + 1)⁻¹ of each episode, shape (E, c, c)."""
        rows = self._scaled * self.weights
        return np.linalg.inv(np.einsum("cetn,detn->ecd", rows, rows) + np.eye(len(rows)))

    def _project(self, errors: np.ndarray) -> np.ndarray:
        return np.einsum("cetn,...etn->...ec", self._scaled * self.weights**2, errors, optimize=True)

    def _solve(self, right: np.ndarray) -> np.ndarray:
        return -np.einsum("ecd,...ed->...ec", self._inverse, right)

    def _move(self, errors: np.ndarray, steps: np.ndarray) -> np.ndarray:
        return np.asarray(errors + np.einsum("cetn,...ec->...etn", self._scaled, steps, optimize=True))


def measure_deviations(changes: np.ndarray, deviations: np.ndarray) -> np.ndarray:
    """Return changes of initial states over their standard deviations, same shape; 0 where the state is certain."""
    return np.asarray(changes / np.where(deviations > 0, deviations, np.inf))


def measure_prior(changes: np.ndarray, deviations: np.ndarray) -> np.ndarray:
    """Return ½ Σ (change / σ)² of initial states, shape (E,), from shapes (E, c); certain coordinates do not count."""
    return np.asarray(0.5 * (measure_deviations(changes, deviations) ** 2).sum(1))
