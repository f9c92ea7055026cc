"""Pairing of a dataset, compared with the `mujoco.rollout` calls that it needs."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np

from nas_data.api.recording import record
from nas_data.benchmarks.datasets import pair_folder, write_version
from nas_data.benchmarks.result import BenchmarkResult, Ratio, take_turns
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.read import read
from nas_data.pairing import pair
from nas_data.runs.progress import say
from nas_data.simulators.mujoco import CHUNK_STATES, MujocoSimulator

ROBOT = "ergojr"
RATE = 100.0  # [Hz]
GOAL = 1 / 1.2  # pairing may take 1.2 times as long as the rollouts
OURS, MEMORY, BARE = "nas pair", "pair() in memory", "bare mujoco.rollout"


@dataclass(frozen=True)
class BareRollouts:
    """The `mujoco.rollout` calls of a pairing; states and controls are prepared beforehand."""

    model: mujoco.MjModel  # compiled source
    substeps: int  # physics steps per control step
    # full initial states (B, size) and controls (B, substeps, nu) of each call
    chunks: tuple[tuple[np.ndarray, np.ndarray], ...]
    threads: int  # threads of the pool

    @classmethod
    def of(cls, simulator: MujocoSimulator, dataset: Dataset) -> "BareRollouts":
        """Prepare the states and controls, in the chunks of the simulator."""
        size = max(1, CHUNK_STATES // (simulator.substeps * len(simulator.rest.base)))
        chunks = []
        for start in range(0, dataset.n_frames, size):
            rows = slice(start, start + size)
            controls = simulator.layout.controls(dataset.commands[rows].astype(float)[:, None])
            states = simulator.rest(dataset.states[rows].astype(float))
            chunks.append((states, np.repeat(controls, simulator.substeps, axis=1)))
        return cls(simulator.model, simulator.substeps, tuple(chunks), simulator.threads)

    def runner(self) -> Callable[[], int]:
        """Return a function that does every rollout once."""
        pooled = self.threads if self.threads > 1 else 0
        pool = mujoco.rollout.Rollout(nthread=pooled)
        data = [mujoco.MjData(self.model) for _ in range(max(1, pooled))]

        def run() -> int:
            for states, controls in self.chunks:
                pool.rollout(self.model, data, states, controls, nstep=self.substeps)
            return sum(len(states) for states, _ in self.chunks)

        return run


def benchmark(scratch: Path, episodes: int, frames: int, rounds: int) -> BenchmarkResult:
    """Time `nas pair` from dataset to dataset, `pair()` alone, and the bare rollouts."""
    say(f"recording {episodes} episodes of {frames} frames …")
    simulator = MujocoSimulator.load(ROBOT, 1 / RATE)
    recording = record(ROBOT, rate=RATE, episodes=episodes, seconds=frames / RATE, quantum=0.0)
    root = write_version(recording, scratch / "recorded")
    dataset = read(root)
    versions = (scratch / f"paired-{number}" for number in count())

    def command() -> int:
        pair_folder(root, ROBOT, next(versions))
        return dataset.n_frames

    def in_memory() -> int:
        return pair(dataset, simulator).n_frames

    bare = BareRollouts.of(simulator, dataset)
    times = take_turns({OURS: command, MEMORY: in_memory, BARE: bare.runner()}, rounds)
    calls = f"{len(bare.chunks)} calls on {simulator.threads} threads"
    return BenchmarkResult(
        title=f"Pairing {dataset.n_frames} transitions of {ROBOT}, {simulator.substeps} physics steps each",
        times=times,
        ratios=(Ratio("pairing_vs_rollout", OURS, BARE, GOAL), Ratio("pairing_in_memory_vs_rollout", MEMORY, BARE)),
        notes=(f"'{OURS}' reads the dataset, predicts and writes the new version; '{BARE}' is {calls}, inputs ready.",),
    )
