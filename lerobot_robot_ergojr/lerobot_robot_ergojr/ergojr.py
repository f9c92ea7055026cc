"""An ErgoJr as LeRobot's commands use a robot: connect, observe, act, disconnect."""

import logging
from contextlib import ExitStack
from functools import cached_property

import numpy as np
from lerobot.robots import Robot
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from lerobot_robot_ergojr.config_ergojr import ErgoJrConfig
from nas_data.dataset.features import make_position_feature, make_state_feature
from nas_data.hardware.virtual_bus.process import VIRTUAL, port_of
from nas_data.hardware.xl320.arm import Configuration, Xl320, Xl320Arm
from nas_data.hardware.xl320.joints import (
    Joints,
    compute_zero_offsets,
    make_ergojr_joints,
    read_calibration,
    write_calibration,
)
from nas_data.recorders.arm_motion import ArmMotion
from nas_data.recorders.guarded import GuardedArm, Setup
from nas_data.recorders.path_planner import PathPlanner
from nas_data.recorders.schedule import MonotonicClock
from nas_data.robots.ergojr import JOINTS, ROBOT

POSITIONS, STATE = make_position_feature(JOINTS).names, make_state_feature(JOINTS).names


class ErgoJr(Robot):
    """Six XL-320 servos: positions [rad] and velocities [rad/s] are observed, positions [rad] commanded."""

    config_class = ErgoJrConfig
    name = "ergojr"

    def __init__(self, config: ErgoJrConfig) -> None:
        super().__init__(config)
        self.config = config
        self.cameras: dict[str, object] = {}
        self._open, self._port = ExitStack(), ""
        self._guarded: GuardedArm | None = None
        self._motion: ArmMotion | None = None

    @cached_property
    def observation_features(self) -> dict[str, type]:
        """Names of what is observed: `<joint>.pos` and `<joint>.vel`."""
        return dict.fromkeys(STATE, float)

    @cached_property
    def action_features(self) -> dict[str, type]:
        """Names of what is commanded: `<joint>.pos`."""
        return dict.fromkeys(POSITIONS, float)

    @property
    def is_connected(self) -> bool:
        """Whether the port is open."""
        return self._guarded is not None

    @property
    def is_calibrated(self) -> bool:
        """Whether the zeros of this arm are stored; those of a virtual arm need not be."""
        return self.calibration_fpath.is_file() or self.config.port == VIRTUAL

    def connect(self, calibrate: bool = True) -> None:
        """Open the port; then the arm goes slowly to its upright pose.

        Args:
            calibrate: Whether it is calibrated where it is not, and moves; the torque stays off otherwise.

        Raises:
            DeviceAlreadyConnectedError: it is connected.
            ArmError: something is wrong with the arm.
        """
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected already.")
        self._port = self._open.enter_context(port_of(self.config.port))
        try:
            self._guard()
            if calibrate and not self.is_calibrated:
                self.calibrate()
            if calibrate:
                self.configure()
        except BaseException:
            self.disconnect()
            raise

    def calibrate(self) -> None:
        """Take the pose that a person gives the arm as zero, and store it; the arm sinks before."""
        self._let_go()
        input("Put the arm upright by hand, all horns on their marks, hold it and press Enter.")
        joints = make_ergojr_joints()
        arm = Xl320Arm(self._port, joints)
        try:
            raw = np.array([arm.bus.get(identity, "present_position") for identity in joints.ids])
        finally:
            arm.close()
        write_calibration(self.calibration_fpath, joints.with_offsets(compute_zero_offsets(joints, raw)))
        self._load_calibration()
        self._guard()

    def configure(self) -> None:
        """Set the servos up, switch the torque on and go slowly to the upright pose."""
        rest = np.array(ROBOT.rest or np.zeros(len(JOINTS)))
        self._motion = self._connected().take(rest)
        self._motion.approach(rest)

    def get_observation(self) -> dict[str, float]:
        """Return positions [rad] and velocities [rad/s]."""
        guarded = self._connected()
        reading = self._motion.sense() if self._motion else guarded.arm.read()
        return dict(zip(STATE, [*reading.positions.tolist(), *reading.velocities.tolist()], strict=True))

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        """Command positions [rad]; return them as they were sent: within limits and step size, in whole ticks."""
        if self._motion is None:
            self.configure()
        assert self._motion is not None
        sent = self._motion.send(np.array([float(action[name]) for name in POSITIONS]))
        return dict(zip(POSITIONS, sent.tolist(), strict=True))

    def disconnect(self) -> None:
        """Hold the arm until it is slow, switch its torque off, give the port back."""
        self._let_go()
        self._open.close()

    def _guard(self) -> None:
        """Open the port and start the guard."""
        config = self.config
        configuration = Configuration(speed=config.speed, torque=config.torque)
        setup = Setup(
            driver=Xl320(port=self._port, joints=self._joints(), configuration=configuration),
            planner=PathPlanner(ROBOT),
            largest_step=config.max_step,
        )
        self._guarded = GuardedArm(setup, MonotonicClock(), config.patience)

    def _joints(self) -> Joints:
        path, virtual = self.calibration_fpath, self.config.port == VIRTUAL
        return read_calibration(path, make_ergojr_joints()) if path.is_file() and not virtual else make_ergojr_joints()

    def _let_go(self) -> None:
        """Leave the arm without torque, if it is held."""
        guarded, self._guarded, self._motion = self._guarded, None, None
        if guarded:
            guarded.leave()
            if guarded.safety_warning:
                logging.error(guarded.safety_warning)

    def _connected(self) -> GuardedArm:
        if self._guarded is None:
            raise DeviceNotConnectedError(f"{self} is not connected; call connect() first.")
        return self._guarded
