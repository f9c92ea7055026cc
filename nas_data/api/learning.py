"""Train φ and ψ, and judge them beside what needs no learning."""

import json
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from nas_data.api.arguments import Actuators, Progress, as_dataset, as_optional_model, name_of, silent
from nas_data.dataset import versions
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.foreign import warn
from nas_data.dataset.origin import identity_of, kept_folders
from nas_data.errors import DatasetInvalid, ModelFileError, NasError, OptionError
from nas_data.models import checkpoint
from nas_data.models.evaluation import PLAIN, Evaluation
from nas_data.models.evaluation import evaluate as evaluate_predictors
from nas_data.models.lstm import DynamicsModel, Kind
from nas_data.models.presets import TrainingOptions
from nas_data.models.presets import preset as find_preset
from nas_data.models.run import CHECKPOINT, HISTORY, TrainingRun
from nas_data.models.training import ModelTraining
from nas_data.pairing import check_source, warn_of_ranges
from nas_data.robots.base import find_robot
from nas_data.simulators.base import Simulator
from nas_data.sources import SourceModel, find_source, kept_files, locate_source, source_files

Count = Callable[[int, int], None]
MUJOCO = "mujoco"


@dataclass(frozen=True, repr=False)
class LearnedModel:
    """φ or ψ, frozen.

    Attributes:
        network: The network, in evaluation mode.
        source: Files of the source that φ corrects, by name.
        split: What was held out for early stopping, in words.
        held_out: Errors on that; None where no source was at hand, or the model was read from a folder.
        history: A row for each validation: update, validation error, loss, seconds.
        trained_on: The recording; None where the model was read from a folder.
        folder: Its checkpoint; None where it is in memory only.
    """

    network: DynamicsModel
    source: Mapping[str, bytes] = field(default_factory=dict)
    split: str = ""
    held_out: Evaluation | None = None
    history: tuple[Mapping[str, float], ...] = ()
    trained_on: Dataset | None = None
    folder: Path | None = None

    def __repr__(self) -> str:
        """Return kind, joints and held-out error in a line."""
        name = {"delta": "φ", "forward": "ψ"}[self.kind]
        error = ""
        if self.held_out is not None:
            errors = next(iter(self.held_out.open_loop.values()))
            error = f"; held-out open-loop error {errors.overall:.3g} {errors.unit.si}"
        return f"LearnedModel({name} of {', '.join(self.joints)} at {self.network.fps:g} Hz{error})"

    @property
    def kind(self) -> Kind:
        """`delta` for φ, `forward` for ψ."""
        return self.network.kind

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of its joints."""
        return tuple(self.network.joints)

    @classmethod
    def load(cls, folder: str | Path) -> "LearnedModel":
        """Read a checkpoint.

        Args:
            folder: Written by `nas train` or `save`; the checkpoint, or the training's folder around it.

        Raises:
            CheckpointError: it is missing or damaged.
        """
        place = checkpoint.find(Path(folder))
        return cls(checkpoint.load_frozen(place), kept_files(place), folder=place)

    def save(self, folder: str | Path) -> Path:
        """Write a checkpoint, which every command takes; an older one in the folder is replaced."""
        Path(folder).parent.mkdir(parents=True, exist_ok=True)
        return checkpoint.save(self.network, Path(folder), self.source)


def train_delta(
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
    """Train φ: (state, command, simulated next state) → measured next − simulated next.

    Args:
        dataset: Paired transitions, or their folder.
        model: The source that it was paired with; needed only where the dataset keeps none.
        engine: `mujoco` or `bullet`; the source's own where None.
        out: Folder for checkpoint, history and TensorBoard files, in which an interrupted training goes on; in memory
            where None.
        preset: `fast`, `few`, `symmetric` or `paper`, or options of one's own.
        updates: Updates in free running, in place of the preset's; 0 trains by teacher forcing.
        seed: Of weights, split, order and windows, in place of the preset's; same seed, same bits.
        device: torch device; a GPU where there is one by default.
        actuators: What moves the joints of a URDF given as model.
        progress: Told of each validation in a line.

    Raises:
        DatasetInvalid: the dataset is not paired, or too short.
        JointMismatch: the source is another one than that of the predictions.
        OutputExists: `out` holds something else.
        OptionError, UnknownName: a value is out of its range, or there is no such preset.
    """
    options = options_of(preset, updates, seed)
    return train("delta", as_dataset(dataset), options, model, engine, out, device, actuators, progress or silent)


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

    Arguments and errors are those of `train_delta`; the dataset need not be paired, and a model is only compared with.
    """
    options = options_of(preset, updates, seed)
    return train("forward", as_dataset(dataset), options, model, engine, out, device, actuators, progress or silent)


