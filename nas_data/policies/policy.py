"""A trained policy from the files of its folder, without pickle."""

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file

from nas_data.atomic_file import write_atomic
from nas_data.errors import CheckpointError
from nas_data.typed_json import FormError, as_object, from_json
from nas_data.visible_files import list_visible_files


@dataclass(frozen=True)
class Hyperparameters:
    """The paper's PPO; 16 arms share a rollout of its robot experiments (4 processes × 2048 steps)."""

    arms: int = 16  # simulations stepped together
    rollout: int = 8192  # frames between two updates, over all arms
    minibatches: int = 32  # parts of a rollout, one gradient step each
    epochs: int = 10  # passes over a rollout
    learning_rate: float = 3e-4  # learning rate of Adam
    discount: float = 0.99  # γ
    trace: float = 0.95  # λ of the advantage estimate
    clip: float = 0.2  # largest change of an action's probability ratio
    entropy_weight: float = 0.0  # weight of the entropy in the loss
    value_weight: float = 0.5  # weight of the value error in the loss
    gradient_norm: float = 0.5  # largest norm of a gradient
    hidden: tuple[int, ...] = (64, 64)  # widths of the tanh layers, separate for actor and critic


RESULT = "result.json"


@dataclass(frozen=True)
class PolicyScore:
    """Score over the episodes of an evaluation."""

    mean_return: float = field(metadata={"key": "return"})
    return_median: float  # median return
    success_rate: float  # share of episodes that reached the goal
    mean_length: float  # mean number of control steps
    diverged: int  # number of episodes that ended because the simulation diverged
    episodes: int  # number of episodes


@dataclass(frozen=True)
class EvaluationTime:
    """Wall time and processor time of an evaluation [s]."""

    wall_seconds: float
    cpu_seconds: float


@dataclass(frozen=True)
class DivergedEpisodes:
    """Number of diverged episodes in the training and in the evaluation."""

    learning: int
    judging: int


@dataclass(frozen=True)
class PolicyResult:
    """Result of one method with one seed."""

    question: Mapping[str, object]  # what the result depends on; see `Run.question`
    circumstances: Mapping[str, object]  # versions, commit and files behind it
    score: PolicyScore  # score on the target
    returns: tuple[float, ...]  # return of each episode
    wall_seconds: float  # wall time of the training [s]
    cpu_seconds: float  # processor time of the training [s]
    judging: EvaluationTime  # time of the evaluation
    diverged: DivergedEpisodes  # diverged episodes

    def write(self, folder: Path) -> None:
        """Write the result into the folder of the policy."""
        write_atomic(folder / RESULT, (json.dumps(as_object(self), indent=1) + "\n").encode())


