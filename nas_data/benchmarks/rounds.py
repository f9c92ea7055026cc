"""Timing in rounds: every side runs once per round, so that other load on the machine affects all of them."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import median
from typing import Literal

from nas_data.runs.progress import say

Work = Callable[[], int]


@dataclass(frozen=True)
class Times:
    """Times of one side."""

    wall: tuple[float, ...]  # elapsed time per frame of each round [s]
    cpu: tuple[float, ...]  # processor time of all threads per frame of each round [s]


def take_turns(sides: Mapping[str, Work], rounds: int) -> dict[str, Times]:
    """Time several ways of the same work.

    Each side runs once beforehand without timing, for imports, caches and compilers. The order is reversed after each
    round.

    Args:
        sides: Name of a side → its work, which returns the number of frames.
        rounds: Number of timed rounds.
    """
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in sides}
    for number in range(rounds + 1):
        for name in list(sides) if number % 2 else reversed(list(sides)):
            begun, spent = time.perf_counter(), time.process_time()
            frames = sides[name]()
            took = (time.perf_counter() - begun) / frames, (time.process_time() - spent) / frames
            if number:
                found[name].append(took)
                say(f"round {number} of {rounds}: {name} {took[0] * 1e6:.4g} µs a frame")
    return {name: Times(tuple(wall for wall, _ in took), tuple(cpu for _, cpu in took)) for name, took in found.items()}


@dataclass(frozen=True)
class Ratio:
    """Speed of one side relative to another."""

    name: str  # its name in `--json`, for example `pairing_vs_rollout`
    ours: str  # name of our side
    other: str  # name of the other side
    wanted: float | None = None  # required ratio; None if there is none
    # `wall`, or `cpu` if other load on the machine would dominate the elapsed time
    clock: Literal["wall", "cpu"] = "wall"

    def values(self, times: Mapping[str, Times]) -> list[float]:
        """Return the other time divided by ours for each round; above 1 our side is faster."""
        ours, other = (getattr(times[side], self.clock) for side in (self.ours, self.other))
        return [theirs / mine for mine, theirs in zip(ours, other, strict=True)]

    def of(self, times: Mapping[str, Times]) -> float:
        """Return the median over the rounds."""
        return median(self.values(times))

    def describe(self, times: Mapping[str, Times]) -> str:
        """Return the ratio with its spread as a sentence."""
        values = self.values(times)
        bar = "" if self.wanted is None else f", at least {self.wanted:.2g} is wanted"
        return (
            f"{self.name} {self.of(times):.3g}, between {min(values):.3g} and {max(values):.3g} "
            f"in {len(values)} rounds{' of processor time' if self.clock == 'cpu' else ''}{bar}"
        )
