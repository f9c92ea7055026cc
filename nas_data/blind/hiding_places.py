"""Drawing what hides in a case: effects, their places and their sizes, until the mark of each can be seen."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from nas_data.blind.arms import Arm
from nas_data.blind.case import FAMILIES, Identity
from nas_data.blind.conditions import Conditions
from nas_data.blind.marks import Marks, measure_marks, out_of_sight
from nas_data.blind.plants.base import find_plant
from nas_data.blind.plants.constants import Constants
from nas_data.blind.settings.base import Setting
from nas_data.blind.truth import Base, Hidden, Truth
from nas_data.errors import SimulationDiverged

FAINTEST_MARK = 0.3  # multiples of the noise floor from which an effect counts in the power curve
SCREEN = "numpy"  # plant on which what is outside the catalogue is tried first: not every plant can play it
TRIES = 3  # sizes of an effect before another effect is drawn


class Hider:
    """Hides effects in one case; remembers where its stream of randomness stands."""

    def __init__(self, identity: Identity, setting: Setting, arm: Arm, conditions: Conditions) -> None:
        """Start the case's stream."""
        self.identity = identity
        self.setting = setting
        self.arm = arm
        self.conditions = conditions
        self.constants = Constants.of(arm.model())
        self.screen = SCREEN if identity.family == "outside" else setting.screen
        self.kinds = setting.outside if identity.family == "outside" else setting.inside
        self.rng = identity.stream("effects")
        self.least = FAINTEST_MARK if identity.faint else setting.least

    def hide(self, commands: np.ndarray, poses: np.ndarray) -> tuple[Truth, Marks]:
        """Draw what hides until each of it can be seen on the case's own plant.

        Args:
            commands: Of the episodes that are handed over [rad], shape (E, T, n).
            poses: Held before them [rad], shape (E, n).

        Raises:
            SimulationDiverged: it never can.
        """
        truth = Truth(Base.draw(len(self.arm.joints), self.identity.stream("base")))
        while len(truth.hidden) < FAMILIES[self.identity.family]:
            truth = Truth(truth.base, (*truth.hidden, self._another(truth.hidden)))
        tries = [1] * len(truth.hidden)
        for _ in range(self.setting.rounds):
            marks, unfit = self._seen(truth, commands, poses)
            if not unfit:
                return truth, marks
            for index in unfit:
                truth = self._redrawn(truth, index, tries[index] < TRIES)
                tries[index] = tries[index] + 1 if tries[index] < TRIES else 1
        raise SimulationDiverged(f"{self.identity.name} hides nothing that can be seen; use another number.")

    def show(self, plant: str, truths: Sequence[Truth], commands: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Return states (len(truths), E, T + 1, 2n) of commands (E, T, n) from poses (E, n) on a plant."""
        conditions = self.conditions
        return find_plant(plant)(self.arm, truths, commands, poses, conditions.period, conditions.settle)

    def _seen(self, truth: Truth, commands: np.ndarray, poses: np.ndarray) -> tuple[Marks, list[int]]:
        """Return the marks, and which do not fit; a slow plant is asked only once the fast one sees them all."""
        screened = self.identity.plant != self.screen and bool(truth.hidden)
        for plant in (self.screen, self.identity.plant) if screened else (self.identity.plant,):
            show = partial(self.show, plant, commands=commands, poses=poses)
            marks = measure_marks(show, truth, self.arm.joints, self.conditions.sensor.floor)
            unfit = out_of_sight(marks.values, self.least, self.setting.most)
            if unfit:
                break
        return marks, unfit

    def _redrawn(self, truth: Truth, index: int, same: bool) -> Truth:
        """Return the truth with one effect of another size, or another effect in its stead."""
        hidden = truth.hidden[index]
        if same:
            return truth.exchanged(index, self._sized(hidden.effect, hidden.joint))
        return truth.exchanged(index, self._another(truth.without(index).hidden))

    def _another(self, beside: Sequence[Hidden]) -> Hidden:
        """Draw an effect, its place and its size; it can be told apart from those beside it."""
        while True:
            effect = str(self.rng.choice(sorted(self.kinds)))
            kind = self.kinds[effect]
            arm_wide = kind.whole_arm and (not kind.per_joint or self.rng.random() < 0.5)
            joint = None if arm_wide else str(self.rng.choice(self.constants.joints))
            if not any(self._alike(effect, joint, other) for other in beside):
                return self._sized(effect, joint)

    def _alike(self, effect: str, joint: str | None, other: Hidden) -> bool:
        """Whether two effects cannot be told apart: of one sort, in the same joint or in all of them."""
        sort, others = (self.kinds[name].apart or name for name in (effect, other.effect))
        return sort == others and (joint is None or other.joint is None or joint == other.joint)

    def _sized(self, effect: str, joint: str | None) -> Hidden:
        """Draw an effect's size."""
        row = 0 if joint is None else self.constants.joints.index(joint)
        return Hidden(effect, joint, self.kinds[effect].draw(self.rng, self.constants, row, self.identity.faint))
