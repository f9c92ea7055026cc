"""The stage find: gaps by joint and regime on recordings whose truth is known, and audits that must notice."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support.recording_samples import recorded_on, wander

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE, TIME, Feature, make_time_feature
from nas_data.dataset.torque_off import TORQUE, keep_torque_on
from nas_data.dataset.transitions import estimate_velocities
from nas_data.effects.base import parse
from nas_data.errors import DatasetInvalid
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.finding.find import GapFindings, find
from nas_data.gap.finding.joint_gaps import measure_repeatability
from nas_data.gap.finding.regimes import (
    compute_grouped_chance,
    compute_paired_chance,
    correct_holm,
    count_episodes_needed,
)
from nas_data.gap.floor import estimate_noise_floor
from nas_data.gap.nominal import Nominal
from nas_data.gap.write_model import write_model
from nas_data.models.evaluation import evaluate
from nas_data.simulators.mujoco import MujocoSimulator

RATE = 100.0  # [Hz]
QUANTUM = np.radians(0.29)  # [rad] XL-320
EPISODES, MANY = 6, 20  # for audits; for what must be significant
STEPS = 200
PLAY_AND_DELAY = ("backlash:joint=m3,half_width=0.05", "command_delay:delay=0.03")


def jumps(episodes: int, joints: int = 6) -> list[np.ndarray]:
    """Return targets held for half a second; they begin where the arm rests, and jump after a tenth."""
    rng = np.random.default_rng(5)
    held = [np.repeat(rng.uniform(-0.9, 0.9, (STEPS // 50, joints)), 50, axis=0) for _ in range(episodes)]
    return [np.roll(episode, 10, axis=0) for episode in held]


@cache
def recording(
    effects: tuple[str, ...] = (), quantised: bool = True, signal: str = "wander", episodes: int = EPISODES
) -> Dataset:
    """Return an ErgoJr with effects, read in quanta where asked, velocities from the readings."""
    target = MujocoSimulator.load("ergojr", 1 / RATE, effects=[parse(text) for text in effects], threads=1)
    commands = wander([STEPS] * episodes, joints=6, size=0.9) if signal == "wander" else jumps(episodes)
    dataset = recorded_on(target, commands)
    return read_in_quanta(dataset) if quantised else dataset


def read_in_quanta(dataset: Dataset) -> Dataset:
    """Round positions to the XL-320's reading and difference them."""
    positions = np.concatenate([dataset.states[:, :6].reshape(-1, STEPS, 6), last_positions(dataset)], axis=1)
    return with_positions(dataset, np.round(positions / QUANTUM) * QUANTUM)


def last_positions(dataset: Dataset) -> np.ndarray:
    return dataset.next_states[:, :6].reshape(-1, STEPS, 6)[:, -1:]


def with_positions(dataset: Dataset, positions: np.ndarray) -> Dataset:
    """Return the dataset with other readings, shape (E, T + 1, n), and their velocities."""
    states = [np.concatenate([row, estimate_velocities(row, RATE)], axis=1).astype(np.float32) for row in positions]
    now = np.concatenate([state[:-1] for state in states])
    after = np.concatenate([state[1:] for state in states])
    return replace(dataset, columns={**dataset.columns, STATE: now, NEXT_STATE: after})


def with_commands(dataset: Dataset, commands: np.ndarray) -> Dataset:
    return replace(dataset, columns={**dataset.columns, ACTION: commands.astype(np.float32)})


def search(dataset: Dataset) -> GapFindings:
    evidence = EpisodeBatch.of(dataset)
    return find(dataset, evidence, Nominal.load("ergojr", evidence), estimate_noise_floor(evidence))


@cache
def own() -> GapFindings:
    """Return what is found on a recording of the model itself."""
    return search(recording(episodes=MANY))


def said(found: GapFindings, check: str) -> tuple[str, bool]:
    """Return what an audit says, and whether it lets the recording pass."""
    return next((entry.finding, entry.ok) for entry in found.audit if entry.check == check)


def significant(found: GapFindings, joint: str) -> set[tuple[str, str]]:
    """Return the regimes in which a joint's error is surely larger."""
    return {(b.regime, b.bin) for b in found.regimes if b.joint == joint and b.significant and b.rmse > b.rest}


