"""LeRobot's SO-101 follower arm, in primitive shapes: six Feetech STS3215 servos."""

import math

from nas_data.robots.base import FOLDER, Robot

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
QUANTUM = 2 * math.pi / 4096  # [rad] count of the STS3215's encoder, and [rad/s] unit of its speed register
# Registers of the factory (Feetech's memory table); stiffness and friction, which fit a real arm, include their effect.
REGISTERS = (("dead_zone", 1.0), ("minimum_startup_force", 16.0))

ROBOT = Robot(
    name="so101_follower",
    mjcf=FOLDER / "so101_follower.xml",
    joints=JOINTS,
    rest=(0.0, -0.8, 0.8, 0.0, 0.0, 0.0),
    position_quantum=QUANTUM,
    velocity_quantum=QUANTUM,
    tip="tip",
    registers=REGISTERS,
)
