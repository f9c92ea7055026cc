"""Drawing a case: arm, base errors, hidden effects whose marks can be seen, commands, and what the plant does."""

import numpy as np

from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.case import DEFAULT, Case, Episodes, Identity
from nas_data.benchmarks.blind.command_sequence import CommandSequence, Script
from nas_data.benchmarks.blind.conditions import Conditions, Sensor
from nas_data.benchmarks.blind.following import FollowingSession, find_reach
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.sampling import EffectSampler
from nas_data.benchmarks.blind.settings.base import Episodes as EpisodesOf
from nas_data.benchmarks.blind.settings.base import find_setting


def draw_case(family: str, plant: str, number: int, seed: int, faint: bool = False, setting: str = DEFAULT) -> Case:
    """Draw a case; same arguments, same case.

    Args:
        family: `none`, `one`, `two`, `three` (hidden effects of the contract's table), `every` (one effect in every
            joint) or `outside` of the table.
        plant: `numpy`, `bullet` or `mujoco`.
        number: Of the case.
        seed: Master seed.
        faint: Draw marks from 0.3 floors upwards instead of the setting's least.
        setting: File of `settings/`: `xl320`, `any` for other arms and recordings, `far`, `poor`, or `torque`.

    Raises:
        UnknownName: there is no such family, plant or setting.
        OptionError: the setting has no such family.
        SimulationDiverged: no draw leaves marks that can be seen.
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
        recorded=simulate_measurements(tape, marks.states, conditions.sensor, streams),
        fresh=simulate_measurements(later, hider.show(plant, [truth], later)[0], conditions.sensor, streams),
    )


def make_scripts(
    arm: NominalArm, conditions: Conditions, episodes: EpisodesOf, rng: np.random.Generator
) -> tuple[Script, Script]:
    """Return what is handed over and what is kept back: commands as drawn, or what a controller makes of references."""
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
    """Return episodes as they were recorded.

    Args:
        tape: What was played.
        states: True positions [rad], then velocities [rad/s], shape (E, T + 1, 2n).
        sensor: What the servos report of them.
        streams: Randomness of positions and of speeds.
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
