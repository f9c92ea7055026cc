"""Record episodes from an ErgoJr on a serial port, or from a virtual one."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from nas_data.commands._record_arm import VIRTUAL, RecordArm
from nas_data.errors import OptionError

if TYPE_CHECKING:
    from nas_data.hardware.arms.base import Driver
    from nas_data.hardware.xl320.arm import Configuration
    from nas_data.hardware.xl320.joints import Joints
    from nas_data.robots.base import Robot

NAME = "ergojr"


@dataclass(frozen=True, kw_only=True)
class RecordErgojr(RecordArm):
    """Record episodes from an ErgoJr; the same command resumes an interrupted recording.

    The arm moves slowly to its first pose: keep hands away. Ctrl-C stops the arm, holds it until it is slow and
    switches its torque off; it then sinks. Saved episodes are kept.

    Example: nas record ergojr --port virtual --episodes 3 --lockstep --name try
    """

    FASTEST: ClassVar[float] = 200.0  # [Hz] limit of six servos at 1 Mbit/s through a USB adapter

    port: str
    """Serial port of the adapter; 'virtual' for a simulated arm."""
    rate: float = 100.0
    """Control rate [Hz]."""
    speed: float = 1.745
    """Speed limit in the servos [rad/s], 100°/s as in the paper's recordings; 0 for none."""
    torque: float = 1.0
    """Torque limit in the servos, as a share of the largest."""
    p_gain: int = 32
    """Proportional gain in the servos' units; 32 corresponds to the simulated arm."""
    i_gain: int = 0
    """Integral gain; Poppy's software sets 4."""
    d_gain: int = 0
    """Derivative gain."""
    largest_step: float = 3.2
    """Largest difference between successive commands [rad]; the speed limit keeps large ones slow."""
    calibration: Path | None = None
    """Calibration file; LeRobot's file of --id by default."""
    id: str = NAME
    """Name of this arm: LeRobot's robot id."""

    @property
    def kind(self) -> str:
        """Name of the robot in datasets."""
        return NAME

    @property
    def virtual(self) -> bool:
        """Whether the arm is simulated."""
        return self.port == VIRTUAL

    @property
    def step(self) -> float:
        """Largest difference between successive commands [rad]."""
        if not 0 < self.largest_step < math.inf:
            raise OptionError(f"--largest-step is {self.largest_step}; it must be a number above zero.")
        return self.largest_step

    def arm_model(self) -> "Robot":
        """Return the model for collision checks."""
        from nas_data.robots.base import find_robot

        return find_robot(NAME)

    @contextmanager
    def driver(self) -> "Iterator[Driver]":
        """Yield the driver of the arm."""
        from nas_data.hardware.virtual_bus.process import port_of
        from nas_data.hardware.virtual_bus.terminal import Options
        from nas_data.hardware.xl320.arm import Xl320

        configuration = self.configuration
        with port_of(self.port, self.effect, self.fault, self.lockstep, Options(period=1 / self.rate)) as port:
            yield Xl320(port=port, joints=self._joints(), configuration=configuration)

    def simulated(self) -> str:
        """Return a phrase for the kind of virtual arm."""
        return "virtual XL-320 servos"

    @property
    def configuration(self) -> "Configuration":
        """Settings that are written to every servo."""
        from nas_data.hardware.xl320.arm import Configuration

        return Configuration(
            p_gain=self.p_gain, i_gain=self.i_gain, d_gain=self.d_gain, speed=self.speed, torque=self.torque
        )

    def _joints(self) -> "Joints":
        from nas_data.hardware.xl320.joints import find_joints, make_ergojr_joints

        if self.virtual and not self.calibration:
            return make_ergojr_joints()
        return find_joints(make_ergojr_joints(), NAME, self.id, self.calibration)
