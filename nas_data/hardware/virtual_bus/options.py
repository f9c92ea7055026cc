"""Options of a virtual arm."""

import contextlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from nas_data.effects.base import Effect
from nas_data.effects.base import parse as parse_effect
from nas_data.errors import OptionError
from nas_data.hardware.virtual_bus.arm import MountedServo, VirtualArm
from nas_data.hardware.virtual_bus.clock import LockStep, RealClock
from nas_data.hardware.virtual_bus.device import Device
from nas_data.hardware.virtual_bus.faults.base import LineGone
from nas_data.hardware.virtual_bus.faults.base import parse as parse_fault
from nas_data.hardware.virtual_bus.terminal import Terminal


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a virtual arm, which can be sent to another process as JSON."""

    effects: tuple[str, ...] = ()  # effects of the arm that its model lacks, in command-line syntax
    faults: tuple[str, ...] = ()  # faults in command-line syntax
    offsets: tuple[int, ...] = ()  # mounting offsets of an ErgoJr's horns [ticks]; zero if empty
    model: str = ""  # name or model file of an arm other than the ErgoJr
    mounted: tuple[MountedServo, ...] = ()  # servos of such an arm
    lying: tuple[float, ...] = ()  # its initial pose [rad], shape (n,)
    seed: int = 0  # seed of random faults
    wire_delay: bool = True  # whether replies are delayed by the transmission time of bytes
    lockstep: bool = False  # whether each goal advances the arm by a period, instead of the clock
    period: float = 0.01  # period in lock-step [s]; by default that of the paper's 100 Hz

    def check(self) -> None:
        """Check the options before a process is started, because errors in that process are not reported well.

        For the check, the faults are applied in order to another arm.

        Raises:
            NasError: an effect or a fault is unknown, malformed, or names a joint or servo that the arm does not have.
        """
        effects = [parse_effect(text) for text in self.effects]
        faults = sorted((parse_fault(text) for text in self.faults), key=lambda fault: fault.after)
        if len(self.offsets) not in (0, 6):
            raise OptionError(f"{len(self.offsets)} offsets are given; one for each of the six servos is needed.")
        if not effects and not faults and not self.mounted:
            return
        arm = self._arm(effects)
        for fault in faults:
            with contextlib.suppress(LineGone):
                fault.apply(arm)

    def to_json(self) -> str:
        """Return the options as one line of JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, line: str) -> "Options":
        """Read the output of `to_json`."""
        values = json.loads(line)
        mounted = tuple(MountedServo(**one) for one in values.pop("mounted"))
        kinds: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in values.items()
        }
        return cls(mounted=mounted, **kinds)

    def open(self) -> Terminal:
        """Create the arm and open its port."""
        arm = self._arm([parse_effect(text) for text in self.effects])
        goal = arm.kind.registers["goal_position"].address
        clock = LockStep(arm.kind.protocol, goal, self.period) if self.lockstep else RealClock()
        faults = [parse_fault(text) for text in self.faults]
        device = Device(arm, clock, faults, np.random.default_rng(self.seed), self.wire_delay)
        return Terminal(device)

    def _arm(self, effects: Sequence[Effect]) -> VirtualArm:
        if self.mounted:
            return VirtualArm.of(effects, self.model, self.mounted, self.lying)
        return VirtualArm.ergojr(effects, self.offsets)
