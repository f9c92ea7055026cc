"""The paper's Pusher: three torque motors in a plane, and a puck."""

from nas_data.robots.base import FOLDER, Robot

JOINTS = ("j1", "j2", "j3")
RATE = 20.0  # [Hz] five physics steps of 10 ms, the authors' environment

ROBOT = Robot(name="pusher", mjcf=FOLDER / "pusher.xml", joints=JOINTS, rate=RATE, tip="gripper")
