"""Specification of the dynamics for a policy: a task on a simulator, a target, or a learned model."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data.environment_ids import make_environment_id
from nas_data.envs.base import SOURCE, Task, find_task, find_task_file
from nas_data.errors import OptionError
from nas_data.simulators.base import Simulator, Stepper

if TYPE_CHECKING:
    from nas_data.gap.model_correction import ModelCorrection


@dataclass(frozen=True)
class DynamicsSpec:
    """A task, the dynamics of its robot, and named or learned corrections of them.

    Attributes:
        environment: Name of the environment.
        dynamics: Name of one of the task's dynamics; `source` is the plain model.
        checkpoint: Learned model: φ corrects the physics after each step, ψ replaces it.
        effects: Gap report, or its `effects.json`; its effects and base parameters are applied to the physics.
        engine: Physics engine, `mujoco` or `bullet`; the two differ by a natural simulation gap.
        missed: Share of touches that ErgoShield does not detect.
        randomised: Whether physics parameters are drawn for each episode (domain randomisation).
    """

    environment: str
    dynamics: str = SOURCE
    checkpoint: str | None = None
    effects: str | None = None
    engine: str = "mujoco"
    missed: float = 0.0
    randomised: bool = False

    @property
    def task(self) -> Task:
        """The task.

        Raises:
            UnknownName: there is no such environment.
            OptionError: the share of missed touches is outside 0 … 1, or the task has no touches.
        """
        task = find_task(self.environment)
        if not self.missed:
            return task
        if not 0 < self.missed <= 1:
            raise OptionError(f"The share of missed touches is {self.missed}; it must be in 0 … 1.")
        if "missed" not in vars(task):
            raise OptionError(
                f"{self.environment} has no touches to miss; leave the share of missed touches out, or use ErgoShield."
            )
        return replace(task, missed=self.missed)  # type: ignore[call-arg]  # a field of tasks with touches

    def simulator(self) -> Simulator:
        """Return the physics.

        Raises:
            UnknownName: there is no such environment or engine, or it has no such dynamics.
            OptionError: the effects cannot be read.
            JointMismatch: the effects belong to another robot.
        """
        return self.task.simulator(self.dynamics, self._read_named_effects(), self.engine)

    def stepper(self, size: int) -> Stepper:
        """Return B simulations.

        Raises:
            UnknownName: there is no such environment or engine, or it has no such dynamics.
            OptionError: the effects cannot be read, or both randomisation and a learned or named correction are
                requested.
            CheckpointError: the checkpoint is damaged or does not fit the environment.
            JointMismatch: the effects or the checkpoint belong to another robot.
        """
        if self.randomised:
            return self._make_randomised_stepper(size)
        simulator = self.simulator()
        if self.checkpoint is None:
            return simulator.stepper(size)
        from nas_data.envs.loop.load_model import load_model
        from nas_data.models.augmented import LearnedStepper

        return LearnedStepper(simulator.stepper(size), load_model(Path(self.checkpoint), simulator))

    def describe(self) -> dict[str, object]:
        """Return the description for provenance; specifications with equal behaviour have equal descriptions.

        Raises:
            UnknownName: there is no such environment or engine, or it has no such dynamics.
            OptionError: the effects cannot be read.
            CheckpointError: there is no such checkpoint.
        """
        named = self._read_named_effects()
        described: dict[str, object] = {
            "environment": make_environment_id(find_task_file(self.environment)),
            "dynamics": self.dynamics,
            "simulator": self.simulator().describe(),  # the effects' content is in here
            "model": self._describe_model(),
        }
        described |= {"missed": self.missed} if self.missed else {}
        if self.randomised:
            from nas_data.envs.loop.ranges import RANGES

            described["randomised"] = RANGES.describe()
        return described if named is None else {**described, "retuned": dict(named.retuned)}

    def modules(self) -> tuple[str, ...]:
        """Return the modules of this package that determine the dynamics, for `code_hash`.

        `code_hash` follows no imports inside the functions of this module, so the modules of each option are listed.
        """
        named = self._read_named_effects()
        effects = (*self.task.effects(self.dynamics), *(() if named is None else named.effects))
        return (
            __name__,
            f"nas_data.envs.{find_task_file(self.environment)}",
            "nas_data.envs.loop.task_batch",
            f"nas_data.simulators.{self.engine}",
            *(type(effect).__module__ for effect in effects),
            *(["nas_data.envs.loop.load_model", "nas_data.models.augmented"] if self.checkpoint else []),
            *(["nas_data.gap.model_correction"] if self.effects else []),
            *(["nas_data.envs.loop.randomised"] if self.randomised else []),
        )

    def check(self) -> None:
        """Check the specification before a long run; raises like `stepper`."""
        self.stepper(1)

    def _make_randomised_stepper(self, size: int) -> Stepper:
        """Return B simulations of the plain physics with parameters drawn for each episode."""
        from nas_data.envs.loop.randomised import RandomisedStepper, make_delay_line
        from nas_data.simulators.mujoco import MujocoSimulator

        if self.checkpoint or self.effects or self.engine != "mujoco":
            raise OptionError("Randomised dynamics need plain MuJoCo physics; leave out checkpoint and named effects.")
        robot, effects = self.task.body(self.dynamics)
        simulator = MujocoSimulator(robot, self.task.period, self.task.joints, (*effects, make_delay_line()))
        return RandomisedStepper(simulator.stepper(size))

    def _read_named_effects(self) -> "ModelCorrection | None":
        if self.effects is None:
            return None
        from nas_data.gap.model_correction import ModelCorrection

        named = ModelCorrection.read(self.effects)
        if not named.effects and not named.retuned:
            raise OptionError(f"{named.path} names no effect and retunes nothing; use the plain source instead.")
        return named

    def _describe_model(self) -> dict[str, object] | None:
        if self.checkpoint is None:
            return None
        from nas_data.envs.loop.load_model import hash_checkpoint
        from nas_data.models.checkpoint import find_checkpoint, load_for_inference

        folder = Path(self.checkpoint)
        return {"kind": load_for_inference(find_checkpoint(folder)).kind, "sha256": hash_checkpoint(folder)}
