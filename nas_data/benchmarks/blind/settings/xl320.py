"""Six joints of an XL-320's size, 100 Hz, 20 episodes of 3 s, readings of 0.29°: cases of one kind."""

import numpy as np

from nas_data.benchmarks.blind.arms import NominalArm, draw_arm
from nas_data.benchmarks.blind.case import Conditions, Identity, Sensor
from nas_data.benchmarks.blind.catalogue import INSIDE, OUTSIDE
from nas_data.benchmarks.blind.motions import draw_episodes
from nas_data.benchmarks.blind.plants.base import SETTLE
from nas_data.benchmarks.blind.settings.base import CaseSetting

SIGNALS = ("steps", "mixed")
RATE = 100.0  # [Hz]
EPISODES, FRESH = 20, 10
SECONDS = 3.0
QUANTUM = np.radians(0.29)  # [rad] XL-320 e-manual
NOISE = np.radians(0.05)  # [rad] standard deviation before rounding
FLOOR = float(QUANTUM / np.sqrt(12))  # [rad] what rounding alone leaves
SENSOR = Sensor(float(NOISE), float(QUANTUM), FLOOR)


def draw(identity: Identity) -> tuple[NominalArm, Conditions]:
    """Draw the Ergo Jr or a random arm of its size, commanded by steps or a mixture of signals."""
    arm = draw_arm(identity.stream("arm"))
    signal = str(identity.stream("signal").choice(SIGNALS))
    return arm, Conditions(RATE, SECONDS, EPISODES, FRESH, SETTLE, signal, SENSOR)


SETTING = CaseSetting(draw, draw_episodes, INSIDE, OUTSIDE, least=3.0, most=np.inf, rounds=40)
