"""Training of φ and ψ on a dataset in memory or in a folder."""

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.api.arguments import (
    Actuators,
    Count,
    Progress,
    as_dataset,
    as_optional_model,
    count_aloud,
    find_name,
)
from nas_data.api.learned_model import LearnedModel
from nas_data.count_of import count_of
from nas_data.dataset import versions
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.origin import describe_identity, find_root, kept_folders
from nas_data.dataset.torque_off import drop_rows_without_torque
from nas_data.errors import DatasetInvalid, ModelFileError
from nas_data.models.checkpoint import KINDS
from nas_data.models.evaluation import evaluate as evaluate_predictors
from nas_data.models.lstm import Kind
from nas_data.models.presets import TrainingOptions, choose_preset
from nas_data.models.presets import preset as find_preset
from nas_data.models.run import CHECKPOINT, HISTORY, TrainingRun
from nas_data.models.training import ModelTraining
from nas_data.pairing import check_source, warn_of_overlaps, warn_of_ranges
from nas_data.robots.base import find_robot
from nas_data.runs.progress import begin, silence
from nas_data.simulators.base import Simulator
from nas_data.sources import collect_source_files, find_source, read_kept_files


@dataclass(frozen=True, kw_only=True)
class TrainingRequest:
    """Arguments of a training.

    Attributes:
        kind: `delta` for φ, `forward` for ψ.
        options: Options of the training.
        model: The source, if the dataset stores none.
        engine: Physics engine of the source.
        actuators: Actuators for a URDF.
        out: Folder of the training; None for a temporary one.
        device: torch device.
        progress: Called with a message per validation.
        count: Called with the control steps done and in total in the last rollouts; None for `progress`.
    """

    kind: Kind
    options: TrainingOptions
    model: str | Path | None = None
    engine: str | None = None
    actuators: Actuators = "position"
    out: str | Path | None = None
    device: str | None = None
    progress: Progress = silence
    count: Count | None = None


def train_delta(
    dataset: Dataset | str | Path,
    *,
    model: str | Path | None = None,
    engine: str | None = None,
    out: str | Path | None = None,
    preset: str | TrainingOptions | None = None,
    updates: int | None = None,
    seed: int | None = None,
    device: str | None = None,
    actuators: Actuators = "position",
    progress: Progress | None = None,
) -> LearnedModel:
    """Train φ: (state, command, simulated next state) → measured next − simulated next.

    Args:
        dataset: Paired transitions, or their folder.
        model: Source of the pairing; only needed if the dataset stores none.
        engine: `mujoco` or `bullet`; None for the source's own.
        out: Folder for checkpoint, history and TensorBoard files, where an interrupted training resumes; None for
            memory only.
        preset: `stiction`, `fast`, `few`, `symmetric` or `paper`, or custom options; None for `stiction` if the arm
            takes positions, else `fast`.
        updates: Updates in free running; None for the preset's, 0 for teacher forcing.
        seed: Seed of weights, split, order and windows; None for the preset's; same seed, same bits.
        device: torch device; a GPU by default, if there is one.
        actuators: Actuators for a URDF given as model.
        progress: Called with a message per validation.

    Raises:
        DatasetInvalid: the dataset is not paired, or too short.
        JointMismatch: the source is not that of the predictions.
        OutputExists: `out` holds something else.
        OptionError, UnknownName: a value is out of its range, or there is no such preset.
    """
    recorded = as_dataset(dataset)
    request = TrainingRequest(
        kind="delta",
        options=choose_options(preset or choose_preset("delta", recorded.commands_positions), updates, seed),
        model=model,
        engine=engine,
        out=out,
        device=device,
        actuators=actuators,
        progress=progress or silence,
    )
    return train(recorded, request)


def train_forward(
    dataset: Dataset | str | Path,
    *,
    model: str | Path | None = None,
    engine: str | None = None,
    out: str | Path | None = None,
    preset: str | TrainingOptions = "fast",
    updates: int | None = None,
    seed: int | None = None,
    device: str | None = None,
    actuators: Actuators = "position",
    progress: Progress | None = None,
) -> LearnedModel:
    """Train ψ: (state, command) → measured next − current; it needs no simulator.

    Arguments and errors as for `train_delta`; the dataset need not be paired, and a model only serves for comparison.
    """
    request = TrainingRequest(
        kind="forward",
        options=choose_options(preset, updates, seed),
        model=model,
        engine=engine,
        out=out,
        device=device,
        actuators=actuators,
        progress=progress or silence,
    )
    return train(as_dataset(dataset), request)