def options_of(preset: str | TrainingOptions, updates: int | None, seed: int | None) -> TrainingOptions:
    """Return a preset's options, some of them changed; None leaves one as it is."""
    if isinstance(preset, str):
        return find_preset(preset, updates=updates, seed=seed)
    changed = {name: value for name, value in (("updates", updates), ("seed", seed)) if value is not None}
    return replace(preset, **changed)  # type: ignore[arg-type]  # dataclasses.replace is not generic over fields


def train(
    kind: Kind,
    dataset: Dataset,
    options: TrainingOptions,
    model: str | Path | None,
    engine: str | None,
    out: str | Path | None,
    device: str | None,
    actuators: Actuators,
    progress: Progress,
    episodes: Sequence[int] = (),
    count: Count | None = None,
) -> LearnedModel:
    """Train φ or ψ; see `train_delta`.

    Args:
        kind: `delta` or `forward`.
        dataset: Transitions, as `as_dataset` returns them.
        options: How to train.
        model: The source, where the dataset keeps none.
        engine: Its engine.
        out: Folder of the training; None for one that is removed afterwards.
        device: torch device.
        actuators: What moves the joints of a URDF.
        progress: Told of each validation.
        episodes: Which of the recording's episodes the dataset holds, for provenance; empty for all.
        count: Told of control steps done and to do in the last rollouts; `progress` is where None.
    """
    if out is None:
        with tempfile.TemporaryDirectory() as brief:
            place = Path(brief, "training")
            learned = train(kind, dataset, options, model, engine, place, device, actuators, progress, episodes, count)
            return replace(learned, folder=None)
    if kind == "delta":
        check_paired(dataset)
    origin, seen, folder = dataset.origin, identity_of(dataset), Path(out)
    notes = [f"derived {key}: {how}" for key, how in (origin.derived if origin else {}).items()]
    provenance: dict[str, object] = {
        "dataset": {"name": seen.name, "content_hash": seen.content_hash, "episodes": list(episodes)}
    }
    given = as_optional_model(model, actuators)
    with kept_folders(dataset) as kept_in:
        simulator, kept = find_training_source(kind, dataset, given, engine, kept_in, notes)
        if simulator is not None:
            recorded = origin.provenance.source if origin and given is None else None
            provenance["source"] = recorded or simulator.describe()
        training = ModelTraining(kind, dataset, options, simulator, provenance, device)
        run = TrainingRun(training, folder, progress, kept)
        notes.append(f"{dataset.n_episodes} episodes, {dataset.n_frames} transitions; held out: {training.split.what}")
        notes.append(f"{training.phase.name}, {training.phase.updates} updates; validation is {training.criterion}")
        for note in notes:  # only now: bad input is one sentence and nothing else
            progress(note)
        network = run.run()
        held_out = None
        if simulator is not None or kind == "forward":
            held_out = evaluate_predictors(training.split.held, simulator, network, count or counting(progress))
    rows = json.loads((folder / HISTORY).read_text(encoding="utf-8"))
    return LearnedModel(network, kept, training.split.what, held_out, tuple(rows), dataset, folder / CHECKPOINT)


def check_paired(dataset: Dataset) -> None:
    """Refuse a dataset without a source's predictions.

    Raises:
        DatasetInvalid: says how to make one with them.
    """
    origin = dataset.origin
    if origin is not None and origin.root is not None:
        versions.check_paired(origin.root, dataset, "A delta model")
    if not dataset.paired:
        raise DatasetInvalid(
            "A delta model learns from the source's predictions, which the dataset does not hold: "
            'pair it first, nas_data.pair(dataset, model="MODEL.xml").'
        )


def find_training_source(
    kind: Kind, dataset: Dataset, model: str | None, engine: str | None, kept_in: Sequence[Path], notes: list[str]
) -> tuple[Simulator | None, Mapping[str, bytes]]:
    """Return the source and the files that keep it with the checkpoint; None, with a note, where there is none."""
    try:
        simulator = find_source(model, (), dataset, kept_in, engine)
    except ModelFileError as error:
        if model is not None:
            raise
        if kind == "delta":
            told = str(error).replace(str(kept_in[0]), str(name_of(dataset)))
            notes.append(
                f"{told} Without it, training is by teacher forcing alone, and open-loop errors cannot be told."
            )
        return None, {}
    if kind == "delta" and dataset.paired:
        check_source(dataset, simulator)
    if model is None:
        return simulator, kept_files(kept_in[0])
    robot = find_robot(model)
    warn_of_ranges(dataset, robot.spec().compile())
    return simulator, source_files(robot)


