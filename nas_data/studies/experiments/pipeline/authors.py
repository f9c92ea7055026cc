"""The paper's published numbers, each with its source; they refer to the authors' environments, not to ours.

Their repository is aalitaiga/sim-to-real at commit d97cce7; their simulated backlash is `dynamics="paper"` here.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import mean, median

from nas_data.envs.base import find_task_file

PLOT = "aalitaiga/sim-to-real, scripts/Plot.ipynb: figure 5a, 5 seeds of 100 episodes"
REACHER = "aalitaiga/sim-to-real, test/results.md: figure 5c, 5 seeds"
TRAJECTORIES = "aalitaiga/sim-to-real, scripts/Plot.ipynb: figure 6, mean and standard deviation of the seeds"
HITS = "aalitaiga/sim-to-real, results/*.npz: figure 8a, mean hits of each policy in 10 s on the real arm"
TABLE = "paper, appendix D, table 1: squared differences of angles in units of 90°, on episodes of the training file"


@dataclass(frozen=True)
class Numbers:
    """The authors' results."""

    values: tuple[float, ...]  # one per policy, or as `unit` states
    source: str  # their publication

    @property
    def mean(self) -> float:
        """Their mean, as in the paper."""
        return mean(self.values)

    @property
    def median(self) -> float:
        """Their median, for comparison with ours."""
        return median(self.values)

    def describe(self) -> dict[str, object]:
        """Return the numbers for JSON."""
        return {"values": list(self.values), "mean": self.mean, "median": self.median, "source": self.source}


# Returns of each seed on their target, by environment and method. Figure 5b (Striker) was never published in numbers.
RETURNS: Mapping[str, Mapping[str, Numbers]] = {
    "pusher": {
        "expert": Numbers((-69.34, -67.84, -69.95, -65.71, -66.40), PLOT),
        "source": Numbers((-134.24, -102.17, -136.69, -143.70, -96.46), PLOT),
        "forward": Numbers((-94.52, -97.50, -95.60, -93.12, -91.46), PLOT),
        "nas": Numbers((-69.67, -67.55, -64.22, -66.92, -68.04), PLOT),  # with 1000 trajectories; the text says 250
    },
    "ergo_reacher": {
        "expert": Numbers((0.233, 0.316, 0.351, 0.356, 0.401), REACHER),
        "source": Numbers((-8.37, -1.29, -0.74, 0.13, 0.15), REACHER),
        "forward": Numbers((-0.796, -0.538, -0.118, -0.330, 0.191), REACHER),
        "nas": Numbers((-0.025, -0.012, 0.160, 0.239, 0.377), REACHER),
    },
    "ergo_shield": {
        "expert": Numbers((1.80, 1.76), HITS),
        "source": Numbers((3.68, 5.60, 11.15, 1.28), HITS),  # trained with slower servos than the two below
        "forward": Numbers((3.90,), HITS),  # its reward was zero throughout
        "nas": Numbers((20.17, 11.95), HITS),  # the first over 6 episodes, the others over 20 to 25
    },
}

SIMULATED = (
    "The authors' numbers (diamonds) belong to their target, here the dynamics 'paper', and to their training. With "
    "other dynamics they only show the scale."
)
ON_THE_ARM = (
    "The authors' hits (diamonds) were measured on the real arm, which the dynamics 'paper' represents here. They come "
    "from 2, 4, 1 and 2 policies of expert, source, forward and nas. The source policies were trained with slower "
    "servos than the others, forward with a reward that was always zero."
)
REMARKS = {PLOT: SIMULATED, REACHER: SIMULATED, HITS: ON_THE_ARM}


def list_remarks(environments: Iterable[str]) -> list[str]:
    """Return remarks on the authors' numbers for some environments; empty without such numbers."""
    beside = [RETURNS.get(name, {}) for name in map(find_task_file, environments)]
    return list(dict.fromkeys(REMARKS[numbers.source] for methods in beside for numbers in methods.values()))


# Return of NAS on Pusher by number of trajectories: mean, then standard deviation over seeds
RETURN_BY_COUNT: Mapping[int, tuple[float, float]] = {
    50: (-72.31, 3.27),
    100: (-71.86, 2.34),
    250: (-68.17, 1.04),
    500: (-69.09, 1.96),
    1000: (-67.28, 1.99),
    2000: (-68.99, 0.42),
    10_000: (-68.19, 4.41),
    50_000: (-67.09, 1.66),
}

# First quartile, mean and third quartile by predictor, on ErgoShield's arm
DIFFERENCES: Mapping[str, Numbers] = {
    "source": Numbers((0.027, 0.120, 0.172), TABLE),
    "ψ": Numbers((0.002, 0.008, 0.009), TABLE),
    "source + φ": Numbers((0.015, 0.063, 0.078), TABLE),  # with the correction multiplied by 0.7
}
