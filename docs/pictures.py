"""Draw the pictures of the concept pages: python docs/pictures.py."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pyarrow.parquet as pq
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure

CONCEPTS = Path(__file__).parent / "concepts"
BLIND_CASES = Path(__file__).parent / "results/blind.parquet"
SEALED = {15: "mostly effects of the catalogue", 82186: "with a cause outside the catalogue"}  # seeds of sealed runs
QUANTUM = 0.293  # [°] of an XL-320's encoder: 300° in 1024 steps
NOISE = 0.08  # [°]
RATE = 100.0  # [Hz]
BINS = (
    (0.0, 0.2, "below\n0.2"),
    (0.2, 0.5, "0.2 to\n0.5"),
    (0.5, 0.8, "0.5 to\n0.8"),
    (0.8, 0.9, "0.8 to\n0.9"),
    (0.9, 1.01, "0.9 or\nmore"),
)


def draw_noise_floor() -> Figure:
    """Show a motion as an encoder reads it, and how differences of third order leave its noise alone."""
    time = np.arange(150) / RATE
    motion = 6.0 * np.sin(2 * np.pi * 0.5 * time)
    noisy = motion + np.random.default_rng(0).normal(0.0, NOISE, len(time))
    read = np.round(noisy / QUANTUM) * QUANTUM
    figure, (above, below) = pyplot.subplots(2, 1, figsize=(7, 4.4), sharex=True, layout="constrained")
    above.plot(time, motion, color="tab:blue", label="motion")
    above.step(time, read, color="black", linewidth=0.9, where="mid", label="readings")
    above.set_ylabel("position [°]")
    above.legend(frameon=False)
    below.plot(time[3:], np.diff(read, 3), color="black", linewidth=0.9, label="of the readings")
    below.plot(time[3:], np.diff(motion, 3), color="tab:blue", label="of the motion")
    below.set(ylabel="third difference [°]", xlabel="time [s]")
    below.legend(frameon=False)
    return figure


def draw_objective() -> Figure:
    """Show the misfit of one joint in one episode of 3 s over its error."""
    floor, observations = 0.1, 3 / 0.15
    error = np.geomspace(0.02, 10, 300)
    figure, axes = pyplot.subplots(figsize=(7, 3.2), layout="constrained")
    for present, style in ((5.0, "--"), (0.5, "-")):
        tolerance = floor**2 + 0.1 * present**2
        misfit = 0.5 * observations * np.log(tolerance + error**2)
        label = f"present error {present:g}°: tolerance {np.sqrt(tolerance):.2f}°"
        axes.plot(error, misfit - misfit[-1], style, color="tab:blue", label=label)
    axes.axvline(floor, color="grey", linestyle=":")
    axes.text(floor * 1.05, -60, "noise floor", color="grey")
    axes.set(xscale="log", xlabel="open-loop error [°]", ylabel="misfit [nats], 0 at 10°")
    axes.legend(frameon=False)
    return figure


def draw_confidence() -> Figure:
    """Show how many findings of the sealed runs were right, by their confidence."""
    figure, panels = pyplot.subplots(1, len(SEALED), figsize=(9, 3.2), sharey=True, layout="constrained")
    for axes, (seed, title) in zip(panels, SEALED.items(), strict=True):
        cases = pq.read_table(BLIND_CASES, columns=["confidences"], filters=[("seed", "=", seed)])
        said = [finding for case in cases["confidences"].to_pylist() for finding in case]
        for place, (low, high, _) in enumerate(BINS):
            right = [finding["right"] for finding in said if low <= finding["confidence"] < high]
            axes.hlines(min(high, 1.0) / 2 + low / 2, place - 0.4, place + 0.4, color="grey", linestyle=":")
            draw_bar(axes, place, sum(right), len(right))
        axes.set_xticks(range(len(BINS)), [name for *_, name in BINS])
        axes.set(ylim=(0, 1.15), xlabel="stated confidence", title=f"{title}, {len(cases)} cases")
    panels[0].set_ylabel("share of right names")
    return figure


def draw_bar(axes: Axes, place: int, right: int, count: int) -> None:
    """Draw the share of right findings, with their number."""
    share = right / max(count, 1)
    axes.bar(place, share, width=0.6, color="tab:blue")
    axes.text(place, share + 0.03, f"{right} of {count}", ha="center")


def main() -> None:
    """Write all pictures."""
    mpl.use("Agg")
    for draw in (draw_noise_floor, draw_objective, draw_confidence):
        figure = draw()
        figure.savefig(CONCEPTS / f"{draw.__name__.removeprefix('draw_')}.png", dpi=110)
        pyplot.close(figure)


if __name__ == "__main__":
    main()
