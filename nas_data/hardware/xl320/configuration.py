"""How the servos are set up before they move, and which of it outlives the power."""

from dataclasses import asdict, dataclass

from nas_data.errors import OptionError
from nas_data.hardware.xl320.bus import Bus
from nas_data.hardware.xl320.units import speed_units

FULL = 1023


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """Registers that every servo gets.

    Attributes:
        p_gain: Proportional gain in the register's units; 32 at the factory.
        i_gain: Integral gain.
        d_gain: Derivative gain.
        speed: Speed limit [rad/s]; 0 for none. The paper's recordings had 100°/s.
        torque: Torque limit as a share of the largest; Poppy's software uses 0.7.
    """

    p_gain: int = 32
    i_gain: int = 0
    d_gain: int = 0
    speed: float = 1.745
    torque: float = 1.0

    def __post_init__(self) -> None:
        for name in ("p_gain", "i_gain", "d_gain"):
            if not 0 <= getattr(self, name) <= 254:
                raise OptionError(f"{name} is {getattr(self, name)}; it must lie in 0 … 254.")
        if not 0 <= self.speed < 12:
            raise OptionError(f"The speed limit is {self.speed} rad/s; it must lie in 0 (none) … 11.9.")
        if not 0 < self.torque <= 1:
            raise OptionError(f"The torque limit is {self.torque}; it must be a share above 0 and up to 1.")

    def write(self, bus: Bus, identity: int, limits: tuple[int, int]) -> None:
        """Set one servo up; its torque is off afterwards.

        Args:
            bus: The line.
            identity: Whom to set up.
            limits: Lowest and highest goal [ticks].

        Raises:
            ArmError: the servo does not take it.
        """
        bus.write(identity, "torque_enable", 0)  # first: what outlives the power is locked while the torque is on
        lasting = {"return_delay": 0, "status_level": 2, "control_mode": 2}
        for name, value in (lasting | {"cw_limit": limits[0], "ccw_limit": limits[1]}).items():
            if bus.get(identity, name) != value:  # the memory wears out with every write
                bus.write(identity, name, value)
        for name, value in self.registers().items():
            bus.write(identity, name, value)

    def registers(self) -> dict[str, int]:
        """Return the registers that a loss of power forgets."""
        return {
            "p_gain": self.p_gain,
            "i_gain": self.i_gain,
            "d_gain": self.d_gain,
            "moving_speed": speed_units(self.speed) if self.speed else 0,
            "torque_limit": round(self.torque * FULL),
        }

    def to_json(self) -> dict[str, object]:
        """Return what provenance records."""
        return {**asdict(self), "registers": self.registers(), "return_delay": 0}
