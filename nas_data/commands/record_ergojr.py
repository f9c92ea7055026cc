"""Record episodes from an ErgoJr on a serial port, or from a virtual one."""

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
    """Record episodes from an ErgoJr; stopped at any moment, the same command goes on where it was.

    The arm goes slowly to its first pose: keep hands away. Ctrl-C stops it, holds it until it is slow and switches its
    torque off; it then sinks. What is saved stays saved.

    Example: nas record ergojr --port virtual --episodes 3 --lockstep --name try
    """

    FASTEST: ClassVar[float] = 200.0  # [Hz] beyond what six servos answer in time at 1 Mbit/s through a USB adapter

    port: str
    """Serial port of the adapter; 'virtual' for a simulated arm."""
    rate: float = 100.0
    """Control rate [Hz]."""
    speed: float = 1.745
    """Speed limit in the servos [rad/s], 100°/s as in the paper's recordings; 0 for none."""
    torque: float = 1.0
    """Torque limit in the servos, a share of the largest."""
    p_gain: int = 32
    """Proportional gain in the servos' units; 32 is what the simulated arm has."""
    i_gain: int = 0
    """Integral gain; Poppy's software sets 4."""
    d_gain: int = 0
    """Derivative gain."""
    largest_step: float = 3.2
    """By how much a command may differ from the one before it [rad]; the speed limit keeps big ones slow."""
    calibration: Path | None = None
    """Calibration file; where LeRobot keeps that of --id where not given."""
    id: str = NAME
    """Name of this very arm: LeRobot's robot id."""

    @property
    def kind(self) -> str:
        """See `RecordArm`."""
        return NAME

    @property
    def virtual(self) -> bool:
        """See `RecordArm`."""
        return self.port == VIRTUAL

    @property
    def step(self) -> float:
        """See `RecordArm`."""
        if not self.largest_step > 0:
            raise OptionError(f"--largest-step is {self.largest_step}; it must be above zero.")
        return self.largest_step

    def arm_model(self) -> "Robot":
        """See `RecordArm`."""
        from nas_data.robots.base import find_robot

        return find_robot(NAME)

    @contextmanager
    def driver(self) -> "Iterator[Driver]":
        """See `RecordArm`."""
        from nas_data.hardware.virtual_bus.process import port_of
        from nas_data.hardware.xl320.arm import Xl320

        configuration = self._configuration()
        with port_of(self.port, self.effect, self.fault, self.lockstep) as port:
            yield Xl320(port=port, joints=self._joints(), configuration=configuration)

    def simulated(self) -> str:
        """See `RecordArm`."""
        return "virtual XL-320 servos"

    def _configuration(self) -> "Configuration":
        from nas_data.hardware.xl320.arm import Configuration

        return Configuration(
            p_gain=self.p_gain, i_gain=self.i_gain, d_gain=self.d_gain, speed=self.speed, torque=self.torque
        )

    def _joints(self) -> "Joints":
        from nas_data.hardware.xl320.joints import find_joints, make_ergojr_joints

        if self.virtual and not self.calibration:
            return make_ergojr_joints()
        return find_joints(make_ergojr_joints(), NAME, self.id, self.calibration)