def test_a_model_has_no_gap_on_its_own_recording():
    found = own()
    assert all(gap.ratio_to_noise < 1.2 for gap in found.joints.values())
    assert all(entry.ok for entry in found.audit)
    assert found.undecidable == ()
    assert "  nowhere" in found.text()


@pytest.mark.parametrize(
    ("effects", "rows"),
    [
        pytest.param((), STEPS, id="plain, whole", marks=pytest.mark.slow),
        pytest.param((), STEPS // 4, id="plain, cut in motion", marks=pytest.mark.slow),
        pytest.param(PLAY_AND_DELAY, STEPS, id="play and delay, whole", marks=pytest.mark.slow),
        pytest.param(PLAY_AND_DELAY, STEPS // 4, id="play and delay, cut in motion"),
    ],
)
def test_the_open_loop_gap_is_the_one_that_evaluate_reports(effects: tuple[str, ...], rows: int, tmp_path: Path):
    """Both start episodes at the same velocity, play and delays settled alike."""
    whole = recording(("viscous_friction:joint=m2,coefficient=0.1",)).select(range(3))
    dataset = replace(whole, lengths=np.full(whole.n_frames // rows, rows))
    evidence = EpisodeBatch.of(dataset)
    assert (evidence.initial_velocities != 0).any() == (rows < STEPS)
    plain = Nominal.load("ergojr", evidence)
    model, _ = write_model(tmp_path, plain, [parse(text) for text in effects], {})
    found = find(dataset, evidence, Nominal.load(model, evidence), estimate_noise_floor(evidence))
    told = evaluate(dataset, MujocoSimulator.load(model, 1 / RATE, dataset.joints), None).open_loop
    assert {joint: gap.open_loop for joint, gap in found.joints.items()} == pytest.approx(told["source"].per_joint)
    assert {joint: gap.open_loop_hold for joint, gap in found.joints.items()} == pytest.approx(told["hold"].per_joint)


def test_a_gap_stands_at_its_joint_and_in_its_regime():
    found = search(recording(("viscous_friction:joint=m2,coefficient=0.1",), episodes=MANY))
    ratios = {joint: gap.ratio_to_noise for joint, gap in found.joints.items()}
    assert max(ratios, key=ratios.get) == "m2" and ratios["m2"] > 5
    assert ("speed", "fast") in significant(found, "m2")
    assert not significant(found, "m1")
    assert "m2  " in found.text().split("Where the error is")[1]


def test_friction_leaves_the_model_ahead_of_the_motion_both_ways():
    found = search(recording(("coulomb_friction:joint=m3,torque=0.03",), episodes=MANY))
    ways = {b.bin: b.mean for b in found.regimes if b.joint == "m3" and b.regime == "direction"}
    assert ways["positive"] > 0.02 and ways["negative"] < -0.02
    assert "m3  " in found.text() and "ahead of the motion in both directions" in found.text()


def test_a_weaker_servo_shows_where_its_model_is_at_the_limit_or_the_command_far():
    found = search(recording(("torque_limit:joint=m3,torque=0.1",), signal="jumps", episodes=MANY))
    assert significant(found, "m3") & {("command size", "large"), ("saturation", "at the limit")}


def test_bins_add_up_to_the_gap_of_the_joint():
    found = search(recording(("backlash:joint=m4,half_width=0.03",)))
    bins = [b for b in found.regimes if b.joint == "m4" and b.regime == "speed"]
    assert sum(b.share for b in bins) == pytest.approx(1.0)
    total = sum(b.rows for b in bins)
    assert total == EPISODES * STEPS
    assert sum(b.rows * b.rmse**2 for b in bins) / total == pytest.approx(found.joints["m4"].open_loop ** 2)


def test_the_report_is_what_the_contract_says():
    content = json.loads(json.dumps(own().to_json()))
    assert set(content["joints"]) == {"m1", "m2", "m3", "m4", "m5", "m6"}
    keys = {"floor", "one_step", "one_step_hold", "open_loop", "open_loop_hold", "open_loop_command", "ratio_to_noise"}
    assert keys <= set(content["joints"]["m1"])
    assert {"joint", "regime", "bin", "rows", "rmse", "ratio_to_noise", "share", "significant"} <= set(
        content["regimes"][0]
    )
    assert all(set(entry) == {"check", "finding", "ok"} for entry in content["audit"])


@pytest.mark.parametrize(
    "rows", [pytest.param(-2, marks=pytest.mark.slow), -1, pytest.param(1, marks=pytest.mark.slow), 2]
)
def test_commands_that_slipped_by_rows_are_noticed(rows):
    """The logged command at a row is the one of `rows` rows later: positive looks early."""
    dataset = recording(signal="jumps")
    commands = dataset.commands.reshape(EPISODES, STEPS, 6)
    index = np.clip(np.arange(STEPS) + rows, 0, STEPS - 1)
    finding, ok = said(search(with_commands(dataset, commands[:, index].reshape(-1, 6))), "command shift")
    assert not ok
    assert f"{abs(rows)} row" in finding and ("early" if rows > 0 else "late") in finding and "all joints" in finding


def test_a_delay_is_said_to_look_like_a_slip_where_all_joints_have_it():
    delayed = search(recording(("command_delay:delay=0.02",), signal="jumps"))
    assert "command_delay" in said(delayed, "command shift")[0]
    finding, ok = said(search(recording(("command_delay:joint=m3,delay=0.02",), signal="jumps")), "command shift")
    assert ok and "m3 starts about 2 rows (20 ms) later" in finding
    assert said(search(recording(("speed_limit:joint=m1,speed=1.5",), signal="jumps")), "command shift")[1]


def test_a_device_slower_than_the_recording_is_noticed_with_its_rate():
    dataset = recording(quantised=False)
    positions = np.concatenate([dataset.states[:, :6].reshape(EPISODES, STEPS, 6), last_positions(dataset)], axis=1)
    finding, ok = said(search(with_positions(dataset, positions[:, np.arange(STEPS + 1) // 2 * 2])), "repeated samples")
    assert not ok
    assert "about 50 readings per second" in finding


def test_readings_lost_here_and_there_are_noticed_without_a_rate():
    dataset = recording(quantised=False)
    positions = np.concatenate([dataset.states[:, :6].reshape(EPISODES, STEPS, 6), last_positions(dataset)], axis=1)
    lost = np.random.default_rng(2).random(STEPS + 1) < 0.1
    lost[0] = False
    latest = np.maximum.accumulate(np.where(lost, 0, np.arange(STEPS + 1)))
    finding, ok = said(search(with_positions(dataset, positions[:, latest])), "repeated samples")
    assert not ok and "irregular" in finding


def test_rounding_is_not_taken_for_repeated_samples():
    assert said(own(), "repeated samples")[1]


def test_late_rows_and_other_rates_are_noticed():
    times = np.tile(np.arange(STEPS) / RATE, (EPISODES, 1))
    even = recording().with_column(TIME, make_time_feature(), times.reshape(-1, 1))
    assert said(search(even), "timing")[1]
    times[3:5] *= 1.25
    found = search(even.with_column(TIME, make_time_feature(), times.reshape(-1, 1)))
    finding, ok = said(found, "timing")
    assert not ok and "rows come at 80 Hz" in finding and f"2 of {EPISODES} episodes" in finding
    assert any("different rates" in sentence for sentence in found.undecidable)


def test_a_late_velocity_register_is_noticed():
    dataset = recording(quantised=False)
    assert said(search(dataset), "velocities")[1]
    states = dataset.states.reshape(EPISODES, STEPS, 12).copy()
    states[:, 3:, 6:] = states[:, :-3, 6:].copy()
    found = search(replace(dataset, columns={**dataset.columns, STATE: states.reshape(-1, 12)}))
    finding, ok = said(found, "velocities")
    assert not ok and "30 ms behind" in finding


def test_what_never_moves_cannot_be_decided():
    dataset = recording()
    commands, states = dataset.commands.copy(), dataset.states.copy()
    following = dataset.next_states.copy()
    commands[:, 0] = 0.3
    for column in (states, following):
        column[:, [1, 7]] = 0.0
    columns = {**dataset.columns, ACTION: commands, STATE: states, NEXT_STATE: following}
    found = search(replace(dataset, columns=columns))
    text = " ".join(found.undecidable)
    assert "What is missing at m1 cannot be decided" in text and "m2 never moves" in text
    assert not said(found, "excitation")[1]


def test_one_short_episode_is_said_to_be_too_little():
    found = search(recording().select([0]))
    assert len(found.undecidable) == 2
    assert not any(b.significant for b in found.regimes)


def test_rows_with_the_torque_off_are_left_out():
    dataset = recording()
    on = np.ones((EPISODES, STEPS, 1), np.float32)
    on[::2, 120:] = 0
    fallen = dataset.next_states.copy().reshape(EPISODES, STEPS, 12)
    fallen[::2, 120:, :6] += 0.5
    columns = {**dataset.columns, NEXT_STATE: fallen.reshape(-1, 12)}
    released = replace(dataset, columns=columns).with_column(
        TORQUE, Feature(names=("torque_enable",)), on.reshape(-1, 1)
    )
    found = search(released)
    assert all(gap.open_loop < 0.01 for gap in found.joints.values())
    assert f"20 % of the rows, in {EPISODES // 2} episodes" in said(found, "torque off")[0]
    assert keep_torque_on(dataset) is dataset


def test_a_recording_without_torque_is_refused():
    off = recording().with_column(TORQUE, Feature(names=("torque_enable",)), np.zeros((EPISODES * STEPS, 1)))
    with pytest.raises(DatasetInvalid, match="off in every row"):
        search(off)


def test_the_longest_driven_stretch_is_kept_wherever_it_is():
    on = np.zeros((EPISODES, STEPS, 1))
    on[0, 5:20], on[0, 50:150], on[2, 10:40] = 1, 1, 1
    dataset = recording().with_column(TORQUE, Feature(names=("torque_enable",)), on.reshape(-1, 1))
    driven = keep_torque_on(dataset)
    assert driven.lengths.tolist() == [100, 0, 30] + [0] * (EPISODES - 3)
    assert np.array_equal(driven.states[:100], dataset.states[50:150])
    assert EpisodeBatch.of(driven).numbers.tolist() == [0, 2]


def test_repeats_tell_the_noise_whatever_the_motion():
    dataset = recording(quantised=False)
    rng = np.random.default_rng(1)
    chosen = dataset.select([0, 1, 0, 1, 2])
    evidence = EpisodeBatch.of(chosen)
    noisy = replace(evidence, measured=evidence.measured + rng.normal(0, 0.004, evidence.measured.shape))
    found = measure_repeatability(noisy, np.full(6, 0.004))
    assert found == pytest.approx(np.full(6, 0.004), rel=0.15)
    assert measure_repeatability(evidence.select([0, 4]), np.full(6, 0.004)) is None


def test_chance_alone_is_rarely_called_significant():
    rng = np.random.default_rng(0)
    alarms = 0
    for _ in range(100):
        chances = np.array([compute_paired_chance(rng.standard_normal(12), rng) for _ in range(30)])
        alarms += bool(correct_holm(chances).any())
    assert alarms <= 12  # 5 expected


def test_permutation_tests_are_exact_where_all_can_be_counted():
    rng = np.random.default_rng(0)
    assert compute_paired_chance(np.ones(6), rng) == 2 / 2**6
    assert compute_grouped_chance(np.array([0.0, 0, 0, 9, 9]), np.array([0, 0, 0, 1, 1], bool), rng) == pytest.approx(
        0.1
    )
    assert compute_grouped_chance(np.zeros(4), np.ones(4, bool), rng) == 1.0
    assert compute_paired_chance(np.empty(0), rng) == 1.0


def test_holm_is_stricter_than_each_test_and_stops_at_the_first_failure():
    assert correct_holm(np.array([0.001, 0.04, 0.03, 0.011])).tolist() == [True, False, False, True]
    assert correct_holm(np.empty(0)).shape == (0,)
    assert 2 / 2 ** count_episodes_needed(100) <= 0.05 / 100 < 2 / 2 ** (count_episodes_needed(100) - 1)
