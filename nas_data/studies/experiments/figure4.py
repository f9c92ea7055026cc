"""Figure 4: one command sequence on the target, predicted by φ, ψ, the source and a constant pose."""

import numpy as np

from nas_data.count_of import count_of
from nas_data.reports.figures import draw_error_growth, warn
from nas_data.reports.style import to_png
from nas_data.studies.experiments.base import Experiment, ExperimentResult, Request, ResultTable
from nas_data.studies.experiments.pipeline.dry_run import plan_sequence
from nas_data.studies.experiments.pipeline.sequence import DRAWN, Sequence, predict_heldout
from nas_data.studies.experiments.pipeline.table_notes import list_model_notes

PARTS = (0.25, 0.5, 1.0)  # shares of the rollout at which errors are reported
HEADERS = ("predictor", *(f"error after {part:.0%} [°]" for part in PARTS), "whole rollout [°]", "all held out [°]")


def run(request: Request) -> ExperimentResult:
    """Roll out one sequence on every environment."""
    tables, notes, data, pictures = [], [], {}, {}
    for number, environment in enumerate(request.environments):
        found = predict_heldout(request, environment)
        end = f"-{environment}" if number else ""
        pictures[end] = found.picture(request.sizes.quick)
        grown = {name: found.errors(name) for name in DRAWN}
        figure = draw_error_growth(grown, 1 / found.dataset.fps)
        warn(figure, request.sizes.quick)
        pictures[f"{end}-growth"] = to_png(figure)
        title = f"{environment}, {request.target_text}: RMS position error over joints, started once, held-out sequence"
        rows = [make_row(found, name) for name in DRAWN]
        tables.append(ResultTable(title, HEADERS, rows, list_model_notes(found.material)))
        notes.append(describe_sequence(found, environment))
        errors = {name: found.errors(name)[found.episode].tolist() for name in DRAWN}
        data[environment] = {**found.describe(), "rms_error_rad": errors}
    return ExperimentResult(tables, notes, {"environments": data}, pictures)


def describe_sequence(found: Sequence, environment: str) -> str:
    """Return notes on the chosen sequence and on diverged predictions."""
    lost = "".join(f" {name} diverged in {len(times)} of them." for name, times in found.evaluation.diverged.items())
    hold, steps = found.material.plan.recipe.holds[0], len(found.measured[found.episode])
    return (
        f"{environment}: held-out episode {found.episode} of {steps} control steps, under the paper's protocol (random "
        f"actions, each held for {count_of(hold, 'step')}); of these the one in which the source's error "
        f"is the median. Drawn is {found.dataset.joints[found.joint]}, the joint that the source predicts worst. "
        f"'All held out' is the median of {count_of(found.dataset.n_episodes, 'episode')}.{lost}"
    )


def make_row(found: Sequence, name: str) -> tuple[str, ...]:
    """Return a predictor's errors [°]."""
    errors = found.errors(name)
    shown = errors[found.episode]
    at = [shown[max(0, round(part * len(shown)) - 1)] for part in PARTS]
    whole = float(np.sqrt(np.square(shown).mean()))
    every = float(np.median([np.sqrt(np.square(one).mean()) for one in errors]))
    return (name, *(format_cell(value) for value in (*at, whole, every)))


def format_cell(error: float) -> str:
    """Return an error [rad] in degrees."""
    return f"{np.degrees(error):.3f}" if np.isfinite(error) else "diverged"


EXPERIMENT = Experiment("One command sequence, predicted in open loop", ("Pusher",), run, plan=plan_sequence)
