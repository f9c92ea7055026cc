"""Several frozen networks for one batch: each closed loop follows one of them for an episode."""

from collections.abc import Sequence

import numpy as np

from nas_data.models.frozen.base import FrozenNetwork


class Committee(FrozenNetwork):
    """Networks that learned the same from few data, each wrong in its own way.

    Where all rows begin, they follow the members in turn; each row that begins anew follows the next one. A policy
    that learns from all of them can rely on nothing that only one of them says (model ensembles: Kurutach et al.,
    Model-ensemble trust-region policy optimization, 2018, arXiv:1802.10592). All members read all rows, which costs
    little beside the simulation, so that any number of rows does.
    """

    def __init__(self, members: Sequence[FrozenNetwork]) -> None:
        """Take networks of the same joints and rows.

        Args:
            members: At least one, each of B rows.
        """
        self.size = members[0].size
        self._members = members
        self._rows = np.arange(self.size)
        self._followed = self._rows % len(members)

    def changes(self, states: np.ndarray, commands: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        """Return for each row what the member that it follows adds; see `FrozenNetwork.changes`."""
        said = np.stack([member.changes(states, commands, predicted) for member in self._members])
        return np.asarray(said[self._followed, self._rows])

    def forget(self, rows: np.ndarray | slice) -> None:
        """Zero what is remembered of some rows, and let them follow the next member; all rows begin as at first."""
        for member in self._members:
            member.forget(rows)
        begun = self._rows if isinstance(rows, slice) and rows == slice(None) else self._followed + 1
        self._followed[rows] = (begun % len(self._members))[rows]
