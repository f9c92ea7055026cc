"""`nas benchmark training`: the time to a loss is the time of the first epoch that is as good."""

import json
import math
import tempfile
import time
from dataclasses import replace
from itertools import pairwise

import pytest
from support.training_samples import TINY

from nas_data.benchmarks.training import FAST, PAPER, RECIPE, TUNED, Point, Race, Stopwatch, find_time_to_loss, learn
from nas_data.cli import main
from nas_data.models.training import ModelTraining

CURVE = (Point(1.0, 2.0, 0.9), Point(2.0, 5.0, 0.5), Point(3.0, 6.0, 0.5), Point(4.0, 8.0, 0.2))


@pytest.mark.parametrize(
    ("loss", "expected"),
    [(1.0, (1.0, 2.0)), (0.9, (1.0, 2.0)), (0.6, (2.0, 5.0)), (0.2, (4.0, 8.0)), (0.1, (math.inf, math.inf))],
)
def test_a_loss_is_reached_by_the_first_epoch_that_is_as_low(loss, expected):
    assert find_time_to_loss(CURVE, loss) == expected


def test_a_loss_that_ours_never_reaches_counts_as_none_of_the_papers_speed():
    race = Race(paper=CURVE, tuned=CURVE[:2], fast=CURVE[:3], recipe=CURVE[:1])
    seconds = race.seconds()
    assert seconds["paper"] == (4.0, 8.0)
    assert seconds["tuned"] == seconds["nas, to tuned's loss"] == (2.0, 5.0)
    assert seconds["nas, to paper's loss"] == seconds["recipe, to paper's loss"] == (math.inf, math.inf)


def test_the_sides_differ_in_what_they_are_said_to_differ_in():
    assert (PAPER.batch, PAPER.rate, PAPER.cosine, PAPER.segment) == (1, 0.01, False, 0)
    assert replace(TUNED, rate=PAPER.rate) == PAPER
    assert replace(RECIPE, relative=FAST.relative, shortcut=FAST.shortcut) == FAST
    assert not RECIPE.relative and not RECIPE.shortcut
    assert FAST.updates == 0, "all sides train by teacher forcing"


def test_a_training_is_what_it_would_be_without_being_watched(swings):
    curve = learn(swings, replace(TINY, epochs=4), lambda point: False)
    assert len(curve) == 4
    assert all(later.loss <= point.loss and later.cpu > point.cpu for point, later in pairwise(curve))
    assert curve[-1].loss < ModelTraining("delta", swings, TINY, device="cpu").validation_error()
    again = learn(swings, replace(TINY, epochs=4), lambda point: point.loss <= curve[1].loss)
    assert [point.loss for point in again] == [point.loss for point in curve[: len(again)]]
    assert len(again) <= 2


def test_a_clock_that_stands_still_counts_nothing(monkeypatch):
    now = iter(range(100))
    monkeypatch.setattr(time, "process_time", lambda: float(next(now)))
    clock = Stopwatch()  # 0
    clock.stop()  # 1
    next(now)  # what is done meanwhile
    clock.go()  # 3
    clock.stop()  # 4
    assert clock.cpu == 2.0
    assert clock.wall > 0


@pytest.mark.slow
def test_the_benchmark_answers_with_its_ratios_and_leaves_nothing_behind(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert main(["benchmark", "training", "--episodes", "20", "--budget", "1", "--seeds", "1", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert set(answer["ratios"]) == {"training_vs_paper", "training_vs_tuned", "recipe_vs_paper"}
    assert answer["wanted"] == {"training_vs_paper": 8.0, "training_vs_tuned": 1.0}
    paper, ours = (answer["seconds"][side]["cpu"] for side in ("paper", "nas, to paper's loss"))
    assert len(paper) == len(ours) == 1
    assert all(1 <= seconds < 3 for seconds in paper), "the paper's recipe gets its budget, and no more than an epoch"
    assert answer["rounds"]["training_vs_paper"] == pytest.approx(
        [0.0 if mine is None else theirs / mine for theirs, mine in zip(paper, ours, strict=True)]
    )
    assert list(tmp_path.glob("nas-*")) == []
