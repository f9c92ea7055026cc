"""First stage of the demo: recordings of the target, paired with the source's predictions."""

from pathlib import Path

from nas_data.dataset import versions
from nas_data.recorders.recipe import Recipe
from nas_data.runs.stages import StageResult
from nas_data.studies.demo.plan import Demo, DemoPlan
from nas_data.studies.experiments.pipeline.pairs import Predictor, record_and_pair

DATASETS = "datasets"
TRAIN, HELDOUT = "ergojr_demo", "ergojr_demo_heldout"


def record_pairs(demo: Demo) -> StageResult:
    """Record training and held-out data, and pair both with the source."""
    plan, source = demo.plan, Predictor.of(demo.plan.environment)
    sets = ((TRAIN, plan.episodes, plan.seed), (HELDOUT, plan.heldout, plan.seed + 1))
    train, heldout = (
        record_and_pair(make_recipe(plan, episodes, seed), source, name, demo.folder, DATASETS)
        for name, episodes, seed in sets
    )
    moved = plan.episodes * plan.seconds
    said = [
        f"{plan.episodes} episodes to learn from ({train.frames:,} control steps, {moved:.0f} s of motion) "
        f"→ {demo.folder / train.path}",
        f"{plan.heldout} held-out episodes → {demo.folder / heldout.path}",
    ]
    return StageResult(said, {"train": train.describe(), "heldout": heldout.describe(), **describe_gap(plan)})


def describe_gap(plan: DemoPlan) -> dict[str, object]:
    """Return the effects and joints in which the target differs from the source, as text."""
    joints: dict[str, list[str]] = {}
    for effect in plan.task.effects(plan.dynamics):
        joints.setdefault(effect.name(), []).append(effect.joint or "the whole arm")
    return {"effects": [effect.to_json() for effect in plan.task.effects(plan.dynamics)], "joints": joints}


def make_recipe(plan: DemoPlan, episodes: int, seed: int) -> Recipe:
    """Return how the target is recorded: joints that the task does not act on are commanded as in the task."""
    period = plan.task.period
    return Recipe(
        environment=plan.environment,
        dynamics=plan.dynamics,
        episodes=episodes,
        steps=round(plan.seconds / period),
        holds=tuple(max(1, round(hold / period)) for hold in plan.holds),
        seed=seed,
    )


def find_newest(demo: Demo, name: str) -> Path:
    """Return the folder of a dataset's newest version: the paired one."""
    return versions.resolve(demo.folder / DATASETS / name)
