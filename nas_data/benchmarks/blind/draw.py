"""Draw a case: arm, base errors, hidden effects with visible marks, commands, and the plant's motion."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.case import (
    DEFAULT,
    EVERY,
    FAMILIES,
    FELT,
    Base,
    Case,
    CommandSequence,
    Conditions,
    Episodes,
    Hidden,
    Identity,
    Script,
    Sensor,
    Truth,
)
from nas_data.benchmarks.blind.catalogue import EVERYWHERE
from nas_data.benchmarks.blind.machines import FollowingSession, find_reach
from nas_data.benchmarks.blind.plants.base import find_plant
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.settings.base import CaseSetting, find_setting
from nas_data.benchmarks.blind.settings.base import Episodes as EpisodesOf
from nas_data.errors import OptionError, SimulationDiverged

FAINTEST_MARK = 0.3  # multiples of the noise floor from which an effect counts in the power curve
SCREEN = "numpy"  # plant that sizes of effects outside the catalogue are tried on first; not every plant supports them
TRIES = 3  # sizes tried before another effect is drawn
UNLIKE = 1.3  # largest over smallest size of an effect that every joint has

Show = Callable[[Sequence[Truth]], np.ndarray]  # truths → states (len(truths), E, T + 1, 2n)
Group = tuple[Hidden, ...]  # one effect, in one joint or in every joint


@dataclass(frozen=True)
class EffectSizes:
    """Size of each hidden effect in the positions, from simulations with and without it."""

    # RMS change of the position over all episodes, as a multiple of the noise floor, one for each effect
    values: tuple[float, ...]
    # joint of each value: the effect's own, or the one with the largest change for effects of the whole arm
    joints: tuple[str, ...]
    states: np.ndarray  # simulation with all effects, positions [rad] then velocities [rad/s], shape (E, T + 1, 2n)
    changes: np.ndarray  # RMS change of each joint by each effect, as a multiple of the noise floor, shape (effects, n)


class EffectSampler:
    """Draws hidden effects for one case; holds the state of its random generator."""

    def __init__(self, identity: Identity, setting: CaseSetting, arm: NominalArm, conditions: Conditions) -> None:
        """Seed the case's random generator.

        Raises:
            OptionError: the setting hides no effect in every joint.
        """
        self.identity = identity
        self.setting = setting
        self.arm = arm
        self.conditions = conditions
        self.given = setting.given(identity, arm)
        self.constants = Constants.of(arm.model())
        self.family = FAMILIES[identity.family]
        self.screen = SCREEN if self.family.outside else setting.screen
        for hidden in self.given:  # sizes refer to the arm's true servos, not to those of its model
            if hidden.effect == "servo_stiffness" and hidden.joint is not None:
                self.constants.gain[arm.joints.index(hidden.joint)] *= hidden.parameters["factor"]
        self.kinds = {**setting.inside, **setting.outside}
        inside = [name for name in setting.inside if identity.family != EVERY or name in EVERYWHERE]
        outside = [name for name, kind in setting.outside.items() if kind.before < len(arm.joints)]
        # names that each hidden effect is drawn from
        self.pools = [sorted(inside)] * self.family.inside + [sorted(outside)] * self.family.outside
        if not all(self.pools):
            raise OptionError(
                f"The setting {identity.setting} has no effects for the family '{identity.family}'; choose another one."
            )
        self.rng = identity.stream("effects")
        self.least = FAINTEST_MARK if identity.faint else setting.least

    def hide(self, script: Script) -> tuple[Truth, CommandSequence, EffectSizes]:
        """Draw hidden effects until each of them is visible on the case's own plant.

        Raises:
            SimulationDiverged: no draw is visible.
        """
        base, groups = self._draw_base(), list[Group]()
        for pool in self.pools:
            groups.append(self._draw_other(flatten(groups), pool))
        tries = [1] * len(groups)
        for _ in range(self.setting.rounds):
            truth = Truth(base, (*self.given, *flatten(groups)))
            tape, marks, unfit = self._draw_visible(truth, script)
            unfit_groups = [
                row for row, members in enumerate(number_groups(groups, len(self.given))) if members & unfit
            ]
            if not unfit_groups:
                return truth, tape, marks
            for row in unfit_groups:
                same = tries[row] < TRIES
                groups[row] = self._redraw(groups, row, same)
                tries[row] = tries[row] + 1 if same else 1
        raise SimulationDiverged(
            f"{self.identity.name} has a hidden effect without visible influence; use another number."
        )

    def show(self, plant: str, truths: Sequence[Truth], tape: CommandSequence) -> np.ndarray:
        """Return states of a plant under commands, shape (len(truths), E, T + 1, 2n)."""
        period, settle = self.conditions.period, self.conditions.settle
        return find_plant(plant)(self.arm, truths, tape.commands, tape.poses, period, settle, tape.start_speeds)

    def _draw_base(self) -> Base:
        """Draw the base errors; a motor's torque constant has none."""
        base = Base.draw(len(self.arm.joints), self.identity.stream("base"))
        return replace(base, stiffness=(1.0,) * len(self.arm.joints)) if self.conditions.pieces else base

    def _draw_visible(self, truth: Truth, script: Script) -> tuple[CommandSequence, EffectSizes, set[int]]:
        """Return commands, marks and effects whose marks do not fit; a slow plant runs only once the fast one fits."""
        screened = self.identity.plant != self.screen and bool(truth.hidden)
        for plant in (self.screen, self.identity.plant) if screened else (self.identity.plant,):
            tape = script(plant, truth)
            marks = measure_marks(
                partial(self.show, plant, tape=tape), truth, self.arm.joints, self.conditions.sensor.floor
            )
            # effects given by the setting keep their size
            unfit = set(find_unfit_marks(marks.values, self.least, self.setting.most)) - set(range(len(self.given)))
            if unfit:
                break
        return tape, marks, unfit

    def _redraw(self, groups: Sequence[Group], row: int, same: bool) -> Group:
        """Return an effect in another size, or another effect in its place."""
        if same:
            return self._draw_size(groups[row][0].effect, [hidden.joint for hidden in groups[row]])
        return self._draw_other(flatten([*groups[:row], *groups[row + 1 :]]), self.pools[row])

    def _draw_other(self, beside: Sequence[Hidden], pool: Sequence[str]) -> Group:
        """Draw an effect from some names, its joint and its size, distinguishable from those in `beside`."""
        while True:
            effect = str(self.rng.choice(pool))
            kind = self.kinds[effect]
            if self.identity.family == EVERY:
                return self._draw_size(effect, self.constants.joints)
            arm_wide = kind.whole_arm and (not kind.per_joint or self.rng.random() < 0.5)
            joint = None if arm_wide else str(self.rng.choice(self.constants.joints[kind.before :]))
            if not any(self._is_confusable(effect, joint, other) for other in beside):
                return self._draw_size(effect, [joint])

    def _is_confusable(self, effect: str, joint: str | None, other: Hidden) -> bool:
        """Whether two effects can hardly be distinguished: alike or apart, in the same joint or in all joints."""
        apart = effect in self.kinds[other.effect].apart or other.effect in self.kinds[effect].apart
        return (effect == other.effect or apart) and (joint is None or other.joint is None or joint == other.joint)

    def _draw_size(self, effect: str, joints: Sequence[str | None]) -> Group:
        """Draw an effect's size; in several joints the sizes are similar."""
        draw, faint = self.kinds[effect].draw, self.identity.faint
        if self.identity.family != EVERY:
            row = 0 if joints[0] is None else self.constants.joints.index(joints[0])
            return (Hidden(effect, joints[0], draw(self.rng, self.constants, row, faint)),)
        seed = int(self.rng.integers(2**32))  # the same random numbers: sizes differ only by the joints' properties
        group = []
        for row, joint in enumerate(self.constants.joints):
            values = draw(np.random.default_rng(seed), self.constants, row, faint)
            group.append(Hidden(effect, joint, scale_parameters(values, float(self.rng.uniform(0, np.log(UNLIKE))))))
        return tuple(group)


