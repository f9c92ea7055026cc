"""Training options and their presets."""

from dataclasses import dataclass, replace
from typing import Literal

from nas_data.errors import OptionError, UnknownName

Corrected = Literal["state", "command"]


@dataclass(frozen=True)
class TrainingOptions:
    """All options of a training.

    Attributes:
        preset: Preset on which these options are based.
        hidden: Units of each LSTM layer.
        layers: Number of LSTM layers.
        relative: Feed differences instead of absolute commands and predictions.
        shortcut: Linear map from inputs to outputs, fitted in closed form before training.
        epochs: Passes over the training episodes with teacher forcing (inputs are measured states). Teacher forcing is
            used if `updates` is 0 or φ's source is not available.
        batch: Segments per teacher-forced update.
        segment: Longest segment [frames]; longer episodes are cut; 0 keeps whole episodes.
        rate: Learning rate of teacher forcing.
        updates: Updates in free running (inputs are the model's own states, through the source), which replaces
            teacher forcing: teacher forcing before it increases open-loop errors on new motions.
        frames: Frames per free-running update.
        horizon: Longest free-running window [frames]; windows start at 20 and grow to it.
        discount: Factor on the gradient through the states of each free-running step; 1 for none. In long windows
            gradients through many steps would grow and dominate.
        free_rate: Learning rate of free running.
        cosine: Whether the learning rate follows a cosine decay; otherwise it is constant.
        clip: Largest norm of a gradient; 0 for none.
        weight_decay: AdamW's decoupled weight decay.
        average: Decay of a running mean of the weights, which is validated and stored instead of the weights (Polyak
            and Juditsky, 1992); 0 for none.
        bf16: Whether teacher forcing uses bfloat16, if the CPU supports it.
        validation: Share held out for early stopping: of the episodes, or of each episode if there are few.
        patience: Most validations without improvement of a training that has hardly improved on its start; one more
            ends it. Other trainings run to the end: with growing windows and decaying rate, the best is often last.
        seed: Seed of weights, order and windows.
        corrects: Whether φ corrects `state` or `command`; see `DynamicsModel`.
        symmetric: Whether φ that corrects commands is equivariant under the symmetry of the source's model.
        stiction: Whether joints stand still below a threshold, in φ of an arm that takes positions; see `stiction.py`.
    """

    preset: str = "fast"
    hidden: int = 128
    layers: int = 3
    relative: bool = True
    shortcut: bool = True
    epochs: int = 40
    batch: int = 16
    segment: int = 300
    rate: float = 2e-3
    updates: int = 400
    frames: int = 3200
    horizon: int = 150
    discount: float = 1.0
    free_rate: float = 2e-3
    cosine: bool = True
    clip: float = 0.5
    weight_decay: float = 1e-3
    average: float = 0.0
    bf16: bool = True
    validation: float = 0.1
    patience: int = 1000
    seed: int = 0
    corrects: Corrected = "state"
    symmetric: bool = False
    stiction: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.validation < 1:
            raise OptionError(f"The validation share is {self.validation}; it must lie between 0 and 1.")
        if not 0 <= self.discount <= 1:
            raise OptionError(f"The discount of gradients is {self.discount}; it must lie between 0 and 1.")
        if not 0 <= self.average < 1:
            raise OptionError(f"The decay of the weights' mean is {self.average}; it must lie between 0 and 1.")
        if min(self.hidden, self.layers, self.batch, self.frames) < 1 or self.horizon < 2:
            raise OptionError("Hidden units, layers, batch and frames must be at least 1, the horizon at least 2.")
        if min(self.epochs, self.updates, self.segment, self.patience, self.seed) < 0:
            raise OptionError("Epochs, updates, segment, patience and seed must not be negative.")
        if self.symmetric and self.corrects != "command":
            raise OptionError("A symmetry needs a φ that corrects commands.")
        if self.stiction and self.corrects != "state":
            raise OptionError("Stiction needs a φ that corrects states.")


FEW = TrainingOptions(
    preset="few",
    layers=1,
    updates=480,
    frames=6400,
    horizon=30,
    discount=0.95,
    free_rate=4e-3,
    weight_decay=1.0,
    average=0.99,
    patience=20,
)

PRESETS = {
    "fast": TrainingOptions(),
    # The discount keeps the gradient of long windows from growing. With one layer errors are smaller than with three.
    "stiction": TrainingOptions(preset="stiction", layers=1, discount=0.97, stiction=True),
    # For recordings of a few minutes, which a larger network overfits. With longer windows some trainings diverge.
    # Chosen on four sets of 100 Pusher trajectories (docs/log/experiments.md).
    "few": FEW,
    # For short recordings of a torque-driven arm whose model declares a symmetry.
    "symmetric": replace(FEW, preset="symmetric", weight_decay=3.0, corrects="command", symmetric=True),
    # Appendix A.1: Adam, 250 epochs, batch size 1, learning rate 0.01; teacher forcing on whole trajectories.
    "paper": TrainingOptions(
        preset="paper",
        relative=False,
        shortcut=False,
        epochs=250,
        batch=1,
        segment=0,
        rate=0.01,
        updates=0,
        cosine=False,
        clip=0.0,
        weight_decay=0.0,
        bf16=False,
    ),
}


def choose_preset(kind: Literal["delta", "forward"], commands_positions: bool) -> str:
    """Return the name of the default preset: `stiction` for φ of an arm that takes positions, else `fast`."""
    return "stiction" if kind == "delta" and commands_positions else "fast"


def preset(name: str, **changes: int | float | bool | None) -> TrainingOptions:
    """Return a preset with some options changed; None leaves an option as it is.

    Raises:
        UnknownName: there is no such preset.
        OptionError: a value is out of its range.
    """
    if name not in PRESETS:
        raise UnknownName("preset", name, PRESETS)
    given = {key: value for key, value in changes.items() if value is not None}
    return replace(PRESETS[name], **given)  # type: ignore[arg-type]  # dataclasses.replace is not generic over fields
