"""Summary of a sweep: median and spread over seeds of each kind and amount, and the sufficient amount of data."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.errors import OptionError
from nas_data.joint_units import HINGE, JointUnit, find_display_unit
from nas_data.studies.ablation.evaluation import BASELINES, TrialResult
from nas_data.studies.ablation.kinds.base import find_kind
from nas_data.studies.ablation.sweep_data import Amount, Unit
from nas_data.studies.ablation.trial import Config

JSON = "ablation.json"
MAX_EXCESS = 0.05  # relative excess of the median error over the best one at a sufficient amount
LOOPS = ("open_loop", "one_step")

Outcome = tuple[Config, TrialResult]


@dataclass(frozen=True)
class Spread:
    """Errors of several seeds."""

    values: tuple[float, ...]  # error of each seed [rad]; infinite after divergence

    @property
    def median(self) -> float:
        """Median [rad]; infinite if half of the seeds diverged."""
        ordered = sorted(self.values)
        low, high = ordered[(len(ordered) - 1) // 2], ordered[len(ordered) // 2]
        return high if math.isinf(high) else (low + high) / 2

    @property
    def ends(self) -> tuple[float, float]:
        """The smallest and the largest [rad]."""
        return min(self.values), max(self.values)

    def to_json(self) -> dict[str, object]:
        """Return values and statistics; the writer replaces infinity."""
        low, high = self.ends
        return {"median": self.median, "min": low, "max": high, "values": list(self.values)}


@dataclass(frozen=True)
class Cell:
    """One kind with one amount of data."""

    kind: str  # name of the kind
    amount: Amount  # requested amount of data
    size: float  # actual amount in its unit, median over seeds
    errors: Mapping[str, Spread]  # spread of `open_loop` and `one_step`

    @property
    def text(self) -> str:
        """The amount with its unit; the actual number if all data were requested."""
        return str(Amount(float(f"{self.size:.3g}"), self.amount.unit))


@dataclass(frozen=True)
class SweepSummary:
    """A sweep's results."""

    unit: Unit  # unit of the amounts
    cells: Mapping[str, Sequence[Cell]]  # cells by kind, by ascending amount
    # spread of `open_loop` and `one_step` of source, hold and command, over seeds
    baselines: Mapping[str, Mapping[str, Spread]]
    failed: Sequence[str]  # sentences on failed trials
    shown: JointUnit = HINGE  # display unit of errors

    @classmethod
    def of(cls, outcomes: Sequence[Outcome]) -> "SweepSummary":
        """Summarise the results of trials."""
        good = [(config, result) for config, result in outcomes if result.failed is None]
        kinds = dict.fromkeys(config.kind for config, _ in outcomes)
        gathered = {kind: gather_cells(kind, [(c, result) for c, result in good if c.kind == kind]) for kind in kinds}
        return cls(
            unit=outcomes[0][0].amount.unit,
            cells={kind: cells for kind, cells in gathered.items() if cells},
            baselines=collect_baselines(good),
            failed=[f"{c.kind}, {c.amount}, seed {c.seed}: {found.failed}" for c, found in outcomes if found.failed],
            shown=good[0][1].shown if good else HINGE,
        )

    @classmethod
    def read(cls, path: Path) -> "SweepSummary":
        """Read the `ablation.json` of a sweep.

        Raises:
            OptionError: the file is invalid or incomplete.
        """
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            unit: Unit = "minutes" if content["amount_unit"] == "minutes" else "episodes"
            cells = {
                kind: [
                    Cell(kind, Amount.of(entry["amount"], unit), float(entry[unit]), read_spreads(entry))
                    for entry in entries
                ]
                for kind, entries in content["kinds"].items()
            }
            baselines = {name: read_spreads(entry) for name, entry in content["baselines"].items()}
            return cls(unit, cells, baselines, content["failed"], find_display_unit(content["unit"]))
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise OptionError(
                f"{path} is not a result of a sweep ({error!r}); make it again with: nas ablate"
            ) from None

    def enough(self) -> dict[str, Cell]:
        """Return for each kind the smallest amount whose median open-loop error is within 5 % of its best."""
        found = {}
        for kind, cells in self.cells.items():
            limit = (1 + MAX_EXCESS) * find_best(cells).errors["open_loop"].median
            if math.isfinite(limit):
                found[kind] = next(cell for cell in cells if cell.errors["open_loop"].median <= limit)
        return found

    def sentence(self) -> str:
        """Return the sufficient amount of data as text."""
        enough = self.enough()
        parts = [self._describe(kind, enough.get(kind)) for kind in self.cells]
        head = f"Smallest amount of data whose median open-loop error is within {MAX_EXCESS:.0%} of the best."
        return " ".join([head, *parts]) if parts else "No trial succeeded."

    def _describe(self, kind: str, cell: Cell | None) -> str:
        label, cells = find_kind(kind).label, self.cells[kind]
        if cell is None:
            return f"{label} diverges with every amount."
        top = find_best(cells)
        error, least = (self._format_error(one.errors["open_loop"].median) for one in (cell, top))
        text = f"{label}: {cell.text} ({error}" + (")" if cell is top else f"; {least} with {top.text})")
        text += ", the largest amount tried, so more may help" if cell is cells[-1] and len(cells) > 1 else ""
        return f"{text}{self._describe_better_baselines(top)}."

    def _describe_better_baselines(self, cell: Cell) -> str:
        """Return a phrase on baselines that are as good as the best of a kind; empty if there are none."""
        found = {name: spreads["open_loop"].median for name, spreads in self.baselines.items()}
        if not found or min(found.values()) > cell.errors["open_loop"].median:
            return ""
        name = min(found, key=lambda name: found[name])
        return f"; no better than the baseline '{name}' ({self._format_error(found[name])})"

    def _format_error(self, value: float) -> str:
        """Return an error in its display unit."""
        return f"{self.shown.factor * value:.3g}{self.shown.mark}"

    def to_json(self) -> dict[str, object]:
        """Return the summary for JSON, in SI units."""
        return {
            "metric": "position RMSE on held-out episodes, mean of the episodes",
            "unit": self.shown.si,
            "amount_unit": self.unit,
            "kinds": {
                kind: [
                    {"amount": cell.amount.word, cell.amount.unit: cell.size, **make_spreads_json(cell.errors)}
                    for cell in cells
                ]
                for kind, cells in self.cells.items()
            },
            "baselines": {name: make_spreads_json(spreads) for name, spreads in self.baselines.items()},
            "enough": {kind: cell.amount.word for kind, cell in self.enough().items()},
            "sentence": self.sentence(),
            "failed": list(self.failed),
        }


