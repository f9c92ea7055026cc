"""φ on a source that remembers: while it learns, the source's memory is kept as it is in a closed loop."""

from dataclasses import replace

import numpy as np
import pytest
from support.linear_samples import silent
from support.recording_samples import pendulum, recorded_on, wander
from support.training_samples import TINY

from nas_data.effects.backlash import Backlash
from nas_data.effects.speed_limit import SpeedLimit
from nas_data.models.episodes import read_episodes
from nas_data.models.stateful_source import predict_with_memory, start_at_windows, step_from
from nas_data.models.training import ModelTraining
from nas_data.pairing import pair

PLAY, SLOW = Backlash(joint="pendulum", half_width=0.1), SpeedLimit(joint="pendulum", speed=2.0)

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def swings():
    return recorded_on(pendulum(PLAY, SLOW), wander((80, 45, 60)))


def test_the_true_source_predicts_what_was_measured_once_its_memory_is_kept(swings):
    source = pendulum(PLAY, SLOW)
    assert source.remembers and not pendulum().remembers
    forgetful, kept = pair(swings, source), predict_with_memory(swings, source)
    assert np.abs(forgetful.sim_states - swings.next_states).max() > 0.01
    np.testing.assert_allclose(kept.sim_states[:, 0], swings.next_states[:, 0], atol=1e-4)


def test_windows_begin_where_the_source_stands_after_what_was_measured_before(swings):
    source = pendulum(PLAY, SLOW)
    episodes, starts = read_episodes(predict_with_memory(swings, source)), np.array([50, 0, 7])
    stepper = start_at_windows(source, episodes, starts, longest=50)
    columns = [
        np.stack([getattr(episode, name)[start].numpy() for episode, start in zip(episodes, starts, strict=True)])
        for name in ("states", "commands", "predicted")
    ]
    np.testing.assert_allclose(step_from(stepper, *columns[:2]), columns[2], atol=1e-5)


def test_nothing_is_left_to_learn_where_the_source_is_the_target(swings):
    source = pendulum(PLAY, SLOW)
    training = ModelTraining("delta", pair(swings, source), replace(TINY, updates=40), source, device="cpu")
    silent(training.model)
    for update in (0, 7, 39):
        assert float(training.phase.loss(update).detach()) < 1e-3