def read_result(folder: Path) -> PolicyResult | None:
    """Return the result in the folder of a policy; None if there is no valid one."""
    try:
        return from_json(PolicyResult, json.loads((folder / RESULT).read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return None


CONFIG = "config.json"
WEIGHTS = "policy.safetensors"
PROGRESS = "progress.csv"

HIDDEN = "mlp_extractor.policy_net."  # prefix of the actor's layers in stable-baselines3
OUTPUT = "action_net"
MEAN, VARIANCE = "observation.mean", "observation.variance"
EPSILON = 1e-8  # stable-baselines3's VecNormalize: keeps a constant observation finite
CLIP = 10.0  # the same: normalised observations beyond this are cut


@dataclass(frozen=True)
class PlantModel:
    """Learned model of the dynamics that a policy was trained on."""

    kind: str


@dataclass(frozen=True)
class TrainedPlant:
    """Dynamics that a policy was trained on."""

    environment: str  # name of the environment
    dynamics: str = ""  # name of its dynamics
    model: PlantModel | None = None  # learned model; None if there is none
    retuned: Mapping[str, float] | None = None  # factors of base parameters by name; None without named effects


@dataclass(frozen=True)
class PolicyConfig:
    """What is read of a policy's `config.json`."""

    plant: TrainedPlant  # dynamics of the training
    seed: int = 0  # seed of the training
    frames: int = 0  # its control steps
    hyperparameters: Hyperparameters | None = None  # its hyperparameters; None if the file has none

    @classmethod
    def read(cls, folder: Path) -> "PolicyConfig":
        """Read the file in a policy's folder.

        Raises:
            CheckpointError: it is missing, damaged, or not that of a policy.
        """
        try:
            return from_json(cls, read_config(folder))
        except FormError as error:
            raise CheckpointError(f"{folder / CONFIG} is damaged ({error}); train the policy again.") from None


@dataclass(frozen=True)
class Policy:
    """A policy: mean actions of an actor with tanh layers, with frozen observation statistics."""

    config: PolicyConfig  # settings of its training
    # weights of actor and critic under stable-baselines3's names, and the observation statistics
    tensors: Mapping[str, np.ndarray]

    def act(self, observations: np.ndarray) -> np.ndarray:
        """Return the mean actions (B, a), clipped to [-1, 1], for raw observations (B, o)."""
        scale = np.sqrt(self.tensors[VARIANCE] + EPSILON)
        values = np.clip((observations - self.tensors[MEAN]) / scale, -CLIP, CLIP).astype(np.float32)
        for layer in list_hidden_layers(self.tensors):
            values = np.tanh(self._apply_linear(layer, values))
        return np.clip(self._apply_linear(OUTPUT, values), -1.0, 1.0)

    def _apply_linear(self, layer: str, values: np.ndarray) -> np.ndarray:
        return values @ self.tensors[f"{layer}.weight"].T + self.tensors[f"{layer}.bias"]

    @property
    def environment(self) -> str:
        """Name of the environment that it was trained for."""
        return self.config.plant.environment

    @property
    def seed(self) -> int:
        """Seed of its training."""
        return self.config.seed

    @property
    def frames(self) -> int:
        """Control steps of its training."""
        return self.config.frames


def list_hidden_layers(tensors: Mapping[str, np.ndarray]) -> list[str]:
    """Return the names of the actor's hidden layers, first to last."""
    numbers = sorted(int(name.removeprefix(HIDDEN).split(".")[0]) for name in tensors if name.startswith(HIDDEN))
    return [f"{HIDDEN}{number}" for number in dict.fromkeys(numbers)]


def read_config(folder: Path) -> dict[str, object]:
    """Read a policy's `config.json`.

    Raises:
        CheckpointError: it is missing, or not that of a policy.
    """
    path = folder / CONFIG
    try:
        config = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        config = None
    if not isinstance(config, dict) or config.get("kind") != "ppo":
        raise CheckpointError(
            f"{path} is not the configuration of a policy; give a folder that `nas policy train` wrote."
        )
    return config


def load_policy(folder: Path) -> Policy:
    """Read a policy.

    Raises:
        CheckpointError: the folder holds no policy, or an incomplete one.
    """
    config = PolicyConfig.read(folder)
    path = folder / WEIGHTS
    try:
        tensors = load_file(path)
    except (OSError, SafetensorError) as error:
        raise CheckpointError(
            f"{path} cannot be read ({error}); train the policy to its end, or copy its folder again."
        ) from None
    layers = [f"{layer}.{part}" for layer in (*list_hidden_layers(tensors), OUTPUT) for part in ("weight", "bias")]
    missing = [name for name in (*layers, MEAN, VARIANCE) if name not in tensors]
    if missing:
        raise CheckpointError(
            f"{path} lacks the tensor '{missing[0]}'; it is not a policy that `nas policy train` wrote."
        )
    return Policy(config=config, tensors=tensors)


def find_policies(path: Path) -> list[Path]:
    """Return the policy folders at a path: the path itself, or its subfolders (one per seed), sorted by number.

    Raises:
        CheckpointError: there is no policy.
    """
    if (path / CONFIG).is_file():
        return [path]
    found = [config.parent for config in list_visible_files(path, f"*/{CONFIG}")] if path.is_dir() else []
    if not found:
        what = f"{path} holds no policy" if path.exists() else f"There is no folder {path}"
        raise CheckpointError(f"{what}; give a folder that `nas policy train` wrote.")
    return sorted(found, key=lambda folder: (len(folder.name), folder.name))


def read_progress(folder: Path) -> dict[str, np.ndarray]:
    """Return a policy's learning curve: the columns of `progress.csv`, one value per rollout.

    Raises:
        CheckpointError: the file is missing or damaged.
    """
    path = folder / PROGRESS
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    except (OSError, ValueError, TypeError, IndexError) as error:
        raise CheckpointError(f"{path} is not a learning curve ({error}); train the policy again.") from None
