"""What differs between two datasets is found, wherever it is, and from both sides alike."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.dataset_samples import any_dataset, recorded
from support.version_samples import FEW, SIMULATED, original

from nas_data.cli import main
from nas_data.dataset.diff import compare_datasets
from nas_data.dataset.features import ACTION, SIM_STATE, STATE, TIME, make_time_feature
from nas_data.dataset.versions import write_version
from nas_data.dataset.write import write


@FEW
@given(any_dataset())
def test_a_dataset_does_not_differ_from_itself(dataset):
    found = compare_datasets(dataset, dataset, (SIMULATED, SIMULATED))
    assert found.equal_content
    assert found.equal_episodes == dataset.n_episodes and found.moved == 0
    assert not any([found.changed, found.values, found.tasks, found.provenance, found.compared])
    assert found.only == found.joints == found.unmatched == ((), ())
    assert found.rates is None and found.robots is None


def changed_somehow(draw, dataset):
    """Return a dataset with episodes dropped, reordered or changed."""
    episodes = draw(st.lists(st.integers(0, dataset.n_episodes - 1), min_size=1, max_size=6))
    changed = dataset.select(episodes)
    key = draw(st.sampled_from(sorted(changed.features)))
    column = changed.columns[key].copy()
    row = draw(st.integers(0, len(column) - 1))
    column[row, 0] = 0 if column[row, 0] else 1
    changed = changed.with_column(key, changed.features[key], column)
    fps = draw(st.sampled_from([dataset.fps, 10.0]))
    return replace(changed, fps=fps, tasks=tuple(draw(st.sampled_from("ab")) for _ in episodes))


@FEW
@given(st.data())
def test_a_difference_is_symmetric(data):
    a = data.draw(st.one_of(any_dataset(), st.just(recorded())))
    b = changed_somehow(data.draw, a)
    there, back = compare_datasets(a, b), compare_datasets(b, a)
    for name in ("content_hashes", "only", "joints", "counts", "unmatched"):
        assert getattr(there, name) == getattr(back, name)[::-1]
    assert (there.rates or (0, 0)) == (back.rates or (0, 0))[::-1]
    assert (there.equal_episodes, there.moved) == (back.equal_episodes, back.moved)
    assert sorted((j, i) for i, j in there.compared) == sorted(back.compared)
    assert there.values.keys() == back.values.keys()
    for key, change in there.values.items():
        assert (change.largest, change.frames) == (back.values[key].largest, back.values[key].frames)
    assert {(j, i, y, x) for i, j, x, y in there.tasks} == set(back.tasks)
    total = there.equal_episodes + len(there.compared) + len(there.unmatched[0])
    assert total == a.n_episodes
    assert there.equal_content == back.equal_content


def test_the_largest_difference_is_found_where_it_is():
    a = recorded()
    changed = a.commands.copy()
    changed[5 + 3, 1] += 0.25
    changed[5 + 4, 0] -= 0.125
    found = compare_datasets(a, a.with_column(ACTION, a.features[ACTION], changed))
    change = found.values[ACTION]
    assert found.compared == ((1, 1),) and found.equal_episodes == 2
    assert (change.component, change.episodes, change.frame, change.frames) == ("m2.pos", (1, 1), 3, 2)
    assert change.largest == pytest.approx(0.25, rel=1e-6) and change.unit == "rad"


def test_episodes_are_found_wherever_they_stand():
    a = recorded(lengths=(5, 7, 6, 4))
    found = compare_datasets(a, a.select([3, 0, 2]))
    assert (found.equal_episodes, found.moved) == (3, 2)
    assert found.unmatched == ((1,), ())
    assert not found.equal_content


def test_a_zero_of_another_sign_is_a_difference_of_nothing():
    a = recorded(lengths=(4,))
    columns = [np.zeros_like(a.commands), -np.zeros_like(a.commands)]
    one, other = (a.with_column(ACTION, a.features[ACTION], column) for column in columns)
    found = compare_datasets(one, other)
    assert not found.equal_content
    assert found.values[ACTION].largest == 0.0 and found.values[ACTION].frames == 4


def test_the_paired_version_has_the_episodes_of_the_plain_one(folder, capsys):
    plain = recorded()
    paired = plain.with_column(SIM_STATE, plain.features[STATE], plain.next_states)
    a, b = original(plain).root, original(paired, replace(SIMULATED, source={"name": "x", "effects": [1]})).root
    assert main(["diff", str(a), str(b), "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert (answer["equal"], answer["equal_episodes"]) == (False, 3)
    assert answer["only"] == [[], [SIM_STATE]]
    assert answer["provenance"]["source.effects"] == [None, [1]]
    assert main(["diff", str(a), str(b)]) == 1
    assert f"feature only in B: {SIM_STATE}" in capsys.readouterr().out


def test_diff_answers_equal_content_of_other_provenance_with_zero(folder, capsys):
    a = write(recorded(), Path("a"), SIMULATED)
    b = write(recorded(), Path("b"), replace(SIMULATED, seeds=(4,), how="imported"))
    assert main(["diff", str(a), str(b)]) == 0
    text = capsys.readouterr().out
    assert "have equal content" in text and "provenance seeds: [3] in A, [4] in B" in text
    assert main(["diff", str(a), "nowhere"]) == 2


def test_episodes_that_share_their_times_only_are_not_equal():
    first = recorded()
    first = first.with_column(TIME, make_time_feature(), np.arange(float(first.n_frames))[:, None])
    second = replace(first, features=dict(first.features), columns=dict(first.columns))
    other = second.without_columns(second.features.keys() - {TIME})
    assert compare_datasets(first, other).equal_episodes == 0
    assert compare_datasets(first, second).equal_episodes == first.n_episodes


def test_tasks_that_change_in_other_frames_are_a_difference(folder, capsys):
    walks = recorded(lengths=(6, 5), tasks=("walk",))
    parts = [np.array(["walk"] * row + ["run"] * (11 - row), object) for row in (2, 4)]
    a, b = (replace(walks, frame_tasks=part) for part in parts)
    found = compare_datasets(a, b)
    assert not found.equal_content and found.equal_episodes == 2
    assert found.tasks == () and found.frame_tasks == ((0, 0, 2, 2),)
    assert compare_datasets(a, a).frame_tasks == ()
    roots = [write_version(dataset, "arm", SIMULATED, Path("datasets")) for dataset in (a, b, a)]
    assert roots[0] != roots[1] and roots[2] == roots[0]
    assert main(["diff", str(roots[0]), str(roots[1])]) == 1
    assert "tasks of episode 0/0: differ in 2 frames, first in frame 2" in capsys.readouterr().out


def test_diff_names_rate_robot_and_joints():
    a = recorded()
    found = compare_datasets(a, replace(recorded(joints=("m1", "elbow", "m3")), fps=40.0, robot_type="so101"))
    assert (found.rates, found.robots, found.joints) == ((50.0, 40.0), ("ergojr", "so101"), (("m2",), ("elbow",)))
    assert STATE in found.changed and STATE not in found.values
