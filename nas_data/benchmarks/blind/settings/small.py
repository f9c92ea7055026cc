"""Two joints of an XL-320's size, 50 Hz, 8 episodes of 0.8 s: cases of seconds, to test a search quickly."""

import numpy as np

from nas_data.benchmarks.blind.arms import NominalArm, draw_random_arm
from nas_data.benchmarks.blind.case import Conditions, Identity
from nas_data.benchmarks.blind.catalogue import INSIDE, OUTSIDE
from nas_data.benchmarks.blind.motions import draw_episodes
from nas_data.benchmarks.blind.plants.base import SETTLE
from nas_data.benchmarks.blind.settings.base import CaseSetting
from nas_data.benchmarks.blind.settings.xl320 import SENSOR

JOINTS = 2
RATE = 50.0  # [Hz]
EPISODES, FRESH = 8, 4
SECONDS = 0.8
LEAST = 5.0  # [noise floors] 320 samples per joint show less than the 6000 of xl320


def draw(identity: Identity) -> tuple[NominalArm, Conditions]:
    """Draw a random arm and a mixture of signals."""
    arm = draw_random_arm(identity.stream("arm"), JOINTS)
    return arm, Conditions(RATE, SECONDS, EPISODES, FRESH, SETTLE, "mixed", SENSOR)


SETTING = CaseSetting(draw, draw_episodes, INSIDE, OUTSIDE, least=LEAST, most=np.inf, rounds=200, screen="mujoco")
