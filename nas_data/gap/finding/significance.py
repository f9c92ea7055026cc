"""Permutation tests over episodes for differences between bins, with Holm's correction.

Episodes are independent, rows are not. A bin is compared with other rows within each episode, and the signs of the
differences are permuted (sign-flip test). For bins of whole episodes, the labels are permuted. Tests are exact if all
permutations can be enumerated, else sampled. Holm's correction (Scandinavian Journal of Statistics 6, 1979) bounds the
probability of one false alarm among all bins.
"""

from itertools import combinations
from math import comb

import numpy as np

LEVEL = 0.05  # probability of one false alarm among all bins of an arm
MAX_ENUMERATED = 2**14  # most permutations that are enumerated
SAMPLED_PERMUTATIONS = 20_000  # permutations sampled otherwise
SUM_TOLERANCE = 1e-9  # relative rounding error of equal sums


def compute_paired_chance(differences: np.ndarray, rng: np.random.Generator) -> float:
    """Return the two-sided p-value of a mean difference under random signs.

    Args:
        differences: One per episode, shape (E,).
        rng: Samples signs if they cannot be enumerated.
    """
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
    """Return the two-sided p-value of a difference of means under random labels.

    Args:
        values: One per episode, shape (E,).
        chosen: Whether an episode is in the bin, shape (E,).
        rng: Samples labels if they cannot be enumerated.
    """
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
    """Return which of m tests are significant by Holm's correction, shape (m,).

    Args:
        chances: p-value of each test, shape (m,).
        level: Probability of a single false alarm among all.
    """
    order = np.argsort(chances, kind="stable")
    passed = chances[order] <= level / np.arange(len(chances), 0, -1)
    result = np.zeros(len(chances), bool)
    result[order] = np.logical_and.accumulate(passed)
    return result


def count_episodes_needed(tests: int, level: float = LEVEL) -> int:
    """Return the number of episodes from which a sign-flip test can be significant after correction."""
    return int(np.ceil(np.log2(2 * max(tests, 1) / level)))
