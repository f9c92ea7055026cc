"""A fitted set of effects, and which candidates are worth fitting next."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.effects.base import Effect
from nas_data.gap.base import BaseParameter
from nas_data.gap.search.fit import Fit, Task
from nas_data.gap.search.screen import Candidate
from nas_data.gap.search.unknowns import Unknowns

SHORTLIST = 6  # candidates that are fitted, of those screened
BESIDE = 3  # candidates beside the best of each joint
STRAINED = 2.5  # standard deviations from which a base parameter is hardly to be believed
GAIN = 12.0  # nats by which an added effect must lower the loss on fitted episodes
PLAUSIBLE = 12.0  # nats by which an effect may lower the loss by what it spares the base
MOVED = 10.0  # noise floors between a joint's extremes in an episode from which it counts as having moved
MANY = 8  # effects beyond which fewer of them are doubted at a time: each trial fits all of them anew

Place = tuple[str, str | None]


def place(effect: Effect) -> Place:
    """Return an effect's name and joint."""
    return effect.name(), effect.joint


@dataclass(frozen=True)
class Hypothesis:
    """A fitted set of effects, judged on held-out episodes.

    Attributes:
        fit: Fit on some training episodes.
        heldout: Mean squares on held-out episodes [rad²], shape (E, n).
    """

    fit: Fit
    heldout: np.ndarray

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The fitted effects."""
        return self.fit.effects

    @property
    def loss(self) -> float:
        """Loss on the fitted episodes: misfit and prior."""
        return self.fit.loss

    @property
    def is_sound(self) -> bool:
        """Whether the model runs on every held-out episode without diverging."""
        return bool(np.isfinite(self.heldout).all())

    def text(self) -> str:
        """Say it in a line."""
        parts = [
            f"{e.name()}({e.joint or 'arm'}: {', '.join(f'{getattr(e, p.name):.4g}' for p in e.sought)})"
            for e in self.effects
        ]
        return ", ".join(parts) or "base only"


def lively(task: Task) -> set[str]:
    """Return the joints that were commanded to move and moved: a joint that stood still tells no cause."""
    evidence = task.evidence
    commanded = np.ptp(evidence.commands, axis=1).max(0) > 0
    moved = np.ptp(evidence.measured, axis=1).max(0) > MOVED * task.floor
    return {joint for joint, told in zip(evidence.joints, commanded & moved, strict=True) if told}


def strained(h: Hypothesis) -> set[str]:
    """Return the joints whose base parameters had to go beyond what a real arm's do."""
    return {base.joint for base in h.fit.unknowns.base if is_strained(h, base)}


def is_strained(h: Hypothesis, base: BaseParameter) -> bool:
    """Whether a base parameter had to go beyond what a real arm's does."""
    log = float(np.log(h.fit.factors[base.name]))
    return abs(log) > STRAINED * base.tolerance(log)


def relief(h: Hypothesis, effect: Effect) -> bool:
    """Whether a base parameter that had to go beyond what a real arm's does may stand for an effect."""
    kind = effect.replaces or effect.strains
    near = [base for base in h.fit.unknowns.base if base.kind == kind and effect.joint in (None, base.joint)]
    return any(is_strained(h, base) for base in near)


def worth(h: Hypothesis) -> float:
    """Return the loss with what each effect has to lower it by."""
    return h.loss + GAIN * len(h.effects)


def relieves(without: Hypothesis, with_: Hypothesis) -> bool:
    """Whether the base had to go further from the model without an effect than a real arm's does."""
    return without.loss - with_.loss > PLAUSIBLE and bool(strained(without))


def lent_slopes(near: Fit | None, unknowns: Unknowns, fresh: int = 0) -> dict[int, np.ndarray]:
    """Return another fit's slopes by the numbers that a hypothesis shares with it, by the number's index.

    Args:
        near: The other fit.
        unknowns: The hypothesis.
        fresh: How many of its last effects are to be measured anyway.
    """
    if near is None:
        return {}
    known = dict(zip(labels(near.unknowns), near.slopes, strict=True))
    last = len(unknowns.effects) - fresh
    places = [unknown.place for unknown in unknowns.sought] + [-1] * len(unknowns.base)
    own = enumerate(zip(labels(unknowns), places, strict=True))
    return {index: known[label] for index, (label, number) in own if label in known and number < last}


def labels(unknowns: Unknowns) -> list[tuple[str | None, ...]]:
    """Return what each number stands for: effect, joint and parameter, or a base parameter."""
    sought = [(*place(unknowns.effects[u.place]), u.parameter.name) for u in unknowns.sought]
    return [*sought, *((parameter.name,) for parameter in unknowns.base)]


def shortened(found: Sequence[Candidate], reach: float, slack: float) -> list[Candidate]:
    """Return the candidates that are worth a fit: the best of each joint, and the best of all.

    Args:
        found: Candidates, the most promising first.
        reach: First-order misfit below which a candidate promises enough.
        slack: By how much the first order may be too high.
    """
    leaders: dict[str | None, Candidate] = {}
    for candidate in found:
        if candidate.misfit < reach:
            leaders.setdefault(candidate.effect.joint, candidate)
    others = [c for c in found if c.misfit < reach + slack and leaders.get(c.effect.joint) is not c]
    chosen = [*leaders.values(), *others[: max(SHORTLIST - len(leaders), BESIDE)]]
    return sorted(chosen, key=lambda candidate: candidate.misfit)