def scale_parameters(values: dict[str, float], distance: float) -> dict[str, float]:
    """Scale positive parameters away from the neutral value by a logarithmic distance; a factor away from 1."""
    return {
        name: value * float(np.exp(-distance if name == "factor" and value < 1 else distance))
        for name, value in values.items()
    }


def flatten(groups: Sequence[Group]) -> Group:
    """Concatenate groups of effects."""
    return tuple(hidden for group in groups for hidden in group)


def number_groups(groups: Sequence[Group], first: int) -> list[set[int]]:
    """Return the indices of each group's effects, counted from `first`."""
    ends = np.cumsum([first, *map(len, groups)]).tolist()
    return [set(range(begin, end)) for begin, end in pairwise(ends)]


def measure_marks(show: Show, truth: Truth, joints: Sequence[str], floor: float) -> EffectSizes:
    """Simulate with all hidden effects and without each of them; the noise floor is in radians."""
    played = show([truth, *(truth.without(index) for index in range(len(truth.hidden)))])
    positions = played[..., : len(joints)]
    changes = [np.sqrt(np.square(positions[0] - without).mean(axis=(0, 1))) / floor for without in positions[1:]]
    seen = [find_mark(change, joints, hidden.joint) for change, hidden in zip(changes, truth.hidden, strict=True)]
    return EffectSizes(
        tuple(value for value, _ in seen), tuple(joint for _, joint in seen), played[0], np.array(changes)
    )


