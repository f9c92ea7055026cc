"""What a simulator is: something that predicts one control step, rolls out episodes and steps in a closed loop."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from nas_data.dataset.features import Feature


class Stepper(Protocol):
    """A batch of B independent simulations stepped together in a closed loop.

    Implemented by plain simulators, by the augmented one (source + φ) and by the learned one (ψ).
    """

    joints: tuple[str, ...]
    size: int

    @property
    def states(self) -> np.ndarray:
        """Joint positions [rad] then velocities [rad/s], shape (B, 2n), float64."""

    @property
    def objects(self) -> np.ndarray:
        """Positions then velocities of what moves beside the joints (see `Objects`), shape (B, m), float64."""

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Start (some of the) simulations anew at rest or in motion, with every hidden memory cleared.

        Args:
            states: Positions [rad] then velocities [rad/s], and the objects' states where they are not to be in the
                model's reference posture, shape (rows, 2n or 2n + m).
            rows: Which simulations, shape (rows,); all where None.
        """

    def guide(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Command the servos of objects (an opponent's) until the next reset or guidance.

        Args:
            targets: Positions [rad], in the order of `Objects.servos`, shape (rows, k).
            rows: Which simulations, shape (rows,).
        """

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Hold the commands (B, n) for one control period and return the new states (B, 2n)."""

    def set_states(self, states: np.ndarray) -> None:
        """Set the joints' state (B, 2n), not the objects', without clearing memories (delays, play, activations)."""

    def site_positions(self, name: str) -> np.ndarray:
        """Return where a site is in the world [m], shape (B, 3), in agreement with `states`."""


@runtime_checkable
class Redrawn(Protocol):
    """A batch of simulations whose models are drawn anew with every episode."""

    def redraw(self, rngs: Sequence[np.random.Generator], rows: np.ndarray | None = None) -> None:
        """Draw the models of episodes that are about to begin; `Stepper.reset` follows.

        Args:
            rngs: One generator a simulation that starts; what it gives to others stays the same.
            rows: Which simulations, shape (rows,); all where None.
        """


class Simulator(Protocol):
    """A model of a robot on a physics engine, at a fixed control period.

    Attributes:
        joints: Measured and commanded joints.
        slides: Those of them that are slides: in metres and newtons, where others are in radians and newton metres.
        period: Control period [s].
        kinds: What each joint is commanded: `.pos` [rad; m], `.vel` [rad/s; m/s] or `.effort` [N·m; N].
        remembers: Whether it has a state that is not measured (play, a command under way), which a reset forgets.
        object_feature: Names and units of the states of objects in the scene, m components; none in most.
    """

    joints: tuple[str, ...]
    slides: tuple[str, ...]
    period: float
    kinds: tuple[str, ...]
    remembers: bool
    object_feature: Feature

    def predict(self, states: np.ndarray, commands: np.ndarray, continues: np.ndarray | None = None) -> np.ndarray:
        """Simulate transitions: each row reset to its state, warm start zeroed, command held one period.

        Args:
            states: Positions [rad] then velocities [rad/s], shape (N, 2n), or with the objects' states (N, 2n + m).
                Without them objects start in the model's reference posture.
            commands: What each joint is asked for, shape (N, n).
            continues: Whether a row follows the one before it in a recording, shape (N,); nowhere where None. Then it
                starts with what the simulation of that one tells of what is not measured, where that matters: how far
                constraints gave way, and where a servo's setpoint is whose speed is commanded.

        Returns:
            Next states, as wide as the states given, float64.
        """

    def rollout(self, initial: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Simulate whole episodes in open loop.

        Args:
            initial: First states, shape (B, 2n), or with the objects' states (B, 2n + m). Their servos hold still.
            commands: Shape (B, T, n).

        Returns:
            States after each command, shape (B, T, 2n), or (B, T, 2n + m), float64.
        """

    def rollout_settled(self, initial: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Do as `rollout`, from an arm whose servos have long held its weight: play and springs lie as they then do."""

    def stepper(self, size: int) -> Stepper:
        """Return a batch of simulations for closed loops."""

    def describe(self) -> dict[str, object]:
        """Return what provenance records: model's name and SHA-256, engine and version, effects with parameters."""
