"""Motion of the measured arm and its models in one episode, as postures to draw."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.origin import kept_folders
from nas_data.dataset.torque_off import TORQUE, find_torque_off, keep_torque_on, keep_torque_on_and_fall
from nas_data.effects.base import add_effects
from nas_data.joint_units import JointUnit, group_by_kind
from nas_data.log import warn
from nas_data.open_loop import roll_out_scene
from nas_data.pairing import read_initial_states, read_object_states, with_model_units
from nas_data.simulators.engines import MUJOCO
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.simulators.servo_registers import ServoRegisters
from nas_data.sources import SourceModel, locate_source

MEASURED = "measured"


@dataclass(frozen=True)
class Ghost:
    """One arm of a film over T control steps."""

    name: str  # name in the caption
    simulator: MujocoSimulator  # simulator of the model that is drawn
    # joint positions [rad; m], velocities [rad/s; m/s] and objects' states, shape (T + 1, 2n or 2n + m), from the start
    # of the episode
    states: np.ndarray
    errors: np.ndarray  # RMSE over the joints of each kind, hinges [rad] before slides [m], shape (T + 1, kinds)

    @property
    def finite(self) -> np.ndarray:
        """Which rows are finite, shape (T + 1,): a simulation may diverge."""
        return np.asarray(np.isfinite(self.states).all(axis=1))

    def spec(self) -> mujoco.MjSpec:
        """Return the model of the arm, with the simulator's effects."""
        spec = self.simulator.robot.spec()
        add_effects(spec, self.simulator.effects)
        return spec

    def postures(self) -> np.ndarray:
        """Return `qpos` of its model with followers and play, shape (T + 1, nq).

        Rows that are not finite repeat the last finite one.
        """
        last = np.maximum.accumulate(np.where(self.finite, np.arange(len(self.states)), 0))
        rest = self.simulator.rest
        positions, _ = rest.motion(rest(self.states[last]))
        return np.array(positions)

    def error_text(self, frame: int, units: Sequence[JointUnit]) -> str:
        """Return its error at a frame for the caption, for example `3.21° off`."""
        if not self.finite[frame]:
            return "diverged"
        return ", ".join(unit.text(value) for unit, value in zip(units, self.errors[frame], strict=True)) + " off"


@dataclass(frozen=True)
class Motion:
    """Motion of all ghosts in one episode."""

    episode: int  # its number
    dataset: Dataset  # the episode alone, T transitions
    ghosts: tuple[Ghost, ...]  # the measured arm, then the models in the given order

    @property
    def times(self) -> np.ndarray:
        """Seconds since the episode's start, shape (T + 1,)."""
        return np.arange(self.dataset.n_frames + 1) / self.dataset.fps

    @property
    def units(self) -> list[JointUnit]:
        """Units of the kinds of joints present."""
        return [unit for unit, _ in group_by_kind(self.dataset.joints, self.dataset.slides)]

    @property
    def worst(self) -> int:
        """Frame with the largest error of the first model; 0 without models."""
        return int(np.nanargmax(self.ghosts[1].errors[:, 0])) if len(self.ghosts) > 1 else 0


def follow(dataset: Dataset, episode: int, models: Sequence[str] = (), engine: str | None = None) -> Motion:
    """Simulate models under the commands of an episode in open loop, with the recording's registers as in `evaluate`.

    Of an episode whose torque is off in some rows, the film shows the longest motion with torque and, in MuJoCo, the
    fall after it.

    Args:
        dataset: Transitions of the episode alone.
        episode: Its number in the recording.
        models: MJCF or URDF files, or robots' names; empty for the source stored with the dataset.
        engine: `mujoco` or `bullet`; None for the source's own.

    Raises:
        ModelFileError: a model cannot be used or diverges, or none is given and none is stored.
        JointMismatch: a model has other joints than the dataset.
    """
    with kept_folders(dataset) as folders:
        sources = [locate_source(model, (), folders, engine) for model in models or (None,)]
        if models:  # a stored source is the one of the pairing
            sources = [source.with_registers(ServoRegisters.of(dataset)) for source in sources]
        dataset = select_shown(dataset, all(source.engine == MUJOCO for source in sources))
        simulators = [source.simulator(dataset) for source in sources]
        bodies = [load_in_mujoco(source, dataset) for source in sources]
        dataset = with_model_units(dataset, bodies[0])
        rollouts = [roll_out_scene(dataset, simulator)[0] for simulator in simulators]
    measured = read_measured_states(dataset, bodies[0])
    kinds = group_by_kind(dataset.joints, dataset.slides)
    ghosts = [Ghost(MEASURED, bodies[0], measured, np.zeros((len(measured), len(kinds))))]
    for name, simulator, body, rolled in zip(shorten_names(models), simulators, bodies, rollouts, strict=True):
        states = np.concatenate([read_initial_states(dataset, simulator), rolled])
        n = len(dataset.joints)
        squared = np.square(states[:, :n] - measured[:, :n])
        errors = np.sqrt(np.stack([squared[:, places].mean(axis=1) for _, places in kinds], axis=1))
        ghosts.append(Ghost(name, body, states, errors))
    return Motion(episode, dataset, tuple(ghosts))


def select_shown(dataset: Dataset, falls: bool) -> Dataset:
    """Return the rows of an episode that a film shows, and warn of others.

    Args:
        dataset: The episode.
        falls: Whether models can be simulated without torque.
    """
    if falls and find_torque_off(dataset).all():
        return dataset
    shown = (keep_torque_on_and_fall if falls else keep_torque_on)(dataset)
    if shown.n_frames < dataset.n_frames:
        warn([f"the torque is off at times ({TORQUE}): {shown.n_frames} of {dataset.n_frames} rows are shown"])
    return shown


def load_in_mujoco(source: SourceModel, dataset: Dataset) -> MujocoSimulator:
    """Return the model in MuJoCo, which also draws motions of other engines."""
    simulator = SourceModel(source.model, source.effects).simulator(dataset, threads=1)
    assert isinstance(simulator, MujocoSimulator)
    return simulator


def read_measured_states(dataset: Dataset, simulator: MujocoSimulator) -> np.ndarray:
    """Return the measured states of an episode of T transitions, shape (T + 1, 2n or 2n + m)."""
    states = np.concatenate([dataset.states[:1], dataset.next_states]).astype(float)
    objects = read_object_states(dataset, simulator).astype(float)
    return np.concatenate([states, np.concatenate([objects, objects[-1:]])], axis=1)


def shorten_names(models: Sequence[str]) -> list[str]:
    """Return a short name of each model: its file name, with as many folders as are needed to be unique."""
    if not models:
        return ["source"]
    paths = [Path(model).with_suffix("") for model in models]
    longest = max(len(path.parts) for path in paths)
    telling = 2 if {path.name for path in paths} == {"model"} else 1  # all gap reports use this file name
    for length in range(min(telling, longest), longest + 1):
        names = ["/".join(path.parts[-length:]) for path in paths]
        if len(set(names)) == len(names):
            return names
    return [f"{path} ({number})" for number, path in enumerate(paths, 1)]