def choose_options(preset: str | TrainingOptions, updates: int | None, seed: int | None) -> TrainingOptions:
    """Return a preset's options with changes; None leaves an option unchanged."""
    if isinstance(preset, str):
        return find_preset(preset, updates=updates, seed=seed)
    changed = {name: value for name, value in (("updates", updates), ("seed", seed)) if value is not None}
    return replace(preset, **changed)  # type: ignore[arg-type]  # dataclasses.replace is not generic over fields


def train(dataset: Dataset, request: TrainingRequest) -> LearnedModel:
    """Train φ or ψ on transitions of `as_dataset`; see `train_delta`."""
    if request.out is None:
        with tempfile.TemporaryDirectory() as brief:
            return replace(train(dataset, replace(request, out=Path(brief, "training"))), folder=None)
    kind, folder, say = request.kind, Path(request.out), request.progress
    if kind == "delta":
        check_paired(dataset)
    origin = dataset.origin
    notes = [f"derived {key}: {how}" for key, how in (origin.derived if origin else {}).items()]
    provenance: dict[str, object] = {"dataset": describe_identity(dataset), KINDS: list(dataset.kinds)}
    given = as_optional_model(request.model, request.actuators)
    powered, left_out = drop_rows_without_torque(dataset)
    notes += left_out
    with kept_folders(dataset) as kept_in:
        simulator, kept = find_training_source(kind, dataset, given, request.engine, kept_in, notes)
        if simulator is not None:
            recorded = origin.provenance.source if origin and given is None else None
            provenance["source"] = recorded or simulator.describe()
        begin(f"preparing the training on {count_of(powered.n_episodes, 'episode')}")
        training = ModelTraining(kind, powered, request.options, simulator, provenance, request.device)
        run = TrainingRun(training, folder, say, kept)
        notes.append(
            f"{count_of(powered.n_episodes, 'episode')}, {count_of(powered.n_frames, 'transition')}; held out: "
            f"{training.split.description}"
        )
        notes.append(
            f"{training.phase.name}, {count_of(training.phase.updates, 'update')}; validation is {training.criterion}"
        )
        for note in notes:  # after all checks, so that bad input gives a single sentence
            say(note)
        network = run.run()
        held_out = None
        if simulator is not None or kind == "forward":
            count = request.count or count_aloud(say)
            held_out = evaluate_predictors(training.split.validation, simulator, network, count)
    rows = json.loads((folder / HISTORY).read_text(encoding="utf-8"))
    return LearnedModel(network, kept, training.split.description, held_out, tuple(rows), dataset, folder / CHECKPOINT)


def check_paired(dataset: Dataset) -> None:
    """Refuse a dataset without a source's predictions.

    Raises:
        DatasetInvalid: it is not paired; the message names the command.
    """
    if (root := find_root(dataset)) is not None:
        versions.check_paired(root, dataset, "A delta model")
    if not dataset.paired:
        raise DatasetInvalid(
            "A delta model learns from the source's predictions, which the dataset does not hold: "
            'pair it first, nas_data.pair(dataset, model="MODEL.xml").'
        )


def find_training_source(
    kind: Kind, dataset: Dataset, model: str | None, engine: str | None, kept_in: Sequence[Path], notes: list[str]
) -> tuple[Simulator | None, Mapping[str, bytes]]:
    """Return the source, and its files that are stored with the checkpoint; None and a note if it is not known."""
    try:
        simulator = find_source(model, (), dataset, kept_in, engine)
    except ModelFileError as error:
        if model is not None:
            raise
        if kind == "delta":
            reason = str(error).replace(str(kept_in[0]), str(find_name(dataset)))
            notes.append(
                f"{reason} Without it, training uses teacher forcing only, and open-loop errors are not computed."
            )
        return None, {}
    if kind == "delta" and dataset.paired:
        check_source(dataset, simulator)
    if model is None:
        return simulator, read_kept_files(kept_in[0])
    robot = find_robot(model)
    warn_of_ranges(dataset, robot)
    warn_of_overlaps(dataset, simulator)
    return simulator, collect_source_files(robot)