def find_best(cells: Sequence[Cell]) -> Cell:
    """Return the smallest amount with the least median open-loop error."""
    return min(cells, key=lambda cell: cell.errors["open_loop"].median)


def make_spreads_json(spreads: Mapping[str, Spread]) -> dict[str, object]:
    """Return the spreads of open-loop and one-step errors."""
    return {loop: spread.to_json() for loop, spread in spreads.items()}


def read_spreads(entry: Mapping[str, Mapping[str, Sequence[float | None]]]) -> dict[str, Spread]:
    """Return the spreads of open-loop and one-step errors from JSON, which has no infinity."""
    return {
        loop: Spread(tuple(math.inf if value is None else float(value) for value in entry[loop]["values"]))
        for loop in LOOPS
    }


def gather_cells(kind: str, outcomes: Sequence[Outcome]) -> list[Cell]:
    """Return a kind's cells, by ascending size."""
    groups: dict[Amount, list[TrialResult]] = {}
    for config, result in outcomes:
        groups.setdefault(config.amount, []).append(result)
    cells = []
    for amount, members in groups.items():
        errors = {loop: Spread(tuple(result.error(loop, kind) for result in members)) for loop in LOOPS}
        sizes = [getattr(result.training_data, amount.unit) for result in members]
        cells.append(Cell(kind, amount, float(np.median(sizes)), errors))
    return sorted(cells, key=lambda cell: (cell.size, cell.amount))


def collect_baselines(outcomes: Sequence[Outcome]) -> dict[str, dict[str, Spread]]:
    """Return the errors of the baselines, one per seed: all trials of a seed have the same held-out episodes."""
    by_seed = {config.seed: result for config, result in outcomes}
    names = [name for name in BASELINES if all(name in one.predictors("open_loop") for one in by_seed.values())]
    return {
        name: {loop: Spread(tuple(result.error(loop, name) for result in by_seed.values())) for loop in LOOPS}
        for name in (names if by_seed else [])
    }
