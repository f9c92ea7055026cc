"""Committees of learned models: each simulation follows one member for an episode, and the next in the next."""

import dataclasses
import json

import numpy as np
import pytest
from linear_samples import network
from test_envs import small_model
from test_frozen import CLOSE, episode, play
from test_policies import SMALL, Interrupted, assert_same_bits, stop_after, weights

from nas_data import cli
from nas_data.envs.ergo_reacher import TASK
from nas_data.envs.loop.plant import Plant
from nas_data.errors import CheckpointError, JointMismatch
from nas_data.models.augmented import LearnedStepper
from nas_data.models.frozen.committee import Committee
from nas_data.models.frozen.freeze import freeze
from nas_data.policies.learner import Learner, Training
from nas_data.policies.policy import CONFIG, load_policy
from nas_data.policies.ppo import train

MODELS = [network(seed=seed) for seed in range(3)]
BEFORE = 20  # steps before some rows begin anew


def committee(rows: int) -> Committee:
    return Committee([freeze(model, rows) for model in MODELS])


def alone(rows: int, steps) -> np.ndarray:
    """Return what each member says of all rows, shape (members, T, B, 2n)."""
    return np.stack([play(freeze(model, rows), steps) for model in MODELS])


def test_rows_follow_the_members_in_turn():
    steps = episode(MODELS[0], 5)
    found, said = play(committee(5), steps), alone(5, steps)
    for row in range(5):
        np.testing.assert_allclose(found[:, row], said[row % 3, :, row], **CLOSE)
    assert np.abs(said[0] - said[1]).max() > 0.1, "the members say the same: the test shows nothing"


def test_a_row_that_begins_anew_follows_the_next_member_without_a_memory():
    steps = episode(MODELS[0], 5)
    together = committee(5)
    play(together, steps[:BEFORE])
    together.forget(np.array([1, 2]))
    found, going_on, fresh = play(together, steps[BEFORE:]), alone(5, steps)[:, BEFORE:], alone(5, steps[BEFORE:])
    for row, expected in ((0, going_on[0]), (1, fresh[2]), (2, fresh[0]), (3, going_on[0]), (4, going_on[1])):
        np.testing.assert_allclose(found[:, row], expected[:, row], **CLOSE)


def test_where_all_begin_anew_it_is_as_at_first():
    steps = episode(MODELS[0], 5)
    together = committee(5)
    play(together, steps[:BEFORE])
    together.forget(np.array([0, 4]))
    together.forget(slice(None))
    np.testing.assert_array_equal(play(together, steps), play(committee(5), steps))


def members(folder) -> tuple[str, ...]:
    return tuple(small_model(folder / f"phi{member}", gain=gain) for member, gain in enumerate((0.01, 0.005, 0.0)))


def plant_of(folders) -> Plant:
    return Plant("ErgoReacher", checkpoint=folders[0], others=tuple(folders[1:]))


def test_each_simulation_of_a_plant_is_corrected_by_its_own_member(tmp_path):
    folders = members(tmp_path)
    together = plant_of(folders).stepper(3)
    single = [Plant("ErgoReacher", checkpoint=folder).stepper(3) for folder in folders]
    commands = np.random.default_rng(0).uniform(-1, 1, (30, 3, len(TASK.joints)))
    for stepper in (together, *single):
        stepper.reset(np.zeros((3, 2 * len(TASK.joints))))
    for command in commands:
        found, said = together.step(command), [stepper.step(command) for stepper in single]
        for row in range(3):
            np.testing.assert_allclose(found[row], said[row][row], rtol=0, atol=1e-9)
    assert np.abs(said[0][0] - said[2][0]).max() > 1e-3


def test_a_plants_description_names_all_members_and_one_alone_is_described_as_before(tmp_path):
    folders = members(tmp_path)
    described = plant_of(folders).describe()
    assert json.loads(json.dumps(described)) == described
    assert described != plant_of((folders[0], folders[2], folders[1])).describe()
    assert described["others"] == [
        Plant("ErgoReacher", checkpoint=folder).describe()["model"] for folder in folders[1:]
    ]
    assert "others" not in Plant("ErgoReacher", checkpoint=folders[0]).describe()


def test_members_of_another_kind_or_robot_are_refused(tmp_path):
    phi, psi = small_model(tmp_path / "phi"), small_model(tmp_path / "psi", "forward")
    with pytest.raises(CheckpointError, match="forward model; a delta model is needed"):
        plant_of((phi, psi)).check()
    with pytest.raises(JointMismatch, match="left, right"):
        plant_of((phi, small_model(tmp_path / "other", joints=("left", "right")))).check()
    strange = network("delta", ("left", "right"))
    with pytest.raises(JointMismatch, match="left, right"):
        LearnedStepper(TASK.simulator().stepper(2), network("delta", TASK.joints), [strange])


def test_an_interrupted_training_with_a_committee_goes_on_to_the_same_bits(tmp_path):
    plant = plant_of(members(tmp_path))
    hyperparameters = dataclasses.replace(SMALL, rollout=1024)  # 256 steps of each arm, and an episode has 100
    training = Training(plant, 0, (Learner.SEGMENT + 2) * hyperparameters.rollout, hyperparameters)
    train(training, tmp_path / "whole", lambda _: None)
    with pytest.raises(Interrupted):
        train(training, tmp_path / "stopped", stop_after(Learner.SEGMENT + 1))
    train(training, tmp_path / "stopped", lambda _: None)
    assert_same_bits(weights(tmp_path / "whole"), weights(tmp_path / "stopped"))


def test_policy_train_takes_several_checkpoints_and_keeps_them_in_mind(tmp_path, capsys):
    folders = members(tmp_path)
    command = ["policy", "train", "--on", "augmented", "--frames", "1", "--out", str(tmp_path / "p"), "--checkpoint"]
    assert cli.main([*command, *folders]) == 0
    config = json.loads((tmp_path / "p/seed0" / CONFIG).read_text())
    assert config["plant"] == plant_of(folders).describe()
    assert (config["checkpoint"], config["others"]) == (folders[0], list(folders[1:]))
    assert load_policy(tmp_path / "p/seed0").seed == 0
    capsys.readouterr()
    assert cli.main([*command, folders[0]]) != 0
    assert "differs in: plant" in capsys.readouterr().err
    wrong = small_model(tmp_path / "psi", "forward")
    assert cli.main([*command, folders[0], wrong]) != 0
    assert "forward model; a delta model is needed" in capsys.readouterr().err
