"""The control table of the XL-320: where each register lies, what it may hold and what it holds at first.

Source: ROBOTIS e-manual, XL-320, control table.
"""

from dataclasses import dataclass

MODEL_NUMBER = 350
SIZE = 53  # bytes, the last register included
RAM = 24  # first address that a loss of power forgets; what lies below is locked while the torque is on
FEEDBACK = 37  # address of position, speed and load, which lie side by side
FEEDBACK_SIZE = 6
HEALTH = 45  # address of voltage and temperature, five bytes before the hardware error
HEALTH_SIZE = 6

OVERLOAD, OVERHEAT, VOLTAGE = 1, 2, 4  # bits of the hardware error and of what shuts the servo down


@dataclass(frozen=True)
class Register:
    """One entry of the control table.

    Attributes:
        name: Its name in this package.
        address: First byte.
        size: Bytes, little endian.
        initial: Value at the factory.
        low: Smallest value that may be written.
        high: Largest value that may be written.
        writable: Whether it may be written at all.
    """

    name: str
    address: int
    size: int
    initial: int
    low: int = 0
    high: int = 255
    writable: bool = True


REGISTERS = {
    register.name: register
    for register in (
        Register("model_number", 0, 2, MODEL_NUMBER, writable=False),
        Register("firmware", 2, 1, 29, writable=False),
        Register("id", 3, 1, 1, 0, 252),
        Register("baud_rate", 4, 1, 3, 0, 3),
        Register("return_delay", 5, 1, 250, 0, 254),
        Register("cw_limit", 6, 2, 0, 0, 1023),
        Register("ccw_limit", 8, 2, 1023, 0, 1023),
        Register("control_mode", 11, 1, 2, 1, 2),
        Register("temperature_limit", 12, 1, 65, 0, 150),
        Register("lowest_voltage", 13, 1, 60, 50, 250),
        Register("highest_voltage", 14, 1, 90, 50, 250),
        Register("max_torque", 15, 2, 1023, 0, 1023),
        Register("status_level", 17, 1, 2, 0, 2),
        Register("shutdown", 18, 1, 3, 0, 7),
        Register("torque_enable", 24, 1, 0, 0, 1),
        Register("led", 25, 1, 0, 0, 7),
        Register("d_gain", 27, 1, 0, 0, 254),
        Register("i_gain", 28, 1, 0, 0, 254),
        Register("p_gain", 29, 1, 32, 0, 254),
        Register("goal_position", 30, 2, 512, 0, 1023),
        Register("moving_speed", 32, 2, 0, 0, 2047),
        Register("torque_limit", 35, 2, 1023, 0, 1023),
        Register("present_position", 37, 2, 512, writable=False),
        Register("present_speed", 39, 2, 0, writable=False),
        Register("present_load", 41, 2, 0, writable=False),
        Register("present_voltage", 45, 1, 74, writable=False),
        Register("present_temperature", 46, 1, 25, writable=False),
        Register("registered", 47, 1, 0, writable=False),
        Register("moving", 49, 1, 0, writable=False),
        Register("hardware_error", 50, 1, 0, writable=False),
        Register("punch", 51, 2, 32, 0, 1023),
    )
}
FLEETING = ("registered", "moving", "hardware_error", "goal_position", "led")  # registers that are no settings
SETTINGS = tuple(r for r in REGISTERS.values() if not r.name.startswith("present") and r.name not in FLEETING)
