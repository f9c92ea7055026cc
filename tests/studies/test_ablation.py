"""Ablations: what is drawn is nested, and what is told follows from the numbers."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nas_data import registry
from nas_data.dataset.dataset import Dataset
from nas_data.errors import OptionError
from nas_data.models.presets import preset
from nas_data.models.split import select_frames
from nas_data.reports.figures import AblationCurve, draw_error_over_amount
from nas_data.reports.style import to_png
from nas_data.runs.executors import FOLDER as EXECUTORS
from nas_data.runs.executors import find_workers
from nas_data.runs.parallel import run_jobs
from nas_data.studies.ablation.evaluation import TrainingData, TrialResult
from nas_data.studies.ablation.kinds.base import FOLDER as KINDS
from nas_data.studies.ablation.kinds.base import ModelKind, find_kind
from nas_data.studies.ablation.summary import MAX_EXCESS, Spread, SweepSummary
from nas_data.studies.ablation.sweep_data import Amount, divide, draw, parse
from nas_data.studies.ablation.trial import Config
from nas_data.studies.ablation.write import format_markdown, format_table, make_rows, write

RATE = 5.0  # [Hz] a low rate: stretches of ten seconds in short columns
MANY = settings(max_examples=60, deadline=None)
LENGTHS = st.lists(st.integers(2, 400), min_size=3, max_size=15)
SEED = st.integers(0, 1000)


def lasting(lengths) -> Dataset:
    """Return a dataset of episodes of which nothing but the lengths is known."""
    return Dataset({}, {}, np.array(lengths), RATE)


def frames(runs) -> set[int]:
    """Return the frames of runs, which must not overlap."""
    found = [frame for start, stop in runs for frame in range(start, stop)]
    assert len(set(found)) == len(found)
    return set(found)


# subsets


@MANY
@given(LENGTHS, st.floats(0.01, 0.99), SEED)
def test_what_is_held_out_and_what_trains_are_all_and_disjoint(lengths, share, seed):
    train, held = divide(len(lengths), share, seed)
    assert train and held
    assert sorted(train + held) == list(range(len(lengths)))
    assert (train, held) == divide(len(lengths), share, seed)


@MANY
@given(LENGTHS, SEED, st.data())
def test_the_smaller_of_two_counts_is_part_of_the_larger_and_of_the_training_episodes(lengths, seed, data):
    dataset, (train, _) = lasting(lengths), divide(len(lengths), 0.2, seed)
    few = data.draw(st.integers(1, len(train)))
    many = data.draw(st.integers(few, len(train)))
    small, large = (draw(dataset, train, Amount(count, "episodes"), seed) for count in (few, many))
    assert (len(small), len(large)) == (few, many)
    assert set(small) <= set(large) <= {(rows.start, rows.stop) for rows in map(dataset.episode, train)}


@MANY
@given(LENGTHS, SEED, st.data())
def test_the_smaller_of_two_lengths_is_part_of_the_larger_and_as_long_as_asked_for(lengths, seed, data):
    dataset, (train, _) = lasting(lengths), divide(len(lengths), 0.2, seed)
    there = int(dataset.lengths[train].sum())
    short = data.draw(st.integers(1, there))
    long = data.draw(st.integers(short, there))
    small, large = (frames(draw(dataset, train, Amount(n / RATE / 60, "minutes"), seed)) for n in (short, long))
    assert (len(small), len(large)) == (short, long)
    assert small <= large <= frames((rows.start, rows.stop) for rows in map(dataset.episode, train))


@MANY
@given(LENGTHS, SEED)
def test_all_minutes_are_the_whole_training_episodes(lengths, seed):
    dataset, (train, _) = lasting(lengths), divide(len(lengths), 0.2, seed)
    whole = [(rows.start, rows.stop) for rows in map(dataset.episode, train)]
    assert draw(dataset, train, Amount(math.inf, "minutes"), seed) == whole
    assert draw(dataset, train, Amount(math.inf, "episodes"), seed) == whole


def test_minutes_are_drawn_from_several_episodes_and_other_seeds_draw_others():
    dataset, minute = lasting([600] * 6), Amount(1.0, "minutes")
    drawn = [draw(dataset, range(6), minute, seed) for seed in (0, 1)]
    assert drawn[0] != drawn[1]
    for runs in drawn:
        assert len({start // 600 for start, _ in runs}) > 2


def test_more_than_the_training_episodes_hold_is_refused():
    dataset = lasting([300] * 10)
    with pytest.raises(OptionError, match="--counts asks for 9 episodes, but 8 training episodes hold 8"):
        draw(dataset, range(8), Amount(9, "episodes"), 0)
    with pytest.raises(OptionError, match="--minutes asks for 9 minutes, but 8 training episodes hold 8 minutes"):
        draw(dataset, range(8), Amount(9, "minutes"), 0)


def test_the_columns_of_a_subset_are_those_of_its_frames(swings):
    with pytest.raises(OptionError, match="less than a frame"):
        draw(swings, range(swings.n_episodes), Amount(1e-4, "minutes"), 3)
    runs = draw(swings, range(swings.n_episodes), Amount(0.1, "minutes"), 3)
    subset = select_frames(swings, runs)
    np.testing.assert_array_equal(subset.states, swings.states[sorted(frames(runs))])


# amounts


def test_amounts_are_sorted_and_counted_once():
    assert parse(("10,2", "all", "2"), "episodes") == (
        Amount(2, "episodes"),
        Amount(10, "episodes"),
        Amount(math.inf, "episodes"),
    )
    assert [str(amount) for amount in parse(("all,0.5,1",), "minutes")] == ["0.5 minutes", "1 minute", "all minutes"]


@pytest.mark.parametrize("word", ["ten", "0", "-3", "2.5", "nan", "inf"])
def test_what_is_no_amount_is_refused(word):
    with pytest.raises(OptionError, match=f"--counts has '{word}'; give whole numbers above 0, or all"):
        parse((word,), "episodes")


# kinds and executors


@pytest.mark.parametrize("name", registry.list_names(KINDS))
def test_every_kind_of_the_folder_has_a_name_of_its_own(name):
    kind = find_kind(name)
    assert isinstance(kind, ModelKind)
    assert sum(find_kind(other).label == kind.label for other in registry.list_names(KINDS)) == 1
    assert kind.needs_source or not (kind.names or kind.needs_pairs)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow if name == "ray" else ()) for name in registry.list_names(EXECUTORS)],
)
def test_every_executor_of_the_folder_returns_each_result_with_its_number(name):
    assert dict(run_jobs(abs, [-3, 2, -1], find_workers(name, 1))) == {0: 3, 1: 2, 2: 1}


# what a sweep found


def result(kind, amount, seed, degrees, baseline=10.0, unit="episodes"):
    """Return a trial's result with known errors."""

    def errors(scale):
        found = {kind: degrees, "source": baseline, "hold": 20.0}
        return {
            name: {"mean_of_episodes": None if math.isinf(value) else math.radians(value * scale)}
            for name, value in found.items()
        }

    count = 40 if amount == "all" else amount
    config = Config(kind, Amount.of(amount, unit), seed, preset("fast"), 0.2)
    data = TrainingData(episodes=count, frames=100 * count, minutes=float(count))
    return config, TrialResult(training_data=data, open_loop=errors(1.0), one_step=errors(0.1))


