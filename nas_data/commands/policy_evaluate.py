"""Roll out policies on the target or on the arm itself: return, success, and their spread over seeds."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.errors import OptionError


@dataclass(frozen=True, kw_only=True)
class PolicyEvaluate(Command):
    """Judge policies on the same episodes, beside what anyone can do without learning.

    On an arm (--on ergojr) each episode begins with a slow way to its first pose: keep hands away. Ctrl-C stops it,
    holds it until it is slow and switches its torque off; it then sinks. Commands stay within limits and step size,
    and those that would lead into a touch with the arm itself, the floor or the other arm are not sent. A servo that
    goes unheard is asked again; what lasts ends the rollout with the arm safe.

    Example: nas policy evaluate runs/policy/ErgoReacher-source runs/policy/ErgoReacher-augmented

    Example: nas policy evaluate runs/policy/ErgoReacher-named --on ergojr --port virtual --episodes 5
    """

    policies: tyro.conf.Positional[tuple[Path, ...]]
    """Folders that `nas policy train` wrote: of one policy, or of one a seed."""
    on: Literal["target", "source", "named", "ergojr"] = "target"
    """What the policies are judged on: the target, the plain model, the model with named effects, or the arm itself."""
    dynamics: str = "backlash"
    """What the target is: one of the environment's dynamics."""
    engine: Literal["mujoco", "bullet"] = "mujoco"
    """Physics engine of what the policies are judged on."""
    effects: Path | None = None
    """A gap report's folder, or its effects.json, for `named`."""
    episodes: int = 100
    """Episodes of each policy; starts and goals are the same for all."""
    missed: float = 0.0
    """Share of ErgoShield's touches that are not noticed; 0.10 to 0.15 on the authors' robots."""
    port: str | None = None
    """Serial port of the arm's adapter, for `ergojr`; 'virtual' for a simulated arm."""
    defender_port: str | None = None
    """The same of the second arm, which ErgoShield needs."""
    hits: str | None = None
    """Input device that says an 's' while sword and shield touch (a MakeyMakey), or 'simulated': told by where the
    model has them in the measured poses, which is what virtual arms take."""
    apart: Literal["bodies", "all"] = "bodies"
    """What of two arms is kept from touching: their bodies, or also the sword from the other body and the shield from
    this one, which in simulation pass through."""
    record: str | None = None
    """Keep what was read and sent, with its rewards, as the next version of datasets/RECORD; stopped at any moment, the
    same command goes on after the last episode that is saved."""
    finish: bool = False
    """Roll out nothing more: make the dataset of what is saved."""
    speed: float = 1.745
    """Speed limit in the servos [rad/s], 100°/s as in the paper; take what the policy learned with. 0 for none."""
    largest_step: float = 3.2
    """By how much a command may differ from the one before it [rad]."""
    id: str = "ergojr"
    """Name of the arm, which names its calibration."""
    defender_id: str = "ergojr_defender"
    """Name of the second arm, which names its calibration."""
    lockstep: bool = False
    """Let virtual arms move as fast as the machine can, instead of in real time."""

    def run(self) -> CommandResult:
        """Score every policy."""
        if not self.policies:
            raise OptionError("Name at least one policy's folder; see: nas policy evaluate --help.")
        if self.episodes < 1:
            raise OptionError(f"{self.episodes} episodes cannot be judged; give --episodes 1 or more.")
        if (self.on == "named") != (self.effects is not None):
            needed = "needs --effects DIR, a gap report" if self.on == "named" else "takes no --effects"
            raise OptionError(f"Judging on '{self.on}' {needed}; see: nas policy evaluate --help.")
        if (self.on == "ergojr") != (self.port is not None):
            needed = "needs --port PORT" if self.on == "ergojr" else "takes no --port"
            raise OptionError(f"Judging on '{self.on}' {needed}; see: nas policy evaluate --help.")
        self._check_unused()
        return self._on_arm(self.port) if self.port else self._evaluate_in_simulation()

    def _check_unused(self) -> None:
        """Refuse options that would do nothing, so that nobody waits for what they ask."""
        arms = {
            "--defender-port": self.defender_port,
            "--hits": self.hits,
            "--record": self.record,
            "--lockstep": self.lockstep,
            "--finish": self.finish,
            "--apart": self.apart != "bodies",
        }
        simulations = {"--engine": self.engine != "mujoco", "--dynamics": self.dynamics != "backlash"}
        unused = [option for option, given in (simulations if self.port else arms).items() if given]
        if unused:
            raise OptionError(f"Judging on '{self.on}' takes no {unused[0]}; see: nas policy evaluate --help.")

    def _evaluate_in_simulation(self) -> CommandResult:
        from nas_data.envs.base import SOURCE
        from nas_data.envs.loop.dynamics_spec import DynamicsSpec
        from nas_data.policies.evaluate import format_policy_table, score_baselines, score_group
        from nas_data.policies.policy import find_policies, load_policy

        first = load_policy(find_policies(self.policies[0])[0])
        effects = None if self.effects is None else str(self.effects)
        dynamics = self.dynamics if self.on == "target" else SOURCE
        plant = DynamicsSpec(first.environment, dynamics, effects=effects, engine=self.engine, missed=self.missed)
        stepper = plant.stepper(self.episodes)
        groups = [score_group(path, plant, self.episodes, stepper) for path in self.policies]
        baselines = score_baselines(plant, self.episodes, stepper)
        named = f" and the effects of {effects}" if effects else ""
        head = f"{plant.environment} with dynamics '{plant.dynamics}'{named}"
        what = f"{head}, {count_of(self.episodes, 'episode')} a policy, mean actions:"
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
            raise OptionError("--finish needs --record NAME, what is to be finished.")
        if not self.largest_step > 0:
            raise OptionError(f"--largest-step is {self.largest_step}; it must be above zero.")
        virtual = {name for name in (port, self.defender_port) if name == "virtual"}
        if self.hits is None and self.defender_port and not virtual:
            raise OptionError("Say where hits are read: --hits /dev/input/by-id/…-event-kbd, or --hits simulated.")
        return OnArm(self, port).run()
