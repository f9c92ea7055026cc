"""Train policies with PPO in the source, plain or with named effects, on the target, or in a learned environment."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from nas_data.commands._long import LongCommand
from nas_data.commands.base import CommandResult
from nas_data.environment_ids import TARGET_DYNAMICS
from nas_data.errors import OptionError

if TYPE_CHECKING:
    from nas_data.policies.ppo import PolicyTraining


@dataclass(frozen=True, kw_only=True)
class PolicyTrain(LongCommand):
    """Train one policy per seed with PPO; the same command resumes an interrupted training.

    Example: nas policy train --env ErgoReacher --on augmented --checkpoint runs/delta --frames 400000 --seed 0 1 2

    Example: nas policy train --env ErgoReacher --on named --effects runs/gap --frames 400000 --seed 0 1 2
    """

    env: str = "ErgoReacher"
    """Environment, such as ErgoReacher or Pusher; an unknown name lists all."""
    on: Literal["source", "named", "target", "augmented", "forward"] = "source"
    """Training environment: the plain model, the model with named effects, the target itself (the expert), the model
    corrected by φ (and by named effects with --effects), or ψ alone."""
    checkpoint: Path | None = None
    """Folder of the learned model: φ, needed with --on augmented, or ψ, needed with --on forward."""
    effects: Path | None = None
    """A gap report's folder, or its effects.json: needed with --on named, and with augmented if φ corrects this
    model."""
    dynamics: str = TARGET_DYNAMICS
    """Dynamics of the target, such as backlash or paper; an unknown name lists all. With another --on, policies are
    trained on the source that belongs to them."""
    engine: Literal["mujoco", "bullet"] = "mujoco"
    """Physics engine, for all but ψ; a policy of one engine may be evaluated in the other."""
    frames: int = 2_000_000
    """Control steps of the training, rounded up to whole rollouts of 8192; 2 million as in the paper."""
    seed: tuple[int, ...] = (0,)
    """Seeds, one policy each; the same seed gives identical bits."""
    out: Path | None = None
    """Folder of the policies, one subfolder per seed; runs/policy/ENV-ON by default."""

    def run(self) -> CommandResult:
        """Train every seed."""
        trainings = self._list_trainings()
        from nas_data.envs.base import find_task
        from nas_data.policies.dry_run import plan_training
        from nas_data.policies.policy import load_policy, read_progress
        from nas_data.policies.ppo import train_job
        from nas_data.runs.job_locks import list_locks
        from nas_data.runs.parallel import run_jobs
        from nas_data.text_table import format_table

        what = "named-augmented" if self.on == "augmented" and self.effects else self.on
        folder = self.out or Path("runs/policy") / f"{self.env.removeprefix('nas/')}-{what}"
        jobs = [(training, folder / f"seed{training.seed}") for training in trainings]
        workers = self.find_workers(folder)
        if self.dry_run:
            return self.list_jobs([plan_training(*job) for job in jobs])
        rows, results = {}, {}
        locks = list_locks(folder, [f"seed{training.seed}" for training in trainings])
        for number, path in run_jobs(train_job, jobs, workers, locks=locks):
            policy, curve = load_policy(path), read_progress(path)
            last = {key: float(values[-1]) for key, values in curve.items()}
            rate = last["frames"] / last["seconds"]
            results[number] = {"seed": policy.seed, "policy": path, **last, "frames": policy.frames}
            rows[number] = (
                str(policy.seed),
                f"{policy.frames:,}",
                f"{last['mean_return']:.2f}" if last["episodes"] else "–",
                f"{last['success_rate']:.0%}" if last["episodes"] else "–",
                f"{rate:,.0f}",
                str(path),
            )
        headers = ("seed", "frames", "return", "success", "frames/s", "policy")
        text = [
            f"Trained in {self.env}, {what}; return and success with exploration, in the last rollout:",
            format_table(headers, [rows[number] for number in sorted(rows)]),
            f"Next: {suggest_evaluation(folder, self.dynamics, tuple(find_task(self.env).dynamics))}",
        ]
        return CommandResult(
            "\n".join(text), {"out": folder, "policies": [results[number] for number in sorted(results)]}
        )

    def _list_trainings(self) -> "list[PolicyTraining]":
        """Check the options and return the trainings."""
        learned = self.on in {"augmented", "forward"}
        if learned != (self.checkpoint is not None):
            needed = "needs --checkpoint FOLDER" if learned else "takes no --checkpoint"
            raise OptionError(f"Training on '{self.on}' {needed}; see: nas policy train --help.")
        if (self.on == "named" and self.effects is None) or (self.effects and self.on not in {"named", "augmented"}):
            needed = "needs --effects DIR, a gap report" if self.on == "named" else "takes no --effects"
            raise OptionError(f"Training on '{self.on}' {needed}; see: nas policy train --help.")
        if self.frames < 1:
            raise OptionError(f"--frames is {self.frames}; it must be 1 or more.")
        if not self.seed or len(set(self.seed)) < len(self.seed) or min(self.seed) < 0:
            raise OptionError(f"--seed {' '.join(map(str, self.seed))}: give different numbers, 0 or more.")
        from nas_data.envs.base import find_task
        from nas_data.envs.loop.dynamics_spec import DynamicsSpec
        from nas_data.policies.ppo import PolicyTraining

        plant = DynamicsSpec(
            environment=self.env,
            dynamics=self.dynamics if self.on == "target" else find_task(self.env).find_source(self.dynamics),
            checkpoint=None if self.checkpoint is None else str(self.checkpoint),
            effects=None if self.effects is None else str(self.effects),
            engine=self.engine,
        )
        plant.check()  # before anything is written
        if self.checkpoint is not None:
            from nas_data.models.augmented import require_kind
            from nas_data.models.checkpoint import find_checkpoint, load_for_inference

            require_kind(
                load_for_inference(find_checkpoint(self.checkpoint)), "delta" if self.on == "augmented" else "forward"
            )
        return [PolicyTraining(plant=plant, seed=seed, frames=self.frames) for seed in self.seed]


def suggest_evaluation(folder: Path, dynamics: str, known: Sequence[str]) -> str:
    """Return the command that evaluates policies on the target.

    Args:
        folder: Folder of the policies.
        dynamics: Value of --dynamics.
        known: Dynamics of the environment; the last one is suggested if `dynamics` is none of them.
    """
    chosen = dynamics.removesuffix("-source") if dynamics in known else known[-1]
    return f"nas policy evaluate {folder}" + (f" --dynamics {chosen}" if chosen != TARGET_DYNAMICS else "")
