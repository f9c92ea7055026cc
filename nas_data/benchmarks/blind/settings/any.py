"""Two to seven joints of any size, recorded at any usual rate and resolution, under any usual command."""

import numpy as np

from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.case import Conditions, Identity, Sensor
from nas_data.benchmarks.blind.catalogue import INSIDE, OUTSIDE, EffectDraw, Rng, Span, Values, draw_payload_mass
from nas_data.benchmarks.blind.designs import draw_design
from nas_data.benchmarks.blind.motions import SIGNALS, draw_motions
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.settings.base import CaseSetting

RATES = (50.0, 100.0, 200.0)  # [Hz]
EPISODES, FRESH = (10, 25), 8
SECONDS = (2.5, 5.0)
SETTLE = 1.5  # [s] three times an XL-320's: as long as a damped loop of 2.5 Hz takes
NOISE = (np.radians(0.03), np.radians(0.2))  # [rad] standard deviation before rounding
QUANTA = (0.0, np.radians(0.088), np.radians(0.29))  # [rad] none, 4096 and 1241 steps a turn
FINER = (0.1, 0.5)  # noise of a measured speed relative to that of differenced positions


def draw(identity: Identity) -> tuple[NominalArm, Conditions]:
    """Draw an arm and its recording conditions."""
    conditions = draw_conditions(identity)
    return draw_design(identity.stream("arm"), conditions.period), conditions


def draw_conditions(identity: Identity) -> Conditions:
    """Draw recording conditions."""
    rng = identity.stream("conditions")
    rate = float(rng.choice(RATES))
    return Conditions(
        rate=rate,
        seconds=float(rng.uniform(*SECONDS)),
        episodes=int(rng.integers(EPISODES[0], EPISODES[1] + 1)),
        fresh=FRESH,
        settle=SETTLE,
        signal=str(rng.choice(SIGNALS)),
        sensor=draw_sensor(rng, rate),
    )


def draw_sensor(rng: Rng, rate: float) -> Sensor:
    """Draw the servos' sensor at a rate [Hz]; half of them measure speed."""
    noise, quantum = float(rng.uniform(*NOISE)), float(rng.choice(QUANTA))
    floor = float(np.hypot(noise, quantum / np.sqrt(12)))
    differenced, finer = np.sqrt(2) * floor * rate, rng.uniform(*FINER)
    return Sensor(noise, quantum, floor, float(finer * differenced) if rng.random() < 0.5 else None)


def draw_payload(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a load anywhere on the last link; links are about twice as long as the distance to their centre of mass."""
    centre = constants.centres[-1]
    along = rng.uniform(-0.9, 0.9) * centre
    aside = 0.2 * np.linalg.norm(centre) * rng.uniform(-1, 1, 3)
    return {
        **draw_payload_mass(rng, constants, joint, faint),
        **dict(zip("xyz", (along + aside).tolist(), strict=True)),
    }


def draw_swinging_load(rng: Rng, constants: Constants, joint: int, faint: bool) -> Values:
    """Draw a weight of 1/10 to 1/2 of the arm's moving mass on a string of 1/3 to 1 link length."""
    return {
        "mass": float(constants.masses.sum()) * Span(0.1, 0.5, 0.01).draw(rng, faint),
        "length": float(2 * np.linalg.norm(constants.centres[-1]) * rng.uniform(0.33, 1.0)),
        "heading": float(rng.uniform(0, 2 * np.pi)),
    }


SETTING = CaseSetting(
    draw,
    draw_motions,
    inside={**INSIDE, "payload": EffectDraw(draw_payload, per_joint=False, whole_arm=True)},
    outside={**OUTSIDE, "swinging_load": EffectDraw(draw_swinging_load, per_joint=False, whole_arm=True)},
    least=4.0,
    most=60.0,
    rounds=200,
)