def swept():
    """Return results whose medians are 4, 2.08 and 2 for φ, and 5, 3, and 2.5 for ψ, over three seeds."""
    known = {
        "delta": {10: (3.0, 4.0, 9.0), 20: (2.0, 2.08, 2.2), "all": (1.9, 2.0, 2.1)},
        "forward": {10: (5.0, 5.0, 5.0), 20: (3.0, 2.0, math.inf), "all": (2.5, 2.4, 2.6)},
    }
    return [
        result(kind, amount, seed, value, baseline=9.0 + seed)
        for kind, amounts in known.items()
        for amount, values in amounts.items()
        for seed, value in enumerate(values)
    ]


def test_the_sentence_names_the_smallest_amount_within_five_percent_of_the_best():
    assert MAX_EXCESS == 0.05
    found = SweepSummary.of(swept())
    assert {kind: cell.amount.word for kind, cell in found.enough().items()} == {"delta": 20, "forward": "all"}
    assert found.sentence() == (
        "Smallest amount of data whose median open-loop error is within 5% of the best. "
        "source + φ: 20 episodes (2.08°; 2° with 40 episodes). "
        "ψ: 40 episodes (2.5°), the largest amount tried, so more may help."
    )


def test_the_best_may_lie_before_the_last_and_a_kind_may_diverge_everywhere():
    values = [result("delta", n, 0, error) for n, error in ((1, 5.0), (2, 1.0), (3, 1.04))]
    told = SweepSummary.of([*values, result("forward", 1, 0, math.inf)]).sentence()
    assert told.endswith("source + φ: 2 episodes (1°). ψ diverges with every amount.")


def test_the_sentence_says_where_nothing_learned_is_as_good():
    values = [result(kind, 2, 0, error, baseline=1.0) for kind, error in (("delta", 1.0), ("forward", 0.9))]
    told = SweepSummary.of(values).sentence()
    assert "(1°); no better than the baseline 'source' (1°). ψ" in told
    assert told.endswith("ψ: 2 episodes (0.9°).")


