"""Closed loops with learned models: the source corrected by φ, and ψ alone."""

import numpy as np

from nas_data.errors import CheckpointError, JointMismatch
from nas_data.models.divergence import is_out_of_bounds
from nas_data.models.inference.base import prepare_inference
from nas_data.models.lstm import DynamicsModel
from nas_data.simulators.base import Stepper


class LearnedStepper:
    """A batch of simulations whose next joint states a learned model determines; implements `Stepper`.

    With φ the source takes one step from the corrected state, φ corrects the result, and the source is set to it
    (algorithm 2 of the paper). Thus bodies, sites and contacts agree with the corrected state. A φ that corrects
    torques changes the commands of the source instead, and does not change its states. With ψ the source is not
    stepped; it is set to the predicted state and provides the poses of bodies and sites.

    If the model diverges, the states are NaN until the next reset, and the source keeps its last state.

    Only joints are corrected or predicted. The source simulates objects (a puck, an opponent) and their contacts with
    the arm; with ψ it is stepped for that purpose only.
    """

    def __init__(self, source: Stepper, model: DynamicsModel) -> None:
        """Wrap a source.

        Args:
            source: Batch of B simulations with the model's joints.
            model: φ or ψ; later training of it has no effect.

        Raises:
            JointMismatch: the model was trained for other joints.
        """
        if source.joints != model.joints:
            raise JointMismatch(
                f"The model was trained for the joints {', '.join(model.joints)}; "
                f"the source has {', '.join(source.joints)}."
            )
        self.source = source
        self.model = model
        self.joints = source.joints
        self.size = source.size
        self._states = source.states
        self._steps_source = model.kind == "delta" or source.objects.shape[1] > 0
        self._network = prepare_inference(model, self.size)
        self._diverged = np.zeros(self.size, bool)

    @property
    def states(self) -> np.ndarray:
        """Corrected positions [rad] then velocities [rad/s], shape (B, 2n); NaN where the model diverged."""
        return self._states

    @property
    def objects(self) -> np.ndarray:
        """The source's objects, uncorrected, shape (B, m); see `Stepper.objects`."""
        return self.source.objects

    def command_objects(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Command the servos of objects; see `Stepper.command_objects`."""
        self.source.command_objects(targets, rows)

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Reset simulations and the model's memory; see `Stepper.reset`."""
        self.source.reset(states, rows)
        chosen = slice(None) if rows is None else rows
        self._network.reset_memory(chosen)
        self._diverged[chosen] = False
        self._states = self.source.states.copy()
        self._states[self._diverged] = np.nan

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Hold the commands for one control period; see `Stepper.step`."""
        if self.model.corrects == "command":
            return self._step_with_torques(commands)
        stepped = self.source.step(commands) if self._steps_source else self._states
        base = stepped if self.model.kind == "delta" else self._states
        # the sum is float64, so that a zero correction leaves the source's state unchanged to the last bit
        self._states = base + self._network.changes(self._states, commands, base)
        self._diverged |= is_out_of_bounds(self._states)
        if self._diverged.any():
            self.source.set_states(np.where(self._diverged[:, None], self.source.states, self._states))
            self._states[self._diverged] = np.nan
        else:
            self.source.set_states(self._states)
        return self._states

    def _step_with_torques(self, commands: np.ndarray) -> np.ndarray:
        """Step the source with corrected torques (B, n)."""
        self._states = self.source.step(commands + self._network.changes(self._states, commands, self._states))
        return self._states

    def set_states(self, states: np.ndarray) -> None:
        """Set the joints' states (B, 2n); unmeasured state stays."""
        self.source.set_states(states)
        self._states = np.array(states, dtype=np.float64)

    def site_positions(self, name: str) -> np.ndarray:
        """Return the world position of a site [m] for the corrected state, shape (B, 3)."""
        return self.source.site_positions(name)


class AugmentedStepper(LearnedStepper):
    """Source + φ."""

    def __init__(self, source: Stepper, model: DynamicsModel) -> None:
        """Wrap a source with φ; see `LearnedStepper`."""
        require_kind(model, "delta")
        super().__init__(source, model)


class ForwardStepper(LearnedStepper):
    """ψ alone, with a source for the poses of bodies and sites."""

    def __init__(self, source: Stepper, model: DynamicsModel) -> None:
        """Wrap a source with ψ; see `LearnedStepper`."""
        require_kind(model, "forward")
        super().__init__(source, model)


def require_kind(model: DynamicsModel, kind: str) -> None:
    """Check the kind of a model.

    Raises:
        CheckpointError: the model is of the other kind.
    """
    if model.kind != kind:
        raise CheckpointError(
            f"The checkpoint is a {model.kind} model; a {kind} model is needed here: train one with `nas train {kind}`."
        )
