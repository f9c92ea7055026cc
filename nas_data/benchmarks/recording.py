"""Bulk recording and pairing, compared with stepping two Gymnasium environments into LeRobot's writer."""

from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces

from nas_data.api.recording import record
from nas_data.benchmarks.datasets import create, lerobot, pair_folder, write_version
from nas_data.benchmarks.result import BenchmarkResult, Ratio, take_turns
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, NEXT_STATE, SIM_STATE, STATE, TIME
from nas_data.dataset.read import read
from nas_data.effects.base import parse
from nas_data.errors import DatasetInvalid
from nas_data.recorders.session import SETTLE
from nas_data.simulators.layout import FULLPHYSICS
from nas_data.simulators.mujoco import MujocoSimulator

if TYPE_CHECKING:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

ROBOT = "ergojr"
RATE = 100.0  # [Hz]
EFFECTS = ("backlash:joint=m3,half_width=0.02", "backlash:joint=m5,half_width=0.02")
GOAL = 8.0
ROUNDING = 1e-5  # [rad, rad/s] both sides play identical commands; single precision of 30 rad/s is 2e-6
OURS, OTHER = "nas record sim + nas pair", "Gymnasium + LeRobot"


class GymArm(gymnasium.Env[np.ndarray, np.ndarray]):
    """A robot in MuJoCo; actions are position commands [rad].

    Observations are positions [rad], then velocities [rad/s]. It is leaner than Gymnasium's `MujocoEnv` (no reward, no
    rendering, no second forward pass), so that the cost of stepping environments is not overestimated.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (not a ClassVar: Gymnasium's base class declares it as it is)

    def __init__(self, simulator: MujocoSimulator) -> None:
        """Store the model and the joint layout of a simulator."""
        n = len(simulator.joints)
        self.model, self.layout, self.substeps = simulator.model, simulator.layout, simulator.substeps
        self.data = mujoco.MjData(self.model)
        self.control_rate = 1 / simulator.period  # [Hz]
        self._rest = simulator.rest(np.zeros((1, 2 * n)))[0]
        self.observation_space = spaces.Box(-np.inf, np.inf, (2 * n,), np.float32)
        self.action_space = spaces.Box(-np.pi, np.pi, (n,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[np.ndarray, dict[str, object]]:
        """Start at rest at zero; `options={"settle": seconds}` holds that pose first."""
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, self._rest, FULLPHYSICS)
        settle = float(str((options or {}).get("settle", 0.0)))
        for _ in range(round(settle * self.control_rate)):
            self.step(np.zeros(len(self.layout.joints)))
        return self._observe(), {}

    def set_state(self, state: np.ndarray) -> None:
        """Set the joints [rad, rad/s], shape (2n,), and clear the warm start of the solver."""
        n = len(self.layout.joints)
        self.data.qpos[self.layout.qpos] = state[:n]
        self.data.qvel[self.layout.dof] = state[n:]
        self.data.qacc_warmstart[:] = 0.0

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, object]]:
        """Hold the commands for one control period; return what `gymnasium.Env.step` does."""
        self.data.ctrl[self.layout.control] = self.layout.inputs.from_commands(action)
        mujoco.mj_step(self.model, self.data, nstep=self.substeps)
        return self._observe(), 0.0, False, False, {}

    def _observe(self) -> np.ndarray:
        return self.layout.measure(self.data.qpos, self.data.qvel).astype(np.float32)


@dataclass(frozen=True)
class Bulk:
    """Our side: record and pair in bulk, up to a paired version on disk."""

    folder: Path  # folder of the versions
    episodes: int  # number of episodes
    seconds: float  # length of each [s]

    def record(self, name: str) -> Path:
        """Record and pair; return the paired version."""
        dataset = record(ROBOT, effects=EFFECTS, rate=RATE, episodes=self.episodes, seconds=self.seconds, quantum=0.0)
        recorded = write_version(dataset, self.folder / f"{name}-recorded")
        return pair_folder(recorded, ROBOT, self.folder / f"{name}-paired")


@dataclass(frozen=True)
class Stepwise:
    """The usual approach: two environments; the source is set to the measured state in every frame."""

    folder: Path  # folder of the datasets
    kind: "type[LeRobotDataset]"  # LeRobot's dataset class
    reference: Dataset  # dataset with the commands of each episode
    target: GymArm  # robot with its effects
    source: GymArm  # plain robot

    @classmethod
    def of(cls, folder: Path, kind: "type[LeRobotDataset]", reference: Dataset) -> "Stepwise":
        """Build both environments from the models of the bulk side."""
        target = MujocoSimulator.load(ROBOT, 1 / RATE, effects=[parse(text) for text in EFFECTS])
        source = MujocoSimulator.load(ROBOT, 1 / RATE)
        return cls(folder, kind, reference, GymArm(target), GymArm(source))

    def record(self, name: str) -> Path:
        """Record every episode; return the dataset."""
        root = self.folder / name
        writer = create(self.kind, root, self.reference.features, self.reference.fps, ROBOT)
        for frames, task in zip(self.reference.episodes(), self.reference.tasks, strict=True):
            self.record_episode(writer, self.reference.commands[frames], task)
        writer.finalize()
        return root

    def record_episode(self, writer: "LeRobotDataset", commands: np.ndarray, task: str) -> None:
        """Step both environments through the commands of one episode [rad], shape (T, n)."""
        state, _ = self.target.reset(options={"settle": SETTLE})
        self.source.reset()
        for number, command in enumerate(commands):
            following, *_ = self.target.step(command)
            self.source.set_state(state)
            simulated, *_ = self.source.step(command)
            frame = {
                STATE: state,
                ACTION: command,
                NEXT_STATE: following,
                TIME: np.array([number / RATE]),
                SIM_STATE: simulated,
                "task": task,
            }
            writer.add_frame(frame)
            state = following
        writer.save_episode()


def benchmark(scratch: Path, episodes: int, frames: int, rounds: int) -> BenchmarkResult:
    """Time both ways of recording the same paired episodes into a LeRobot dataset.

    Raises:
        DatasetInvalid: the two ways recorded different values.
    """
    names = (f"{number:03d}" for number in count())
    latest: dict[str, Path] = {}
    bulk = Bulk(scratch, episodes, frames / RATE)
    reference = read(bulk.record("reference"))

    def work(side: str, way: "Bulk | Stepwise") -> int:
        latest[side] = way.record(next(names))
        return reference.n_frames

    with lerobot(scratch) as kind:
        stepwise = Stepwise.of(scratch, kind, reference)
        times = take_turns({OURS: lambda: work(OURS, bulk), OTHER: lambda: work(OTHER, stepwise)}, rounds)
    check_equal(read(latest[OURS]), read(latest[OTHER]))
    return BenchmarkResult(
        title=f"Recording {episodes} paired episodes of {frames} frames of {ROBOT} at {RATE:g} Hz into a valid dataset",
        times=times,
        ratios=(Ratio("recording_vs_lerobot", OURS, OTHER, GOAL),),
        notes=(
            f"'{OURS}' writes two versions; '{OTHER}' steps two environments and calls add_frame and save_episode. "
            "Both hold the same numbers, to rounding.",
        ),
    )


def check_equal(bulk: Dataset, stepwise: Dataset) -> None:
    """Check that both ways recorded the same numbers.

    Raises:
        DatasetInvalid: names the feature that differs.
    """
    for key, column in bulk.columns.items():
        difference = float(np.abs(column.astype(float) - stepwise.columns[key].astype(float)).max())
        if difference > ROUNDING:
            raise DatasetInvalid(
                f"Bulk and stepwise recording differ in '{key}' by up to {difference:.3g}; "
                "their times cannot be compared."
            )
