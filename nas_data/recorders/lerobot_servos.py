"""Properties of servo families that LeRobot's control tables leave out: signs, units and error registers."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from lerobot.motors import MotorNormMode
from lerobot.motors.motors_bus import SerialMotorsBus

from nas_data.errors import OptionError
from nas_data.hardware.arms.line import Register, StopRegisters


@dataclass(frozen=True)
class Family:
    """A maker's servos.

    Attributes:
        sdk: Package of the SDK.
        protocol: Protocol version, as the SDK counts.
        speed_unit: Unit of the speed register [rad/s].
        load: Name of the load register.
        load_unit: Unit of the load register, as a share of the largest torque.
        load_sign: Sign bit of the load register; −1 for two's complement.
        voltage: Name of the supply voltage register.
        errors: Name of the hardware error register.
    """

    sdk: str
    protocol: float
    speed_unit: float
    load: str
    load_unit: float
    load_sign: int
    voltage: str
    errors: str


FAMILIES = {
    # STS series: counts a second, 0.1 %; source: Feetech's memory table
    "FeetechMotorsBus": Family(
        "scservo_sdk", 0, 2 * np.pi / 4096, "Present_Load", 1e-3, 10, "Present_Voltage", "Status"
    ),
    # X series: 0.229 rev/min, a PWM of 885 is the largest; source: ROBOTIS e-manual
    "DynamixelMotorsBus": Family(
        "dynamixel_sdk",
        2.0,
        0.229 * 2 * np.pi / 60,
        "Present_PWM",
        1 / 885,
        -1,
        "Present_Input_Voltage",
        "Hardware_Error_Status",
    ),
}


def find_family(bus: SerialMotorsBus) -> Family:
    """Return the family of the servos on a bus.

    Raises:
        OptionError: the family is not supported.
    """
    for kind in type(bus).__mro__:
        if kind.__name__ in FAMILIES:
            return FAMILIES[kind.__name__]
    raise OptionError(
        f"{type(bus).__name__} is not a bus of Feetech or Dynamixel servos, the kinds that nas can record."
    )


def list_shared_registers(bus: SerialMotorsBus) -> Mapping[str, tuple[int, int]]:
    """Return address and size of the registers that all motors of a bus share, by LeRobot's names."""
    tables = [bus.model_ctrl_table[motor.model] for motor in bus.motors.values()]
    return {name: entry for name, entry in tables[0].items() if all(table.get(name) == entry for table in tables)}


def find_register(bus: SerialMotorsBus, name: str) -> Register:
    """Return a register with the sign that LeRobot's encoding table gives it."""
    address, size = list_shared_registers(bus)[name]
    family = find_family(bus)
    encoded = bus.model_encoding_table.get(next(iter(bus.motors.values())).model) or {}
    if name == family.load:
        return Register(address, size, family.load_sign)
    if name not in encoded:
        return Register(address, size)
    return Register(address, size, -1 if family.load_sign < 0 else encoded[name])


def find_stop_registers(bus: SerialMotorsBus) -> StopRegisters:
    """Return the registers that are needed to stop an arm."""
    family = find_family(bus)
    return StopRegisters(
        sdk=family.sdk,
        protocol=family.protocol,
        baud=bus.default_baudrate,
        speed_unit=family.speed_unit,
        torque=find_register(bus, "Torque_Enable"),
        goal=find_register(bus, "Goal_Position"),
        position=find_register(bus, "Present_Position"),
        speed=find_register(bus, "Present_Velocity"),
    )


def convert_to_units(bus: SerialMotorsBus, counts: np.ndarray) -> list[float]:
    """Return the goals in LeRobot's units that make it send these counts, shape (n,); LeRobot truncates fractions."""
    wanted = []
    for (name, motor), count in zip(bus.motors.items(), counts.tolist(), strict=True):
        known = bus.calibration[name]
        within = count + (0.5 if count >= 0 else -0.5)
        if motor.norm_mode is MotorNormMode.DEGREES:
            turn = bus.model_resolution_table[motor.model] - 1
            wanted.append((within - (known.range_min + known.range_max) / 2) * 360 / turn)
            continue
        share = (within - known.range_min) / (known.range_max - known.range_min)
        share = 1 - share if bus.apply_drive_mode and known.drive_mode else share
        wanted.append(share * 100 if motor.norm_mode is MotorNormMode.RANGE_0_100 else share * 200 - 100)
    return wanted
