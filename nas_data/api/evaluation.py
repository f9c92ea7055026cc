"""Evaluation of φ, ψ and model files against baselines that need no learning."""

import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from nas_data.api.arguments import (
    Actuators,
    Count,
    Progress,
    as_dataset,
    as_models,
    as_optional_model,
    count_aloud,
    find_folder,
)
from nas_data.api.learned_model import LearnedModel
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.origin import kept_folders
from nas_data.dataset.split import format_episodes
from nas_data.dataset.supply_voltage import read_supply_voltages
from nas_data.dataset.torque_off import drop_rows_without_torque, follow_shutdowns
from nas_data.envs.loop.load_model import check_source
from nas_data.errors import CheckpointError, ModelFileError, NasError, OptionError
from nas_data.log import warn
from nas_data.models import checkpoint
from nas_data.models.evaluation import PLAIN, Evaluation
from nas_data.models.evaluation import evaluate as evaluate_predictors
from nas_data.models.lstm import DynamicsModel
from nas_data.models.predictions import Predictions, predict
from nas_data.pairing import warn_of_overlaps, warn_of_ranges
from nas_data.robots.base import find_robot, list_robot_names
from nas_data.runs.progress import silence
from nas_data.simulators.base import Simulator
from nas_data.simulators.engines import MUJOCO
from nas_data.simulators.servo_registers import ServoRegisters, group_by_registers
from nas_data.sources import SourceModel, locate_source

MODEL = "model"  # name of a model file that is compared with its source


def evaluate(
    learned: LearnedModel | str | Path,
    dataset: Dataset | str | Path,
    *,
    model: str | Path | None = None,
    engine: str | None = None,
    episodes: Iterable[int] | None = None,
    plain_fit: bool = True,
    actuators: Actuators = "position",
    progress: Progress | None = None,
    count: Count | None = None,
) -> Evaluation:
    """Compare φ, ψ or a model file with hold, source, command and a plain fit, in one step and in open loop.

    The plain fit adjusts every smooth parameter of the source, without names and networks. It is fitted to the model's
    training data if these are in memory, else to the evaluated dataset itself.

    Args:
        learned: φ or ψ, its folder, or a model: an MJCF or URDF file, or a robot's name.
        dataset: Any recording of the same joints and rate, or its folder; it need not be paired.
        model: Source. If None, the one stored with φ, ψ or the dataset; an evaluated model file is then its own source.
            Else an evaluated model file is listed as `model`.
        engine: `mujoco` or `bullet`; None for the source's own.
        episodes: Only these episodes, each once; None for all.
        plain_fit: Whether to make the plain fit; it takes seconds to minutes.
        actuators: Actuators for a URDF.
        progress: Called with progress messages.
        count: Called with the control steps done and in total; None for `progress`.

    Returns:
        Errors by predictor, overall, per joint and per episode: `evaluation.open_loop["source"].per_joint` [rad; m].

    Raises:
        JointMismatch: dataset, source and model do not fit together.
        CheckpointError: the checkpoint cannot be used.
        ModelFileError: φ has no source, or the model file cannot be used.
        OptionError: no episodes are given, or one twice.
    """
    say = progress or silence
    recorded = as_dataset(dataset, episodes)
    if is_model(learned):
        models = as_models([str(learned) if model is None else model, str(learned)], actuators)
        return evaluate_model(recorded, models, engine, plain_fit, say)
    return evaluate_learned(
        recorded, as_learned(learned), as_optional_model(model, actuators), engine, plain_fit, say, count
    )


def evaluate_learned(
    recorded: Dataset,
    learned: LearnedModel,
    given: str | None,
    engine: str | None,
    plain_fit: bool,
    say: Progress,
    count: Count | None,
) -> Evaluation:
    """Compare φ or ψ; see `evaluate`. φ corrects the source as given, without the recording's registers; see `pair`."""
    with checkpoint_folder(learned) as own, kept_folders(recorded) as folders:
        checkpoint.check_fits(learned.network, recorded, own[0])
        source = find_evaluation_source(learned, given, engine, [*own, *folders])
        powered, left_out = drop_rows_without_torque(recorded)
        simulator = source.simulator(powered) if source else None
        if simulator is not None and given is not None:
            warn_of_ranges(recorded, find_robot(given))
            warn_of_overlaps(recorded, simulator)
        fitted, notes = fit_plain(learned, recorded, source, say) if plain_fit else ({}, ())
        notes = (*notes, *note_registers(recorded, source, fitted))
        found = evaluate_predictors(powered, simulator, learned.network, count or count_aloud(say), fitted)
        if simulator is not None and (given is not None or engine is not None):
            notes = (*notes, *note_other_source(own[0], learned.network, simulator))
    return replace(found, notes=(*left_out, *notes))


