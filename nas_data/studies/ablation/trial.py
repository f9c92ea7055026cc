"""A trial: one kind learns from one subset with one seed; its result depends only on these and the data."""

import hashlib
import json
import shutil
import tempfile
import time
import traceback
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.provenance import package_versions
from nas_data.errors import NasError, WorkerLost
from nas_data.models.presets import TrainingOptions
from nas_data.models.split import select_frames
from nas_data.models.threads import one_thread
from nas_data.runs.environment_info import commit
from nas_data.studies.ablation.amount import Amount
from nas_data.studies.ablation.code import trial_code
from nas_data.studies.ablation.judging import judge
from nas_data.studies.ablation.kinds.base import Lesson, find_kind
from nas_data.studies.ablation.material import Content, SweepData
from nas_data.studies.ablation.subsets import Run, draw
from nas_data.whole_file import write_whole

SCHEMA = 1
TRIALS, UNFINISHED = "trials", ".unfinished"

Record = dict[str, object]


@dataclass(frozen=True)
class Config:
    """Settings of a trial; with the data they determine its result.

    Attributes:
        kind: Name of the kind.
        amount: Amount of training data.
        seed: Seed of held-out episodes, subset, weights, order and windows.
        options: Options of the training; its seed is the trial's.
        held_out: Share of held-out episodes; None if another dataset is held out.
    """

    kind: str
    amount: Amount
    seed: int
    options: TrainingOptions
    held_out: float | None

    def to_json(self) -> dict[str, object]:
        """Return it; without options where nothing is trained."""
        options = replace(self.options, seed=self.seed)
        return {
            "kind": self.kind,
            "amount": self.amount.word,
            "unit": self.amount.unit,
            "seed": self.seed,
            "held_out": self.held_out,
            "options": asdict(options) if find_kind(self.kind).trains else None,
        }


@dataclass(frozen=True)
class Trial:
    """A trial to do.

    Attributes:
        config: Settings of the trial.
        content: Identity of the data.
        material: Location of the data.
        folder: The sweep's folder.
        code: Hash of the code that determines the result, at the start of the sweep.
    """

    config: Config
    content: Content
    material: SweepData
    folder: Path
    code: str

    @property
    def question(self) -> dict[str, object]:
        """Everything that the result depends on, for JSON."""
        named = find_kind(self.config.kind).names
        content = self.content.to_json(named)
        return {"schema": SCHEMA, "config": self.config.to_json(), "content": content, "code": self.code}

    @property
    def key(self) -> str:
        """Hash of these dependencies, 16 hexadecimal digits."""
        return hashlib.sha256(json.dumps(self.question, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def path(self) -> Path:
        """File of the result."""
        return self.folder / TRIALS / f"{self.key}.json"


def do_trial(trial: Trial) -> Record:
    """Do a trial and write its result; one that cannot be done is recorded with the reason.

    Raises:
        DatasetInvalid: the data are no longer those that the sweep began with.
        WorkerLost: this process has other code than the one that began the sweep.
    """
    trial.material.check(trial.content)
    check_code(trial)
    workplace = trial.folder / UNFINISHED
    workplace.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix=f"{trial.key}-", dir=workplace))
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        found: Mapping[str, object] = learn_and_judge(trial, folder)
    except Exception as error:  # whatever it is, the other trials of a sweep of hours can go on
        found = failure(error)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    record: Record = {
        "question": trial.question,
        **found,
        "commit": commit(),
        "packages": package_versions(),
        "wall_seconds": time.perf_counter() - wall,
        "cpu_seconds": time.process_time() - cpu,
    }
    write_whole(trial.path, (json.dumps(record, indent=1, allow_nan=False) + "\n").encode())
    return record


def check_code(trial: Trial) -> None:
    """Refuse to do a trial by other code than its result would be filed under.

    Raises:
        WorkerLost: the code was edited since the sweep began, or another machine has another version.
    """
    if trial_code(trial.config.kind, trial.material.source()) != trial.code:
        raise WorkerLost(
            f"A worker has other code of nas_data than the sweep in {trial.folder} was begun with: it was edited "
            "since, or is another version on that machine; run the same command again with one version everywhere."
        )


def failure(error: Exception) -> Record:
    """Return an error as a sentence; one that is no user's fault with its traceback."""
    if isinstance(error, NasError):
        return {"failed": str(error)}
    text = " ".join(str(error).split()).rstrip(".") or "no reason given"
    return {"failed": f"{type(error).__name__}: {text}.", "traceback": traceback.format_exception(error)}


def learn_and_judge(trial: Trial, folder: Path) -> Record:
    """Draw the subset, learn from it, predict what was held out.

    Args:
        trial: What to do.
        folder: Empty folder for working files.
    """
    lesson, held, runs = prepare(trial, folder)
    with one_thread(), threadpool_limits(1):
        learned = find_kind(trial.config.kind).learn(lesson)
        errors = judge(trial.config.kind, learned, lesson.source, held)
    return {
        "training_data": {
            "episodes": len(runs),
            "frames": lesson.data.n_frames,
            "minutes": lesson.data.n_frames / lesson.data.fps / 60,
            "runs": runs,
        },
        **errors,
        **(learned.named.to_json() if learned.named else {}),
    }


def prepare(trial: Trial, folder: Path) -> tuple[Lesson, Dataset, list[Run]]:
    """Return what a trial learns from, the transitions that judge, and the subset's runs of rows.

    Args:
        trial: What to do.
        folder: Empty folder for working files.
    """
    config, material = trial.config, trial.material
    dataset = material.read()
    train, held = material.divide(dataset, config.held_out, config.seed)
    runs = draw(dataset, train, config.amount, config.seed)
    lesson = Lesson(
        data=select_frames(dataset, runs),
        root=material.root,
        source=material.source(),
        effects=material.effects,
        options=replace(config.options, seed=config.seed),
        folder=folder,
    )
    return lesson, held, runs
