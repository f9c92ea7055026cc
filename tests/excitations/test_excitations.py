"""Every excitation of the folder stays within limits, repeats itself for a seed, and is what its name says."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nas_data import registry
from nas_data.errors import OptionError, UnknownName
from nas_data.excitations.base import Excitation, find_excitation, make_excitation, parse

NAMES = registry.list_names("excitations")
LOW, HIGH = np.array([-1.5, -0.3, 0.2]), np.array([1.5, 0.1, 2.0])
PERIOD = 0.01

limits = st.lists(st.tuples(st.floats(-10, 10), st.floats(0, 10)), min_size=1, max_size=4)


def draw(excitation: Excitation, seed=0, episodes=20, steps=600, low=LOW, high=HIGH) -> np.ndarray:
    return excitation.commands(np.random.default_rng(seed), episodes, steps, PERIOD, low, high)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=20, deadline=None)
@given(limits=limits, seed=st.integers(0, 2**32), share=st.floats(0.01, 1), steps=st.integers(1, 300))
def test_commands_lie_within_the_share_of_the_limits(name, limits, seed, share, steps):
    low = np.array([pair[0] for pair in limits])
    high = low + np.array([pair[1] for pair in limits])
    commands = draw(find_excitation(name)(share=share), seed, 3, steps, low, high)
    assert commands.shape == (3, steps, len(low))
    assert np.isfinite(commands).all()
    assert (commands >= low).all()
    assert (commands <= high).all()
    beyond = np.abs(commands - (low + high) / 2) - share * (high - low) / 2
    assert beyond.max() < 1e-9


@pytest.mark.parametrize("name", ["sine", "multisine"])
def test_a_band_of_frequencies_begins_with_the_slowest(name):
    with pytest.raises(OptionError, match="give both, slowest first"):
        parse(f"{name}:slowest=8,fastest=2")
    assert parse("chirp:slowest=8,fastest=2").slowest == 8  # it starts at 8 Hz


@pytest.mark.parametrize("name", NAMES)
def test_same_seed_same_bits_and_another_seed_others(name):
    excitation = find_excitation(name)()
    assert np.array_equal(draw(excitation, seed=3), draw(excitation, seed=3))
    assert not np.array_equal(draw(excitation, seed=3), draw(excitation, seed=4))


@pytest.mark.parametrize("name", NAMES)
def test_joints_and_episodes_move_differently_and_use_their_range(name):
    share = draw(find_excitation(name)(), episodes=40)
    shape = (share - (LOW + HIGH) / 2) / ((HIGH - LOW) / 2)
    assert len(np.unique(shape.round(9), axis=0)) > 4
    assert np.abs(shape[..., 0] - shape[..., 1]).max() > 0.1
    reach = find_excitation(name)().share
    assert shape.max() > 0.5 * reach
    assert shape.min() < -0.5 * reach


@pytest.mark.parametrize("name", NAMES)
def test_text_reads_back_as_the_same_excitation(name):
    excitation = find_excitation(name)()
    for field in fields(excitation):
        changed = replace(excitation, **{field.name: 0.5 if field.name in ("share", "slowest") else 2})
        text = f"{name}:" + ",".join(f"{key}={value!r}" for key, value in changed.to_json()["parameters"].items())
        assert parse(text) == changed
    assert parse(name) == excitation
    assert excitation.to_json()["excitation"] == name


def test_mistakes_are_answered_with_choices():
    with pytest.raises(UnknownName, match="babbling, chirp"):
        parse("wobble")
    with pytest.raises(OptionError, match="share, slowest, smallest"):
        parse("sine:frequency=2")
    with pytest.raises(OptionError, match="above zero"):
        parse("steps:seconds=0")
    with pytest.raises(OptionError, match="whole number"):
        make_excitation("babbling", {"every": 2.5})
    with pytest.raises(OptionError, match="0 … 1"):
        parse("steps:share=1.2")
    with pytest.raises(OptionError, match="NAME:PARAMETER"):
        parse("steps:seconds")
    with pytest.raises(OptionError, match="above zero"):
        parse("steps:seconds=nan")


def test_steps_are_held_for_a_second_and_fill_the_range_evenly():
    commands = draw(parse("steps"), episodes=2000, steps=300)
    held = commands.reshape(2000, 3, 100, 3)
    assert (held == held[:, :, :1]).all()
    shape = (held[:, :, 0] - LOW) / (HIGH - LOW)
    assert shape.mean() == pytest.approx(0.5, abs=0.01)
    assert shape.std() == pytest.approx(1 / np.sqrt(12), abs=0.01)
    assert np.corrcoef(shape[:, 0].T)[0, 1] == pytest.approx(0, abs=0.1)


def test_babbling_changes_every_few_steps():
    commands = draw(parse("babbling:every=7"), steps=71)
    changes = np.flatnonzero(np.abs(np.diff(commands[0, :, 0])) > 0) + 1
    assert changes.tolist() == list(range(7, 71, 7))


def test_ramps_join_random_targets_by_straight_lines():
    commands = draw(parse("ramps:every=7"), steps=71)
    bends = np.flatnonzero(np.abs(np.diff(commands[0, :, 0], n=2)) > 1e-9) + 1
    assert bends.tolist() == list(range(7, 70, 7))
    targets = (draw(parse("ramps:every=100"), episodes=2000)[:, ::100] - LOW) / (HIGH - LOW)
    assert targets.mean() == pytest.approx(0.5, abs=0.01)
    assert targets.std() == pytest.approx(1 / np.sqrt(12), abs=0.01)
    assert np.corrcoef(targets[:, 0].T)[0, 1] == pytest.approx(0, abs=0.1)


def test_triangles_move_at_constant_speed_with_sharp_turns():
    commands = draw(parse("triangle:speed=0.5"))
    speeds = np.abs(np.diff(commands, axis=1)) / PERIOD
    cruise = np.median(speeds, axis=1)
    assert (cruise > 0.24).all()
    assert (cruise < 0.501).all()
    assert (speeds <= cruise[:, None] + 1e-9).all()
    assert np.mean(speeds > cruise[:, None] - 1e-9) > 0.9


@pytest.mark.parametrize("name", ["sine", "triangle", "chirp"])
def test_smooth_signals_start_in_the_middle(name):
    assert draw(find_excitation(name)())[:, 0] == pytest.approx(np.tile((LOW + HIGH) / 2, (20, 1)))


def test_a_chirp_sweeps_from_its_slowest_to_its_fastest_frequency():
    commands = draw(parse("chirp:slowest=0.5,fastest=4"), episodes=1, steps=2000)[0, :, 0]
    crossings = np.flatnonzero(np.diff(np.sign(commands)) != 0) * PERIOD
    halves = np.diff(crossings)
    assert 1 / (2 * halves[-1]) == pytest.approx(4, rel=0.1)
    assert 1 / (2 * halves[1]) == pytest.approx(0.5, rel=0.35)
    assert np.polyfit(np.arange(len(halves)), halves, 1)[0] < 0


def test_a_multisine_has_power_at_its_frequencies_only():
    commands = draw(parse("multisine:slowest=0.5,fastest=4,count=4"), episodes=1, steps=2000)[0, :, 0]
    power = np.abs(np.fft.rfft(commands - commands.mean())) ** 2
    frequencies = np.fft.rfftfreq(2000, PERIOD)
    inside = np.isin(frequencies, [0.5, 1.0, 2.0, 4.0])
    assert power[inside].sum() > 0.999 * power.sum()


def test_sines_have_the_frequencies_and_sizes_asked_for():
    commands = draw(parse("sine:slowest=0.5,fastest=2,smallest=0.5,share=0.6"), episodes=200, steps=1000)
    shape = (commands - (LOW + HIGH) / 2) / ((HIGH - LOW) / 2)
    size = np.abs(shape).max(axis=1)
    assert size.min() > 0.6 * 0.5 * 0.95
    assert size.max() <= 0.6
    crossings = (np.diff(np.sign(shape), axis=1) != 0).sum(axis=1)
    assert crossings.min() >= 2 * 0.5 * 10 - 3
    assert crossings.max() <= 2 * 2 * 10 + 3
