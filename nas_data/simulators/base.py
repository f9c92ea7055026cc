"""Interfaces of simulators: one-step predictions, open-loop rollouts and closed loops."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from nas_data.dataset.features import Feature


class Stepper(Protocol):
    """A batch of B independent simulations stepped together in a closed loop.

    Physics engines, the augmented source (source + φ) and the learned model ψ implement it.
    """

    joints: tuple[str, ...]
    size: int

    @property
    def states(self) -> np.ndarray:
        """Joint positions [rad] then velocities [rad/s], shape (B, 2n), float64."""

    @property
    def objects(self) -> np.ndarray:
        """Positions then velocities of the objects in the scene (see `Objects`), shape (B, m), float64."""

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Reset simulations to states, and clear all unmeasured state.

        Args:
            states: Positions [rad], velocities [rad/s] and, optionally, object states, shape (rows, 2n or 2n + m).
                Without object states, objects start in the model's reference posture.
            rows: Indices of the simulations, shape (rows,); all if None.
        """

    def command_objects(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Command the servos of objects, such as an opponent; commands hold until the next call or reset.

        Args:
            targets: Positions [rad], in the order of `Objects.servos`, shape (rows, k).
            rows: Indices of the simulations, shape (rows,).
        """

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Hold the commands (B, n) for one control period and return the new states (B, 2n)."""

    def set_states(self, states: np.ndarray) -> None:
        """Set the joints' states (B, 2n); objects and unmeasured state (delays, play, activations) stay."""

    def site_positions(self, name: str) -> np.ndarray:
        """Return the world position of a site [m], shape (B, 3), consistent with `states`."""


@runtime_checkable
class RandomizedStepper(Protocol):
    """A batch of simulations with domain randomization: each episode has its own model."""

    def redraw(self, rngs: Sequence[np.random.Generator], rows: np.ndarray | None = None) -> None:
        """Draw the models of new episodes; the caller then calls `Stepper.reset`.

        Args:
            rngs: One generator per simulation in `rows`.
            rows: Indices of the simulations, shape (rows,); all if None.
        """


class Simulator(Protocol):
    """A model of a robot on a physics engine, at a fixed control period.

    Attributes:
        joints: Measured and commanded joints.
        slides: Slides among them, in metres and newtons instead of radians and newton metres.
        period: Control period [s].
        kinds: Command quantity of each joint: `.pos` [rad; m], `.vel` [rad/s; m/s] or `.effort` [N·m; N].
        remembers: Whether it has unmeasured state, such as play or a delayed command, which a reset clears.
        object_feature: Names and units of the m components of the object states; empty without objects.
    """

    joints: tuple[str, ...]
    slides: tuple[str, ...]
    period: float
    kinds: tuple[str, ...]
    remembers: bool
    object_feature: Feature

    def predict(self, states: np.ndarray, commands: np.ndarray, continues: np.ndarray | None = None) -> np.ndarray:
        """Simulate transitions: each row is reset to its state, warm start zeroed, and its command held for one period.

        Args:
            states: Positions [rad] then velocities [rad/s], shape (N, 2n), or with the objects' states (N, 2n + m).
                Without them objects start in the model's reference posture.
            commands: Commands in the quantities of `kinds`, shape (N, n).
            continues: Whether a row follows the previous one in a recording, shape (N,); none does if None. Such a row
                takes over two unmeasured quantities from the simulation of the previous row: the deviation from
                constraints, and the setpoint of a servo that is commanded a velocity.

        Returns:
            Next states, shape as `states`, float64.
        """

    def rollout(self, initial: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Simulate whole episodes in open loop.

        Args:
            initial: First states, shape (B, 2n), or with the objects' states (B, 2n + m). Servos of objects hold their
                initial position.
            commands: Commands in the quantities of `kinds`, shape (B, T, n).

        Returns:
            States after each command, shape (B, T, 2n), or (B, T, 2n + m), float64.
        """

    def rollout_settled(
        self, initial: np.ndarray, commands: np.ndarray, initial_loads: np.ndarray | None = None
    ) -> np.ndarray:
        """Simulate as `rollout`, with play, springs and setpoints initially settled under a load.

        Args:
            initial: As for `rollout`.
            commands: As for `rollout`.
            initial_loads: Initial load of each joint (an `InitialLoad`), shape (B, n); the arm's weight if None.
        """

    def stepper(self, size: int) -> Stepper:
        """Return a batch of simulations for closed loops."""

    def describe(self) -> dict[str, object]:
        """Return the description for provenance: model, SHA-256, engine and version, effects with parameters."""
