"""Conversion of recordings with only LeRobot's keys to transitions: velocities and next states are derived.

The velocity is the derivative of a quadratic fitted by least squares to five samples around each frame (Savitzky and
Golay, Analytical Chemistry 36, 1964; as `scipy.signal.savgol_filter`), per episode. The first and last two frames use
the quadratic of the nearest whole window. The estimate is centred and has no delay, but it contains the two following
positions. One-step errors on such recordings are therefore too small; open-loop errors are not affected.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import compress

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import (
    ACTION,
    ENVIRONMENT,
    NEXT_STATE,
    POSITION,
    SIM_STATE,
    STATE,
    Feature,
    make_action_feature,
    make_position_feature,
    make_state_feature,
)
from nas_data.dataset.joints import Components, check_units, find_slides, match_joints
from nas_data.errors import DatasetInvalid, JointMismatch

WINDOW = 5  # samples
VELOCITIES_DERIVED = (
    "velocities: centred quadratic over 5 samples (savgol_filter, deriv=1; fewer in shorter episodes), per episode"
)
NEXT_DERIVED = "state of the following frame; the last frame of each episode is dropped"


def as_transitions(dataset: Dataset) -> tuple[Dataset, dict[str, str]]:
    """Convert a dataset to the contract's form: 2n-state, n commands, next state.

    Args:
        dataset: The dataset as read. Velocities, name suffixes and `next.observation.state` may be missing, and the
            joints of the action may have another order.

    Returns:
        The dataset, and the derived features (feature → how) for the provenance.

    Raises:
        JointMismatch: state and action name different joints, or none.
        DatasetInvalid: measured values are not in SI units, or no episode has two frames.
    """
    needed = {key: _find_feature(dataset, key) for key in (STATE, ACTION)}
    optional = {key: dataset.features[key] for key in (NEXT_STATE, SIM_STATE) if key in dataset.features}
    parts = {key: Components.of(key, feature) for key, feature in (needed | optional).items()}
    joints = match_joints(parts[STATE], parts[ACTION])
    slides = find_slides(dataset.features[STATE], parts[STATE])
    derived: dict[str, str] = {}
    for key, components in parts.items():
        known = check_units(dataset, key, components, slides)
        notes = [] if known else ["no unit was stored: taken as radians and SI"]
        unused = _list_unused(key, dataset.features[key].names, components)
        notes += [f"left out: {', '.join(unused)}"] if unused else []
        if notes:
            derived[key] = "; ".join(notes)
        dataset = _arrange_components(dataset, key, components, joints, slides)
    dataset, made = _add_derived(dataset, len(joints))
    derived |= {key: "; ".join(filter(None, [how, derived.get(key)])) for key, how in made.items()}
    return dataset, derived


def list_single_frames(dataset: Dataset) -> list[int]:
    """Return the episodes of one frame without a next state, which make no transition and are left out."""
    return [] if NEXT_STATE in dataset.features else np.flatnonzero(dataset.lengths == 1).tolist()


def estimate_velocities(positions: np.ndarray, fps: float) -> np.ndarray:
    """Estimate velocities by the method in the module's docstring.

    Args:
        positions: Positions of one episode at evenly spaced times [rad], shape (T, n).
        fps: Rate [Hz].

    Returns:
        Velocities [rad/s], float64, shape (T, n); zero if T is 1.
    """
    exact = positions.astype(np.float64)
    if len(exact) < 3:  # too short for a quadratic
        return np.repeat(np.diff(exact, axis=0) * fps, 2, axis=0) if len(exact) == 2 else np.zeros_like(exact)
    window = min(WINDOW, len(exact) - 1 + len(exact) % 2)
    half = window // 2
    places = np.arange(-half, half + 1)
    _, slope, bend = np.linalg.pinv(np.vander(places, 3, increasing=True))  # of the quadratic through a window
    weights = fps * (slope + 2 * places[:, None] * bend)  # of the derivative at each place of a window
    inner = np.moveaxis(sliding_window_view(exact, window, axis=0), -1, 0)
    ends = weights[:half] @ exact[:window], weights[half + 1 :] @ exact[-window:]
    return np.concatenate([ends[0], np.tensordot(weights[half], inner, 1), ends[1]])


def _find_feature(dataset: Dataset, key: str) -> Feature:
    if key not in dataset.features:
        raise JointMismatch(f"The dataset has no feature '{key}'; it has: {', '.join(dataset.features)}.")
    return dataset.features[key]


def _list_unused(key: str, names: Sequence[str], components: Components) -> list[str]:
    """Return the names of the components that transitions do not have: of each joint an action has one command."""
    if key == ACTION:
        used = {place for _, place in components.commanded().values()}
    else:
        used = {*components.positions.values(), *components.velocities.values()}
    return [name for place, name in enumerate(names) if place not in used]


def _arrange_components(
    dataset: Dataset, key: str, components: Components, joints: tuple[str, ...], slides: Collection[str]
) -> Dataset:
    """Rename and reorder the components of a feature to the contract's; a state may have positions only."""
    groups: list[Mapping[str, int]]
    if key == ACTION:
        commanded = components.commanded()
        groups = [{joint: place for joint, (_, place) in commanded.items()}]
        kinds = [commanded[joint][0] if joint in commanded else POSITION for joint in joints]
        feature = make_action_feature(joints, kinds, slides)
    elif not components.velocities:
        feature, groups = make_position_feature(joints, slides), [components.positions]
    else:
        feature, groups = make_state_feature(joints, slides), [components.positions, components.velocities]
    feature = replace(feature, dtype=dataset.features[key].dtype)
    if feature == dataset.features[key]:
        return dataset
    if any(set(group) != set(joints) for group in groups):
        raise JointMismatch(
            f"'{key}' names the joints {', '.join(groups[0])}; '{STATE}' names {', '.join(joints)}; name the same in "
            f"both, or leave '{key}' out."
        )
    places = [group[joint] for group in groups for joint in joints]
    return dataset.with_column(key, feature, dataset.columns[key][:, places])


