"""Identification of the effects that a model lacks, from a recording."""

import tempfile
from pathlib import Path

from nas_data.api.arguments import Actuators, Progress, as_dataset, as_model, find_folder
from nas_data.dataset.dataset import Dataset
from nas_data.gap.problem import Problem, name_baseline
from nas_data.gap.report import GapReport
from nas_data.gap.workflow import investigate_problem
from nas_data.runs.progress import silence


def identify(
    dataset: Dataset | str | Path,
    model: str | Path,
    *,
    out: str | Path | None = None,
    learn: int = 0,
    baseline: Dataset | str | Path | None = None,
    actuators: Actuators = "position",
    progress: Progress | None = None,
) -> GapReport:
    """Find where model and recording disagree, name the missing effects, add them, and test on held-out episodes.

    Args:
        dataset: At least two recorded episodes, or their folder; they need not be paired.
        model: Model to correct: an MJCF or URDF file, or a robot's name.
        out: Folder of the report; an earlier report in it is replaced. None keeps it in memory: see `GapReport.save`.
        learn: Number of updates to train φ on the remaining gap; 0 for none.
        baseline: Earlier recording, or its folder. What the model leaves unexplained there is subtracted from the same
            motion and counts as noise in others, so that only what has changed since is named. None names everything.
        actuators: Actuators for a URDF: `position` servos, or motors (`torque`).
        progress: Called with progress messages; for example `print`.

    Returns:
        The report: verdict, effects with parameters and intervals, errors before and after, the written model.

    Raises:
        DatasetInvalid: there are fewer than two episodes.
        JointMismatch: model and dataset have other joints or command types.
        ModelFileError: the model cannot be used.
        OutputExists: `out` holds files that no report wrote and this one would replace.
    """
    if out is None:
        with tempfile.TemporaryDirectory() as folder:
            inside = Path(folder, "gap")
            return identify(
                dataset, model, out=inside, learn=learn, baseline=baseline, actuators=actuators, progress=progress
            )
    given = as_model(model, actuators)

    def load_one(recorded: Dataset | str | Path) -> Problem:
        complete = as_dataset(recorded)
        return Problem.of(complete, given, find_folder(complete))

    def load() -> Problem:
        problem = load_one(dataset)
        if baseline is None:
            return problem
        with name_baseline(baseline if isinstance(baseline, str | Path) else "dataset"):
            before = load_one(baseline)
        return problem.compare_with(before)

    return investigate_problem(load, given, out, progress or silence, learn)
