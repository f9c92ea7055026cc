"""Loading of learned models for an environment, with checks of joints, rate, commands and source."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from nas_data.dataset.features import POSITION
from nas_data.effects.base import read_effects
from nas_data.errors import CheckpointError
from nas_data.models import checkpoint as checkpoints
from nas_data.models.lstm import DynamicsModel
from nas_data.simulators.base import Simulator
from nas_data.simulators.engines import load_simulator
from nas_data.sources import EFFECTS, MODEL

SAME_SOURCE = 1e-3  # [rad] apart after PROBED; equal sources agree to rounding, 4 g more at the tip makes 0.03
PROBED = 20  # control steps with large commands: limits, backlash and friction need more than one step to show
PROBES = 64  # rollouts for the comparison of two sources
REMEDY = "Pair the dataset with the source in use, with the same effects if any, and train again."
WIDE, WEAK = 1.5, 0.1  # [rad] and [N·m] of the probes' commands


def load_model(folder: Path, simulator: Simulator) -> DynamicsModel:
    """Load a frozen φ or ψ for a simulator.

    Raises:
        CheckpointError: it is damaged, or corrects another source.
        JointMismatch: it was trained for other joints, another rate or other commands.
    """
    folder = checkpoints.find_checkpoint(folder)
    model = checkpoints.load_for_inference(folder)
    checkpoints.check_fits(model, simulator, folder)
    if model.kind == "delta":
        check_source(folder, model, simulator)
    return model


def check_source(folder: Path, model: DynamicsModel, simulator: Simulator) -> None:
    """Refuse φ if the simulator is not the source that it was trained to correct.

    The source stored with the checkpoint must move like the simulator. Without a stored source, its description in the
    checkpoint must match the simulator.

    Raises:
        CheckpointError: the sources differ.
    """
    recorded = model.provenance.get("source")
    record = recorded if isinstance(recorded, dict) else {}
    engine, ours = str(record.get("engine", "mujoco")), simulator.describe()
    if engine != ours.get("engine"):
        raise CheckpointError(
            f"The checkpoint {folder} corrects a source in {engine}; the one in use runs in {ours.get('engine')}."
        )
    if not (folder / MODEL).is_file():
        check_record(folder, record, ours)
        return
    effects = read_effects(folder / EFFECTS) if (folder / EFFECTS).is_file() else ()
    kept = load_simulator(folder / MODEL, simulator.period, simulator.joints, effects, engine)
    if (apart := measure_rollout_difference(kept, simulator)) > SAME_SOURCE:
        raise CheckpointError(
            f"The checkpoint {folder} was trained with another source than the one in use: under the same commands "
            f"they are up to {apart:.2g} rad apart after {PROBED} steps. {REMEDY}"
        )


def check_record(folder: Path, record: Mapping[str, object], ours: Mapping[str, object]) -> None:
    """Refuse φ without a stored source if the description of its source differs from the environment's."""
    theirs = {"effects": [], **record}
    different = [key for key in ("sha256", "effects") if key in theirs and theirs[key] != ours.get(key, theirs[key])]
    if different:
        what = "another model" if "sha256" in different else "other effects"
        raise CheckpointError(
            f"The checkpoint {folder} was trained on a source with {what} than the one in use. {REMEDY}"
        )


def measure_rollout_difference(one: Simulator, other: Simulator) -> float:
    """Return the largest joint difference [rad] of two simulators in rollouts from the same states."""
    n = len(other.joints)
    rng = np.random.default_rng(0)
    states = rng.uniform(-0.5, 0.5, (PROBES, 2 * n))
    reach = WIDE if set(other.kinds) == {POSITION} else WEAK
    commands = np.repeat(rng.uniform(-reach, reach, (PROBES, 2, n)), PROBED // 2, axis=1)
    apart = np.abs(one.rollout(states, commands) - other.rollout(states, commands))
    return float(apart[..., :n].max())


def hash_checkpoint(folder: Path) -> str:
    """Return a hash of a checkpoint's configuration and weights."""
    names = (checkpoints.CONFIG, checkpoints.WEIGHTS)
    return hashlib.sha256(
        b"".join((checkpoints.find_checkpoint(folder) / name).read_bytes() for name in names)
    ).hexdigest()
