"""Contents of a regular reading of LeRobot's servos: the registers that are read in each servo, and their meaning."""

from collections.abc import Sequence

import numpy as np
from lerobot.motors.motors_bus import SerialMotorsBus

from nas_data.hardware.arms.base import Reading
from nas_data.hardware.arms.line import Register
from nas_data.recorders.lerobot_frame import Frame
from nas_data.recorders.lerobot_servos import find_family, find_register, find_stop_registers


class ReadingFormat:
    """The registers of a regular reading, which lie in one range of addresses.

    Attributes:
        start: Address of the first byte.
        size: Number of bytes.
    """

    def __init__(self, bus: SerialMotorsBus, frame: Frame) -> None:
        """Look up the registers.

        Args:
            bus: LeRobot's motor bus.
            frame: Conversion between servo counts and joint positions.
        """
        self._frame, self._ids = frame, tuple(motor.id for motor in bus.motors.values())
        self._registers, self._family = find_stop_registers(bus), find_family(bus)
        self._load, self._errors = (find_register(bus, name) for name in (self._family.load, self._family.errors))
        turns = np.array([bus.model_resolution_table[motor.model] for motor in bus.motors.values()])
        self._travel = frame.ticks * turns / (2 * np.pi)  # joint travel per radian of the servo [rad/rad; m/rad]
        wanted = [self._registers.goal, self._registers.position, self._registers.speed, self._load]
        if self._errors.address > self._registers.position.address:  # else they would make every reading longer
            wanted.append(self._errors)
        self.start = min(register.address for register in wanted)
        self.size = max(register.address + register.size for register in wanted) - self.start

    def decode(self, answers: Sequence[bytes], time: float) -> Reading:
        """Decode the replies of all servos.

        Args:
            answers: Reply of each servo, `size` bytes from `start` on.
            time: Time of the reading [s].
        """

        def decode_all(register: Register) -> np.ndarray:
            return np.array([register.decode(answer, self.start) for answer in answers], float)

        registers, errors = self._registers, self._errors
        replies = answers if self.start <= errors.address < self.start + self.size else []
        state = registers.position.address - self.start  # the goal, which comes first, does not measure the state
        return Reading(
            time=time,
            positions=self._frame.positions(decode_all(registers.position)),
            velocities=decode_all(registers.speed) * registers.speed_unit * self._travel,
            loads=decode_all(self._load) * self._family.load_unit * np.sign(self._frame.ticks),
            raw=b"".join(answer[state:] for answer in answers),
            alerts=tuple(i for i, data in zip(self._ids, replies, strict=False) if errors.decode(data, self.start)),
            goals=self._frame.positions(decode_all(registers.goal)),
        )
