"""Whether a learned model fits an environment: the same joints, rate, commands, and the source that it corrects."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from nas_data.dataset.features import POSITION
from nas_data.effects.base import read_effects
from nas_data.errors import CheckpointError, JointMismatch
from nas_data.models import checkpoint as checkpoints
from nas_data.models.lstm import DynamicsModel
from nas_data.simulators.base import Simulator
from nas_data.simulators.engines import load_simulator
from nas_data.sources import EFFECTS, MODEL

SAME_SOURCE = 1e-3  # [rad] apart after PROBED; equal sources agree to rounding, 4 g more at the tip makes 0.03
PROBED = 20  # control steps, with wide commands: limits, play and friction under load do not show in one step
PROBES = 64  # rollouts in which two sources are compared
REMEDY = "Pair the dataset with this environment's robot, with the same effects if any, and train again."
WIDE, WEAK = 1.5, 0.1  # [rad] and [N·m] of the probes' commands


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
    if model.commands_effort == (set(simulator.kinds) == {POSITION}):
        raise CheckpointError(f"The checkpoint {folder} and the environment take different commands (angle, torque).")
    if model.kind == "delta":
        check_source(folder, model, simulator)
    return model


def check_source(folder: Path, model: DynamicsModel, simulator: Simulator) -> None:
    """Refuse φ where it would correct another source than it was trained to correct.

    The source kept with the checkpoint must move as the simulator does; where none is kept, what the checkpoint
    records of it must be what the simulator is.

    Raises:
        CheckpointError: it is another source.
    """
    recorded = model.provenance.get("source")
    record = recorded if isinstance(recorded, dict) else {}
    engine, ours = str(record.get("engine", "mujoco")), simulator.describe()
    if engine != ours.get("engine"):
        raise CheckpointError(
            f"The checkpoint {folder} corrects a source in {engine}; the environment runs in {ours.get('engine')}."
        )
    if not (folder / MODEL).is_file():
        check_record(folder, record, ours)
        return
    effects = read_effects(folder / EFFECTS) if (folder / EFFECTS).is_file() else ()
    kept = load_simulator(folder / MODEL, simulator.period, simulator.joints, effects, engine)
    if (apart := distance(kept, simulator)) > SAME_SOURCE:
        raise CheckpointError(
            f"The checkpoint {folder} corrects another source than this environment's: under the same commands they "
            f"are up to {apart:.2g} rad apart after {PROBED} steps. {REMEDY}"
        )


def check_record(folder: Path, record: Mapping[str, object], ours: Mapping[str, object]) -> None:
    """Refuse φ that keeps no source, where what it records of its source is not what the environment's is."""
    theirs = {"effects": [], **record}
    different = [key for key in ("sha256", "effects") if key in theirs and theirs[key] != ours.get(key, theirs[key])]
    if different:
        what = "another model" if "sha256" in different else "other effects"
        raise CheckpointError(
            f"The checkpoint {folder} was trained on a source with {what} than this environment's. {REMEDY}"
        )


def distance(one: Simulator, other: Simulator) -> float:
    """Return how far apart [rad] the joints of two simulators are at most in rollouts from the same states."""
    n = len(other.joints)
    rng = np.random.default_rng(0)
    states = rng.uniform(-0.5, 0.5, (PROBES, 2 * n))
    reach = WIDE if set(other.kinds) == {POSITION} else WEAK
    commands = np.repeat(rng.uniform(-reach, reach, (PROBES, 2, n)), PROBED // 2, axis=1)
    apart = np.abs(one.rollout(states, commands) - other.rollout(states, commands))
    return float(apart[..., :n].max())


def checkpoint_sha256(folder: Path) -> str:
    """Return a hash of what a checkpoint's model is: configuration and weights."""
    names = (checkpoints.CONFIG, checkpoints.WEIGHTS)
    return hashlib.sha256(b"".join((checkpoints.find(folder) / name).read_bytes() for name in names)).hexdigest()
