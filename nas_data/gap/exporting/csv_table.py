"""Export of an identified model as a CSV table with a row for each quantity and its interval."""

import csv
from collections.abc import Sequence
from pathlib import Path

from nas_data.count_of import count_of
from nas_data.gap.exporting.identified import Quantity

FILE = "parameters.csv"
HEADER = ("joint", "parameter", "unit", "value", "low", "high")


def write_table(folder: Path, quantities: Sequence[Quantity]) -> tuple[Path, list[str]]:
    """Write `parameters.csv`; return its path and a sentence for what it lacks.

    `low` and `high` bound the 95 % interval, and are empty if it is unknown. A quantity of the whole arm has an empty
    `joint`.
    """
    path = folder / FILE
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        for quantity in quantities:
            numbers = (quantity.value, *(quantity.interval or ()))
            row = [quantity.joint or "", quantity.name, quantity.unit, *(f"{number:.6g}" for number in numbers)]
            writer.writerow(row + [""] * (len(HEADER) - len(row)))
    unknown = sum(quantity.interval is None for quantity in quantities)
    return path, [
        f"ranges of {unknown} of {count_of(len(quantities), 'number')}, because they have no interval"
    ] if unknown else []
