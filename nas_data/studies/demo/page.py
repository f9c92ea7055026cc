"""Last stage of the demo: a page with charts, tables, and the facts behind them."""

from collections.abc import Mapping, Sequence

import numpy as np

from nas_data.atomic_file import write_atomic
from nas_data.benchmarks.result import read_hardware
from nas_data.count_of import join_items
from nas_data.dataset.provenance import format_current_time, read_provenance
from nas_data.gap.report import GapReport
from nas_data.gap.showing.page_charts import draw_joint_errors as errors_by_joint
from nas_data.gap.showing.page_tables import NONE, make_joints_table
from nas_data.gap.showing.page_words import as_words, describe_verdict, format_confidence, format_interval, format_value
from nas_data.gap.showing.series import Series
from nas_data.joint_units import HINGE
from nas_data.reports.charts import make_axis, make_log_axis, make_motion_chart, make_spread
from nas_data.reports.figures import FLOOR, compute_joint_errors, quartiles
from nas_data.reports.page import Block, Chart, Facts, HtmlPage, HtmlTable, PageSection, Text
from nas_data.reports.run_sections import (
    make_learning_charts,
    make_models_chart,
    make_policies_table,
    make_target_chart,
)
from nas_data.reports.runs import Runs, find_runs
from nas_data.reports.style import choose_strokes
from nas_data.runs.stages import StageResult, read_stage
from nas_data.studies.demo.learning import (
    BASELINES,
    ERRORS,
    FOLDERS,
    NAMES,
    ROLLOUTS,
    load_baselines,
    load_errors,
    load_rollouts,
)
from nas_data.studies.demo.learning import FOLDER as POLICIES
from nas_data.studies.demo.plan import Demo, DemoPlan
from nas_data.studies.demo.recording import FOLDER as GAP
from nas_data.studies.demo.recording import HELDOUT, TRAIN, find_newest, read_named_dynamics

PAGE = "report.html"
LEAD = (
    "A simulator of a robot arm is never exact. From recordings of the arm, a network φ learns its error, nas gap can "
    "name the effects that it lacks, and policies then learn in the corrected simulator."
)
LEARNERS = ("source", "source + φ", "ψ", NAMES)  # predictors in the trajectory chart; hold and command are in tables


def write_page(demo: Demo) -> StageResult:
    """Write the page."""
    runs = find_runs([demo.folder / folder for folder in (*FOLDERS.values(), POLICIES)])
    summaries = [line for name in ("names", "models", "policies") for line in read_stage(name, demo.folder).summary]
    page = HtmlPage(
        "The gap between a simulator and its robot: recorded, learned, closed",
        [
            PageSection("", [Text(LEAD, lead=True), *(Text(line) for line in describe_demo(demo.plan))]),
            PageSection("In short", [Text(line + ".") for line in summaries]),
            PageSection("What the simulator lacks, by name", make_names_blocks(demo)),
            PageSection("One joint, as it moved and as it was predicted", [make_predictions_chart(demo)]),
            PageSection("Errors of prediction", make_errors_blocks(demo)),
            PageSection("Policies", make_policies_blocks(demo, runs)),
            PageSection("How the models learned", [make_models_chart(runs.models)]),
            PageSection("Versions and settings", [Facts(list_facts(demo))]),
        ],
    )
    path = demo.folder / PAGE
    write_atomic(path, page.to_html().encode())
    return StageResult([], {"page": str(path)}, [f"page → {path}"])


def list_joints_with(plan: DemoPlan, effect: str) -> list[str]:
    """Return the joints in which the target has an effect."""
    return [item.joint for item in plan.task.effects(plan.dynamics) if item.name() == effect and item.joint]


def describe_demo(plan: DemoPlan) -> list[str]:
    """Return a description of the demo."""
    play, slow = list_joints_with(plan, "backlash"), list_joints_with(plan, "speed_limit")
    held = ", ".join(f"{hold:g}" for hold in plan.holds)
    return [
        "The arm is a Poppy Ergo Jr of six servos. To let everyone repeat this, it is itself simulated: the target. "
        f"Unlike the plain simulator, the source, it has true play in {' and '.join(play)} and a speed limit in "
        f"{len(slow)} servos, and its sensors have the resolution of XL-320 servos.",
        f"{plan.episodes} episodes of {plan.seconds:g} s were recorded, with random targets that are held "
        f"for {held} s in turn, at {1 / plan.task.period:.0f} control steps a second. The source was set to every "
        "measured state and given the same command: φ learns from these pairs. ψ is the "
        "alternative without a simulator: a network that predicts the next state alone. Their errors, and those of the "
        f"source with the names if there are any, are on {plan.heldout} further episodes that none of them has seen; "
        "in open loop, each "
        "is predicted from its first measured state and its commands only.",
    ]


