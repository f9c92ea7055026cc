"""Whether a difference between bins is more than chance: permutation tests over episodes, Holm's correction over bins.

An episode is what is independent; rows within one are not. A bin and the rest of its joint are compared within each
episode, and the signs of the differences are what chance could have dealt otherwise (sign-flip test); where whole
episodes lie in a bin, their labels are. Both are exact where all permutations can be counted, else drawn.
Holm, Scandinavian Journal of Statistics 6, 1979, bounds the chance of a single false alarm among all bins.
"""

from itertools import combinations
from math import comb

import numpy as np

LEVEL = 0.05  # chance of one false alarm among all bins of an arm
COUNTED = 2**14  # permutations up to which all are counted
DRAWN = 20_000  # permutations drawn where there are more
SLACK = 1e-9  # relative; equal sums added in another order are equal


def compute_paired_chance(differences: np.ndarray, rng: np.random.Generator) -> float:
    """Return the chance of a mean difference as large in size if each sign were a coin toss.

    Args:
        differences: One an episode, shape (E,).
        rng: Draws the tosses where they are too many to count.
    """
    count = len(differences)
    if not count:
        return 1.0
    exact = 2**count <= COUNTED
    if exact:
        signs = 1 - 2 * (np.arange(2**count)[:, None] >> np.arange(count) & 1)
    else:
        signs = rng.choice((-1, 1), (DRAWN, count))
    return _chance(signs @ differences, float(differences.sum()), exact)


def compute_grouped_chance(values: np.ndarray, chosen: np.ndarray, rng: np.random.Generator) -> float:
    """Return the chance of a difference of means as large in size if the episodes of a bin were drawn at random.

    Args:
        values: One an episode, shape (E,).
        chosen: Which episodes lie in the bin, shape (E,).
        rng: Draws bins where there are too many to count.
    """
    count, size = len(values), int(chosen.sum())
    if not 0 < size < count:
        return 1.0
    centred = values - values.mean()
    exact = comb(count, size) <= COUNTED
    if exact:
        sums = np.array([centred[list(rows)].sum() for rows in combinations(range(count), size)])
    else:
        order = rng.random((DRAWN, count)).argsort(axis=1)[:, :size]
        sums = centred[order].sum(axis=1)
    return _chance(sums, float(centred[chosen].sum()), exact)


def _chance(sums: np.ndarray, found: float, exact: bool) -> float:
    """Return the share of permutations whose sum is as large in size; what was found is one of them."""
    as_large = int((np.abs(sums) >= abs(found) * (1 - SLACK)).sum())
    return as_large / len(sums) if exact else (1 + as_large) / (1 + len(sums))


def correct_holm(chances: np.ndarray, level: float = LEVEL) -> np.ndarray:
    """Return which of m tests are significant, shape (m,).

    Args:
        chances: Chance of each by itself, shape (m,).
        level: Chance of a single false alarm among all.
    """
    order = np.argsort(chances, kind="stable")
    passed = chances[order] <= level / np.arange(len(chances), 0, -1)
    result = np.zeros(len(chances), bool)
    result[order] = np.logical_and.accumulate(passed)
    return result


def count_episodes_needed(tests: int, level: float = LEVEL) -> int:
    """Return from how many episodes on the smallest chance that signs can show survives the correction."""
    return int(np.ceil(np.log2(2 * max(tests, 1) / level)))
