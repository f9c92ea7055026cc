"""The demo's stages in their order; what a stage needs is imported when it has something to do."""

from pathlib import Path

from nas_data.runs.progress import Report
from nas_data.runs.stages import Done, Stage, StageResult, run_stages
from nas_data.studies.demo.plan import Demo, DemoPlan


def record(demo: Demo) -> StageResult:
    """Do the first stage."""
    from nas_data.studies.demo.recording import record_pairs

    return record_pairs(demo)


def name_gap(demo: Demo) -> StageResult:
    """Do the second stage."""
    from nas_data.studies.demo.naming import name_effects

    return name_effects(demo)


def learn_gap(demo: Demo) -> StageResult:
    """Do the third stage."""
    from nas_data.studies.demo.learning import learn_models

    return learn_models(demo)


def learn_task(demo: Demo) -> StageResult:
    """Do the fourth stage."""
    from nas_data.studies.demo.policies import learn_policies

    return learn_policies(demo)


def show(demo: Demo) -> StageResult:
    """Do the last stage."""
    from nas_data.studies.demo.page import write_page

    return write_page(demo)


STAGES = (
    Stage(
        "record",
        "Record and pair",
        "An arm of six servos (Poppy Ergo Jr) is moved to random targets and measured. It stands in for a real robot: "
        "two of its joints have play and its servos have a speed limit, of which the plain simulator knows nothing. "
        "That simulator is then set to every measured state and asked where the same command would lead.",
        record,
        ("datasets",),
    ),
    Stage(
        "names",
        "Name what is missing",
        "Where --names asks for it, `nas gap` is given episodes of the recording and the plain simulator, and is not "
        "told what differs. It finds where the two disagree, names the effects that the simulator lacks, and adds them "
        "to its model.",
        name_gap,
        ("gap",),
    ),
    Stage(
        "models",
        "Learn the gap",
        "Two networks learn from the pairs, side by side: φ corrects each step of the simulator, ψ predicts without a "
        "simulator. Both are trained on their own rollouts. 'validation' is the error of such rollouts [rad]; "
        "* marks the best so far, which is kept. Then both are compared with the simulator, and "
        "with one that has the names, if any.",
        learn_gap,
        ("models",),
    ),
    Stage(
        "policies",
        "Learn policies",
        "The task is to reach a point with the arm's tip. Policies learn it by PPO on the target (expert), in the "
        "plain simulator (source), in the simulator corrected by φ (augmented), in ψ (forward) and, if there are "
        "names, in the simulator with them (named). Then each is judged on the target.",
        learn_task,
        ("policies",),
    ),
    Stage("page", "Show", "Charts and tables go on one page.", show, ("report.html",)),
)


def run_demo(plan: DemoPlan, folder: Path, report: Report) -> dict[str, Done]:
    """Run every stage that is not done yet.

    Args:
        plan: Sizes.
        folder: Where everything goes; a finished stage in it is kept.
        report: Told of progress in lines for people.

    Raises:
        OutputExists: the folder holds something else, or a demo of other sizes.
    """
    return run_stages(STAGES, Demo(plan, folder, report))