def evaluate_model(
    recorded: Dataset, models: Sequence[str], engine: str | None, plain_fit: bool, say: Progress
) -> Evaluation:
    """Compare a model with the one that it came from; see `evaluate`.

    Both have the registers of each episode, and no torque where it is off.

    Args:
        recorded: Transitions.
        models: The model that it came from, and the model; both may be the same.
        engine: As for `evaluate`.
        plain_fit: As for `evaluate`.
        say: Receives progress messages.
    """
    named = dict(zip(("source", MODEL), dict.fromkeys(models), strict=False))  # equal models once
    sources = {name: locate_source(model, (), (), engine) for name, model in named.items()}
    is_mujoco = sources["source"].engine == MUJOCO
    powered, notes = (follow_shutdowns if is_mujoco else drop_rows_without_torque)(recorded)
    fitted, more = fit_plain(None, recorded, sources["source"], say) if plain_fit else ({}, ())
    groups = list(group_by_registers(powered, read_supply_voltages(recorded)))
    parts: list[Predictions] = []
    for places, known in groups:
        part = powered.select(places) if len(groups) > 1 else powered
        simulators = {name: source.with_registers(known).simulator(part) for name, source in sources.items()}
        simulator = simulators.pop("source")
        if not parts:
            warn_of_ranges(recorded, sources["source"].robot)
            warn_of_overlaps(recorded, simulator)
        parts.append(predict(part, simulator, None, others={**fitted, **simulators}))
    predictions = Predictions.join(parts, [places for places, _ in groups])
    told = describe_settings(powered.episode_numbers, groups, sources)
    return replace(Evaluation.of(powered, predictions), notes=(*notes, *more, *told))


def describe_settings(
    numbers: Sequence[int], groups: Sequence[tuple[list[int], ServoRegisters]], sources: Mapping[str, SourceModel]
) -> list[str]:
    """Return sentences: what the registers of each group of episodes change in each model.

    Args:
        numbers: Number of each episode.
        groups: Places of the episodes, and their registers.
        sources: Models by name.
    """
    told = []
    for places, known in groups:
        word = "Episode" if len(places) == 1 else "Episodes"
        where = f"{word} {format_episodes([numbers[place] for place in places])}: " if len(groups) > 1 else ""
        if where and not known.values:
            told.append(f"{where}No registers are known.")
        for name, source in sources.items():
            which = f"{name}: " if len(sources) > 1 else ""
            told += [f"{where}{which}{sentence}" for sentence in known.describe(source.robot)]
    return told


def note_registers(recorded: Dataset, source: SourceModel | None, fitted: Mapping[str, Simulator]) -> list[str]:
    """Return a note if a recording's registers would change the source, which φ corrects as given."""
    if source is None:
        return []
    changes = ServoRegisters.of(recorded).list_changes(source.robot)
    if not changes:
        return []
    others = "".join(f", unlike the {name}" for name in fitted)
    return [f"The source is as given, not as the recording's registers say ({'; '.join(changes)}){others}."]


def note_other_source(folder: Path, network: DynamicsModel, simulator: Simulator) -> list[str]:
    """Return a note if φ corrects another source than the one that it was trained for."""
    if network.kind != "delta":
        return []
    try:
        check_source(folder, network, simulator)
    except CheckpointError as error:
        return [f"φ is not used as it was trained: {error}"]
    return []


def is_model(learned: LearnedModel | str | Path) -> bool:
    """Whether the argument is a model file or a robot's name and not a learned model, whose checkpoint is a folder."""
    if isinstance(learned, LearnedModel):
        return False
    return Path(learned).is_file() or (str(learned) in list_robot_names() and not Path(learned).exists())


def as_learned(learned: LearnedModel | str | Path) -> LearnedModel:
    """Return φ or ψ; a folder is read.

    Raises:
        OptionError: there is no such file or folder.
    """
    if not isinstance(learned, LearnedModel) and not Path(learned).exists():
        raise OptionError(
            f"There is no file or folder '{learned}', and no robot of that name ({', '.join(list_robot_names())}); "
            "give a model file or a folder written by `nas train`."
        )
    return learned if isinstance(learned, LearnedModel) else LearnedModel.load(learned)


@contextmanager
def checkpoint_folder(learned: LearnedModel | None) -> Iterator[list[Path]]:
    """Yield the folder of a model's checkpoint, temporary if it is only in memory; empty without a model."""
    if learned is None:
        yield []
    elif learned.folder is not None:
        yield [learned.folder]
    else:
        with tempfile.TemporaryDirectory() as folder:
            yield [learned.save(Path(folder, "checkpoint"))]


def find_evaluation_source(
    learned: LearnedModel | None, model: str | None, engine: str | None, kept_in: Sequence[Path]
) -> SourceModel | None:
    """Return the source for comparison; None for ψ without a known source.

    Raises:
        ModelFileError: φ has no known source.
    """
    try:
        return locate_source(model, (), kept_in, engine)
    except ModelFileError:
        if model is None and learned is not None and learned.kind == "forward":
            return None
        if model is None and learned is not None and learned.folder is None:
            raise ModelFileError(
                'This φ was saved without its source; give the model that it corrects: model="MODEL.xml".'
            ) from None
        raise


def fit_plain(
    learned: LearnedModel | None, dataset: Dataset, source: SourceModel | None, say: Progress
) -> tuple[Mapping[str, Simulator], tuple[str, ...]]:
    """Return the plain fit of a source by name, and the data that it was fitted to; empty if it fails."""
    from nas_data.gap.plain_source import fit_plain_source

    if source is None:
        return {}, (f'no {PLAIN}: it needs the model that it fits; give model="MODEL.xml"',)
    if source.effects or source.engine != MUJOCO:
        return {}, (f"no {PLAIN}: it needs a plain MuJoCo model as the source",)
    trained_on = learned.trained_on if learned else None
    fitted, what = (trained_on, "the training data of the model") if trained_on else (dataset, "these same episodes")
    try:
        simulator = fit_plain_source(fitted, str(source.model), find_folder(fitted), say)
    except NasError as error:
        warn([f"no {PLAIN}: {error}"])
        return {}, (f"no {PLAIN}: {error}",)
    return {PLAIN: simulator}, (f"{PLAIN}: every smooth parameter of the source, fitted to {what}",)
