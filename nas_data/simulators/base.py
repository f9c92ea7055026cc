"""What a simulator is: something that predicts one control step, rolls out episodes and steps in a closed loop."""

from typing import Protocol

import numpy as np


class Stepper(Protocol):
    """A batch of B independent simulations stepped together in a closed loop.

    Implemented by plain simulators, by the augmented one (source + φ) and by the learned one (ψ).
    """

    joints: tuple[str, ...]
    size: int

    @property
    def states(self) -> np.ndarray:
        """Joint positions [rad] then velocities [rad/s], shape (B, 2n), float64."""

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Start (some of the) simulations anew at rest or in motion, with every hidden memory cleared.

        Args:
            states: Positions [rad] then velocities [rad/s], shape (rows, 2n).
            rows: Which simulations, shape (rows,); all where None.
        """

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Hold the commands (B, n) for one control period and return the new states (B, 2n)."""

    def set_states(self, states: np.ndarray) -> None:
        """Set the joints' state (B, 2n) without clearing memories (delays, play, activations)."""

    def site_positions(self, name: str) -> np.ndarray:
        """Return where a site is in the world [m], shape (B, 3), in agreement with `states`."""


class Simulator(Protocol):
    """A model of a robot on a physics engine, at a fixed control period.

    Attributes:
        joints: Measured and commanded joints.
        period: Control period [s].
        commands_effort: Whether it takes torques.
        remembers: Whether it has a state that is not measured (play, a command under way), which a reset forgets.
    """

    joints: tuple[str, ...]
    period: float
    commands_effort: bool
    remembers: bool

    def predict(self, states: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Simulate independent transitions: each row reset to its state, warm start zeroed, command held one period.

        Args:
            states: Positions [rad] then velocities [rad/s], shape (N, 2n).
            commands: Positions [rad] or torques [N·m], shape (N, n).

        Returns:
            Next states, shape (N, 2n), float64.
        """

    def rollout(self, initial: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Simulate whole episodes in open loop.

        Args:
            initial: First states, shape (B, 2n).
            commands: Shape (B, T, n).

        Returns:
            States after each command, shape (B, T, 2n), float64.
        """

    def stepper(self, size: int) -> Stepper:
        """Return a batch of simulations for closed loops."""

    def describe(self) -> dict[str, object]:
        """Return what provenance records: model's name and SHA-256, engine and version, effects with parameters."""
