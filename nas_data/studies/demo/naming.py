"""Second stage of the demo: `nas gap` names the missing effects from the recording alone."""

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
from nas_data.runs.progress import RateLimited
from nas_data.runs.stages import INDENT, WIDTH, StageResult
from nas_data.studies.demo.plan import Demo
from nas_data.studies.demo.recording import DATASETS, TRAIN, find_newest

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
