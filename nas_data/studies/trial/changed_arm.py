"""An ErgoJr with a known change: other register values, commands that are late, or goals that are shifted."""

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from nas_data.errors import ArmError
from nas_data.hardware.xl320.arm import FULL, Configuration, Xl320, Xl320Arm
from nas_data.hardware.xl320.control_table import encode_speed_limit
from nas_data.log import warn
from nas_data.studies.trial.change import ChangeNotMade, KnownChange, TestedArm


@dataclass(frozen=True, kw_only=True)
class Adjustment:
    """A change as it is made on an ErgoJr.

    Attributes:
        joint: Joint whose registers or goals are changed.
        registers: Changed register values of its servo, by name.
        periods: Control periods by which the commands of all joints are late.
        shift: Angle that is added to its goals [rad].
        mass: Mass that is hung on the last link [kg].
    """

    joint: str = ""
    registers: Mapping[str, int] = field(default_factory=dict)
    periods: int = 0
    shift: float = 0.0
    mass: float = 0.0

    @classmethod
    def of(cls, change: KnownChange, arm: TestedArm, configuration: Configuration) -> "Adjustment":
        """Return how a change is made on an ErgoJr whose baseline has a configuration."""
        expected = change.expect(arm)
        size, joint = float(getattr(expected, change.parameter)), expected.joint or ""
        if change.register:
            return cls(joint=joint, registers={change.register: encode(change, size, joint, arm, configuration)})
        if change.of == "period":
            return cls(periods=round(change.size))
        return cls(mass=size) if change.of == "mass" else cls(joint=joint, shift=size)


def encode(change: KnownChange, size: float, joint: str, arm: TestedArm, configuration: Configuration) -> int:
    """Return the register value for the size [SI] of a change; gain and torque are relative to the baseline's.

    Raises:
        ChangeNotMade: the model has no torque limit, to which the register's is relative.
    """
    before, limit = configuration.registers(), float(arm.limits[arm.joints.index(joint)])
    if change.register == "torque_limit" and not np.isfinite(limit):
        raise ChangeNotMade(f"the baseline's model has no torque limit in {joint}")
    values: Mapping[str, float] = {
        "p_gain": size * before["p_gain"],
        "torque_limit": size / limit * before["torque_limit"],
        "moving_speed": encode_speed_limit(size),
        "punch": change.size * FULL,
    }
    return max(1, round(values[change.register]))


class ChangedArm(Xl320Arm):
    """An ErgoJr with a change, which is undone when the port is closed. Its descriptions do not tell the change."""

    def __init__(self, driver: "ChangedXl320", now: Callable[[], float]) -> None:
        """Open the port; raises like `Xl320Arm`."""
        super().__init__(driver.port, driver.joints, now, driver.configuration)
        change = driver.adjustment
        self._change = change
        self._shift = np.array([change.shift * (name == change.joint) for name in self.names])
        self._servo = self.joints.ids[self.names.index(change.joint)] if change.joint else 0
        self._before: dict[str, int] = {}
        self._waiting: deque[np.ndarray] = deque()

    def configure(self, configuration: Configuration | None = None) -> None:
        """Write the settings of the baseline, then the changed registers; raises like `Xl320Arm.configure`."""
        super().configure(configuration)
        for name, value in self._change.registers.items():
            self._before.setdefault(name, self.bus.get(self._servo, name))
            self.bus.write(self._servo, name, value)

    def torque_on(self) -> None:
        """Switch the torque on; late commands begin with the present positions. Raises like `Xl320Arm.torque_on`."""
        super().torque_on()
        self._waiting = deque([self.read().positions] * self._change.periods)

    def command(self, positions: np.ndarray) -> np.ndarray:
        """Send goals [rad], shape (n,), shifted and late; return those that an arm without the change would get."""
        self._waiting.append(positions)
        super().command(self._waiting.popleft() + self._shift)
        return self.joints.positions(self.joints.ticks(positions))

    def hold(self, position: np.ndarray) -> None:
        """Command positions [rad], shape (n,), at once: a stop must not be late."""
        super().command(position)

    def registers(self) -> dict[str, dict[str, int]]:
        """Return no settings: they would tell the change."""
        return {}

    def restore(self) -> None:
        """Write the register values that the servo had before the change, at most once.

        Raises:
            ArmError: the servo does not confirm them.
        """
        for name in list(self._before):
            self.bus.write(self._servo, name, self._before[name])
            del self._before[name]

    def close(self) -> None:
        """Undo the change and close the port; where the servo does not answer, say what is left."""
        try:
            self.restore()
        except ArmError as error:
            left = ", ".join(f"{name} ({value})" for name, value in self._before.items())
            remedy = "switch the supply off and on, which sets it to the servo's own default"
            warn([f"{left} of {self._change.joint} was not put back, {remedy}. {error}"])
        finally:
            super().close()


@dataclass(frozen=True, kw_only=True)
class ChangedXl320(Xl320):
    """The driver of an ErgoJr with a change."""

    adjustment: Adjustment

    def open(self, now: Callable[[], float] = time.monotonic) -> ChangedArm:
        """Open the port; see `ChangedArm`."""
        return ChangedArm(self, now)