def find_mark(change: np.ndarray, joints: Sequence[str], joint: str | None) -> tuple[float, str]:
    """Return the mark of an effect and its joint, from the change in each joint."""
    row = int(np.argmax(change)) if joint is None else joints.index(joint)
    return float(change[row]), joints[row]


def find_felt_joints(change: np.ndarray, joints: Sequence[str], hidden: Hidden, before: int) -> tuple[str, ...]:
    """Return the joints, of those on which an effect acts, at which it is felt.

    Args:
        change: RMS change of each joint, as a multiple of the noise floor, shape (n,).
        joints: Names of the arm's joints.
        hidden: The effect.
        before: Number of joints before its own on which it acts.
    """
    row = None if hidden.joint is None else joints.index(hidden.joint)
    acted = range(len(joints)) if row is None else range(row - before, row + 1)
    return tuple(joints[one] for one in acted if change[one] >= FELT)


def find_unfit_marks(marks: Sequence[float], least: float, most: float) -> list[int]:
    """Return the indices of marks below `least`, above `most` or not finite."""
    return [index for index, value in enumerate(marks) if not (least <= value <= most and value < np.inf)]


def draw_case(family: str, plant: str, number: int, seed: int, faint: bool = False, setting: str = DEFAULT) -> Case:
    """Draw a case; the same arguments give the same case.

    Args:
        family: `none`, `one`, `two`, `three` (hidden effects of the contract's table), `every` (one effect in every
            joint), `outside` of the table, or `outside_one`, `outside_two` (one outside beside one or two of it).
        plant: `numpy`, `bullet` or `mujoco`.
        number: Number of the case in its family.
        seed: Master seed.
        faint: Allow marks from 0.3 noise floors upwards instead of the setting's least.
        setting: File of `settings/`: `xl320`, `any` for other arms and recordings, `far`, `poor`, or `torque`.

    Raises:
        UnknownName: there is no such family, plant or setting.
        OptionError: the setting has no such family.
        SimulationDiverged: no draw has visible marks.
    """
    identity = Identity(family, plant, number, seed, faint, setting)
    sort = find_setting(setting)
    arm, conditions = sort.draw(identity)
    handed, fresh = make_scripts(arm, conditions, sort.episodes, identity.stream("commands"))
    hider = EffectSampler(identity, sort, arm, conditions)
    truth, tape, marks = hider.hide(handed)
    later = fresh(plant, truth)
    streams = identity.stream("noise"), identity.stream("speed noise")
    return Case(
        identity=identity,
        arm=arm,
        conditions=conditions,
        truth=truth,
        marks=marks.values,
        marked_joints=marks.joints,
        felt_joints=tuple(
            find_felt_joints(change, arm.joints, hidden, sort.outside[hidden.effect].before)
            if hidden.effect in sort.outside
            else None
            for change, hidden in zip(marks.changes, truth.hidden, strict=True)
        ),
        recorded=simulate_measurements(tape, marks.states, conditions.sensor, streams),
        fresh=simulate_measurements(later, hider.show(plant, [truth], later)[0], conditions.sensor, streams),
    )


def make_scripts(
    arm: NominalArm, conditions: Conditions, episodes: EpisodesOf, rng: np.random.Generator
) -> tuple[Script, Script]:
    """Return the scripts of the episodes handed over and kept back: drawn commands, or a controller on references."""
    constants, counts = Constants.of(arm.model()), (conditions.episodes, conditions.fresh)
    if conditions.pieces:
        references, _ = episodes(conditions, sum(counts), find_reach(constants.sliding), rng)
        session = FollowingSession(arm, conditions, references)
        return session.part(slice(0, counts[0])), session.part(slice(counts[0], None))
    handed, fresh = (CommandSequence(*episodes(conditions, count, constants.control, rng)) for count in counts)
    return lambda plant, truth: handed, lambda plant, truth: fresh


def simulate_measurements(
    tape: CommandSequence, states: np.ndarray, sensor: Sensor, streams: tuple[np.random.Generator, np.random.Generator]
) -> Episodes:
    """Return the episodes with simulated sensor readings.

    Args:
        tape: Played commands.
        states: True positions [rad], then velocities [rad/s], shape (E, T + 1, 2n).
        sensor: Noise and resolution of the servos' sensors.
        streams: Random generators of positions and of speeds.
    """
    positions, speeds = np.split(states, 2, axis=-1)
    return Episodes(
        tape.commands,
        tape.poses,
        positions,
        sensor.positions(positions, streams[0]),
        sensor.speeds(speeds, streams[1]),
        tape.start_speeds,
    )
