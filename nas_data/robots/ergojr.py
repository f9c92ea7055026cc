"""Poppy Ergo Jr with its plain tip: six XL-320 servos."""

import math

from nas_data.robots.base import FOLDER, Robot

JOINTS = ("m1", "m2", "m3", "m4", "m5", "m6")
RATE = 100.0  # [Hz] control rate of the paper's recordings
POSITION_QUANTUM = math.radians(300 / 1023)  # [rad] 0 … 1023 over 300°, XL-320 e-manual
VELOCITY_QUANTUM = 0.111 * 2 * math.pi / 60  # [rad/s] 0.111 rpm per unit (0.666°/s), XL-320 e-manual
# Registers of the identified servo: its P gain, its full torque, and no speed limit; see the comment in ergojr.xml. The
# punch is that of the factory (XL-320 e-manual); the identified friction includes its effect.
REGISTERS = (("p_gain", 32.0), ("torque_limit", 1023.0), ("moving_speed", 0.0), ("punch", 32.0))

ROBOT = Robot(
    name="ergojr",
    mjcf=FOLDER / "ergojr.xml",
    joints=JOINTS,
    rate=RATE,
    position_quantum=POSITION_QUANTUM,
    velocity_quantum=VELOCITY_QUANTUM,
    tip="tip",
    registers=REGISTERS,
)
