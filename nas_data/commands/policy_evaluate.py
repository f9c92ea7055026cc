"""Roll out policies on the target or on the arm itself: return, success, and their spread over seeds."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.environment_ids import TARGET_DYNAMICS
from nas_data.errors import OptionError

# Options that have no effect elsewhere.
OF_ARMS = (
    "defender_port",
    "hits",
    "record",
    "lockstep",
    "finish",
    "apart",
    "speed",
    "largest_step",
    "id",
    "defender_id",
)
OF_SIMULATIONS = ("engine", "dynamics")


@dataclass(frozen=True, kw_only=True)
class PolicyEvaluate(Command):
    """Evaluate policies on the same episodes, with the baselines that need no learning.

    On an arm (--on ergojr) each episode begins with a slow motion to its first pose: keep hands away. Ctrl-C stops the
    arm, holds it until it is slow and switches its torque off; it then sinks. Commands stay within limits and step
    size. Commands that would lead to contact with the arm itself, the floor or the other arm are not sent. Reads are
    repeated if a servo does not answer; if that persists, the rollout ends with a safe stop.

    Example: nas policy evaluate runs/policy/ErgoReacher-source runs/policy/ErgoReacher-augmented

    Example: nas policy evaluate runs/policy/ErgoReacher-named --on ergojr --port virtual --episodes 5
    """

    policies: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="POLICY…")]
    """Folders written by `nas policy train`: of one policy, or of one per seed."""
    on: Literal["target", "source", "named", "ergojr"] = "target"
    """Where to evaluate: the target, the plain model, the model with named effects, or the arm itself."""
    dynamics: str = TARGET_DYNAMICS
    """Dynamics of the target, such as backlash or paper; an unknown name lists all. With --on source or named, the
    source that belongs to them."""
    engine: Literal["mujoco", "bullet"] = "mujoco"
    """Physics engine of the evaluation."""
    effects: Path | None = None
    """A gap report's folder, or its effects.json; needed with --on named."""
    episodes: int = 100
    """Episodes of each policy; starts and goals are the same for all."""
    missed: float = 0.0
    """Share of ErgoShield's touches that are not detected; 0.10 to 0.15 on the authors' robots."""
    port: str | None = None
    """Serial port of the arm's adapter, or 'virtual' for a simulated arm; needed with --on ergojr."""
    defender_port: str | None = None
    """Serial port of the second arm; ErgoShield needs it."""
    hits: str | None = None
    """Input device that types an 's' while sword and shield touch (a MakeyMakey), or 'simulated': computed from the
    measured poses, as used by virtual arms."""
    apart: Literal["bodies", "all"] = "bodies"
    """Contacts to avoid between two arms: of their bodies, or also of the sword with the other body and the shield with
    this one, which do not collide in simulation."""
    record: str | None = None
    """Record readings, commands and rewards as the next version of datasets/RECORD; after an interruption, the same
    command resumes after the last saved episode."""
    finish: bool = False
    """Roll out no more episodes: write the dataset of the saved ones."""
    speed: float = 1.745
    """Speed limit in the servos [rad/s], 100°/s as in the paper; 0 for none. Use that of the recording
    from which the policy's model was made."""
    largest_step: float = 3.2
    """Largest difference between successive commands [rad]."""
    id: str = "ergojr"
    """Name of the arm, which selects its calibration."""
    defender_id: str = "ergojr_defender"
    """Name of the second arm, which selects its calibration."""
    lockstep: bool = False
    """Simulate virtual arms as fast as the machine can, instead of in real time."""

    def run(self) -> CommandResult:
        """Score every policy."""
        if not self.policies:
            raise OptionError("Name at least one policy's folder; see: nas policy evaluate --help.")
        if self.episodes < 1:
            raise OptionError(f"--episodes is {self.episodes}; it must be 1 or more.")
        if (self.on == "named") != (self.effects is not None):
            needed = "needs --effects DIR, a gap report" if self.on == "named" else "takes no --effects"
            raise OptionError(f"Evaluation on '{self.on}' {needed}; see: nas policy evaluate --help.")
        if (self.on == "ergojr") != (self.port is not None):
            needed = "needs --port PORT" if self.on == "ergojr" else "takes no --port"
            raise OptionError(f"Evaluation on '{self.on}' {needed}; see: nas policy evaluate --help.")
        self._check_unused()
        return self._on_arm(self.port) if self.port else self._evaluate_in_simulation()

    def _check_unused(self) -> None:
        """Refuse options that would have no effect."""
        defaults = {field.name: field.default for field in fields(self)}
        names = OF_SIMULATIONS if self.port else OF_ARMS
        unused = [f"--{name.replace('_', '-')}" for name in names if getattr(self, name) != defaults[name]]
        if unused:
            raise OptionError(f"Evaluation on '{self.on}' takes no {unused[0]}; see: nas policy evaluate --help.")

    def _evaluate_in_simulation(self) -> CommandResult:
        from nas_data.envs.base import find_task
        from nas_data.envs.loop.dynamics_spec import DynamicsSpec
        from nas_data.policies.evaluate import (
            format_policy_table,
            score_baselines,
            score_group,
            warn_of_unequal_training,
        )
        from nas_data.policies.policy import find_policies, load_policy

        first = load_policy(find_policies(self.policies[0])[0])
        effects = None if self.effects is None else str(self.effects)
        source = find_task(first.environment).find_source(self.dynamics)
        dynamics = self.dynamics if self.on == "target" else source
        plant = DynamicsSpec(first.environment, dynamics, effects=effects, engine=self.engine, missed=self.missed)
        stepper = plant.stepper(self.episodes)
        groups = [score_group(path, plant, self.episodes, stepper) for path in self.policies]
        warn_of_unequal_training(groups)
        baselines = score_baselines(plant, self.episodes, stepper)
        named = f" and the effects of {effects}" if effects else ""
        head = f"{plant.environment} with dynamics '{plant.dynamics}'{named}"
        what = f"{head}, {count_of(self.episodes, 'episode')} per policy, deterministic actions:"
        data = {
            "environment": plant.environment,
            "dynamics": plant.dynamics,
            "engine": plant.engine,
            "effects": effects,
            "missed": self.missed,
            "episodes": self.episodes,
            "groups": [group.describe() for group in groups],
            "baselines": {name: score.describe() for name, score in baselines.items()},
        }
        return CommandResult(f"{what}\n{format_policy_table(groups, baselines)}", data)

    def _on_arm(self, port: str) -> CommandResult:
        from nas_data.commands._on_arm import OnArm

        if self.finish and not self.record:
            raise OptionError("--finish needs --record NAME, the recording to finish.")
        if not self.largest_step > 0:
            raise OptionError(f"--largest-step is {self.largest_step}; it must be above zero.")
        virtual = {name for name in (port, self.defender_port) if name == "virtual"}
        if self.hits is None and self.defender_port and not virtual:
            raise OptionError("Give the source of the hits: --hits /dev/input/by-id/…-event-kbd, or --hits simulated.")
        return OnArm(self, port).run()