def make_names_blocks(demo: Demo) -> list[Block]:
    """Return the effects that `nas gap` named beside the hidden ones, and the errors before and after."""
    folder = demo.folder / GAP
    if read_named_dynamics(demo) is None:
        asked = "Nothing was named and nothing retuned." if demo.plan.named else "Not searched for."
        return [Text(asked)]
    report, series = GapReport.load(folder), Series.read(folder)
    return [
        Text(
            f"nas gap was given the first {demo.plan.named} of the recorded episodes and the plain source; the search "
            "does not know the effects of the target. Find: where does the source err, and by how much?"
        ),
        *make_joints_table(report),
        Text("Name: which effects of the catalogue does it lack, and how large are they?"),
        make_names_table(demo.plan, report),
        Text(
            f"Add: {GAP}/model.xml is the source with the named effects and retuned parameters. "
            f"{describe_verdict(report)} The full "
            f"report of nas gap is {GAP}/report.html."
        ),
        *errors_by_joint(report, series),
    ]


def make_names_table(plan: DemoPlan, report: GapReport) -> HtmlTable:
    """Return a table with a row for each hidden or named effect."""
    hidden = {(effect.name(), effect.joint): effect for effect in plan.task.effects(plan.dynamics)}
    named = {(effect.name, effect.joint): effect for effect in report.effects}
    rows = []
    for name, joint in {**hidden, **named}:
        there, found = hidden.get((name, joint)), named.get((name, joint))
        numbers = list(found.parameters.values()) if found else []
        truth = [format_value(getattr(there, one.name), one.unit) for one in there.free_parameters] if there else []
        rows.append(
            (
                f"{as_words(name)} in {joint or 'the whole arm'}",
                "; ".join(truth) or NONE,
                "; ".join(format_value(number.value, number.unit) for number in numbers) or NONE,
                "; ".join(format_interval(number) for number in numbers) or NONE,
                format_confidence(found.confidence) if found else NONE,
            )
        )
    note = (
        "Hidden: the effects of the target. Joints that the task does not move are commanded to stay, so the recording "
        "contains no information about their speed limits."
    )
    return HtmlTable(("", "hidden", "named", "95 % interval", "confidence"), rows, note)