def _add_derived(dataset: Dataset, n: int) -> tuple[Dataset, dict[str, str]]:
    """Add missing velocities and the missing next state."""
    widths = {key: dataset.features[key].width for key in (STATE, NEXT_STATE, SIM_STATE) if key in dataset.features}
    if set(widths.values()) == {2 * n} and NEXT_STATE in widths:
        return dataset, {}
    if SIM_STATE in widths or len(set(widths.values())) > 1:
        raise DatasetInvalid(
            f"Some of {', '.join(widths)} have velocities or predictions that the others lack; record state and next "
            "state with the same components, and pair afterwards."
        )
    made: dict[str, str] = {}
    if widths[STATE] == n:
        dataset = _with_velocities(dataset, NEXT_STATE in widths)
        made[STATE] = VELOCITIES_DERIVED
    if NEXT_STATE in widths:
        made[NEXT_STATE] = VELOCITIES_DERIVED
    else:
        dataset = _with_next(dataset)
        made[NEXT_STATE] = NEXT_DERIVED
    return dataset, made


def _with_velocities(dataset: Dataset, has_next: bool) -> Dataset:
    """Add velocities to positions; the last recorded next position is one more sample of its episode."""
    joints = dataset.joints
    now, after = [], []
    for frames in dataset.episodes():
        positions = dataset.states[frames]
        if has_next:
            following = dataset.next_states[frames]
            if not np.array_equal(positions[1:], following[:-1]):
                raise DatasetInvalid(
                    f"'{NEXT_STATE}' is not the following frame's state and has no velocities, so they cannot be "
                    "estimated; record them, or leave the feature out."
                )
            positions = np.concatenate([positions, following[-1:]])
        states = np.concatenate([positions, estimate_velocities(positions, dataset.fps)], axis=1)
        now.append(states[:-1] if has_next else states)
        after.append(states[1:])
    feature = replace(make_state_feature(joints, dataset.slides), dtype=dataset.features[STATE].dtype)
    dataset = dataset.with_column(STATE, feature, np.concatenate(now).astype(feature.dtype))
    if has_next:
        dataset = dataset.with_column(NEXT_STATE, feature, np.concatenate(after).astype(feature.dtype))
    return dataset


def _with_next(dataset: Dataset) -> Dataset:
    """Use the following frame's state as the next state; the last frame of each episode is dropped.

    So an episode of one frame is left out; see `list_single_frames`.
    """
    kept = np.ones(dataset.n_frames, bool)
    kept[dataset.starts + dataset.lengths - 1] = False
    if not kept.any():
        raise DatasetInvalid("Every episode has a single frame, which makes no transition; record longer episodes.")
    rows = np.flatnonzero(kept)
    whole = dataset.lengths > 1
    tasks = [task for task, long in zip(dataset.tasks, whole, strict=True) if long]
    shorter = dataset.take(rows, dataset.lengths[whole] - 1, tasks)
    shorter = replace(shorter, numbers=tuple(compress(dataset.numbers, whole)))
    moving = [key for key in (STATE, ENVIRONMENT) if key in dataset.columns and f"next.{key}" not in dataset.columns]
    for key in moving:
        shorter = shorter.with_column(f"next.{key}", dataset.features[key], dataset.columns[key][rows + 1])
    return shorter
