"""A trial: one kind learns from one subset with one seed; these and the data determine its result."""

import hashlib
import json
import shutil
import tempfile
import time
import traceback
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from nas_data.atomic_file import write_atomic
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.provenance import read_package_versions
from nas_data.errors import NasError, WorkerLost
from nas_data.models.presets import TrainingOptions
from nas_data.models.split import select_frames
from nas_data.models.threads import one_thread
from nas_data.runs.code_hash import hash_code, list_effect_modules
from nas_data.runs.environment_info import find_commit
from nas_data.sources import SourceModel
from nas_data.studies.ablation.evaluation import TrainingData, TrialResult, evaluate_trial
from nas_data.studies.ablation.kinds.base import FOLDER, TrainingInput, find_kind
from nas_data.studies.ablation.sweep_data import Amount, Content, Run, SweepData, draw
from nas_data.typed_json import as_object

SCHEMA = 1
TRIALS, UNFINISHED = "trials", ".unfinished"


@dataclass(frozen=True)
class Config:
    """Settings of a trial; with the data they determine its result."""

    kind: str  # name of the kind
    amount: Amount  # amount of training data
    seed: int  # seed of held-out episodes, subset, weights, order and windows
    options: TrainingOptions  # options of the training; its seed is the trial's
    held_out: float | None  # share of held-out episodes; None if another dataset is held out

    def to_json(self) -> dict[str, object]:
        """Return the settings for JSON; the options are null if nothing is trained."""
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
    """One trial."""

    config: Config  # settings of the trial
    content: Content  # identity of the data
    material: SweepData  # location of the data
    folder: Path  # the sweep's folder
    code: str  # hash of the code that determines the result, at the start of the sweep

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


def hash_trial_code(kind: str, source: SourceModel | None) -> str:
    """Return the hash of the code that draws the subset, trains on it, with its source if any, and evaluates."""
    effects = list_effect_modules() if find_kind(kind).names else ()  # every effect that may be named
    moves = () if source is None else source.modules()
    return hash_code(__name__, f"nas_data.{FOLDER}.{kind}", *moves, *effects)


def do_trial(trial: Trial) -> TrialResult:
    """Run a trial and write its result, or the reason of its failure.

    Raises:
        DatasetInvalid: the data changed since the sweep began.
        WorkerLost: this process has other code than the one that started the sweep.
    """
    trial.material.check(trial.content)
    check_code(trial)
    workplace = trial.folder / UNFINISHED
    workplace.mkdir(parents=True, exist_ok=True)
    for remains in workplace.glob(f"{trial.key}-*"):
        shutil.rmtree(remains, ignore_errors=True)  # of a killed run of this trial
    folder = Path(tempfile.mkdtemp(prefix=f"{trial.key}-", dir=workplace))
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        found = train_and_evaluate(trial, folder)
    except Exception as error:  # any error; the other trials of the sweep continue
        found = make_failed_result(error)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    result = replace(
        found,
        commit=find_commit(),
        packages=read_package_versions(),
        wall_seconds=time.perf_counter() - wall,
        cpu_seconds=time.process_time() - cpu,
    )
    record = {"question": trial.question, **as_object(result)}
    write_atomic(trial.path, (json.dumps(record, indent=1, allow_nan=False) + "\n").encode())
    return result


def check_code(trial: Trial) -> None:
    """Refuse a trial if this process has other code than the one that began the sweep.

    Raises:
        WorkerLost: the code was edited since the sweep began, or another machine has another version.
    """
    if hash_trial_code(trial.config.kind, trial.material.source()) != trial.code:
        raise WorkerLost(
            f"A worker has another version of nas_data than that with which the sweep in {trial.folder} was started; "
            "run the same command again with one version everywhere."
        )


def make_failed_result(error: Exception) -> TrialResult:
    """Return the result of a failed trial, with the traceback of an unexpected error."""
    if isinstance(error, NasError):
        return TrialResult(failed=str(error))
    text = " ".join(str(error).split()).rstrip(".") or "no reason given"
    lines = tuple(traceback.format_exception(error))
    return TrialResult(failed=f"{type(error).__name__}: {text}.", traceback=lines)


def train_and_evaluate(trial: Trial, folder: Path) -> TrialResult:
    """Draw the subset, learn from it, and predict the held-out episodes."""
    lesson, held, runs = prepare(trial, folder)
    data = lesson.data
    with one_thread(), threadpool_limits(1):
        learned = find_kind(trial.config.kind).learn(lesson)
        result = evaluate_trial(trial.config.kind, learned, lesson.source, held)
    named = learned.named
    return replace(
        result,
        training_data=TrainingData(len(runs), data.n_frames, data.n_frames / data.fps / 60, tuple(runs)),
        effects=tuple(effect.to_json() for effect in named.effects) if named else None,
        retuned=dict(named.retuned) if named else None,
    )


def prepare(trial: Trial, folder: Path) -> tuple[TrainingInput, Dataset, list[Run]]:
    """Return the input of a kind, the held-out transitions, and the frame ranges of the subset."""
    config, material = trial.config, trial.material
    dataset = material.read()
    train, held = material.divide(dataset, config.held_out, config.seed)
    runs = draw(dataset, train, config.amount, config.seed)
    lesson = TrainingInput(
        data=select_frames(dataset, runs),
        root=material.root,
        source=material.source(),
        effects=material.effects,
        options=replace(config.options, seed=config.seed),
        folder=folder,
    )
    return lesson, held, runs
