"""Recording and pairing in bulk against stepping two Gymnasium environments into LeRobot's writer."""

from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nas_data.api.recording import record
from nas_data.benchmarks.bulk import pair_folder, write_version
from nas_data.benchmarks.gym_arm import GymArm
from nas_data.benchmarks.lerobot import create, lerobot
from nas_data.benchmarks.result import BenchmarkResult
from nas_data.benchmarks.rounds import Ratio, take_turns
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, NEXT_STATE, SIM_STATE, STATE, TIME
from nas_data.dataset.read import read
from nas_data.effects.base import parse
from nas_data.errors import DatasetInvalid
from nas_data.recorders.session import SETTLE
from nas_data.simulators.mujoco import MujocoSimulator

if TYPE_CHECKING:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

ROBOT = "ergojr"
RATE = 100.0  # [Hz]
EFFECTS = ("backlash:joint=m3,half_width=0.02", "backlash:joint=m5,half_width=0.02")
WANTED = 8.0
ROUNDING = 1e-5  # [rad, rad/s] both play the same commands to the bit; single precision of 30 rad/s is 2e-6
OURS, OTHER = "nas record sim + nas pair", "Gymnasium + LeRobot"


@dataclass(frozen=True)
class Bulk:
    """Our way: what the two commands do, from nothing to a paired version on disk.

    Attributes:
        folder: Where the versions go.
        episodes: Number of episodes.
        seconds: Length of each [s].
    """

    folder: Path
    episodes: int
    seconds: float

    def record(self, name: str) -> Path:
        """Record and pair; return the paired version."""
        dataset = record(ROBOT, effects=EFFECTS, rate=RATE, episodes=self.episodes, seconds=self.seconds, quantum=0.0)
        recorded = write_version(dataset, self.folder / f"{name}-recorded")
        return pair_folder(recorded, ROBOT, self.folder / f"{name}-paired")


@dataclass(frozen=True)
class Stepwise:
    """The usual way: target and source as environments, the source set to each measured state, frame by frame.

    Attributes:
        folder: Where the datasets go.
        kind: LeRobot's dataset class.
        reference: What is to be recorded: the commands of each episode.
        target: Robot with its effects.
        source: Plain robot.
    """

    folder: Path
    kind: "type[LeRobotDataset]"
    reference: Dataset
    target: GymArm
    source: GymArm

    @classmethod
    def of(cls, folder: Path, kind: "type[LeRobotDataset]", reference: Dataset) -> "Stepwise":
        """Build both environments on the models that our way simulates."""
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

    Args:
        scratch: Empty folder.
        episodes: Number of episodes.
        frames: Frames of each.
        rounds: How often each side is timed.

    Raises:
        DatasetInvalid: the two ways did not record the same.
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
        ratios=(Ratio("recording_vs_lerobot", OURS, OTHER, WANTED),),
        notes=(
            f"'{OURS}' writes two versions; '{OTHER}' steps two environments and calls add_frame and save_episode. "
            "Both hold the same numbers, to rounding.",
        ),
    )


def check_equal(bulk: Dataset, stepwise: Dataset) -> None:
    """Refuse to compare ways that do not record the same numbers.

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
