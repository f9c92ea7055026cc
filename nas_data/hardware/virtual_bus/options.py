"""What a virtual arm is started with."""

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
    """Choices that outlive the way to another process.

    Attributes:
        effects: What the arm has and its model lacks, as a person types it.
        faults: What goes wrong, as a person types it.
        offsets: Ticks by which an ErgoJr's horns were mounted off the middle; none where empty.
        model: Model of another arm than the ErgoJr, a robot's name or a file.
        mounted: The servos of such an arm.
        lying: How a hand left it [rad], shape (n,).
        seed: Of what the faults hit.
        honest: Whether the line takes its time; answers at once otherwise.
        lockstep: Whether the arm moves a period with every goal instead of by the clock.
        period: Between two goals in lock-step [s]; at the paper's 100 Hz where not given.
    """

    effects: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    offsets: tuple[int, ...] = ()
    model: str = ""
    mounted: tuple[MountedServo, ...] = ()
    lying: tuple[float, ...] = ()
    seed: int = 0
    honest: bool = True
    lockstep: bool = False
    period: float = 0.01

    def check(self) -> None:
        """Refuse what cannot be understood or cannot happen, before a process is started for it.

        The faults strike another arm in their order: what goes wrong in the process reaches nobody as a sentence.

        Raises:
            NasError: an effect or a fault is unknown, malformed, or of a joint or servo that the arm does not have.
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
                fault.strike(arm)

    def to_json(self) -> str:
        """Return the choices as one line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, line: str) -> "Options":
        """Read what `to_json` wrote."""
        values = json.loads(line)
        mounted = tuple(MountedServo(**one) for one in values.pop("mounted"))
        kinds: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in values.items()
        }
        return cls(mounted=mounted, **kinds)

    def open(self) -> Terminal:
        """Assemble the arm and open its port."""
        arm = self._arm([parse_effect(text) for text in self.effects])
        goal = arm.kind.registers["goal_position"].address
        clock = LockStep(arm.kind.protocol, goal, self.period) if self.lockstep else RealClock()
        faults = [parse_fault(text) for text in self.faults]
        device = Device(arm, clock, faults, np.random.default_rng(self.seed), self.honest)
        return Terminal(device)

    def _arm(self, effects: Sequence[Effect]) -> VirtualArm:
        if self.mounted:
            return VirtualArm.of(effects, self.model, self.mounted, self.lying)
        return VirtualArm.ergojr(effects, self.offsets)
