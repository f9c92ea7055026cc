"""Where a policy lives: a task on a simulator, on a target, or on what was learned about it."""

from dataclasses import dataclass
from pathlib import Path

from nas_data.envs.base import SOURCE, Task, environment_id, find_task, find_task_file
from nas_data.simulators.base import Stepper


@dataclass(frozen=True)
class Plant:
    """A task, the dynamics of its robot, and what was learned about them.

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
            CheckpointError: the checkpoint is damaged or does not fit the environment.
            JointMismatch: the checkpoint belongs to another robot.
        """
        simulator = self.task.simulator(self.dynamics)
        if self.checkpoint is None:
            return simulator.stepper(size)
        from nas_data.envs.loop.learned import load_model
        from nas_data.models.augmented import LearnedStepper

        return LearnedStepper(simulator.stepper(size), load_model(Path(self.checkpoint), simulator))

    def describe(self) -> dict[str, object]:
        """Return what provenance records: equal for plants that behave alike, wherever their files lie.

        Raises:
            UnknownName: there is no such environment, or it has no such dynamics.
            CheckpointError: there is no such checkpoint.
        """
        return {
            "environment": environment_id(find_task_file(self.environment)),
            "dynamics": self.dynamics,
            "simulator": self.task.simulator(self.dynamics).describe(),
            "model": self._describe_model(),
        }

    def check(self) -> None:
        """Say what is wrong before hours are spent; raises what `stepper` does."""
        self.stepper(1)

    def _describe_model(self) -> dict[str, object] | None:
        if self.checkpoint is None:
            return None
        from nas_data.envs.loop.learned import checkpoint_sha256
        from nas_data.models.checkpoint import find, load_frozen

        folder = Path(self.checkpoint)
        return {"kind": load_frozen(find(folder)).kind, "sha256": checkpoint_sha256(folder)}
