"""Episodes of a dataset: one that differs from the others is named, and in what."""

import numpy as np
from support.recording_samples import pendulum, recorded_on, wander

from nas_data.reports.dataset_page import find_differing, measure_episodes, measure_steps

ROWS, STILL, LATE = 80, 3, 2


def test_the_episode_that_differs_most_comes_first_and_equal_ones_are_not_named():
    lengths = np.array([5.0, 5.0, 5.1, 4.9, 9.0])
    assert find_differing({"length [s]": lengths[:4], "travel": np.ones(4)}) == {}
    found = find_differing({"length [s]": lengths, "travel": np.array([0.9, 0.9, 0.0, 0.9, 0.9])})
    assert list(found.items()) == [(2, ["low travel"]), (4, ["high length"])]


def test_an_arm_that_stood_still_and_a_clock_that_stuttered_are_found():
    commands = [command.copy() for command in wander((ROWS,)) * 6]
    commands[STILL][:] = commands[STILL][:1]
    dataset = recorded_on(pendulum(), commands)
    assert measure_steps(dataset) == []  # without a clock
    assert "uneven steps" not in measure_episodes(dataset, [])
    steps = [np.full(ROWS - 1, 1 / dataset.fps) for _ in commands]
    steps[LATE][::2] *= 1.5
    measured = measure_episodes(dataset, steps)
    assert np.allclose(measured["length [s]"], ROWS / dataset.fps)
    assert measured["uneven steps"].nonzero()[0].tolist() == [LATE]
    found = find_differing(measured)
    assert set(found) == {LATE, STILL}
    assert found[LATE] == ["high uneven steps"] and {"low travel", "low top speed"} <= set(found[STILL])
