"""Error of each joint in each bin of each condition, compared with its other rows.

Episodes are independent, rows are not. A bin is compared with other rows within each episode, and the signs of the
differences are permuted (sign-flip test). For bins of whole episodes, the labels are permuted. Tests are exact if all
permutations can be enumerated, else sampled. Holm's correction (Scandinavian Journal of Statistics 6, 1979) bounds the
probability of one false alarm among all bins.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from math import comb

import numpy as np

from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.finding.conditions import Condition
from nas_data.gap.report_parts import Bin

LEVEL = 0.05  # probability of one false alarm among all bins of an arm
MAX_ENUMERATED = 2**14  # most permutations that are enumerated
SAMPLED_PERMUTATIONS = 20_000  # permutations sampled otherwise
SUM_TOLERANCE = 1e-9  # relative rounding error of equal sums


def compute_paired_chance(differences: np.ndarray, rng: np.random.Generator) -> float:
    """Return the two-sided p-value of the mean of differences (E,) under random signs, sampled if too many."""
    count = len(differences)
    if not count:
        return 1.0
    exact = 2**count <= MAX_ENUMERATED
    if exact:
        signs = 1 - 2 * (np.arange(2**count)[:, None] >> np.arange(count) & 1)
    else:
        signs = rng.choice((-1, 1), (SAMPLED_PERMUTATIONS, count))
    return _compute_p_value(signs @ differences, float(differences.sum()), exact)


def compute_grouped_chance(values: np.ndarray, chosen: np.ndarray, rng: np.random.Generator) -> float:
    """Return the two-sided p-value of the difference between chosen (E,) and other values (E,) under random labels."""
    count, size = len(values), int(chosen.sum())
    if not 0 < size < count:
        return 1.0
    centred = values - values.mean()
    exact = comb(count, size) <= MAX_ENUMERATED
    if exact:
        sums = np.array([centred[list(rows)].sum() for rows in combinations(range(count), size)])
    else:
        order = rng.random((SAMPLED_PERMUTATIONS, count)).argsort(axis=1)[:, :size]
        sums = centred[order].sum(axis=1)
    return _compute_p_value(sums, float(centred[chosen].sum()), exact)


def _compute_p_value(sums: np.ndarray, found: float, exact: bool) -> float:
    """Return the share of permutations with a sum at least as large in size, including the observed one."""
    as_large = int((np.abs(sums) >= abs(found) * (1 - SUM_TOLERANCE)).sum())
    return as_large / len(sums) if exact else (1 + as_large) / (1 + len(sums))


def correct_holm(chances: np.ndarray, level: float = LEVEL) -> np.ndarray:
    """Return a mask of the tests that are significant at a level by Holm's correction of p-values (m,), shape (m,)."""
    order = np.argsort(chances, kind="stable")
    passed = chances[order] <= level / np.arange(len(chances), 0, -1)
    result = np.zeros(len(chances), bool)
    result[order] = np.logical_and.accumulate(passed)
    return result


def count_episodes_needed(tests: int, level: float = LEVEL) -> int:
    """Return the number of episodes from which a sign-flip test can be significant after correction."""
    return int(np.ceil(np.log2(2 * max(tests, 1) / level)))


MIN_BIN_ROWS = 20  # fewest rows inside and outside a bin
TESTED_FLOORS = 1.2  # noise floors above which a joint's bins are tested
MIN_EPISODE_ROWS = 5  # fewest rows inside and outside a bin in an episode
SEED = 0


def find_regimes(
    evidence: EpisodeBatch, predicted: np.ndarray, conditions: Sequence[Condition], floor: np.ndarray
) -> tuple[Bin, ...]:
    """Compare every bin with the other bins of its condition, for each joint.

    Args:
        evidence: Measured episodes.
        predicted: Open-loop positions [rad; m], shape (E, T, n).
        conditions: Divisions of the rows.
        floor: Noise floor [rad; m], shape (n,).
    """
    errors = evidence.errors(predicted)
    rng = np.random.default_rng(SEED)
    found = [
        measured
        for joint in range(len(evidence.joints))
        for condition in conditions
        for number in range(len(condition.bins))
        if (measured := measure_bin(evidence, errors[..., joint], condition, joint, number, float(floor[joint]), rng))
    ]
    return correct_for_multiple_tests(found)


def correct_for_multiple_tests(found: Sequence[Bin]) -> tuple[Bin, ...]:
    """Return the bins with their significance, corrected for the number of tests."""
    tested = np.array([measured.chance < 1 for measured in found], bool)
    significant = np.zeros(len(found), bool)
    significant[tested] = correct_holm(np.array([measured.chance for measured in found])[tested])
    return tuple(replace(measured, significant=bool(real)) for measured, real in zip(found, significant, strict=True))


def measure_bin(
    evidence: EpisodeBatch,
    errors: np.ndarray,
    condition: Condition,
    joint: int,
    number: int,
    floor: float,
    rng: np.random.Generator,
) -> Bin | None:
    """Return one bin of one joint with errors (E, T), uncorrected; None with too few rows."""
    labels, squared = condition.labels[..., joint], errors**2
    here, there = labels == number, (labels >= 0) & (labels != number)
    if min(here.sum(), there.sum()) < MIN_BIN_ROWS:
        return None
    rmse, rest = (float(np.sqrt(squared[rows].mean())) for rows in (here, there))
    compare = compare_between if condition.whole_episodes else compare_within
    visible = squared[evidence.mask].mean() > (TESTED_FLOORS * floor) ** 2
    return Bin(
        joint=evidence.joints[joint],
        regime=condition.name,
        bin=condition.bins[number],
        rows=int(here.sum()),
        rmse=rmse,
        mean=float(errors[here].mean()),
        rest=rest,
        ratio_to_noise=rmse / floor,
        share=float(squared[here].sum() / max(squared.sum(), np.finfo(float).tiny)),
        chance=compare(squared, here, there, floor, rng) if visible else 1.0,
        significant=False,
    )


def compare_within(
    squared: np.ndarray, here: np.ndarray, there: np.ndarray, floor: float, rng: np.random.Generator
) -> float:
    """Return the p-value of a difference between two sets of rows (E, T) within episodes."""
    both = (here.sum(1) >= MIN_EPISODE_ROWS) & (there.sum(1) >= MIN_EPISODE_ROWS)
    logs = [compute_log_mean(squared[both], rows[both], floor) for rows in (here, there)]
    return compute_paired_chance(logs[0] - logs[1], rng)


def compare_between(
    squared: np.ndarray, here: np.ndarray, there: np.ndarray, floor: float, rng: np.random.Generator
) -> float:
    """Return the p-value of a difference between two sets of whole episodes."""
    return compute_grouped_chance(compute_log_mean(squared, here | there, floor), np.asarray(here.any(1)), rng)


def compute_log_mean(squared: np.ndarray, rows: np.ndarray, floor: float) -> np.ndarray:
    """Return the log of each episode's mean squared error over some rows plus the squared floor, shape (E,).

    The logarithm limits the influence of a diverging episode; the floor hides differences below it.
    """
    return np.asarray(np.log(floor**2 + (squared * rows).sum(1) / np.maximum(rows.sum(1), 1)))
