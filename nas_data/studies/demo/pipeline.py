"""Stages of the demo."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from nas_data.runs.progress import Report
from nas_data.runs.stages import Done, Stage, StageResult, run_stages
from nas_data.studies.demo.plan import Demo, DemoPlan


def import_lazily(module: str, function: str) -> Callable[[Demo], StageResult]:
    """Return the function of a stage; its module, with heavy libraries, is imported when the stage runs."""

    def run(demo: Demo) -> StageResult:
        result: StageResult = getattr(import_module(f"nas_data.studies.demo.{module}"), function)(demo)
        return result

    return run


STAGES = (
    Stage(
        "record",
        "Record and pair",
        "An arm of six servos (Poppy Ergo Jr) is moved to random targets and measured. It stands in for a real robot: "
        "two of its joints have play and its servos have a speed limit, of which the plain simulator knows nothing. "
        "That simulator is then set to every measured state and asked where the same command would lead.",
        import_lazily("recording", "record_pairs"),
        ("datasets",),
    ),
    Stage(
        "names",
        "Name what is missing",
        "`nas gap` is given episodes of the recording and the plain simulator, and is not told what differs. It finds "
        "where the two disagree, names the effects that the simulator lacks, and adds them to its model.",
        import_lazily("naming", "name_effects"),
        ("gap",),
    ),
    Stage(
        "models",
        "Learn the gap",
        "Two networks learn from the pairs, side by side: φ corrects each step of the simulator, ψ predicts without a "
        "simulator. Both are trained on their own rollouts. 'validation' is the error of such rollouts [rad]; "
        "* marks the best so far, which is kept. Then both are compared with the simulator, and "
        "with one that has the names, if any.",
        import_lazily("learning", "learn_models"),
        ("models",),
    ),
    Stage(
        "policies",
        "Learn policies",
        "The task is to reach a point with the arm's tip. Policies learn it by PPO on the target (expert), in the "
        "plain simulator (source), in the simulator corrected by φ (augmented), in ψ (forward) and, if there are "
        "names, in the simulator with them (named). Then each is judged on the target.",
        import_lazily("policies", "learn_policies"),
        ("policies",),
    ),
    Stage("page", "Show", "Charts and tables go on one page.", import_lazily("page", "write_page"), ("report.html",)),
)


def run_demo(plan: DemoPlan, folder: Path, report: Report) -> dict[str, Done]:
    """Run the unfinished stages.

    Args:
        plan: Sizes of the demo.
        folder: Folder of all results; finished stages are kept.
        report: Called with lines of progress.

    Raises:
        OutputExists: the folder holds something else, or a demo of other sizes.
    """
    return run_stages(STAGES, Demo(plan, folder, report))
