"""Small datasets for the tests, and hypothesis strategies that draw any dataset the contract allows."""

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import (
    ACTION,
    NEXT_STATE,
    STATE,
    TIME,
    Feature,
    make_position_feature,
    make_state_feature,
    make_time_feature,
)

JOINTS = ("m1", "m2", "m3")
DTYPES = ("float32", "float64", "int64", "int32", "uint8", "bool")


def recorded(lengths=(5, 7, 5), fps=50.0, seed=0, joints=JOINTS, tasks=("walk", "walk", "run")) -> Dataset:
    """Return what a recorder makes: a chain of states, position commands, clock, a done flag."""
    rng = np.random.default_rng(seed)
    lengths = np.asarray(lengths)
    n = len(joints)
    chains = [np.cumsum(rng.normal(scale=0.01, size=(length + 1, 2 * n)), axis=0) for length in lengths]
    features = {
        STATE: make_state_feature(joints),
        ACTION: make_position_feature(joints),
        NEXT_STATE: make_state_feature(joints),
        TIME: make_time_feature(),
        "next.done": Feature(("next.done",), dtype="bool"),
    }
    columns = {
        STATE: np.concatenate([chain[:-1] for chain in chains]).astype(np.float32),
        ACTION: rng.uniform(-1, 1, (lengths.sum(), n)).astype(np.float32),
        NEXT_STATE: np.concatenate([chain[1:] for chain in chains]).astype(np.float32),
        TIME: np.concatenate([np.arange(length) / fps for length in lengths])[:, None],
        "next.done": np.concatenate([np.arange(length) == length - 1 for length in lengths])[:, None],
    }
    tasks = tuple(tasks[index % len(tasks)] for index in range(len(lengths)))
    return Dataset(features, columns, lengths, fps, "ergojr", tasks)


def walks() -> Dataset:
    """Return four episodes of one task, two of them equally long."""
    return replace(recorded(lengths=(20, 7, 20, 31)), tasks=("walk",) * 4)


def same(a: Dataset, b: Dataset) -> bool:
    """Whether two datasets are equal to the last bit."""
    return (
        dict(a.features) == dict(b.features)
        and (a.fps, a.robot_type, a.tasks) == (b.fps, b.robot_type, b.tasks)
        and np.array_equal(a.lengths, b.lengths)
        and all(
            a.columns[key].dtype == b.columns[key].dtype and a.columns[key].tobytes() == b.columns[key].tobytes()
            for key in a.features
        )
    )


@st.composite
def any_dataset(draw) -> Dataset:
    """Draw features of any numeric type and width, episodes of any length, any texts for tasks."""
    words = st.text(st.characters(codec="utf-8", exclude_characters="/"), min_size=1, max_size=8)
    keys = words.map(lambda word: f"nas.{word}").filter(lambda key: "image" not in key and key != TIME)
    lengths = np.array(draw(st.lists(st.integers(1, 6), min_size=1, max_size=5)))
    features, columns = {}, {}
    for key in draw(st.lists(keys, min_size=1, max_size=4, unique=True)):
        names = tuple(draw(st.lists(words, min_size=1, max_size=4)))
        units = draw(st.sampled_from([(), ("rad",) * len(names), tuple(f"u{i}" for i in range(len(names)))]))
        dtype = draw(st.sampled_from(DTYPES))
        features[key] = Feature(names, units, dtype)
        largest = {"float32": float(np.finfo(np.float32).max), "float64": 1e150}.get(dtype)
        finite = {"min_value": -largest, "max_value": largest} if largest else {}
        elements = hnp.from_dtype(np.dtype(dtype), **finite)
        columns[key] = draw(hnp.arrays(dtype, (int(lengths.sum()), len(names)), elements=elements))
    tasks = draw(
        st.lists(st.text(st.characters(codec="utf-8"), max_size=8), min_size=len(lengths), max_size=len(lengths))
    )
    fps = draw(st.sampled_from([50.0, 100.0, 62.5, 49.85, 187.9]))
    return Dataset(features, columns, lengths, fps, draw(words), tuple(tasks))
