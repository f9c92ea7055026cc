"""Small arms with something hidden, and a search at work on them: rollouts of all episodes take a few milliseconds."""

import copy
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from nas_data.effects.base import Effect, parse
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.nominal import Nominal
from nas_data.gap.search.hypothesis import Description, Hypothesis
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.search import Search

NOISE = 1e-4  # [rad]
RATE = 100  # [Hz]
LINK = (
    '<body name="link{0}" pos="{1} 0 0"><joint name="j{0}" axis="0 1 0" damping="{damping}" armature="{armature}" '
    'frictionloss="{frictionloss}"/>'
    '<geom type="capsule" size="0.01" fromto="0 0 0 0.08 0 0" mass="0.03" contype="0" conaffinity="0"/>{2}</body>'
)


def arm(
    joints: int = 2,
    gain: float = 0.5,
    damping: float = 0.03,
    armature: float = 0.001,
    frictionloss: float = 0.0,
    motors: bool = False,
) -> str:
    """Return the model of a planar arm in SI units; motors are told torques, servos positions."""
    own = {"damping": damping, "armature": armature, "frictionloss": frictionloss}
    chain = ""
    for number in reversed(range(joints)):
        chain = LINK.format(number + 1, 0.08 if number else 0, chain, **own)
    kind = "motor" if motors else f'position kp="{gain}"'
    drives = "".join(
        f'<{kind.split()[0]} name="j{n + 1}" joint="j{n + 1}" {kind.partition(" ")[2]}/>' for n in range(joints)
    )
    option = '<option timestep="0.002" integrator="implicitfast"/>'
    return f"<mujoco>{option}<worldbody>{chain}</worldbody><actuator>{drives}</actuator></mujoco>"


def played(
    model: str,
    effects: Sequence[str] = (),
    factors: Mapping[str, float] | None = None,
    target: str | None = None,
    episodes: int = 3,
    seconds: float = 0.9,
    size: float = 0.7,
) -> tuple[Nominal, EpisodeBatch]:
    """Return a model and what a target with hidden effects measures of it, from rest.

    Args:
        model: The model that is handed over.
        effects: Hidden in the target.
        factors: Of the target's own parameters.
        target: Another model than that; the same where None.
        episodes: How many.
        seconds: How long [s].
        size: Greatest command [rad or N·m].
    """
    rng = np.random.default_rng(0)
    joints = tuple(f"j{number + 1}" for number in range(model.count("<joint")))
    held = round(0.3 * RATE)
    told = rng.uniform(-size, size, (episodes, round(seconds * RATE / held), len(joints))).repeat(held, axis=1)
    counts = np.ones(told.shape[:2], bool)
    empty = EpisodeBatch(joints, 1 / RATE, np.zeros((episodes, len(joints))), told, told, counts, np.arange(episodes))
    truth = loaded(target or model, empty).predict(empty, [parse(text) for text in effects], factors)
    seen = truth + rng.normal(0, NOISE, truth.shape)
    return loaded(model, empty), EpisodeBatch(
        joints, 1 / RATE, empty.initial_positions, told, seen, counts, np.arange(episodes)
    )


def loaded(model: str, evidence: EpisodeBatch) -> Nominal:
    """Return a model from its text."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.xml"
        path.write_text(model)
        return Nominal.load(path, evidence)


def tasks(nominal: Nominal, evidence: EpisodeBatch) -> tuple[FitTask, FitTask]:
    """Return what is fitted, and what judges: every third episode."""
    held = np.arange(1, len(evidence), 3)
    rest = np.setdiff1d(np.arange(len(evidence)), held)
    floor = np.full(len(nominal.joints), NOISE)
    return FitTask(nominal, evidence.select(rest), floor), FitTask(nominal, evidence.select(held), floor)


def begun(model: str, *effects: str, **options: object) -> Search:
    """Return a search that has begun on a model and a target with hidden effects."""
    return Search.begin(*tasks(*played(model, effects, **options)))  # type: ignore[arg-type]


def afresh(search: Search) -> Search:
    """Return a search of its own that stands where another does."""
    other = copy.copy(search)
    other.rivals, other.swaps_tried, other._cache = {**search.rivals}, {*search.swaps_tried}, {}
    return other


def described(*effects: str, shared: Sequence[str] = (), freed: Sequence[str] = ()) -> Description:
    """Return a description of effects as texts."""
    return Description(tuple(parse(text) for text in effects), frozenset(freed), frozenset(shared))


def fitted(search: Search, *effects: str, shared: Sequence[str] = (), freed: Sequence[str] = ()) -> Hypothesis:
    """Return a hypothesis fitted from guesses, in an objective that was made there."""
    found = search.fit_description(described(*effects, shared=shared, freed=freed), {}, steps=8, jacobian_refreshes=2)
    assert found is not None
    return search.relinearise(found)


def names(effects: Sequence[Effect]) -> list[tuple[str, str | None]]:
    """Return names and joints of effects, in order."""
    return sorted((effect.name(), effect.joint) for effect in effects)
