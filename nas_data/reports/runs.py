"""Contents of run folders: trained models and policies, with their learning curves."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.errors import CheckpointError
from nas_data.joint_units import HINGE, JointUnit, find_display_unit
from nas_data.policies.compare import EXPERT_METHOD, SOURCE_METHOD
from nas_data.policies.policy import (
    CONFIG,
    PROGRESS,
    PolicyConfig,
    PolicyScore,
    TrainedPlant,
    read_progress,
    read_result,
)
from nas_data.visible_files import list_visible_files

HISTORY, CHECKPOINT = "history.json", "checkpoint"
MODEL_NAMES = {"delta": "source + φ", "forward": "ψ"}
METHODS = {"delta": "augmented", "forward": "forward"}
NAMED, NAMED_AND_LEARNED = "named", "named_nas"  # methods trained on a source with named effects, without and with φ


@dataclass(frozen=True)
class ModelRun:
    """A training of φ or ψ."""

    folder: Path  # its folder
    kind: str  # `delta` or `forward`
    dataset: str  # name and version of its dataset
    content_hash: str  # content hash of its dataset
    # unit of its validation error; None for a normalised one-step error, after teacher forcing
    unit: JointUnit | None
    history: Sequence[Mapping[str, float]]  # update, validation error and seconds of each validation

    @property
    def name(self) -> str:
        """Name in tables."""
        return MODEL_NAMES.get(self.kind, self.kind)

    @property
    def best(self) -> float:
        """Lowest validation error, in the unit of `errors`."""
        return min((error for _, error in self.errors), default=math.nan)

    @property
    def errors(self) -> list[tuple[float, float]]:
        """Update and validation error of each validation, in display units."""
        scale = self.unit.factor if self.unit else 1.0
        return [(row["update"], row["validation"] * scale) for row in self.history]

    @property
    def seconds(self) -> float:
        """Duration of the training [s]."""
        return self.history[-1]["seconds"] if self.history else math.nan


@dataclass(frozen=True)
class LearningCurve:
    """Learning curve of one seed of a method."""

    frames: np.ndarray  # control steps so far, shape (K,)
    returns: np.ndarray  # mean return of the episodes that ended since the previous row, NaN without any, shape (K,)
    success: np.ndarray  # share of these episodes that reached the goal, shape (K,)


@dataclass(frozen=True)
class PolicyRun:
    """A training of a policy."""

    folder: Path  # its folder
    # its training environment: expert (the target), source, augmented (φ), forward (ψ), named (the source with named
    # effects) or named_nas (named effects and φ)
    method: str
    seed: int
    environment: str  # environment of its task
    frames: int  # control steps of its training
    curve: LearningCurve  # its learning curve
    seconds: float  # its duration [s]
    target_score: PolicyScore | None  # its score on the target; None if it was not evaluated


@dataclass(frozen=True)
class Runs:
    """All runs at some paths."""

    models: Sequence[ModelRun]
    policies: Sequence[PolicyRun]

    def groups(self) -> dict[str, list[PolicyRun]]:
        """Return the policies that differ only in their seed, by method.

        If policies of one method are in several folders, the folder's name is added.
        """
        homes: dict[str, set[Path]] = {}
        for run in self.policies:
            homes.setdefault(run.method, set()).add(run.folder.parent)
        result: dict[str, list[PolicyRun]] = {}
        for run in sorted(self.policies, key=lambda run: (order(run.method), run.folder.parent, run.seed)):
            single = len(homes[run.method]) == 1
            result.setdefault(run.method if single else f"{run.method} ({run.folder.parent.name})", []).append(run)
        return result


def order(method: str) -> int:
    """Return the position of a method in tables: the two references first."""
    known = (EXPERT_METHOD, SOURCE_METHOD, *METHODS.values(), NAMED, NAMED_AND_LEARNED)
    return known.index(method) if method in known else len(known)


def find_runs(paths: Iterable[Path]) -> Runs:
    """Read every run at or below some paths.

    Raises:
        CheckpointError: a path does not exist or holds no run, or a run is damaged.
    """
    models: dict[Path, ModelRun] = {}
    policies: dict[Path, PolicyRun] = {}
    for path in paths:
        if not path.is_dir():
            raise CheckpointError(f"There is no run at {path}; give a folder that a training wrote, or one around it.")
        found = {
            file.parent: read_model(file.parent)
            for file in list_visible_files(path, f"**/{HISTORY}")
            if (file.parent / CHECKPOINT / CONFIG).is_file()  # otherwise the history belongs to something else
        }
        learned = {file.parent: read_policy(file.parent) for file in list_visible_files(path, f"**/{PROGRESS}")}
        if not found and not learned:
            raise CheckpointError(
                f"{path} holds no finished run: no {HISTORY} of `nas train` and no {PROGRESS} of `nas policy train`."
            )
        models |= {folder.resolve(): run for folder, run in found.items()}
        policies |= {folder.resolve(): run for folder, run in learned.items()}
    return Runs(list(models.values()), list(policies.values()))


def read_model(folder: Path) -> ModelRun:
    """Read a training of φ or ψ.

    Raises:
        CheckpointError: a file is damaged.
    """
    try:
        history = json.loads((folder / HISTORY).read_text(encoding="utf-8"))
        config = json.loads((folder / CHECKPOINT / CONFIG).read_text(encoding="utf-8"))
        provenance = config["provenance"]
        dataset = provenance.get("dataset") or {}
        updates = provenance.get("training", {}).get("updates", 0)
        free = updates > 0 and (config["kind"] == "forward" or "source" in provenance)
        rows = [{key: float(row[key]) for key in ("update", "validation", "seconds")} for row in history]
        return ModelRun(
            folder=folder,
            kind=str(config["kind"]),
            dataset=str(dataset.get("name", "unknown")),
            content_hash=str(dataset.get("content_hash", "")),
            unit=find_display_unit(provenance.get("validation_unit") or HINGE.si) if free else None,
            history=rows,
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise CheckpointError(f"{folder} is a damaged training ({error!r}); train it again.") from None


def read_policy(folder: Path) -> PolicyRun:
    """Read a training of a policy.

    Raises:
        CheckpointError: a file is missing or damaged.
    """
    config, progress, result = PolicyConfig.read(folder), read_progress(folder), read_result(folder)
    try:
        curve = LearningCurve(progress["frames"], progress["mean_return"], progress["success_rate"])
        return PolicyRun(
            folder=folder,
            method=find_method(config.plant),
            seed=config.seed,
            environment=config.plant.environment,
            frames=int(progress["frames"][-1]),
            curve=curve,
            seconds=float(progress["seconds"][-1]),
            target_score=result.score if result else None,
        )
    except (KeyError, ValueError, TypeError) as error:
        raise CheckpointError(f"{folder} is a damaged policy ({error!r}); train it again.") from None


def find_method(plant: TrainedPlant) -> str:
    """Return the method that a policy's training environment implies."""
    if plant.retuned is not None:
        return NAMED_AND_LEARNED if plant.model else NAMED
    if plant.model is not None:
        return METHODS.get(plant.model.kind, plant.model.kind)
    return SOURCE_METHOD if plant.dynamics == "source" else EXPERT_METHOD


def collect_scores(runs: Sequence[PolicyRun], name: str = "mean_return") -> np.ndarray:
    """Return one entry of `PolicyScore` for each evaluated policy, shape (policies,)."""
    return np.array([getattr(run.target_score, name) for run in runs if run.target_score is not None])
