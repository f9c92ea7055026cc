"""Drawing a case: arm, base errors, hidden effects whose marks can be seen, commands, and what the plant does."""

import numpy as np

from nas_data.blind.arms import draw_arm
from nas_data.blind.case import NOISE, QUANTUM, RATE, Case, Episodes, Identity
from nas_data.blind.excitation import SIGNALS, draw_commands
from nas_data.blind.hiding_places import Hider
from nas_data.blind.plants.base import find_plant
from nas_data.blind.plants.constants import Constants


def draw_case(family: str, plant: str, number: int, seed: int, faint: bool = False) -> Case:
    """Draw a case; same arguments, same case.

    Args:
        family: `none`, `one`, `two`, `three` (hidden effects of the contract's table) or `outside` of it.
        plant: `numpy`, `bullet` or `mujoco`.
        number: Of the case.
        seed: Master seed.
        faint: Draw marks from 0.3 floors upwards instead of 3.

    Raises:
        UnknownName: there is no such family or plant.
        SimulationDiverged: no draw leaves marks that can be seen.
    """
    identity = Identity(family, plant, number, seed, faint)
    arm = draw_arm(identity.stream("arm"))
    signal = str(identity.stream("signal").choice(SIGNALS))
    handed, fresh = draw_commands(signal, Constants.of(arm.model()).control, identity.stream("commands"))
    truth, marks = Hider(identity, arm).hide(*handed)
    play = find_plant(plant)
    later = play(arm, [truth], *fresh, 1 / RATE)[0]
    noise = identity.stream("noise")
    return Case(
        identity=identity,
        arm=arm,
        truth=truth,
        marks=marks.values,
        marked_joints=marks.joints,
        excitation=signal,
        recorded=Episodes(*handed, marks.positions, readings(marks.positions, noise)),
        fresh=Episodes(*fresh, later, readings(later, noise)),
    )


def readings(positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return what an XL-320 reports: noise, then rounding [rad]."""
    return np.round((positions + NOISE * rng.standard_normal(positions.shape)) / QUANTUM) * QUANTUM
