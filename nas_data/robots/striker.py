"""The paper's Striker: seven torque motors, and a ball."""

from nas_data.robots.base import FOLDER, Robot

JOINTS = ("pan", "lift", "upper_arm_roll", "elbow_flex", "forearm_roll", "wrist_flex", "wrist_roll")
RATE = 20.0  # [Hz] five physics steps of 10 ms, the authors' environment

ROBOT = Robot(name="striker", mjcf=FOLDER / "striker.xml", joints=JOINTS, rate=RATE, tip="tip")
