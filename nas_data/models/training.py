"""Setup of a training of φ or ψ: data split, model, loss and validation error."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np
import torch

from nas_data.arrays import thin_evenly
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import EFFORT
from nas_data.errors import DatasetInvalid, JointMismatch, OptionError
from nas_data.joint_units import SHARE, JointUnit, average_by_kind, group_by_kind
from nas_data.log import warn
from nas_data.metrics import Errors
from nas_data.models.episodes import cut_episodes, join, pad, read_episodes
from nas_data.models.fitting import CONSTANT, prepare, shrink_shortcut
from nas_data.models.losses import FreeRunning, Phase, TeacherForcing, compute_one_step_loss
from nas_data.models.lstm import DynamicsModel, Kind
from nas_data.models.predictions import roll_out_model
from nas_data.models.presets import TrainingOptions
from nas_data.models.split import select_frames, split_validation
from nas_data.models.stateful_source import predict_with_memory
from nas_data.models.symmetry import find_symmetry
from nas_data.simulators.base import Simulator

SEGMENT = 1000  # most frames of a validation rollout: enough for errors to accumulate, few enough to run often
SEGMENTS = 32  # most validation rollouts


class ModelTraining:
    """One training of φ or ψ on a dataset.

    Attributes:
        model: The network, with normalisation from the training episodes.
        phase: Free running if a source is available (ψ needs none), else teacher forcing.
        split: Training data, and validation data for early stopping.
    """

    def __init__(
        self,
        kind: Kind,
        dataset: Dataset,
        options: TrainingOptions,
        simulator: Simulator | None = None,
        provenance: Mapping[str, object] | None = None,
        device: str | None = None,
    ) -> None:
        """Split the episodes, and build and initialise the model.

        Args:
            kind: `delta` for φ, `forward` for ψ.
            dataset: Transitions; paired for φ.
            options: See `TrainingOptions`.
            simulator: Source, for free running and validation of φ; without it φ is trained by teacher forcing.
            provenance: Dataset and source, which are stored in the checkpoint.
            device: torch device; a GPU, if available, if None.

        Raises:
            DatasetInvalid: φ without `next.observation.sim_state`.
            JointMismatch: simulator and dataset have different joints.
            ModelFileError: the source's model does not have its declared symmetry.
            OptionError: torch cannot use the device, or the options ask for torque correction without torques, for a
                symmetry that the model does not have, or for stiction without commanded positions.
        """
        if kind == "delta" and not dataset.paired:
            raise DatasetInvalid(
                "A delta model needs the source's predictions: pair the dataset with a model first, by `nas pair` or "
                "`nas_data.pair`."
            )
        if simulator is not None and simulator.joints != dataset.joints:
            raise JointMismatch("The simulator and the dataset have different joints.")
        if options.corrects == "command":
            check_torques(kind, dataset.kinds, options, simulator)
        if options.stiction:
            check_positions(kind, dataset)
        self.options = options
        self.simulator = simulator
        self.device = find_device(device)
        if kind == "delta" and simulator is not None and simulator.remembers:
            dataset = predict_with_memory(dataset, simulator)
        self.split = split_validation(dataset, options.validation, options.seed)
        if self.split.is_still:
            warn(
                [
                    f"the arm hardly moves in the validation data, {self.split.description}, so that these do not tell "
                    "when to stop; record longer episodes or more of them, or give --validation 0.3"
                ]
            )
        self.free = options.updates > 0 and (kind == "forward" or simulator is not None)
        self.model = self._build(kind, dataset, provenance or {})
        episodes = read_episodes(self.split.train, simulator=simulator)
        prepare(self.model, join(episodes), simulator)
        self.model.to(self.device)
        self.phase: Phase = (
            FreeRunning(self.model, episodes, simulator, options, self.device, dataset.slides)
            if self.free
            else TeacherForcing(self.model, episodes, options, self.device)
        )
        self.rollouts = cut_validation_rollouts(self.split.validation)
        self.scales = compute_error_scales(self.split.train)

    def _build(self, kind: Kind, dataset: Dataset, provenance: Mapping[str, object]) -> DynamicsModel:
        torch.manual_seed(self.options.seed)
        options = self.options
        return DynamicsModel(
            kind=kind,
            joints=list(dataset.joints),
            hidden=options.hidden,
            layers=options.layers,
            relative=options.relative,
            shortcut=options.shortcut,
            commands_effort=not dataset.commands_positions,
            fps=float(dataset.fps),
            provenance={
                **provenance,
                "training": asdict(options),
                "validation": self.split.description,
                "validation_unit": self.unit.si if self.unit else None,
            },
            corrects=options.corrects,
            stiction=options.stiction,
            **(find_symmetry(self.simulator) if options.symmetric and self.simulator else {}),
        )

    @property
    def unit(self) -> JointUnit | None:
        """Unit of the validation error; None for normalised one-step errors."""
        kinds = group_by_kind(self.split.train.joints, self.split.train.slides)
        return None if not self.free else kinds[0][0] if len(kinds) == 1 else SHARE

    @property
    def criterion(self) -> str:
        """Description of the validation error, with its unit."""
        if self.unit is None:
            return "one-step normalised MSE"
        unit = "over the spread of hinges, and of slides" if self.unit is SHARE else f"[{self.unit.si}]"
        return f"open-loop position RMSE {unit}"

    def validation_error(self, model: DynamicsModel | None = None) -> float:
        """Return the error on the validation data of the model, or of the same model with other weights."""
        model = model or self.model
        model.eval()
        with torch.no_grad():
            error = self._measure_open_loop_error(model) if self.free else self._measure_one_step_error(model)
        model.train()
        return error

    def shrink_shortcut(self) -> tuple[float, float]:
        """Reduce a diverging shortcut; see `fitting.shrink_shortcut`."""
        if self.model.shortcut is None:
            return 1.0, self.validation_error()
        return shrink_shortcut(self.model, self.validation_error)

    def _measure_open_loop_error(self, model: DynamicsModel) -> float:
        model.to("cpu")
        predicted = roll_out_model(self.rollouts, self.simulator, model)
        measured = [self.rollouts.next_states[rows] for rows in self.rollouts.episodes()]
        model.to(self.device)
        error = Errors.of(self.rollouts.joints, predicted, measured).over(self.scales)
        return error if np.isfinite(error) else float("inf")

    def _measure_one_step_error(self, model: DynamicsModel) -> float:
        batch, mask = pad(cut_episodes(read_episodes(self.split.validation), self.options.segment))
        return float(compute_one_step_loss(model, batch, mask, self.device))


def check_torques(kind: Kind, commands: Sequence[str], options: TrainingOptions, simulator: Simulator | None) -> None:
    """Check the requirements of a training that corrects torques.

    Raises:
        OptionError: the kind is ψ, commands are no torques, the source is missing, or updates are 0.
    """
    if kind != "delta" or set(commands) != {EFFORT}:
        reason = "ψ corrects nothing" if kind != "delta" else "this robot does not take torques"
    elif simulator is None or not options.updates:
        reason = "it is trained in free running, which takes the source and --updates"
    else:
        return
    raise OptionError(f"The preset {options.preset} is of φ that corrects torques: {reason}; use the preset few.")


def check_positions(kind: Kind, dataset: Dataset) -> None:
    """Check the requirements of a training with stiction.

    Raises:
        OptionError: the kind is ψ, or a command is no position.
    """
    if kind != "delta" or not dataset.commands_positions:
        other = "ψ" if kind != "delta" else "an arm with other commands"
        raise OptionError(
            f"Stiction is for φ of an arm that takes positions, not for {other}; use the preset fast, or few for "
            "recordings of a few minutes."
        )


def find_device(name: str | None) -> torch.device:
    """Return a torch device by its name; for None a GPU if available, else the CPU.

    Raises:
        OptionError: torch does not know the device, or this machine does not have it.
    """
    if name is None:
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
        torch.empty(1, device=device).cpu()
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise OptionError(f"torch cannot use the device '{name}' ({reason}); give cpu, or cuda with a GPU.") from None
    return device


def compute_error_scales(train: Dataset) -> np.ndarray:
    """Return the divisors of joint errors in averages, shape (n,): 1 if all joints are of one kind."""
    joints, slides = train.joints, train.slides
    if len(group_by_kind(joints, slides)) == 1:
        return np.ones(len(joints))
    return np.maximum(average_by_kind(train.states[:, : len(joints)].std(axis=0), joints, slides), CONSTANT)


def cut_validation_rollouts(held: Dataset) -> Dataset:
    """Cut validation data into rollouts of bounded length, each of which starts at a measured state."""
    starts = [
        (start, min(start + SEGMENT, rows.stop))
        for rows in held.episodes()
        for start in range(rows.start, rows.stop, SEGMENT)
    ]
    order = thin_evenly(len(starts), SEGMENTS)
    return select_frames(held, [starts[index] for index in order])
