"""How fast episodes begin: at rest where they rest, whatever the noise; at their speed where they are cut in motion."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.linear_samples import LinearSimulator
from support.start_samples import seen

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.start_velocities import (
    SIGNIFICANT_DEVIATIONS,
    StartVelocities,
    find_start_velocities,
    fit_velocity,
)
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.windows import cut_window
from nas_data.pairing import read_initial_states

QUANTUM = np.radians(0.29)  # [rad] XL-320
RATES = (20, 30, 50, 100, 200, 500, 1000)  # [Hz]
FORMULAS = ("backward", "forward", "central", "quadratic")
EPISODES, SECONDS = 10, 2.0


def swings(rate: float, start: float = 0.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return positions [rad] and velocities [rad/s] of a joint that begins at a speed and is driven to and fro."""
    rng = np.random.default_rng(seed)
    times = np.arange(round(SECONDS * rate) + 1) / rate
    swing, turns = rng.uniform(0.3, 0.9, (EPISODES, 1)), 2 * np.pi * rng.uniform(0.5, 2.0, (EPISODES, 1))
    positions = start * times + swing * (1 - np.cos(turns * times))
    return positions, start + swing * turns * np.sin(turns * times)


def read(positions: np.ndarray, noise: float, quantum: float = 0.0, seed: int = 1) -> np.ndarray:
    """Return positions as a sensor with noise and rounding [rad] shows them."""
    noisy = positions + noise * np.random.default_rng(seed).standard_normal(positions.shape)
    return np.round(noisy / quantum) * quantum if quantum else noisy


# One velocity


@given(
    speed=st.floats(-5, 5),
    acceleration=st.floats(-20, 20),
    rate=st.sampled_from(RATES),
    length=st.integers(4, 200),
    place=st.floats(0, 1),
)
@settings(max_examples=100, deadline=None)
def test_a_velocity_is_exact_where_the_acceleration_is_constant(speed, acceleration, rate, length, place):
    times = np.arange(length) / rate
    row = round(place * (length - 1))
    found, deviation = fit_velocity(0.3 + speed * times + acceleration / 2 * times**2, row, 0.0, rate)
    assert found == pytest.approx(speed + acceleration * times[row], abs=1e-7)
    assert deviation < 1e-6


@given(
    size=st.floats(0.05, 1.0),
    frequency=st.floats(0.1, 2.5),
    phase=st.floats(0, 2 * np.pi),
    noise=st.sampled_from([0.0, 1e-5, 1e-4, 1e-3, 1e-2]),
    rate=st.sampled_from(RATES),
    place=st.sampled_from([0.0, 0.3, 1.0]),
    seed=st.integers(0, 10_000),
)
@settings(max_examples=200, deadline=None)
def test_the_uncertainty_of_a_velocity_covers_the_truth(size, frequency, phase, noise, rate, place, seed):
    turns = 2 * np.pi * frequency
    times = np.arange(round(rate * SECONDS)) / rate
    row = round(place * (len(times) - 1))
    positions = read(size * np.sin(turns * times + phase), noise, seed=seed)
    found, deviation = fit_velocity(positions, row, max(noise, 1e-9), rate)
    assert abs(found - size * turns * np.cos(turns * times[row] + phase)) < SIGNIFICANT_DEVIATIONS * deviation


def test_the_uncertainty_of_a_velocity_falls_with_the_noise():
    times = np.arange(200) / 100
    doubts = [fit_velocity(np.sin(3 * times), 0, noise, 100)[1] for noise in (1e-2, 1e-3, 1e-4, 1e-6)]
    assert all(less < 0.5 * more for more, less in pairwise(doubts))


# At rest


