"""First stages of the demo: record and pair the target, and name effects from the recordings alone."""

import textwrap
from dataclasses import replace
from pathlib import Path

from nas_data.dataset import versions
from nas_data.dataset.layout import SOURCE
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.gap.model_correction import ModelCorrection
from nas_data.gap.showing.page_words import list_effects
from nas_data.gap.summary import describe_errors, summarise
from nas_data.gap.workflow import investigate
from nas_data.gap.write_model import EFFECTS
from nas_data.recorders.recipe import Recipe
from nas_data.runs.progress import RateLimited
from nas_data.runs.stages import INDENT, WIDTH, StageResult
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
    texts = [
        f"{plan.episodes} episodes to learn from ({train.frames:,} control steps, {moved:.0f} s of motion) "
        f"→ {demo.folder / train.path}",
        f"{plan.heldout} held-out episodes → {demo.folder / heldout.path}",
    ]
    return StageResult(texts, {"train": train.describe(), "heldout": heldout.describe(), **describe_gap(plan)})


def describe_gap(plan: DemoPlan) -> dict[str, object]:
    """Return the effects and joints in which the target differs from the source, as text."""
    joints: dict[str, list[str]] = {}
    for effect in plan.task.effects(plan.dynamics):
        joints.setdefault(effect.name(), []).append(effect.joint or "the whole arm")
    return {"effects": [effect.to_json() for effect in plan.task.effects(plan.dynamics)], "joints": joints}


def make_recipe(plan: DemoPlan, episodes: int, seed: int) -> Recipe:
    """Return the recording recipe; joints without a part in the task are commanded as in the task."""
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


FOLDER = "gap"
BLIND = "ergojr_demo_blind"
PAUSE = 5.0  # [s] between two progress lines of the search


def name_effects(demo: Demo) -> StageResult:
    """Run `nas gap` on episodes of the recording, and store its report; do nothing if the plan skips the search."""
    folder = demo.folder / FOLDER
    if not demo.plan.named:
        folder.mkdir(exist_ok=True)
        return StageResult(["left out"], {})
    recording, model = record_blind(demo), find_newest(demo, TRAIN) / SOURCE
    say = RateLimited(lambda line: demo.report(INDENT + textwrap.shorten(line, WIDTH, placeholder=" …")), PAUSE)
    report = investigate(recording, model, folder, say)
    content = report.to_json()
    return StageResult(
        summarise(report, folder).splitlines(),
        {key: content[key] for key in ("verdict", "effects", "retuned", "gap")},
        [
            f"nas gap names: {list_effects(report.effects) or 'nothing'}",
            f"Open-loop error on its own held-out episodes: {describe_errors(report.gap)}",
        ],
    )


def record_blind(demo: Demo) -> Path:
    """Return the folder of the input of `nas gap`: the first episodes, without the target's description."""
    root = find_newest(demo, TRAIN)
    recorded = read(root)
    known = read_provenance(root) or Provenance(how="edited")
    target = {key: value for key, value in (known.target or {}).items() if key != "effects"}
    provenance = replace(known, how="edited", target=target, parents=(versions.make_parent(root, recorded),))
    return versions.write_version(recorded.select(range(demo.plan.named)), BLIND, provenance, demo.folder / DATASETS)


def read_named_dynamics(demo: Demo) -> DynamicsSpec | None:
    """Return the source with named effects and base parameters; None if it equals the plain source."""
    folder = demo.folder / FOLDER
    if not (folder / EFFECTS).is_file():
        return None
    named = ModelCorrection.read(folder)
    return DynamicsSpec(demo.plan.environment, effects=str(folder)) if named.effects or named.retuned else None
