"""Where a policy lives: a task on a simulator, on a target, or on what was learned about it."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data.envs.base import SOURCE, Task, environment_id, find_task, find_task_file
from nas_data.errors import CheckpointError
from nas_data.simulators.base import Stepper

if TYPE_CHECKING:
    from nas_data.models.lstm import DynamicsModel


@dataclass(frozen=True)
class Plant:
    """Where a policy lives: a task, the dynamics of its robot, and what was learned about them.

    Attributes:
        environment: Name of the environment.
        dynamics: Which of the task's dynamics the physics has; `source` is the plain model.
        checkpoint: Learned model: φ corrects that physics after each step, ψ takes its place.
    """

    environment: str
    dynamics: str = SOURCE
    checkpoint: str | None = None

    @property
    def task(self) -> Task:
        """The task."""
        return find_task(self.environment)

    def stepper(self, size: int) -> Stepper:
        """Return B simulations.

        Raises:
            UnknownName: there is no such environment, or it has no such dynamics.
            CheckpointError: the checkpoint is damaged, or learned at another rate.
            JointMismatch: the checkpoint belongs to another robot.
        """
        physics = self.task.simulator(self.dynamics).stepper(size)
        if self.checkpoint is None:
            return physics
        from nas_data.models.augmented import LearnedStepper

        return LearnedStepper(physics, load_model(self.checkpoint, self.task))

    def describe(self) -> dict[str, object]:
        """Return what provenance records: equal for plants that behave alike, wherever their files lie.

        Raises:
            UnknownName, CheckpointError, JointMismatch: as `stepper` does.
        """
        if self.checkpoint is not None:
            load_model(self.checkpoint, self.task)
        return {
            "environment": environment_id(find_task_file(self.environment)),
            "dynamics": self.dynamics,
            "simulator": self.task.simulator(self.dynamics).describe(),
            "checkpoint_sha256": None if self.checkpoint is None else checkpoint_sha256(Path(self.checkpoint)),
        }


def load_model(checkpoint: str, task: Task) -> "DynamicsModel":
    """Load a frozen φ or ψ that fits a task.

    Raises:
        CheckpointError: it is damaged, or learned at another rate.
        JointMismatch: it belongs to another robot.
    """
    from nas_data.models.checkpoint import check_joints, load_frozen

    model = load_frozen(checkpoint)
    check_joints(model, task.joints, checkpoint)
    if abs(model.fps * task.period - 1.0) > 1e-3:
        raise CheckpointError(
            f"The checkpoint {checkpoint} learned from data at {model.fps:g} Hz; the environment runs at "
            f"{1 / task.period:g} Hz. Record and train at that rate."
        )
    return model


def checkpoint_sha256(folder: Path) -> str:
    """Return a hash of what a checkpoint's model is: configuration and weights."""
    from nas_data.models.checkpoint import CONFIG, WEIGHTS

    return hashlib.sha256(b"".join((folder / name).read_bytes() for name in (CONFIG, WEIGHTS))).hexdigest()