@given(
    formula=st.sampled_from(FORMULAS),
    rate=st.sampled_from(RATES),
    noise=st.floats(0.0, 0.005),
    quantum=st.sampled_from([0.0, 0.0015, QUANTUM]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=40, deadline=None)
def test_a_recording_that_begins_at_rest_starts_at_zero(formula, rate, noise, quantum, seed):
    positions, velocities = swings(rate, seed=seed)
    dataset = seen(read(positions, noise, quantum, seed), velocities, rate, formula)
    found = find_start_velocities(dataset)
    assert found.derived.all()
    assert np.array_equal(found.values, np.zeros((EPISODES, 1)))
    assert np.array_equal(found.deviations, np.zeros((EPISODES, 1)))
    evidence = EpisodeBatch.of(dataset)
    assert np.array_equal(evidence.initial[:, 1], np.zeros(EPISODES))
    assert np.isnan(evidence.measured_velocities).all(), "derived velocities are no measurement"


@given(rate=st.sampled_from(RATES), stiffness=st.floats(4, 15), noise=st.floats(0.0, 0.003), seed=st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_a_joint_that_is_told_to_jump_in_the_first_row_starts_at_zero(rate, stiffness, noise, seed):
    """A critically damped servo goes to a goal: it is fastest 1/stiffness [s] after the start."""
    times = stiffness * np.arange(round(SECONDS * rate) + 1) / rate
    goals = np.random.default_rng(seed).uniform(-0.7, 0.7, (EPISODES, 1))
    positions = read(goals * (1 - (1 + times) * np.exp(-times)), noise, seed=seed)
    found = find_start_velocities(seen(positions, np.zeros_like(positions), rate))
    assert np.array_equal(found.values, np.zeros((EPISODES, 1)))


@given(noise=st.floats(0.001, 0.5), quantum=st.sampled_from([0.0, QUANTUM]))
@settings(max_examples=30, deadline=None)
def test_a_noisy_sensor_of_speed_starts_an_arm_in_motion_but_none_at_rest(noise: float, quantum: float):
    def sensed(start: float) -> Dataset:
        positions, velocities = swings(100.0, start)
        return seen(read(positions, 0.0, quantum), read(velocities, noise), 100.0, "")

    assert np.array_equal(find_start_velocities(sensed(0.0)).values, np.zeros((EPISODES, 1)))
    moving = sensed(
        3 * SIGNIFICANT_DEVIATIONS * (noise + 0.02)
    )  # the motion itself, up to 2 Hz, looks a little like noise
    found = find_start_velocities(moving)
    assert not found.derived.any()
    assert np.array_equal(found.values[:, 0], moving.states[moving.starts, 1].astype(float))


def test_what_is_left_of_the_settling_before_a_recording_is_no_motion():
    positions, velocities = swings(100.0)
    velocities[:, 0] = 1e-3  # [rad/s] measured without noise
    assert not find_start_velocities(seen(positions, velocities, 100.0, "")).values.any()
    assert find_start_velocities(seen(*swings(100.0, 0.5), 100.0, "")).values.all()


def test_an_arm_under_torques_starts_at_what_is_more_than_rounding():
    slow = seen(*swings(100.0, 0.01), 100.0, "", effort=True)
    assert (find_start_velocities(slow).values > 0).all()


@given(noise=st.floats(0.005, 0.5))
@settings(max_examples=20, deadline=None)
def test_an_arm_under_torques_has_the_noise_of_its_sensor_in_its_start(noise: float):
    positions, velocities = swings(100.0, 1.0)
    found = find_start_velocities(seen(positions, read(velocities, noise), 100.0, "", effort=True))
    assert not found.derived.any()
    assert (0.8 * noise < found.deviations).all() and (found.deviations < 1.2 * noise + 0.02).all()


# In motion


def cut(rate: float, noise: float, seed: int) -> tuple[StartVelocities, np.ndarray]:
    """Return what is told of 12 pieces of 2 s cut out of one motion of up to 1.3 Hz, and the true velocities."""
    rng = np.random.default_rng(seed)
    times = np.arange(round(24 * rate)) / rate
    waves = list(zip((0.8, 0.5, 0.25), 2 * np.pi * np.array([0.23, 0.61, 1.3]), rng.uniform(0, 6, 3), strict=True))
    positions = sum(size * np.sin(turns * times + phase) for size, turns, phase in waves)
    velocities = sum(size * turns * np.cos(turns * times + phase) for size, turns, phase in waves)
    pieces = read(positions, noise, seed=seed).reshape(12, -1)
    return find_start_velocities(seen(pieces, np.zeros_like(pieces), rate)), velocities.reshape(12, -1)[:, 0]


@given(rate=st.sampled_from(RATES), noise=st.sampled_from([0.0, 1e-5, 1e-4, 1e-3]), seed=st.integers(0, 1000))
@settings(max_examples=60, deadline=None)
def test_pieces_of_a_motion_start_at_their_speed(rate: float, noise: float, seed: int):
    found, true = cut(rate, noise, seed)
    assert (found.deviations > 0).all()
    assert (np.abs(found.values[:, 0] - true) < SIGNIFICANT_DEVIATIONS * found.deviations[:, 0]).all()
    if noise < 1e-3 and rate > 30:
        assert np.abs(found.values[:, 0] - true).max() < 0.1 * np.abs(true).max()


def test_few_odd_episodes_do_not_set_the_others_in_motion():
    moving, still = swings(100.0, 1.0)[0], swings(100.0)[0]
    found = find_start_velocities(seen(np.concatenate([moving[:2], still[2:]]), np.zeros_like(still), 100.0))
    assert (found.values[:2] > 0.9).all()
    assert np.array_equal(found.values[2:], np.zeros((EPISODES - 2, 1)))


def test_windows_cut_out_of_an_episode_start_at_its_speed_there():
    positions, velocities = swings(100.0)
    evidence = EpisodeBatch.of(seen(positions, velocities, 100.0))
    for row in (20, 60, 130):
        part = cut_window(evidence, 3, row, 50)
        assert part.initial_velocities[0, 0] == pytest.approx(velocities[3, row], abs=0.05)
        assert (
            abs(part.initial_velocities[0, 0] - velocities[3, row])
            < SIGNIFICANT_DEVIATIONS * part.velocity_deviations[0, 0]
        )
        assert np.array_equal(part.estimated_velocities, part.initial_velocities)


# One rule


def test_rollouts_start_where_evidence_does():
    """For the same dataset, `nas evaluate`, the training of φ and ψ, and `nas gap` begin alike."""
    for rested, moving in ((True, False), (False, True)):
        dataset = seen(*(swings(100.0, 0.5 * moving)), 100.0)
        evidence = EpisodeBatch.of(dataset)
        assert (evidence.initial_velocities == 0).all() == rested
        simulator = LinearSimulator(dataset.joints, np.eye(2), np.zeros((2, 1)))
        assert np.array_equal(read_initial_states(dataset, None), evidence.initial)
        assert np.array_equal(read_initial_states(dataset, simulator), evidence.initial)


def test_episodes_of_no_rows_start_at_zero():
    dataset = seen(*swings(100.0, 1.0), 100.0)
    longer = replace(dataset, lengths=np.append(dataset.lengths, 0))
    assert find_start_velocities(longer).values[-1] == 0
