"""The trial of the names: changes are made, undone and not told; names are graded; an interrupted trial goes on."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.command_samples import nas
from support.truth_samples import FOLDER
from support.xl320_samples import be_patient, be_quick, virtual

from nas_data.dataset.features import ACTION, STATE
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.effects.base import make_effect
from nas_data.errors import OutputExists
from nas_data.gap.report import GapReport
from nas_data.gap.report_effects import EffectName, Evidence, FittedParameter, NamedEffect
from nas_data.gap.report_parts import ArmGap, EpisodeNumbers
from nas_data.gap.write_model import MODEL
from nas_data.hardware.xl320.arm import Configuration, Xl320Arm
from nas_data.hardware.xl320.control_table import TICK
from nas_data.hardware.xl320.joints import make_ergojr_joints
from nas_data.recorders.guarded import GuardedArm, Setup
from nas_data.recorders.path_planner import PathPlanner
from nas_data.recorders.schedule import SteppedClock
from nas_data.robots.base import find_robot
from nas_data.simulators.servo_registers import NO_REGISTERS, ServoRegisters
from nas_data.studies.trial import plan as plans
from nas_data.studies.trial.change import CHANGES, ChangeNotMade, TestedArm
from nas_data.studies.trial.changed_arm import Adjustment, ChangedXl320
from nas_data.studies.trial.outcome import ChangeOutcome, TrialOutcome
from nas_data.studies.trial.page import build, draw_sizes
from nas_data.studies.trial.plan import TrialPlan, run_trial
from nas_data.studies.trial.simulated import SimulatedArm
from nas_data.typed_json import from_json

JOINTS = make_ergojr_joints()
ARM = TestedArm(
    joints=JOINTS.names,
    period=0.02,
    limits=np.full(6, 0.2),
    torques=np.full(6, 0.1),
    speeds=np.full(6, 2.0),
    radians=np.ones(6),
    mass=0.02,
)


def find(name: str):
    return next(change for change in CHANGES if change.name == name)


# the changes


def test_there_are_eight_changes_or_more_over_different_joints():
    assert len(CHANGES) >= 8
    assert len({change.name for change in CHANGES}) == len(CHANGES)
    assert len({change.joint for change in CHANGES}) >= 6


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.name)
def test_each_change_is_an_effect_that_is_not_neutral(change):
    expected = change.expect(ARM)
    assert expected.name() == change.effect
    assert not expected.is_neutral
    assert expected.joint is None or expected.joint in JOINTS.names


def test_registers_hold_the_sizes():
    own = Configuration(speed=0.0, p_gain=40, torque=0.8)
    made = {change.name: Adjustment.of(change, ARM, own) for change in CHANGES}
    assert made["soft"].registers == {"p_gain": 20}
    assert made["weak"].registers == {"torque_limit": 286}  # 0.07 of 0.2 N·m, of 0.8 · 1023
    assert made["slow_base"].registers == {"moving_speed": 86}  # 1 rad/s in units of 0.111 rpm
    assert (made["late"].periods, made["shifted"].shift, made["loaded"].mass) == (3, 0.06, 0.02)


def test_a_torque_limit_needs_that_of_the_model():
    with pytest.raises(ChangeNotMade, match="no torque limit in m3"):
        Adjustment.of(find("weak"), replace(ARM, limits=np.full(6, np.inf)), Configuration())


def test_a_size_out_of_range_is_no_change():
    still = replace(ARM, speeds=np.zeros(6))
    with pytest.raises(ChangeNotMade, match=r"out of range in m1\. speed_limit: speed is 0\.0; it must lie in 0\.001"):
        find("slow_base").expect(still)
    with pytest.raises(ChangeNotMade, match=r"out of range\. command_delay: delay is 3\.0"):
        find("late").expect(replace(ARM, period=1.0))


# the arm


@pytest.fixture
def bus(monkeypatch):
    be_patient(monkeypatch)
    with virtual() as bus:
        yield bus


def setup(port: str, adjustment: Adjustment) -> Setup:
    driver = ChangedXl320(port=port, joints=JOINTS, configuration=Configuration(speed=0.0), adjustment=adjustment)
    return Setup(driver=driver, planner=PathPlanner(find_robot("ergojr")), rate=100.0)


@pytest.mark.parametrize("end", [None, KeyboardInterrupt])
def test_a_changed_register_is_put_back_and_not_told(bus, end):
    guarded = GuardedArm(setup(bus.port, Adjustment(joint="m2", registers={"p_gain": 16})), SteppedClock())
    with pytest.raises(KeyboardInterrupt) if end else guarded:
        if end:
            with guarded:
                guarded.take(np.zeros(6))
                assert guarded.arm.bus.get(2, "p_gain") == 16
                raise end
        guarded.take(np.zeros(6))
        assert guarded.arm.bus.get(2, "p_gain") == 16
        assert guarded.arm.registers() == {}
        assert "16" not in json.dumps(guarded.arm.describe())
    arm = Xl320Arm(bus.port, JOINTS)
    assert arm.bus.get(2, "p_gain") == 32
    arm.close()


def test_late_and_shifted_commands_are_recorded_as_if_they_were_not(bus):
    with GuardedArm(setup(bus.port, Adjustment(periods=2, joint="m6", shift=0.06)), SteppedClock()) as guarded:
        guarded.take(np.zeros(6))
        arm = guarded.arm
        before = arm.read().positions
        goals = []
        for step in range(1, 5):
            wanted = np.full(6, 0.02 * step)
            assert arm.command(wanted) == pytest.approx(wanted, abs=TICK)
            goals.append(JOINTS.positions(np.array([arm.bus.get(one, "goal_position") for one in JOINTS.ids])))
        shift = np.array([0, 0, 0, 0, 0, 0.06])
        assert goals[0] == pytest.approx(before + shift, abs=TICK)
        assert goals[3] == pytest.approx(0.04 + shift, abs=TICK)


@pytest.mark.parametrize("name", ["soft", "shifted"])
def test_a_recording_of_a_changed_arm_does_not_tell_the_change(name, tmp_path, monkeypatch):
    from nas_data.commands.trial_ergojr import TrialErgojr

    be_patient(monkeypatch)
    be_quick(monkeypatch)
    options = TrialErgojr(port="virtual", episodes=1, seconds=0.4, excitation="sine:share=0.2")
    recorder = options.recorder()
    recorder.record_baseline(tmp_path / "base")
    recorder.record_change(tmp_path / "changed", find(name), ARM)
    base, changed = read(tmp_path / "base"), read(tmp_path / "changed")
    assert np.array_equal(base.columns[ACTION], changed.columns[ACTION])
    assert not np.array_equal(base.states, changed.states)
    told = [read_provenance(tmp_path / folder).target for folder in ("base", "changed")]
    assert {key: value for key, value in told[0].items() if key != "tally"} == {
        key: value for key, value in told[1].items() if key != "tally"
    }
    for folder in ("base", "changed"):  # nor are registers read into the model, where the change would be known
        assert ServoRegisters.read(read_provenance(tmp_path / folder), JOINTS.names) == NO_REGISTERS


def test_without_a_terminal_no_mass_is_hung_on(tmp_path):
    from nas_data.commands._changed_ergojr import ask

    with pytest.raises(ChangeNotMade, match="person"):
        ask("Hang 20 g on the last link.", "loaded was left out.")
    ask("Take the mass off.", "")


# grades


def name(effect: str, joint: str | None, confidence: float, **values: float) -> NamedEffect:
    return NamedEffect(
        name=effect,
        joint=joint,
        parameters={
            key: FittedParameter(value=value, unit="", interval95=(0.9 * value, 1.1 * value))
            for key, value in values.items()
        },
        confidence=confidence,
        evidence=Evidence(heldout_error_before=0.1, heldout_error_after=0.01),
    )


def make_report(*effects: NamedEffect) -> GapReport:
    return GapReport(
        verdict="explained" if effects else "none",
        effects=effects,
        retuned=(),
        unexplained=(),
        gap=ArmGap(before=0.1, after=0.01),
        next_experiment=None,
        episodes=EpisodeNumbers(train=(0,), heldout=(1,)),
        seed=0,
        seconds=1.0,
    )


def grade(*effects: NamedEffect) -> ChangeOutcome:
    return ChangeOutcome.of(find("soft"), make_effect("servo_stiffness", "m2", {"factor": 0.5}), make_report(*effects))


RIGHT = name("servo_stiffness", "m2", 0.9, factor=0.52)


@pytest.mark.parametrize(
    ("effects", "right", "size"),
    [
        ((RIGHT,), True, True),
        ((RIGHT, name("backlash", "m3", 0.4, half_width=0.01)), True, True),
        ((RIGHT, name("backlash", "m3", 0.6, half_width=0.01)), False, False),
        ((name("servo_stiffness", "m2", 0.9, factor=0.6),), True, False),
        ((name("servo_stiffness", "m2", 0.4, factor=0.5),), False, False),
        ((name("servo_stiffness", "m3", 0.9, factor=0.5),), False, False),
        ((name("payload", None, 0.9, mass=0.1),), False, False),
        ((), False, False),
    ],
)
def test_only_the_true_name_alone_is_right(effects, right, size):
    outcome = grade(*effects)
    assert (outcome.is_right, outcome.has_right_size) == (right, size)


def test_a_line_and_the_page_show_names_and_truth():
    outcome = grade(RIGHT, name("backlash", "m3", 0.4, half_width=0.01))
    assert outcome.line() == (
        "soft: named: servo_stiffness in m2 0.520 (confidence 0.90), unsure: backlash in m3 (confidence 0.40)  "
        "true: servo_stiffness in m2 0.500  right; size off by 4.0 %"
    )
    whole = TrialOutcome(
        arm="ergojr", model="ergojr", baseline=(), baseline_verdict="none", changes=(outcome, grade()), skipped=("why",)
    )
    assert whole.sentence() == "1 of 2 named, 1 of 2 with size within 15%."
    page = build(whole).to_html()
    for text in ("1 of 2 named", "✓ soft", "✗ soft", "position gain halved", "why", "named size over true size"):
        assert text in page


def test_the_chart_of_sizes_shows_right_names_only():
    unsure, beside = replace(RIGHT, confidence=0.4), name("backlash", "m3", 0.6, half_width=0.01)
    graded = (grade(RIGHT), grade(unsure), grade(RIGHT, beside))
    whole = TrialOutcome(arm="ergojr", model="ergojr", baseline=(), baseline_verdict="none", changes=graded)
    (chart,) = draw_sizes(whole)
    assert chart.traces[0]["x"] == pytest.approx([1.04])
    assert draw_sizes(replace(whole, changes=graded[1:])) == []


def test_names_of_model_and_joints_keep_their_capitals():
    found = EffectName(name="backlash", joint="Elbow")
    whole = TrialOutcome(arm="SO101", model="SO101.xml", baseline=(found,), baseline_verdict="explained", changes=())
    assert "Baseline: explained; the arm has, and SO101.xml lacks: backlash in Elbow." in build(whole).to_html()


# the whole, with recordings of a pendulum and without a search


ARM_OF_ONE = SimulatedArm(
    robot="pendulum", effects=(), excitation="sine", episodes=2, seconds=1.0, rate=None, noise=0.0, seed=0, hung=0.05
)


@pytest.fixture
def searches(monkeypatch) -> list[str]:
    """Replace the search by one that knows the truth; return the names of the recordings that were searched."""
    seen: list[str] = []

    def pretend(dataset: Path, model: str, out: Path, say, propose: bool, baseline: Path | None) -> GapReport:
        assert not propose  # the next recording is known
        assert baseline == (None if dataset.name == plans.BASELINE else dataset.parent / plans.BASELINE)
        seen.append(dataset.name)
        report = make_report()
        if dataset.name != plans.BASELINE:
            assert Path(model) == dataset.parent / "baseline_gap" / MODEL
            made = json.loads((dataset.parent / "stages" / f"record_{dataset.name}.json").read_text())
            true = made["data"]["expected"]
            values = {key: one["value"] for key, one in true["parameters"].items()}
            report = make_report(name(true["effect"], true["joint"], 0.9, **values))
        out.mkdir(parents=True, exist_ok=True)
        shutil.copy(find_robot(model).mjcf, out / MODEL)
        report.write(out)
        return report

    monkeypatch.setattr(plans, "investigate", pretend)
    return seen


def test_a_trial_is_done_once_and_goes_on_where_it_stopped(tmp_path, searches):
    folder, plan = tmp_path / "trial", TrialPlan(ARM_OF_ONE, "pendulum")
    outcome = run_trial(plan, folder, lambda _: None)
    assert searches == ["baseline", *(change.name for change in CHANGES)]
    assert len(outcome.right_sizes) == len(outcome.changes) == len(CHANGES)
    stored = json.loads((folder / "trial.json").read_text())
    assert from_json(TrialOutcome, stored) == outcome
    assert f"of {len(CHANGES)} named" in (folder / "report.html").read_text()
    assert not (read_provenance(folder / "soft").target or {}).get("effects")
    searches.clear()
    assert run_trial(plan, folder, lambda _: None) == outcome
    assert searches == []
    shutil.rmtree(folder / "weak_gap")
    assert run_trial(plan, folder, lambda _: None) == outcome
    assert searches == ["weak"]
    with pytest.raises(OutputExists, match="model"):
        run_trial(TrialPlan(ARM_OF_ONE, "ergojr"), folder, lambda _: None)


def test_a_trial_that_did_nothing_yet_does_not_bind_its_folder(tmp_path, searches):
    options = ("--robot", "pendulum", "--episodes", "2", "--seconds", "1", "--mass", "0", "--out", tmp_path / "trial")
    assert nas("trial", "sim", *options, "--excitation", "nosuch").code == 2
    answer = nas("trial", "sim", *options)
    assert answer.code == 0, answer.err
    assert nas("trial", "sim", *options, "--seed", "3").code == 2


def test_the_command_counts_right_names(tmp_path, searches):
    options = ("--robot", "pendulum", "--episodes", "2", "--seconds", "1", "--mass", "0", "--out", tmp_path / "trial")
    answer = nas("trial", "sim", *options)
    assert answer.code == 0, answer.err
    assert f"{len(CHANGES) - 1} of {len(CHANGES) - 1} named" in answer.out
    again = nas("trial", "sim", *options, "--json").json
    assert again["named"] == again["right_sizes"] == again["changes_made"] == len(CHANGES) - 1


@pytest.mark.parametrize(
    ("joint", "actuator"),
    [
        pytest.param("", "", id="none"),
        pytest.param("", 'forcelimited="false" forcerange="-0.7 0.7"', id="of the actuator, switched off"),
        pytest.param('actuatorfrclimited="false" actuatorfrcrange="-0.1 0.1"', "", id="of the joint, switched off"),
    ],
)
def test_without_a_torque_limit_no_punch_is_raised(joint, actuator, tmp_path, searches, monkeypatch):
    monkeypatch.setattr(plans, "CHANGES", (find("punch"), find("late")))
    text = find_robot("pendulum").mjcf.read_text()
    text = text.replace('forcerange="-0.7124 0.7124"', actuator).replace('type="hinge"', f'type="hinge" {joint}')
    path = tmp_path / "unlimited.xml"
    path.write_text(text)
    outcome = run_trial(TrialPlan(replace(ARM_OF_ONE, robot=str(path)), str(path)), tmp_path / "trial", lambda _: None)
    assert outcome.skipped == ("punch: the baseline's model has no torque limit in pendulum",)
    assert [change.change for change in outcome.right] == ["late"]


def test_a_joint_that_stands_still_is_not_slowed_down(tmp_path, searches):
    still = replace(ARM_OF_ONE, excitation="sine:share=1e-9")
    outcome = run_trial(TrialPlan(still, "pendulum"), tmp_path / "trial", lambda _: None)
    assert [line.partition(": its size is out of range in pendulum. ")[0] for line in outcome.skipped] == [
        "weak",
        "slow_base",
        "slow_elbow",
    ]
    assert len(outcome.right) == len(CHANGES) - 3


def test_sizes_at_a_slide_are_in_metres_and_suit_its_travel(tmp_path, searches, monkeypatch):
    monkeypatch.setattr(plans, "CHANGES", (find("slow_base"), find("shifted")))
    axis = str(FOLDER / "linear_axis.xml")
    outcome = run_trial(TrialPlan(replace(ARM_OF_ONE, robot=axis), axis), tmp_path / "trial", lambda _: None)
    slow, shifted = outcome.right_sizes
    assert (slow.unit, shifted.unit) == ("m/s", "m")
    baseline = read(tmp_path / "trial" / plans.BASELINE)
    travel = np.ptp(baseline.columns[STATE][:, baseline.joints.index("z")])
    assert shifted.size == pytest.approx(0.06 * travel / np.pi)
    stored = json.loads((tmp_path / "trial/stages/record_shifted.json").read_text())["data"]["expected"]
    assert stored["parameters"]["offset"]["unit"] == "m"
    assert " rad" not in (tmp_path / "trial/report.html").read_text().split("Every change")[1].split("</table>")[0]


@pytest.mark.slow
def test_all_changes_of_a_virtual_arm_are_named(tmp_path, monkeypatch):
    be_patient(monkeypatch)
    answer = nas("trial", "ergojr", "--port", "virtual", "--out", tmp_path / "trial", "--json").json
    assert answer["named"] == answer["changes_made"] >= 8
    assert answer["right_sizes"] == answer["changes_made"]
