"""Rollouts on a bad line: what passes is got over, counted and flagged, what lasts ends with a safe arm."""

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from support.rollout_samples import LOCKSTEP, evaluate, policy, refused, work_in
from support.xl320_samples import be_patient, be_quick, virtual

from nas_data.dataset.features import TIME
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.verify import verify
from nas_data.errors import BadReply, GuardLost, NobodyAnswers, ServoSilent
from nas_data.hardware.xl320.arm import Reading, Xl320Arm
from nas_data.hardware.xl320.joints import make_ergojr_joints
from nas_data.policies.rollouts.robot_stepper import RobotStepper
from nas_data.recorders.arm_dataset import LATE
from nas_data.recorders.retry import TRIES, Retry
from nas_data.recorders.schedule import SteppedClock

JOINTS = make_ergojr_joints()
ERRORS = (BadReply, ServoSilent, NobodyAnswers)
REACHER = (-0.8, -0.2, 0.2, 0.1)  # there at once in the first episode, and never in the second


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    be_quick(monkeypatch)
    return work_in(tmp_path, monkeypatch)


def failing(times: int, errors: Iterator[type[Exception]]) -> Callable[[], str]:
    """Return something that fails so often before it succeeds."""
    left = iter(range(times))

    def ask() -> str:
        if next(left, None) is not None:
            raise next(errors)("The line failed.")
        return "heard"

    return ask


def test_what_passes_is_got_over_and_what_lasts_or_is_no_matter_of_the_line_is_not():
    stood = []
    retry = Retry(TRIES, lambda: stood.append(1))
    assert retry.call(failing(TRIES - 1, cycle(ERRORS))) == "heard"
    assert retry.failures == len(stood) == TRIES - 1
    with pytest.raises(ERRORS):
        retry.call(failing(TRIES, cycle(ERRORS)))
    with pytest.raises(GuardLost):
        retry.call(failing(1, cycle([GuardLost])))
    with pytest.raises(BadReply):
        Retry().call(failing(1, cycle(ERRORS)))


@pytest.fixture
def in_steps(monkeypatch) -> Callable[[Callable[[Xl320Arm, int], None]], None]:
    """Let something happen before each reading within an episode's steps; it is told which attempt that is."""
    read, stepping, count = Xl320Arm.read, RobotStepper.step, iter(range(10**6))
    under_way = []

    def step(stepper: RobotStepper, commands: np.ndarray) -> np.ndarray:
        under_way.append(1)
        try:
            return stepping(stepper, commands)
        finally:
            under_way.clear()

    def happen(what: Callable[[Xl320Arm, int], None]) -> None:
        def reading(arm: Xl320Arm) -> Reading:
            if under_way:
                what(arm, next(count))
            return read(arm)

        monkeypatch.setattr(Xl320Arm, "read", reading)

    monkeypatch.setattr(RobotStepper, "step", step)
    return happen


def test_a_passing_error_ends_no_episode_and_is_counted_told_and_flagged(capsys, in_steps, monkeypatch):
    be_patient(monkeypatch)
    errors = cycle(ERRORS)

    def fail(_: Xl320Arm, attempt: int) -> None:
        if attempt in (5, 10, 11):
            raise next(errors)("The line failed.")

    in_steps(fail)
    answer = evaluate(capsys, policy("ErgoReacher", REACHER), "--episodes", "2", *LOCKSTEP, "--record", "rolled")
    root = Path(answer["dataset"])
    dataset = read(root)
    assert verify(root) == []
    assert answer["unheard"] == read_provenance(root).target["tally"]["unheard"] == 3
    assert answer["late"] == answer["missed_readings"] == 2
    assert np.flatnonzero(dataset.columns[LATE][:, 0]).tolist() == [6, 10], "the first row is the first episode"
    assert (
        "0 readings needed more than one attempt, and 3 transactions were repeated because a servo did not answer"
    ) in read_provenance(root).notes


def test_a_health_that_is_not_heard_at_once_is_asked_for_again(capsys, monkeypatch):
    health, asked = Xl320Arm.health, []

    def unwell(arm: Xl320Arm, identity: int) -> object:
        asked.append(identity)
        if len(asked) % 20 == 0:
            raise ServoSilent(f"Servo {identity} does not answer.")
        return health(arm, identity)

    monkeypatch.setattr(Xl320Arm, "health", unwell)
    answer = evaluate(capsys, policy("ErgoReacher", (0.3, -0.2, 0.2, 0.1)), "--episodes", "1", *LOCKSTEP)
    assert answer["unheard"] >= 1


def test_a_late_reading_is_flagged_and_those_after_it_come_in_time(capsys, in_steps, monkeypatch):
    be_patient(monkeypatch)
    clocks, wait = [], SteppedClock.wait_until
    monkeypatch.setattr(SteppedClock, "wait_until", lambda clock, when: (clocks.append(clock), wait(clock, when)))

    def dawdle(_: Xl320Arm, attempt: int) -> None:
        if attempt == 5:
            clocks[-1].wait_until(clocks[-1].now() + 0.035)

    in_steps(dawdle)
    answer = evaluate(capsys, policy("ErgoReacher", REACHER), "--episodes", "2", *LOCKSTEP, "--record", "rolled")
    dataset = read(Path(answer["dataset"]))
    assert answer["late"] == answer["missed_readings"] == 1
    assert np.flatnonzero(dataset.columns[LATE][:, 0]).tolist() == [6]
    assert np.flatnonzero(np.diff(dataset.columns[TIME][:, 0]) > 0.015).tolist() == [5]


def test_a_servo_that_stays_silent_ends_the_rollout_with_the_others_without_torque(capsys, monkeypatch):
    with virtual("unplugged:servo=3,after=4") as bus:
        monkeypatch.setattr("nas_data.commands._on_arm.port_of", lambda *_, **__: nullcontext(bus.port))
        said = refused(capsys, policy("ErgoReacher", REACHER), "--episodes", "9", *LOCKSTEP, "--record", "rolled")
        assert "Servo 3 does not answer" in said
        assert "run the same command to continue" in said or "Nothing was recorded yet" in said
        arm = Xl320Arm(bus.port, JOINTS)
        assert [arm.bus.get(identity, "torque_enable") for identity in JOINTS.ids if identity != 3] == [0] * 5
        arm.close()
