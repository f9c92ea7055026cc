"""Count the seconds of recording until `nas gap` is sure of an effect, with proposed experiments or random motion.

    python docs/closed_loop.py OUT --cases 8 --seed 3

Each case hides one effect in a simulated ErgoJr. Both start from the same short recording. Then either the proposed
experiment or a random motion is recorded and merged, until all names have a confidence of 0.9, at most six times.
"""

import contextlib
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import tyro

import nas_data
from nas_data.cli import main as nas
from nas_data.gap.workflow import EXPERIMENT

# ranges that a small servo may have, by effect and parameter [SI]
RANGES = (
    ("backlash", "half_width", 0.01, 0.04),
    ("coulomb_friction", "torque", 0.02, 0.08),
    ("deadband", "half_width", 0.01, 0.05),
    ("joint_compliance", "stiffness", 2.0, 10.0),
    ("load_friction", "ratio", 0.1, 0.4),
    ("servo_stiffness", "factor", 0.4, 0.8),
    ("torque_limit", "torque", 0.1, 0.25),
    ("viscous_friction", "coefficient", 0.02, 0.1),
)
SURE, ROUNDS = 0.9, 6
FIRST_SECONDS, RANDOM_SECONDS = 1.5, 3.0  # of each of the two first episodes, and of a random motion


@dataclass(frozen=True)
class Outcome:
    """How long one way took.

    Attributes:
        way: `chosen` or `random`.
        hidden: Hidden effect.
        seconds: Recorded time [s].
        sure: Whether all names have the confidence.
        right: Whether the names are the hidden effect alone.
        named: Names with their confidence.
    """

    way: str
    hidden: str
    seconds: float
    sure: bool
    right: bool
    named: str


def run(*words: object) -> None:
    """Run a command of `nas` without its output.

    Raises:
        RuntimeError: it failed.
    """
    with contextlib.redirect_stdout(io.StringIO()):
        if code := nas([str(word) for word in words]):
            raise RuntimeError(f"{' '.join(map(str, words))} ended with {code}")


def record(out: Path, hidden: str, seed: int, *options: object) -> Path:
    """Record the arm with its hidden effect."""
    run(
        "record",
        "sim",
        "--robot",
        "ergojr",
        "--effect",
        hidden,
        "--noise",
        0.0009,
        "--seed",
        seed,
        *options,
        "--out",
        out,
    )
    return out


def follow(way: str, hidden: str, folder: Path, seed: int) -> Outcome:
    """Record until the names are sure."""
    begin = ("--episodes", 2, "--seconds", FIRST_SECONDS, "--excitation", "sine")
    parts = [record(folder / "first", hidden, seed, *begin)]
    for number in range(ROUNDS + 1):
        data = parts[0]
        if len(parts) > 1:
            data = folder / f"all_{number}"
            run("merge", *parts, "--out", data)
        report = nas_data.identify(data, "ergojr", out=folder / f"gap_{number}")
        sure = bool(report.effects) and all(effect.confidence >= SURE for effect in report.effects)
        if sure or number == ROUNDS:
            break
        commands = folder / f"gap_{number}" / EXPERIMENT
        options: Sequence[object] = ("--episodes", 1, "--seconds", RANDOM_SECONDS, "--excitation", "steps")
        if way == "chosen" and commands.is_file():
            options = ("--commands", commands)
        parts.append(record(folder / f"more_{number}", hidden, 1000 + 10 * seed + number, *options))
    recorded = nas_data.Dataset.load(data)
    named = [f"{effect} {effect.confidence:.2f}" for effect in report.effects]
    right = [str(effect) for effect in report.effects] == [describe(hidden)]
    return Outcome(way, hidden, recorded.n_frames / recorded.fps, sure, right, "; ".join(named))


def describe(hidden: str) -> str:
    """Return the name of a hidden effect as reports have it."""
    name, rest = hidden.split(":")
    return f"{name} in {rest.split(',')[0].removeprefix('joint=')}"


def main(out: tyro.conf.Positional[Path], cases: int = 8, seed: int = 0) -> None:
    """Run all cases in both ways; finished ones are kept.

    Args:
        out: Folder of recordings, reports and `outcomes.json`.
        cases: Number of hidden effects.
        seed: Seed of the hidden effects.
    """
    rng = np.random.default_rng(seed)
    kept = out / "outcomes.json"
    outcomes = [Outcome(**each) for each in json.loads(kept.read_text())] if kept.is_file() else []
    for case in range(cases):
        name, parameter, low, high = RANGES[rng.integers(len(RANGES))]
        hidden = f"{name}:joint=m{rng.integers(1, 7)},{parameter}={rng.uniform(low, high):.4g}"
        for way in ("chosen", "random"):
            if (way, hidden) in {(each.way, each.hidden) for each in outcomes}:
                continue
            folder = out / f"{case}_{way}"
            folder.mkdir(parents=True)
            outcomes.append(follow(way, hidden, folder, seed + case))
            kept.write_text(json.dumps([asdict(each) for each in outcomes], indent=1))
            print(outcomes[-1], flush=True)
    both = {way: [each.seconds for each in outcomes if each.way == way] for way in ("chosen", "random")}
    ratios = np.array(both["chosen"]) / np.array(both["random"])
    median, total = np.median(ratios), sum(both["chosen"]) / sum(both["random"])
    print(f"recorded time, chosen over random: median {median:.2f}, of the sums {total:.2f}")


if __name__ == "__main__":
    tyro.cli(main)