def make_predictions_chart(demo: Demo) -> Chart:
    """Return the chart of one joint in one episode; the caption says how both are chosen."""
    plan, curves = demo.plan, load_rollouts(demo.folder / ROLLOUTS)
    joints = plan.task.joints
    candidates = [joints.index(joint) for joint in list_joints_with(plan, "backlash")]
    wrong = np.sqrt(np.square(curves["source"] - curves["measured"]).mean(axis=1))  # [rad], shape (E, n)
    joint = max(candidates, key=lambda index: float(wrong[:, index].mean()))
    slow = np.arange(0, len(wrong), len(plan.holds))  # the episodes of the first hold
    episode = int(slow[np.argsort(wrong[slow, joint])[len(slow) // 2]])
    chosen = {name: np.degrees(values[episode, :, joint]) for name, values in curves.items()}
    time = plan.task.period * np.arange(1, len(chosen["measured"]) + 1)
    predicted = {name: chosen[name] for name in LEARNERS if name in chosen}
    title = f"{joints[joint]} [{HINGE.mark}]"
    traces, layout = make_motion_chart(
        time, chosen["measured"], predicted, chosen.get("command"), (title, HINGE.mark), choose_strokes(list(chosen))
    )
    caption = (
        f"Joint {joints[joint]} in held-out episode {episode}: of the joints with play, the one that the source "
        f"predicts worst; of the episodes that hold targets for {plan.holds[0]:g} s, the one in which the source's "
        "error on it is the median. Every prediction starts at the first measured state and never sees a later one."
    )
    return Chart("trajectory", caption, traces, layout, height=520)


def make_errors_blocks(demo: Demo) -> list[Block]:
    """Return the chart of errors over a rollout, and the tables of errors."""
    curves = load_rollouts(demo.folder / ROLLOUTS)
    n = len(demo.plan.task.joints)
    measured = curves.pop("measured")
    grown = {
        name: np.degrees(
            quartiles([compute_joint_errors(one, other, n) for one, other in zip(values, measured, strict=True)])
        )
        for name, values in curves.items()
    }
    grown = {name: np.where(np.isfinite(rows), rows.clip(FLOOR), np.nan) for name, rows in grown.items()}
    time = demo.plan.task.period * np.arange(1, measured.shape[1] + 1)
    caption = (
        f"How errors grow over a rollout: median over {demo.plan.heldout} held-out episodes, band from the lower to "
        "the upper quartile. Hold predicts no motion; command predicts that each joint is at its commanded position."
    )
    layout = {
        "xaxis": make_axis("time since the start of the rollout [s]"),
        "yaxis": make_log_axis(f"position error, RMS of joints [{HINGE.mark}]"),
    }
    errors = load_errors(demo.folder / ERRORS)
    return [
        Chart("error_growth", caption, make_spread(time, grown, choose_strokes(list(grown))), layout),
        make_error_table(
            errors["open_loop"],
            "Open loop: RMSE of positions over whole episodes [°]. Joints that the task does not move are commanded to "
            "stay.",
        ),
        make_error_table(
            errors["one_step"],
            "One step: RMSE of the next position, each step started at the measured state [°]; the sensors' resolution "
            "of 0.29° is part of it.",
        ),
    ]


def make_error_table(errors: Mapping[str, Mapping[str, float]], note: str) -> HtmlTable:
    """Return a table of RMSE in degrees: a row for each predictor, a column for each joint, all joints last."""
    headers = ["", *next(iter(errors.values()))]
    rows = [(name, *(f"{np.degrees(value):.2f}" for value in row.values())) for name, row in errors.items()]
    return HtmlTable(headers, rows, note)


def make_policies_blocks(demo: Demo, runs: Runs) -> Sequence[Block]:
    """Return the task of the policies, their learning curves and their scores on the target."""
    plan, groups = demo.plan, runs.groups()
    task = Text(
        "The task: bring the tip of the arm to a random point within a second. The reward of each step is minus the "
        "distance in metres, and 1 more within 16 mm, which ends the episode; the highest return is therefore a little "
        f"below 1. Each policy learned from {plan.frames:,} control steps with PPO, and was then evaluated on the "
        "target "
        f"in the same {plan.judged} episodes."
    )
    seeds = Text(
        f"Every method got the same {plan.frames:,} control steps and the same "
        f"seed{'' if len(plan.seeds) == 1 else 's'} of PPO: {join_items(list(map(str, plan.seeds)))}. With short "
        "trainings and few seeds, the spread is larger than the difference between the best methods, so a share of the "
        "distance of over "
        "100 % is chance. Five seeds are the usual measure: docs/results/README.md has them."
    )
    return [
        task,
        *make_target_chart(groups),
        make_policies_table(groups, load_baselines(demo.folder / BASELINES)),
        *make_learning_charts(groups),
        seeds,
    ]


def list_facts(demo: Demo) -> dict[str, str]:
    """Return the facts behind the page: machine, times, data, seeds, versions."""
    plan, machine = demo.plan, read_hardware()
    stages = {name: read_stage(name, demo.folder) for name in ("record", "names", "models", "policies")}
    times = ", ".join(f"{name} {done.seconds:.0f} s" for name, done in stages.items())
    hashes = {name: find_newest(demo, name) for name in (TRAIN, HELDOUT)}
    provenances = {name: read_provenance(path) for name, path in hashes.items()}
    return {
        "Made": f"{format_current_time()} by nas demo",
        "Machine": f"{machine.processor}, {machine.cores} cores, {machine.system}",
        "Time": f"{times}; {sum(done.seconds for done in stages.values()) / 60:.1f} min in all",
        "Load meanwhile": ", ".join(f"{done.load:g}" for done in stages.values()) + " processes",
        **{
            f"Dataset {name}": f"{path.name}, content hash {provenances[name].content_hash}"  # type: ignore[union-attr]
            for name, path in hashes.items()
        },
        "Networks": f"3 LSTM layers of {plan.delta.hidden} units; {plan.delta.updates} updates for φ, "
        f"{plan.forward.updates} for ψ",
        "Seeds": f"recordings {plan.seed} and {plan.seed + 1}, networks {plan.delta.seed}, policies "
        + ", ".join(map(str, plan.seeds)),
        "Versions": ", ".join(f"{name} {version}" for name, version in machine.versions.items()),
    }
