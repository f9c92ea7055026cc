"""The content hash sees every value and nothing else; the statistics are exact."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from support.dataset_samples import any_dataset, recorded

from nas_data.dataset.content import has_content_hash, hash_content
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, STATE, Feature
from nas_data.dataset.statistics import QUANTILES, compute_statistics

# Recomputed by hand only when SCHEMA of content.py is raised: stored datasets name their content by this rule.
GOLDEN = "70634b2ab0ba31ca2402d213513e7aa826b739f20b675ebde793043dc4334a4c"


def tiny() -> Dataset:
    """Return a dataset that needs no random numbers."""
    features = {
        STATE: Feature(("a.pos", "a.vel"), ("rad", "rad/s")),
        "nas.time": Feature(("time",), ("s",), "float64"),
        "next.done": Feature(("next.done",), dtype="bool"),
    }
    columns = {
        STATE: np.arange(6, dtype=np.float32).reshape(3, 2) / 4,
        "nas.time": np.array([[0.0], [0.1], [0.0]]),
        "next.done": np.array([[False], [True], [True]]),
    }
    return Dataset(features, columns, np.array([2, 1]), 10.0, "arm", ("reach", "größer"))


def test_the_hash_of_a_known_dataset_never_changes():
    assert hash_content(tiny()) == GOLDEN


@settings(max_examples=25, deadline=None)
@given(any_dataset(), st.data())
def test_changing_any_value_changes_the_hash(dataset, data):
    key = data.draw(st.sampled_from(sorted(dataset.features)))
    column = dataset.columns[key].copy()
    row = data.draw(st.integers(0, column.shape[0] - 1))
    component = data.draw(st.integers(0, column.shape[1] - 1))
    bits = column.view(np.uint8).reshape(*column.shape, column.itemsize)
    bits[row, component, 0] ^= 1
    changed = replace(dataset, columns={**dataset.columns, key: column})
    assert hash_content(changed) != hash_content(dataset)


@settings(max_examples=15, deadline=None)
@given(any_dataset())
def test_order_of_columns_memory_layout_and_byte_order_do_not_count(dataset):
    keys = list(reversed(dataset.features))
    other = replace(
        dataset,
        features={key: dataset.features[key] for key in keys},
        columns={
            key: np.asfortranarray(dataset.columns[key]).astype(dataset.columns[key].dtype.newbyteorder(">"))
            for key in keys
        },
        lengths=dataset.lengths.astype(np.int32),
    )
    assert hash_content(other) == hash_content(dataset)


def test_everything_but_the_values_counts_too():
    dataset = recorded()
    feature = dataset.features[ACTION]
    others = [
        replace(dataset, fps=50.5),
        replace(dataset, robot_type="so101"),
        replace(dataset, tasks=("walk", "run", "run")),
        replace(dataset, lengths=np.array([6, 6, 5])),
        replace(dataset, features={**dataset.features, ACTION: replace(feature, units=("deg",) * 3)}),
        replace(dataset, features={**dataset.features, ACTION: replace(feature, names=("x.pos", "m2.pos", "m3.pos"))}),
        replace(dataset, features={**dataset.features, ACTION: replace(feature, dtype="float64")}),
        dataset.select([0, 1]),
        dataset.select([1, 0, 2]),
    ]
    assert len({hash_content(other) for other in [dataset, *others]}) == 1 + len(others)


def test_the_tasks_of_frames_count_where_an_episode_has_several():
    dataset = recorded(lengths=(6, 6), tasks=("walk",))

    def changing_at(row: int) -> Dataset:
        return replace(dataset, frame_tasks=np.array(["walk"] * row + ["run"] * (12 - row), object))

    assert len({hash_content(changing_at(row)) for row in (2, 3, 8)}) == 3
    same = replace(dataset, tasks=("walk", "run"))
    assert hash_content(changing_at(6)) == hash_content(same), "each episode has a single task"

    early, late = changing_at(2), changing_at(3)
    assert has_content_hash(early, hash_content(early)) and not has_content_hash(early, hash_content(late))
    before = hash_content(early, frame_tasks=False)  # as stored by earlier versions
    assert has_content_hash(early, before) and has_content_hash(late, before)
    assert not has_content_hash(dataset, before)


@settings(max_examples=25, deadline=None)
@given(any_dataset())
def test_statistics_equal_numpys_for_every_episode_and_over_all(dataset):
    found = compute_statistics(dataset.columns, dataset.lengths)
    shares = list(QUANTILES.values())
    for key, column in dataset.columns.items():
        exact = column.astype(np.float64)
        parts = [(found[key].overall, exact)]
        for index, frames in enumerate(dataset.episodes()):
            parts.append(({name: values[index] for name, values in found[key].episodes.items()}, exact[frames]))
        for stored, values in parts:
            assert np.array_equal(stored["min"], values.min(axis=0))
            assert np.array_equal(stored["max"], values.max(axis=0))
            assert stored["count"].tolist() == [len(values)]
            scale = np.abs(values).max()
            assert np.allclose(stored["mean"], values.mean(axis=0), rtol=0, atol=1e-12 * scale)
            assert np.allclose(stored["std"], values.std(axis=0), rtol=0, atol=1e-7 * scale)
            quantiles = np.quantile(values, shares, axis=0)
            assert np.allclose([stored[name] for name in QUANTILES], quantiles, rtol=0, atol=1e-12 * scale)


def test_statistics_of_many_equal_episodes_are_sorted_in_several_blocks():
    rng = np.random.default_rng(0)
    column = rng.normal(size=(600 * 100, 8)).astype(np.float32)
    found = compute_statistics({"x": column}, np.full(600, 100))["x"]
    expected = np.quantile(column.reshape(600, 100, 8).astype(np.float64), 0.9, axis=1)
    assert np.allclose(found.episodes["q90"], expected, atol=1e-12)
