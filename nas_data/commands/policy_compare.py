"""Compare expert, source, NAS (source + φ), forward (ψ) and named-effects policies on one target, over seeds."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from nas_data.commands._long import LongCommand
from nas_data.commands.base import CommandResult
from nas_data.count_of import count_of
from nas_data.environment_ids import TARGET_DYNAMICS
from nas_data.errors import OptionError


@dataclass(frozen=True, kw_only=True)
class PolicyCompare(LongCommand):
    """Train every method with every seed, evaluate all on the target, and report the share of the gap that each closes.

    The share is (method − source) / (expert − source) of the mean return. Finished runs are not repeated.

    Example: nas policy compare --dynamics backlash --delta runs/phi --forward runs/psi --seed 0 1 2 3 4

    Example: nas policy compare --delta runs/phi --effects runs/gap --delta-named runs/phi_named --frames 400000
    """

    env: str = "ErgoReacher"
    """Environment, such as ErgoReacher or Pusher; an unknown name lists all."""
    dynamics: str = TARGET_DYNAMICS
    """Dynamics of the target, such as backlash or paper; an unknown name lists all."""
    engine: Literal["mujoco", "bullet"] = "mujoco"
    """Physics engine of the target; the sources run in MuJoCo, so that `bullet` adds the difference of the engines."""
    delta: Path | None = None
    """Checkpoint of φ, for the method nas, which is skipped otherwise."""
    forward: Path | None = None
    """Checkpoint of ψ, for the method forward, which is skipped otherwise."""
    effects: Path | None = None
    """A gap report's folder, or its effects.json, for the method named, which is skipped otherwise."""
    delta_named: Path | None = None
    """Checkpoint of the φ that corrects the source with these effects, for the method named_nas, which is skipped
    otherwise."""
    frames: int = 2_000_000
    """Control steps of each training; 2 million as in the paper."""
    seed: tuple[int, ...] = (0, 1, 2, 3, 4)
    """Seeds of every method."""
    episodes: int = 100
    """Evaluation episodes of each policy."""
    out: Path = Path("runs/compare")
    """Folder of the runs and of comparison.json."""

    def run(self) -> CommandResult:
        """Train, evaluate and compare."""
        import json

        from nas_data.atomic_file import write_atomic
        from nas_data.envs.base import find_task
        from nas_data.envs.loop.dynamics_spec import DynamicsSpec
        from nas_data.models.augmented import require_kind
        from nas_data.models.checkpoint import find_checkpoint, load_for_inference
        from nas_data.policies.compare import EXPERT_METHOD, SOURCE_METHOD, Study, compare, list_runs
        from nas_data.policies.dry_run import plan_runs
        from nas_data.typed_json import make_finite

        for option, value in (("--frames", self.frames), ("--episodes", self.episodes)):
            if value < 1:
                raise OptionError(f"{option} is {value}; it must be 1 or more.")
        if len(set(self.seed)) < len(self.seed):
            raise OptionError(f"--seed {' '.join(map(str, self.seed))}: give different numbers, 0 or more.")
        if self.delta_named and not self.effects:
            raise OptionError(
                "--delta-named corrects a source with named effects; give these effects as well: --effects DIR."
            )
        for kind, checkpoint in (("delta", self.delta), ("forward", self.forward), ("delta", self.delta_named)):
            if checkpoint is not None:
                require_kind(load_for_inference(find_checkpoint(checkpoint)), kind)
        target = DynamicsSpec(self.env, self.dynamics, engine=self.engine)
        source = DynamicsSpec(self.env, find_task(self.env).find_source(self.dynamics))
        methods = {EXPERT_METHOD: target, SOURCE_METHOD: source}
        for name, checkpoint in (("nas", self.delta), ("forward", self.forward)):
            if checkpoint is not None:
                methods[name] = replace(source, checkpoint=str(checkpoint))
        if self.effects is not None:
            methods["named"] = replace(source, effects=str(self.effects))
        if self.delta_named is not None:
            methods["named_nas"] = replace(methods["named"], checkpoint=str(self.delta_named))
        study = Study(target, methods, self.seed, self.frames, self.episodes)
        workers = self.find_workers(self.out)
        if self.dry_run:
            return self.list_jobs(plan_runs(list_runs(study, self.out)))
        found = compare(study, self.out, workers)
        result = self.out / "comparison.json"
        write_atomic(result, json.dumps(make_finite(found.describe()), indent=1, allow_nan=False).encode())
        head = (
            f"{self.env} with dynamics '{self.dynamics}', {count_of(self.frames, 'frame', ',')}, "
            f"{count_of(self.episodes, 'episode')} per policy:"
        )
        return CommandResult(f"{head}\n{found.table()}\n→ {result}", {"result": result, **found.describe()})
