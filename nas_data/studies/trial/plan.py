"""Stages of a trial: record the baseline and learn its model, record each change, name each, and report."""

import json
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from nas_data.atomic_file import write_atomic
from nas_data.dataset.features import ACTION
from nas_data.dataset.layout import INFO
from nas_data.dataset.read import read
from nas_data.effects.base import Effect, from_json
from nas_data.effects.edits.servo import read_servo_stiffness, read_torque_limit
from nas_data.gap.report import REPORT, GapReport
from nas_data.gap.report_effects import EffectName
from nas_data.gap.workflow import investigate
from nas_data.gap.write_model import MODEL
from nas_data.joint_units import compute_angle_scales
from nas_data.mjcf.arm_ends import list_arm_ends
from nas_data.robots.base import find_deepest_joint, read_spec
from nas_data.runs.progress import RateLimited
from nas_data.runs.progress import Report as Say
from nas_data.runs.stages import INDENT, WIDTH, Stage, StageResult, Work, read_stage, run_stages
from nas_data.studies.trial.change import CHANGES, ChangeNotMade, KnownChange, TestedArm
from nas_data.studies.trial.outcome import ChangeOutcome, TrialOutcome
from nas_data.studies.trial.page import build
from nas_data.studies.trial.recorder import ArmRecorder
from nas_data.typed_json import as_object, make_finite

BASELINE, RESULT, PAGE = "baseline", "trial.json", "report.html"
SPEED_WINDOW = 0.05  # [s] over which speeds are measured, so that the resolution of positions matters little
LARGE = 98  # percentile of speeds and torques that stands for large ones
PAUSE = 5.0  # [s] between two progress lines of a search


@dataclass(frozen=True)
class TrialPlan:
    """What a trial does."""

    recorder: ArmRecorder  # the arm
    model: str  # model that the baseline is compared with: a robot's name or a model file

    def describe(self) -> dict[str, object]:
        """Return what the results depend on, for JSON."""
        changes = {change.name: f"{change.size:g} × {change.of}" for change in self.changes}
        return {"arm": self.recorder.name, "model": self.model, **self.recorder.describe(), "changes": changes}

    @property
    def changes(self) -> Sequence[KnownChange]:
        """The changes to make, without the mass if there is none."""
        return [change for change in CHANGES if change.of != "mass" or self.recorder.mass > 0]


TrialWork = Work[TrialPlan]


def run_trial(plan: TrialPlan, folder: Path, report: Say) -> TrialOutcome:
    """Run the unfinished stages of a trial in a folder.

    Raises:
        OutputExists: the folder holds something else, or a trial with other settings.
        NasError: the arm or the model cannot be used.
    """
    work = TrialWork(plan, folder, report, "trial")
    run_stages(list_stages(plan), work)
    return collect(work)


def list_stages(plan: TrialPlan) -> list[Stage[TrialPlan]]:
    """Return the stages: all recordings come before the search for names, so that a person may then leave the arm."""
    recorded, named = record_stage_name(BASELINE), name_stage_name(BASELINE)
    stages = [
        Stage(
            recorded,
            "Record the baseline",
            "The arm as it is. All recordings play the same commands.",
            record_baseline,
            (BASELINE,),
            (),
        ),
        Stage(
            named,
            "Name what the model lacks",
            "`nas gap` compares the baseline with the model. With what it names, it is the baseline's own model.",
            name_baseline,
            (f"{gap_folder(BASELINE)}/{REPORT}",),
            (recorded,),
        ),
    ]
    for change in plan.changes:
        does = f"Known change: {change.does}."
        work = partial(record_change, change=change)
        stages.append(
            Stage(
                record_stage_name(change.name), f"Record {change.name}", does, work, (change.name,), (recorded, named)
            )
        )
    for change in plan.changes:
        does = "`nas gap` compares the recording with the baseline's own model, and is not told the change."
        work, before = partial(name_change, change=change), (named, record_stage_name(change.name))
        made = (f"{gap_folder(change.name)}/{REPORT}",)
        stages.append(Stage(name_stage_name(change.name), f"Name {change.name}", does, work, made, before))
    return [*stages, Stage("page", "Report", "Names and truth go on one page.", write_result, (RESULT, PAGE))]


def record_stage_name(name: str) -> str:
    """Return the name of the stage that records a change or the baseline."""
    return f"record_{name}"


def name_stage_name(name: str) -> str:
    """Return the name of the stage that names a change or what the model lacks."""
    return f"name_{name}"


def gap_folder(name: str) -> str:
    """Return the folder of the gap report of a recording."""
    return f"{name}_gap"


def record_baseline(work: TrialWork) -> StageResult:
    """Record the arm as it is."""
    return record_once(work, BASELINE, work.plan.recorder.record_baseline)


def record_once(work: TrialWork, name: str, record: Callable[[Path], Sequence[str]]) -> StageResult:
    """Record into a folder, unless an interrupted run has completed this recording."""
    folder = work.folder / name
    return StageResult([f"{folder} is complete"] if (folder / INFO).is_file() else record(folder), {})