def evaluate(
    learned: LearnedModel | str | Path,
    dataset: Dataset | str | Path,
    *,
    model: str | Path | None = None,
    engine: str | None = None,
    episodes: Sequence[int] = (),
    plain_fit: bool = True,
    actuators: Actuators = "position",
    progress: Progress | None = None,
    count: Count | None = None,
) -> Evaluation:
    """Compare φ, ψ or a model file with hold, source, command and a plain fit, in one step and in open loop.

    The plain fit is what a user has without names and networks: every smooth parameter of the source, fitted to what
    the model was trained on where that is in memory, else to the very dataset that it is judged by.

    Args:
        learned: φ or ψ, its folder, or an MJCF or URDF file that is judged by itself.
        dataset: Any recording of the same joints and rate, or its folder; need not be paired.
        model: The source; the one kept with the model or the dataset where None.
        engine: `mujoco` or `bullet`; the source's own where None.
        episodes: Only these; all by default.
        plain_fit: Whether the plain fit is made; it takes seconds to minutes.
        actuators: What moves the joints of a URDF.
        progress: Told what is being done.
        count: Told of control steps done and to do; `progress` is where None.

    Returns:
        Errors by predictor, overall, per joint and per episode: `evaluation.open_loop["source"].per_joint` [rad; m].

    Raises:
        JointMismatch: dataset, source and model do not fit together.
        CheckpointError: the checkpoint cannot be used.
        ModelFileError: φ is to be judged without a source, or the model file cannot be used.
    """
    say = progress or silent
    alone = not isinstance(learned, LearnedModel) and Path(learned).is_file()  # a checkpoint is a folder
    if alone and model is not None:
        raise OptionError(f"{learned} is a model by itself; leave out --model, or give a checkpoint that corrects it.")
    given = as_optional_model(str(learned) if alone else model, actuators)
    judged = None if alone else as_learned(learned)
    recorded = as_dataset(dataset, episodes)
    with checkpoint_folder(judged) as own, kept_folders(recorded) as folders:
        if judged is not None:
            checkpoint.check_fits(judged.network, recorded, own[0])
        source = find_judging_source(judged, given, engine, [*own, *folders])
        simulator = source.simulator(recorded) if source else None
        if simulator is not None and given is not None:
            warn_of_ranges(recorded, find_robot(given).spec().compile())
        others, notes = ({}, ()) if not plain_fit or source is None else fit_plain(judged, recorded, source, say)
        network = None if judged is None else judged.network
        found = evaluate_predictors(recorded, simulator, network, count or counting(say), others)
    return replace(found, notes=notes)


def as_learned(learned: LearnedModel | str | Path) -> LearnedModel:
    """Return φ or ψ, read where a folder is given."""
    return learned if isinstance(learned, LearnedModel) else LearnedModel.load(learned)


@contextmanager
def checkpoint_folder(learned: LearnedModel | None) -> Iterator[list[Path]]:
    """Yield the folder of a model's checkpoint, written for a moment where it is in memory only; none of none."""
    if learned is None:
        yield []
    elif learned.folder is not None:
        yield [learned.folder]
    else:
        with tempfile.TemporaryDirectory() as folder:
            yield [learned.save(Path(folder, "checkpoint"))]


def find_judging_source(
    learned: LearnedModel | None, model: str | None, engine: str | None, kept_in: Sequence[Path]
) -> SourceModel | None:
    """Return the source that is compared with; None where ψ is judged and none is known.

    Raises:
        ModelFileError: φ is judged and none is known.
    """
    try:
        return locate_source(model, (), kept_in, engine)
    except ModelFileError:
        if model is None and learned is not None and learned.kind == "forward":
            return None
        if model is None and learned is not None and learned.folder is None:
            raise ModelFileError('This φ keeps no source; give the one that it corrects: model="MODEL.xml".') from None
        raise


def fit_plain(
    learned: LearnedModel | None, dataset: Dataset, source: SourceModel, say: Progress
) -> tuple[Mapping[str, Simulator], tuple[str, ...]]:
    """Return the plain fit of a source by its name, with what it was fitted to; nothing where it cannot be made."""
    from nas_data.gap.plain import fit_plain_source

    if source.effects or source.engine != MUJOCO:
        return {}, (f"no {PLAIN}: it is made of a plain model in MuJoCo",)
    trained_on = learned.trained_on if learned else None
    fitted, what = (trained_on, "what the model was trained on") if trained_on else (dataset, "these very episodes")
    try:
        simulator = fit_plain_source(fitted, str(source.model), name_of(fitted), say)
    except NasError as error:
        warn([f"no {PLAIN}: {error}"])
        return {}, (f"no {PLAIN}: {error}",)
    return {PLAIN: simulator}, (f"{PLAIN}: every smooth parameter of the source, fitted to {what}",)


def counting(progress: Progress) -> Count:
    """Return what tells of control steps done as sentences."""
    return lambda done, total: progress(f"rolling out {done}/{total}")
