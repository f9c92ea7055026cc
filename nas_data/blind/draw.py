"""Drawing a case: arm, base errors, hidden effects whose marks can be seen, commands, and what the plant does."""

import numpy as np

from nas_data.blind.case import DEFAULT, Case, Episodes, Identity
from nas_data.blind.conditions import Sensor
from nas_data.blind.hiding_places import Hider
from nas_data.blind.plants.constants import Constants
from nas_data.blind.settings.base import find_setting


def draw_case(family: str, plant: str, number: int, seed: int, faint: bool = False, setting: str = DEFAULT) -> Case:
    """Draw a case; same arguments, same case.

    Args:
        family: `none`, `one`, `two`, `three` (hidden effects of the contract's table) or `outside` of it.
        plant: `numpy`, `bullet` or `mujoco`.
        number: Of the case.
        seed: Master seed.
        faint: Draw marks from 0.3 floors upwards instead of the setting's least.
        setting: File of `settings/`: `xl320`, or `any` for other arms and recordings.

    Raises:
        UnknownName: there is no such family, plant or setting.
        SimulationDiverged: no draw leaves marks that can be seen.
    """
    identity = Identity(family, plant, number, seed, faint, setting)
    sort = find_setting(setting)
    arm, conditions = sort.draw(identity)
    control, rng = Constants.of(arm.model()).control, identity.stream("commands")
    counts = conditions.episodes, conditions.fresh
    handed, fresh = (sort.episodes(conditions, count, control, rng) for count in counts)
    hider = Hider(identity, sort, arm, conditions)
    truth, marks = hider.hide(*handed)
    later = hider.show(plant, [truth], *fresh)[0]
    streams = identity.stream("noise"), identity.stream("speed noise")
    return Case(
        identity=identity,
        arm=arm,
        conditions=conditions,
        truth=truth,
        marks=marks.values,
        marked_joints=marks.joints,
        recorded=measured(handed, marks.states, conditions.sensor, streams),
        fresh=measured(fresh, later, conditions.sensor, streams),
    )


def measured(
    played: tuple[np.ndarray, np.ndarray],
    states: np.ndarray,
    sensor: Sensor,
    streams: tuple[np.random.Generator, np.random.Generator],
) -> Episodes:
    """Return episodes as they were recorded.

    Args:
        played: Commands (E, T, n) and poses (E, n) [rad].
        states: True positions [rad], then velocities [rad/s], shape (E, T + 1, 2n).
        sensor: What the servos report of them.
        streams: Randomness of positions and of speeds.
    """
    positions, speeds = np.split(states, 2, axis=-1)
    return Episodes(*played, positions, sensor.positions(positions, streams[0]), sensor.speeds(speeds, streams[1]))
