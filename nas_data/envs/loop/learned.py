"""Whether a learned model fits an environment: the same joints, rate, commands, and the source that it corrects."""

import hashlib
from pathlib import Path

import numpy as np

from nas_data.errors import CheckpointError, JointMismatch
from nas_data.models import checkpoint as checkpoints
from nas_data.models.lstm import DynamicsModel
from nas_data.simulators.base import Simulator
from nas_data.simulators.engines import load_simulator
from nas_data.sources import EFFECTS, MODEL

SAME_SOURCE = 1e-4  # [rad] per control step; equal sources agree to rounding, 4 g more at the tip makes 1.7e-4
PROBES = 64  # transitions on which two sources are compared


def load_model(folder: Path, simulator: Simulator) -> DynamicsModel:
    """Load a frozen φ or ψ for a simulator.

    Raises:
        CheckpointError: it is damaged, learned at another rate or from other commands, or corrects another source.
        JointMismatch: it belongs to another robot.
    """
    folder = checkpoints.find(folder)
    model = checkpoints.load_frozen(folder)
    if model.joints != simulator.joints:
        raise JointMismatch(
            f"The checkpoint {folder} was trained for the joints {', '.join(model.joints)}; "
            f"the environment has {', '.join(simulator.joints)}."
        )
    rate = 1 / simulator.period
    if abs(model.fps / rate - 1) > 1e-3:
        raise CheckpointError(
            f"The checkpoint {folder} learned at {model.fps:g} Hz; the environment runs at {rate:g} Hz. "
            "Record and train at that rate."
        )
    if model.commands_effort != simulator.commands_effort:
        raise CheckpointError(f"The checkpoint {folder} and the environment take different commands (angle, torque).")
    if model.kind == "delta":
        check_source(folder, model, simulator)
    return model


def check_source(folder: Path, model: DynamicsModel, simulator: Simulator) -> None:
    """Refuse φ where it would correct another source than it was trained to correct.

    The source kept with the checkpoint, if there is one, must predict what the simulator predicts.
    """
    recorded = model.provenance.get("source")
    engine = str(recorded.get("engine", "mujoco")) if isinstance(recorded, dict) else "mujoco"
    ours = str(simulator.describe().get("engine"))
    if engine != ours:
        raise CheckpointError(f"The checkpoint {folder} corrects a source in {engine}; the environment runs in {ours}.")
    if not (folder / MODEL).is_file():
        return
    from nas_data.effects.base import read_effects

    effects = read_effects(folder / EFFECTS) if (folder / EFFECTS).is_file() else ()
    kept = load_simulator(folder / MODEL, simulator.period, simulator.joints, effects, engine)
    n = len(simulator.joints)
    rng = np.random.default_rng(0)
    states = rng.uniform(-0.5, 0.5, (PROBES, 2 * n))
    commands = states[:, :n] + rng.uniform(-0.1, 0.1, (PROBES, n))
    apart = np.abs(kept.predict(states, commands) - simulator.predict(states, commands))[:, :n].max()
    if apart > SAME_SOURCE:
        raise CheckpointError(
            f"The checkpoint {folder} corrects another source than this environment's: they predict angles up to "
            f"{apart:.2g} rad apart after one step. Pair the dataset with this environment's robot and train again."
        )


def checkpoint_sha256(folder: Path) -> str:
    """Return a hash of what a checkpoint's model is: configuration and weights."""
    names = (checkpoints.CONFIG, checkpoints.WEIGHTS)
    return hashlib.sha256(b"".join((checkpoints.find(folder) / name).read_bytes() for name in names)).hexdigest()
