"""Files of a training: policy, learning curve, and the state for resuming; plain numbers only."""

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from stable_baselines3 import PPO
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize

from nas_data.atomic_file import write_atomic
from nas_data.errors import CheckpointError
from nas_data.policies.policy import CONFIG, MEAN, PROGRESS, VARIANCE, WEIGHTS

STATE = "training.safetensors"
PARTIAL = ".partial"  # suffix of a file that `write_atomic` is writing
STATISTICS = ("observation", "return")
WEIGHT_PREFIX, OPTIMISER_PREFIX = "policy.", "optimiser."


@dataclass(frozen=True)
class Row:
    """One rollout of a training, one row of `progress.csv`."""

    frames: int  # control steps so far
    seconds: float  # wall time so far [s], without interruptions
    cpu_seconds: float  # processor time so far [s]
    episodes: int  # episodes that ended in this rollout
    mean_return: float  # their mean return
    success_rate: float  # share of them that reached the goal
    mean_length: float  # their mean length in control steps
    diverged: int  # number of them that ended because the simulation diverged
    action_std: float  # standard deviation of the exploring actions
    divergence: float  # mean approximate Kullback-Leibler divergence of the update
    value_loss: float  # mean squared error of the critic, in normalised returns


def read_running_statistics(normalised: VecNormalize) -> tuple[RunningMeanStd, RunningMeanStd]:
    """Return the running statistics of observations and of discounted returns."""
    assert isinstance(normalised.obs_rms, RunningMeanStd)  # a dict only where observations are dicts
    return normalised.obs_rms, normalised.ret_rms


def is_vacant(folder: Path) -> bool:
    """Whether a training may begin in a folder: it is new, or its first save was interrupted.

    The configuration is written last, so files without it belong to an interrupted save.
    """
    if not folder.exists():
        return True
    names = {path.name for path in folder.iterdir() if not path.name.endswith(PARTIAL)}
    return not names or (names <= {STATE, WEIGHTS, PROGRESS} and bool(names & {STATE, WEIGHTS}))


def clear_half_saved(folder: Path) -> None:
    """Remove the files of an interrupted first save."""
    if folder.is_dir() and is_vacant(folder):
        for path in folder.iterdir():
            path.unlink()


def save_policy(
    ppo: PPO, normalised: VecNormalize, progress: list[Row], config: Mapping[str, object], folder: Path
) -> None:
    """Write the present policy: weights and observation statistics, learning curve, then the configuration."""
    tensors = {name: tensor.contiguous() for name, tensor in ppo.policy.state_dict().items()}
    observation, _ = read_running_statistics(normalised)
    tensors |= {MEAN: torch.from_numpy(observation.mean.copy()), VARIANCE: torch.from_numpy(observation.var.copy())}
    write_atomic(folder / WEIGHTS, save(tensors))
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(field.name for field in fields(Row))
    table.writerows(astuple(row) for row in progress)
    write_atomic(folder / PROGRESS, text.getvalue().encode())
    written = {**config, "frames": ppo.num_timesteps}
    write_atomic(folder / CONFIG, (json.dumps(written, indent=2) + "\n").encode())


def save_state(ppo: PPO, normalised: VecNormalize, progress: list[Row], folder: Path) -> None:
    """Write the state for resuming, between two segments."""
    tensors = {WEIGHT_PREFIX + name: tensor.contiguous() for name, tensor in ppo.policy.state_dict().items()}
    for number, memory in ppo.policy.optimizer.state_dict()["state"].items():
        tensors |= {f"{OPTIMISER_PREFIX}{number}.{key}": value.contiguous() for key, value in memory.items()}
    for name, running in zip(STATISTICS, read_running_statistics(normalised), strict=True):
        for part in ("mean", "var", "count"):
            value = np.array(getattr(running, part), dtype=np.float64)
            tensors[f"statistics.{name}.{part}"] = torch.from_numpy(value)
    tensors["progress"] = torch.tensor([astuple(row) for row in progress], dtype=torch.float64)
    write_atomic(folder / STATE, save(tensors))


def resume(ppo: PPO, normalised: VecNormalize, progress: list[Row], folder: Path) -> None:
    """Load a folder's training state in place; without one nothing changes.

    Raises:
        CheckpointError: the state is damaged.
    """
    path = folder / STATE
    if not path.exists():
        return
    try:
        tensors = load_file(path)
        ppo.policy.load_state_dict(with_prefix(tensors, WEIGHT_PREFIX))
        restore_optimiser(ppo.policy.optimizer, with_prefix(tensors, OPTIMISER_PREFIX))
        for name, running in zip(STATISTICS, read_running_statistics(normalised), strict=True):
            running.mean = tensors[f"statistics.{name}.mean"].numpy()
            running.var = tensors[f"statistics.{name}.var"].numpy()
            running.count = float(tensors[f"statistics.{name}.count"])
        rows = tensors["progress"].tolist()
    except (OSError, SafetensorError, KeyError, RuntimeError, ValueError) as error:
        raise CheckpointError(f"{path} cannot be resumed from ({error}); remove {folder} and train again.") from None
    kinds = [field.type for field in fields(Row)]
    progress[:] = [Row(*(int(v) if kind is int else v for kind, v in zip(kinds, row, strict=True))) for row in rows]
    ppo.num_timesteps = progress[-1].frames


def with_prefix(tensors: Mapping[str, torch.Tensor], prefix: str) -> dict[str, torch.Tensor]:
    """Return the tensors with a name prefix, by the rest of the name."""
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}


def restore_optimiser(optimiser: torch.optim.Optimizer, tensors: Mapping[str, torch.Tensor]) -> None:
    """Load an optimiser's state from tensors named `<parameter>.<key>`."""
    memories: dict[int, dict[str, torch.Tensor]] = {}
    for name, tensor in tensors.items():
        number, key = name.split(".")
        memories.setdefault(int(number), {})[key] = tensor
    optimiser.load_state_dict({**optimiser.state_dict(), "state": memories})
