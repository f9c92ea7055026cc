"""What a trial's record says."""

import math

from nas_data.joint_units import JointUnit, display_unit
from nas_data.studies.ablation.amount import Amount
from nas_data.studies.ablation.trial import Record

METRIC = "mean_of_episodes"  # every held-out episode counts alike, however long


def config(record: Record) -> dict[str, object]:
    """Return the configuration of a trial from its result."""
    question = record["question"]
    assert isinstance(question, dict)
    found = question["config"]
    assert isinstance(found, dict)
    return found


def amount_of(record: Record) -> Amount:
    """Return the amount that a trial was asked to learn from."""
    word, unit = config(record)["amount"], config(record)["unit"]
    return Amount.of(word, "minutes" if unit == "minutes" else "episodes")


def size(record: Record) -> float:
    """Return how much a trial learned from, in the unit of its amount."""
    data = record["training_data"]
    assert isinstance(data, dict)
    return float(data[amount_of(record).unit])


def predictors(record: Record, loop: str) -> dict[str, dict[str, object]]:
    """Return the errors of a trial by predictor."""
    found = record[loop]
    assert isinstance(found, dict)
    return found


def error(record: Record, loop: str, name: str | None = None) -> float:
    """Return an error [rad] of a trial's own predictor, or a baseline's; infinite where it diverged."""
    value = predictors(record, loop)[name or str(config(record)["kind"])][METRIC]
    return math.inf if value is None else float(str(value))


def unit_of(record: Record) -> JointUnit:
    """Return how the errors of a trial are shown: those of hinges, or of slides on an arm without hinges."""
    return display_unit(str(record.get("unit")))


def failure(record: Record) -> str:
    """Say which trial could not be done, and why."""
    entry = config(record)
    return f"{entry['kind']}, {amount_of(record)}, seed {entry['seed']}: {record['failed']}"