def name_baseline(work: TrialWork) -> StageResult:
    """Name what the model lacks, and write the baseline's own model."""
    report = name_recording(work, BASELINE, work.plan.model)
    names = ", ".join(map(str, report.effects)) or "nothing"
    return StageResult([f"verdict {report.verdict}; named: {names}"], {})


def name_recording(work: TrialWork, name: str, model: str, baseline: Path | None = None) -> GapReport:
    """Run `nas gap` on a recording, with its own progress; with a baseline only what differs from it is named."""
    say = RateLimited(lambda line: work.report(INDENT + textwrap.shorten(line, WIDTH, placeholder=" …")), PAUSE)
    return investigate(work.folder / name, model, work.folder / gap_folder(name), say, propose=False, baseline=baseline)


def record_change(work: TrialWork, change: KnownChange) -> StageResult:
    """Make a change and record the arm; the result tells the effect as which it should be named."""
    arm = measure_arm(work)
    try:
        expected = change.expect(arm)
        made = record_once(work, change.name, lambda folder: work.plan.recorder.record_change(folder, change, arm))
    except ChangeNotMade as error:
        return StageResult([f"skipped: {error}"], {"skipped": str(error)})
    return StageResult(made.lines, {"expected": expected.to_json(arm.slides)})


def measure_arm(work: TrialWork) -> TestedArm:
    """Measure what the sizes of changes are relative to, in the baseline and its own model."""
    dataset, spec = read(work.folder / BASELINE), read_spec(work.folder / gap_folder(BASELINE) / MODEL)
    n, gap = len(dataset.joints), max(1, round(SPEED_WINDOW * dataset.fps))
    episodes = [dataset.states[rows, :n].astype(float) for rows in dataset.episodes()]
    steps = np.concatenate([rows[gap:] - rows[:-gap] for rows in episodes])
    errors = dataset.columns[ACTION] - dataset.states[:, :n]
    stiffness = np.array([read_servo_stiffness(spec, joint) for joint in dataset.joints])
    limits = np.array([read_torque_limit(spec, joint) for joint in dataset.joints])
    ends = list_arm_ends(spec, dataset.joints)
    return TestedArm(
        joints=dataset.joints,
        period=1 / dataset.fps,
        limits=limits,
        torques=np.minimum(limits, stiffness * np.percentile(np.abs(errors), LARGE, axis=0)),
        speeds=np.percentile(np.abs(steps), LARGE, axis=0) * dataset.fps / gap,
        radians=compute_angle_scales(dataset.joints, dataset.slides, np.ptp(dataset.states[:, :n], axis=0)),
        slides=dataset.slides,
        mass=work.plan.recorder.mass,
        loaded=find_deepest_joint(spec, ends) if len(ends) > 1 else None,
    )


def name_change(work: TrialWork, change: KnownChange) -> StageResult:
    """Name a change against the baseline's own model."""
    made = read_stage(record_stage_name(change.name), work.folder).data
    if "skipped" in made:
        return StageResult(["skipped, as its recording"], {})
    model = work.folder / gap_folder(BASELINE) / MODEL
    report = name_recording(work, change.name, str(model), work.folder / BASELINE)
    return StageResult([compare(work, change, report).line()], {})


def compare(work: TrialWork, change: KnownChange, report: GapReport) -> ChangeOutcome:
    """Compare the report of a recorded change with the effect that it should name."""
    return ChangeOutcome.of(change, read_expected(work, change), report, read(work.folder / BASELINE).slides)


def read_expected(work: TrialWork, change: KnownChange) -> Effect:
    """Return the effect as which a recorded change should be named."""
    made = read_stage(record_stage_name(change.name), work.folder).data["expected"]
    assert isinstance(made, dict)
    return from_json(made)


def collect(work: TrialWork) -> TrialOutcome:
    """Return the outcome of the finished stages."""
    plan, baseline = work.plan, GapReport.read(work.folder / gap_folder(BASELINE) / REPORT)
    made = {change: read_stage(record_stage_name(change.name), work.folder).data for change in plan.changes}
    return TrialOutcome(
        arm=plan.recorder.name,
        model=plan.model,
        baseline=tuple(EffectName(name=effect.name, joint=effect.joint) for effect in baseline.effects),
        baseline_verdict=baseline.verdict,
        changes=tuple(
            compare(work, change, GapReport.read(work.folder / gap_folder(change.name) / REPORT))
            for change, data in made.items()
            if "skipped" not in data
        ),
        skipped=tuple(f"{change.name}: {data['skipped']}" for change, data in made.items() if "skipped" in data),
    )


def write_result(work: TrialWork) -> StageResult:
    """Write `trial.json` and the page."""
    outcome = collect(work)
    content = json.dumps(make_finite(as_object(outcome)), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write_atomic(work.folder / RESULT, content.encode())
    write_atomic(work.folder / PAGE, build(outcome).to_html().encode())
    return StageResult([f"{work.folder / RESULT}", f"{work.folder / PAGE}"], {})
