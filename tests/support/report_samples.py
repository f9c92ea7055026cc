"""Gap reports as short as the contract allows."""

from nas_data.gap.report import GapReport
from nas_data.typed_json import from_json

SHORTEST = {
    "verdict": "none",
    "effects": [],
    "retuned": [],
    "unexplained": [],
    "gap": {"unit": "rad", "before": 0.01, "after": 0.01, "noise_floor": 0.01},
    "next_experiment": None,
    "episodes": {"train": [0], "heldout": [1]},
    "seed": 0,
    "seconds": 1.0,
}


def gap_report(**changes: object) -> GapReport:
    """Return a report with some keys changed or added, as its file would hold them."""
    return from_json(GapReport, {**SHORTEST, **changes})
