"""The slow ways of two arms: one moves at a time, round what is in its way, or after the other made room."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from nas_data.errors import PathBlocked
from nas_data.recorders.path_planner import PathPlanner


class TwoArmPlanner:
    """The free ways of an attacker and a defender; poses are of the one then the other [rad], shape (2n,)."""

    def __init__(self, alone: PathPlanner, together: Sequence[PathPlanner]) -> None:
        """Take what tells touches.

        Args:
            alone: Of either arm by itself.
            together: Of both; the first that finds a way is followed, so those that keep the arms farther apart go
                first.
        """
        self._alone, self._together = alone, together
        self._attacker = np.arange(2 * len(alone.rest)) < len(alone.rest)

    def find(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return the corners of a free way, shape (k, 2n): between two of them one arm moves, straight in joint space.

        Args:
            begin: Where the arms stand, shape (2n,).
            end: Where they shall go, shape (2n,); the last corner.

        Raises:
            PathBlocked: no way is free.
        """
        for planner in self._together:
            for stops in self._orders(begin, end):
                corners = self._lead(planner, np.stack([begin, *stops]))
                if corners is not None:
                    return corners
        raise PathBlocked(
            f"On the slow ways to their next poses the arms would touch: {self._together[-1].obstacle(begin, end)}; "
            "move both upright by hand (the torque is off) and start again."
        )

    def _orders(self, begin: np.ndarray, end: np.ndarray) -> Iterator[list[np.ndarray]]:
        """Yield where both arms stand after each move: each goes at once, one makes room first, both do."""
        rest = np.concatenate([self._alone.rest] * 2)
        orders = (self._attacker, ~self._attacker)
        for first in orders:
            yield [np.where(first, end, begin), end]
        for first in orders:
            aside = np.where(first, rest, begin)
            yield [aside, np.where(first, aside, end), end]
        for first in orders:
            yield [np.where(first, rest, begin), rest, np.where(first, end, rest), end]

    def _lead(self, planner: PathPlanner, stops: np.ndarray) -> np.ndarray | None:
        """Return the corners of a free way over stops, shape (k, 2n); None where there is none."""
        legs = list[np.ndarray]()
        for a, b in reversed(list(pairwise(stops))):  # what ends in a touch is found out soonest
            leg = self._leg(planner, a, b)
            if leg is None:
                return None
            legs.insert(0, leg)
        return np.concatenate(legs)

    def _leg(self, planner: PathPlanner, begin: np.ndarray, end: np.ndarray) -> np.ndarray | None:
        """Return the corners of a free way of the one arm that stands elsewhere in the end, shape (k, 2n)."""
        moves = self._attacker if (begin != end)[self._attacker].any() else ~self._attacker
        if planner.touches(end):
            return None
        for corners in self._alone.candidates(begin[moves], end[moves]):
            path = np.stack([begin, *(_with(begin, moves, corner) for corner in corners)])
            if planner.is_free(path) and self._alone.is_free(path[:, moves]):
                return path[1:]
        return None


def _with(pose: np.ndarray, moves: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return a pose (2n,) with the half of the arm that moves (2n,) in its place (n,)."""
    whole = pose.copy()
    whole[moves] = half
    return whole
