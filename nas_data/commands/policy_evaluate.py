"""Roll out policies on the target: return, success, and their spread over seeds."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from nas_data.commands.base import Command, Outcome
from nas_data.errors import OptionError


@dataclass(frozen=True, kw_only=True)
class PolicyEvaluate(Command):
    """Judge policies on the same episodes, beside what anyone can do without learning.

    Example: nas policy evaluate runs/policy/ErgoReacher-source runs/policy/ErgoReacher-augmented
    """

    policies: tyro.conf.Positional[tuple[Path, ...]]
    """Folders that `nas policy train` wrote: of one policy, or of one a seed."""
    on: Literal["target", "source", "named"] = "target"
    """What the policies are judged on: the target, the plain model, or the model with named effects."""
    dynamics: str = "backlash"
    """What the target is: one of the environment's dynamics."""
    engine: Literal["mujoco", "bullet"] = "mujoco"
    """Physics engine of what the policies are judged on."""
    effects: Path | None = None
    """A gap report's folder, or its effects.json, for `named`."""
    episodes: int = 100
    """Episodes of each policy; starts and goals are the same for all."""

    def run(self) -> Outcome:
        """Score every policy."""
        if not self.policies:
            raise OptionError("Name at least one policy's folder; see: nas policy evaluate --help.")
        if self.episodes < 1:
            raise OptionError(f"{self.episodes} episodes cannot be judged; give --episodes 1 or more.")
        if (self.on == "named") != (self.effects is not None):
            needed = "needs --effects DIR, a gap report" if self.on == "named" else "takes no --effects"
            raise OptionError(f"Judging on '{self.on}' {needed}; see: nas policy evaluate --help.")
        from nas_data.envs.base import SOURCE
        from nas_data.envs.loop.plant import Plant
        from nas_data.policies.evaluate import score_baselines, score_group
        from nas_data.policies.policy import find_policies, load_policy
        from nas_data.policies.tables import policy_table

        first = load_policy(find_policies(self.policies[0])[0])
        effects = None if self.effects is None else str(self.effects)
        dynamics = self.dynamics if self.on == "target" else SOURCE
        plant = Plant(first.environment, dynamics, effects=effects, engine=self.engine)
        stepper = plant.stepper(self.episodes)
        groups = [score_group(path, plant, self.episodes, stepper) for path in self.policies]
        baselines = score_baselines(plant, self.episodes, stepper)
        named = f" and the effects of {effects}" if effects else ""
        head = f"{plant.environment} with dynamics '{plant.dynamics}'{named}"
        what = f"{head}, {self.episodes} episodes a policy, mean actions:"
        data = {
            "environment": plant.environment,
            "dynamics": plant.dynamics,
            "engine": plant.engine,
            "effects": effects,
            "episodes": self.episodes,
            "groups": [group.describe() for group in groups],
            "baselines": {name: score.describe() for name, score in baselines.items()},
        }
        return Outcome(f"{what}\n{policy_table(groups, baselines)}", data)
