"""A servo pendulum: one XL-330 that swings 0.49 kg at 0.1 m, as in Rhoban/bam's recordings."""

import math

from nas_data.robots.base import FOLDER, Robot

POSITION_QUANTUM = 2 * math.pi / 4096  # [rad] XL-330 e-manual
VELOCITY_QUANTUM = 0.229 * 2 * math.pi / 60  # [rad/s] 0.229 rpm per unit, XL-330 e-manual

ROBOT = Robot(
    name="pendulum",
    mjcf=FOLDER / "pendulum.xml",
    joints=("pendulum",),
    rate=200.0,  # [Hz] the recordings have about 188 rows per second; bam resamples them to 5 ms
    position_quantum=POSITION_QUANTUM,
    velocity_quantum=VELOCITY_QUANTUM,
    tip="tip",
)