def test_the_table_holds_medians_ends_and_baselines():
    table = {(row[0], row[1]): row[2:] for row in make_rows(SweepSummary.of(swept()))}
    assert table["source + φ", "10 episodes"] == ("3", "4.000", "3.000 … 9.000", "0.4000", "0.3000 … 0.9000")
    assert table["ψ", "20 episodes"][:3] == ("3", "3.000", "2.000 … diverged")
    assert table["source", ""] == ("3", "10.000", "9.000 … 11.000", "1.0000", "0.9000 … 1.1000")
    assert table["hold", ""] == ("3", "20.000", "", "2.0000", "")
    assert ("command", "") not in table, "torques are no positions"
    found = SweepSummary.of(swept())
    for row in make_rows(found):
        assert all(word in format_markdown(found) for word in row)
        assert all(word in format_table(found) for word in row)


@given(st.lists(st.floats(0, 10) | st.just(math.inf), min_size=1, max_size=9))
def test_the_median_is_numpys_and_infinite_where_half_diverged(values):
    with np.errstate(invalid="ignore"):
        expected = np.median(values)
    assert Spread(tuple(values)).median == (expected if np.isfinite(expected) else math.inf)


def test_failed_trials_are_told_and_do_not_count(tmp_path):
    failed = (result("delta", 30, 1, 1.0)[0], TrialResult(failed="The arm fell over."))
    found = SweepSummary.of([*swept(), failed])
    assert found.cells == SweepSummary.of(swept()).cells
    assert found.failed == ["delta, 30 episodes, seed 1: The arm fell over."]
    only = SweepSummary.of([failed])
    assert only.sentence() == "No trial succeeded."
    assert set(write(tmp_path, only, {})) == {"result", "table"}


def test_the_files_hold_what_was_found(tmp_path):
    found = SweepSummary.of(swept())
    files = write(tmp_path, found, {"trials": 18})
    content = json.loads(files["result"].read_text())
    assert content["trials"] == 18 and content["enough"] == {"delta": 20, "forward": "all"}
    assert content["kinds"]["forward"][1]["open_loop"]["max"] is None, "infinity is no JSON"
    assert content["kinds"]["delta"][2]["episodes"] == 40
    assert content["baselines"]["source"]["open_loop"]["median"] == pytest.approx(math.radians(10))
    assert files["table"].read_text().endswith(f"{found.sentence()}\n")
    assert files["figure"].read_bytes().startswith(b"\x89PNG")
    again = write(tmp_path / "again", found, {})
    assert again["figure"].read_bytes() == files["figure"].read_bytes()


def test_the_figure_shows_medians_in_degrees_over_amounts_and_baselines_as_lines():
    amounts, median = np.array([1.0, 10.0]), np.radians([4.0, 2.0])
    curve = AblationCurve(amounts, median / 2, median, median * 2)
    figure = draw_error_over_amount({"open_loop": {"ψ": curve}}, {"open_loop": {"source": math.radians(3)}}, "minutes")
    (axes,) = figure.axes
    lines = {line.get_label(): line for line in axes.lines}
    np.testing.assert_allclose(lines["ψ"].get_ydata(), [4.0, 2.0])
    np.testing.assert_allclose(lines["source"].get_ydata(), [3.0, 3.0])
    band = axes.collections[0].get_paths()[0].vertices
    assert band[:, 1].min() == pytest.approx(1.0) and band[:, 1].max() == pytest.approx(8.0)
    assert axes.get_xscale() == axes.get_yscale() == "log"
    assert axes.get_xlabel() == "minutes of training data"


def test_one_seed_that_went_astray_does_not_squash_the_others():
    amounts, median = np.array([1.0, 10.0]), np.radians([4.0, 2.0])
    curve = AblationCurve(amounts, median, median, np.radians([400.0, 2.0]))
    (axes,) = draw_error_over_amount({"open_loop": {"ψ": curve}}, {"open_loop": {"hold": math.inf}}, "minutes").axes
    assert axes.get_ylim()[1] == pytest.approx(8.0)
    assert len(axes.lines) == 1, "a baseline that diverged has no line"


@pytest.mark.parametrize("amounts", [[1.0], [1.0, 2.0]])
def test_a_figure_is_made_where_every_training_diverged(amounts):
    astray = np.full(len(amounts), math.inf)
    curve = AblationCurve(np.array(amounts), astray, astray, astray)
    figure = draw_error_over_amount(
        {"open_loop": {"φ": curve}}, {"open_loop": {"hold": 0.1, "source": 0.01}}, "minutes"
    )
    assert to_png(figure).startswith(b"\x89PNG")
    (low, high), (axes,) = figure.axes[0].get_xlim(), figure.axes
    assert low < amounts[0] <= amounts[-1] < high
    assert [line.get_label() for line in axes.lines] == ["φ", "hold", "source"]
