"""What an audit looks at, and what it says."""

from dataclasses import asdict, dataclass

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.gap.finding.loads import Loads
from nas_data.gap.finding.recorded import Recorded
from nas_data.gap.nominal import Nominal


@dataclass(frozen=True)
class Examined:
    """A recording with what the model says of it.

    Attributes:
        dataset: As recorded, rows with the torque off and all.
        recorded: Its rows with the torque on.
        nominal: The model.
        floor: Noise floor [rad], shape (n,).
        predicted: The model's open-loop positions [rad], shape (E, T, n).
        loads: What the model says of the measured states.
    """

    dataset: Dataset
    recorded: Recorded
    nominal: Nominal
    floor: np.ndarray
    predicted: np.ndarray
    loads: Loads


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes:
        check: What.
        finding: One or two sentences: what was found, and what it means.
        ok: Whether the recording can be taken as it is in this respect.
    """

    check: str
    finding: str
    ok: bool = True

    def to_json(self) -> dict[str, object]:
        """Return the form for machines."""
        return asdict(self)


def listed(items: list[str]) -> str:
    """Return names as people write them: `a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(items[:-1]), items[-1]] if len(items) > 1 else items)


def percent(share: float) -> str:
    """Return a share in percent, small ones with more digits."""
    return f"{100 * share:.2g} %" if share < 0.1 else f"{100 * share:.0f} %"
