"""Settings of the servos."""

from dataclasses import asdict, dataclass

from nas_data.errors import OptionError
from nas_data.hardware.xl320.bus import Bus
from nas_data.hardware.xl320.control_table import encode_speed_limit

FULL = 1023


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """Settings that are written to every servo."""

    p_gain: int = 32  # proportional gain in the register's units; 32 at the factory
    i_gain: int = 0  # integral gain
    d_gain: int = 0  # derivative gain
    speed: float = 1.745  # speed limit [rad/s]; 0 for none. The paper's recordings had 100°/s.
    torque: float = 1.0  # torque limit as a share of the largest torque; Poppy's software uses 0.7

    def __post_init__(self) -> None:
        for name in ("p_gain", "i_gain", "d_gain"):
            if not 0 <= getattr(self, name) <= 254:
                raise OptionError(f"{name} is {getattr(self, name)}; it must lie in 0 … 254.")
        if not 0 <= self.speed < 12:
            raise OptionError(f"The speed limit is {self.speed} rad/s; it must lie in 0 (none) … 11.9.")
        if not 0 < self.torque <= 1:
            raise OptionError(f"The torque limit is {self.torque}; it must be a share above 0 and up to 1.")

    def write(self, bus: Bus, identity: int, limits: tuple[int, int]) -> None:
        """Write the settings and limits (lowest and highest goal [ticks]) of one servo; its torque is off afterwards.

        Raises:
            ArmError: the servo refuses a setting.
        """
        bus.write(identity, "torque_enable", 0)  # first: persistent registers are locked while the torque is on
        persistent = {"return_delay": 0, "status_level": 2, "control_mode": 2}
        for name, value in (persistent | {"cw_limit": limits[0], "ccw_limit": limits[1]}).items():
            if bus.get(identity, name) != value:  # the persistent memory wears out with every write
                bus.write(identity, name, value)
        for name, value in self.registers().items():
            bus.write(identity, name, value)

    def registers(self) -> dict[str, int]:
        """Return the values of the volatile registers."""
        return {
            "p_gain": self.p_gain,
            "i_gain": self.i_gain,
            "d_gain": self.d_gain,
            "moving_speed": encode_speed_limit(self.speed) if self.speed else 0,
            "torque_limit": round(self.torque * FULL),
        }

    def to_json(self) -> dict[str, object]:
        """Return the settings for provenance."""
        return {**asdict(self), "registers": self.registers(), "return_delay": 0}
