"""Arms of the setting `any` with few data: five episodes under one kind of command, at 20 Hz."""

from dataclasses import replace

from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.case import Conditions, Identity
from nas_data.benchmarks.blind.designs import draw_design
from nas_data.benchmarks.blind.motions import MIXTURE, SIGNALS
from nas_data.benchmarks.blind.settings import any as any_setting

RATE = 20.0  # [Hz]
EPISODES = 5
ONE = tuple(signal for signal in SIGNALS if signal != MIXTURE)


def draw(identity: Identity) -> tuple[NominalArm, Conditions]:
    """Draw as `any` does, with a low rate and few episodes."""
    rng, usual = identity.stream("poor"), any_setting.draw_conditions(identity)
    sensor = any_setting.draw_sensor(rng, RATE)
    conditions = replace(usual, rate=RATE, episodes=EPISODES, signal=str(rng.choice(ONE)), sensor=sensor)
    return draw_design(identity.stream("arm"), conditions.period), conditions


SETTING = replace(any_setting.SETTING, draw=draw)
