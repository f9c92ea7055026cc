"""Recordings of an ErgoJr for a trial, through the command that records it: as it is, or with a known change."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data.commands._record_arm import VIRTUAL
from nas_data.commands.record_ergojr import RecordErgojr
from nas_data.commands.trial_ergojr import TrialErgojr
from nas_data.hardware.xl320.arm import Xl320
from nas_data.runs.progress import say
from nas_data.studies.trial.change import ChangeNotMade, KnownChange, TestedArm
from nas_data.studies.trial.changed_arm import Adjustment, ChangedXl320

if TYPE_CHECKING:
    from nas_data.hardware.arms.base import Driver

UNIMPORTANT = ("json", "out", "model", "port", "lockstep")  # options that do not change a recording


@dataclass(frozen=True, kw_only=True)
class RecordChangedErgojr(RecordErgojr):
    """Records an ErgoJr with a change."""

    adjustment: Adjustment

    @contextmanager
    def driver(self) -> "Iterator[Driver]":
        """Yield the driver of the arm with the change."""
        with super().driver() as plain:
            assert isinstance(plain, Xl320)
            yield ChangedXl320(
                port=plain.port, joints=plain.joints, configuration=plain.configuration, adjustment=self.adjustment
            )


@dataclass(frozen=True)
class RecordedErgojr:
    """Records an ErgoJr for a trial; implements `ArmRecorder`."""

    options: TrialErgojr  # the command with its options

    @property
    def name(self) -> str:
        """Name of the arm."""
        return "a virtual ErgoJr" if self.options.port == VIRTUAL else self.options.id

    @property
    def mass(self) -> float:
        """Mass that is hung on the last link [kg]; 0 for none."""
        return self.options.mass

    def describe(self) -> Mapping[str, object]:
        """Return the settings of the recordings for JSON."""
        own = {key: value for key, value in vars(self.options).items() if key not in UNIMPORTANT}
        return {**own, "effect": list(self.options.effect), "calibration": str(self.options.calibration or "")}

    def record_baseline(self, folder: Path) -> Sequence[str]:
        """Record the arm as it is."""
        return self._record(folder, Adjustment())

    def record_change(self, folder: Path, change: KnownChange, arm: TestedArm) -> Sequence[str]:
        """Record the arm with a change; see `ArmRecorder.record_change`."""
        command = self._command(folder, Adjustment())
        adjustment = Adjustment.of(change, arm, command.configuration)
        if command.virtual and "punch" in adjustment.registers:
            raise ChangeNotMade("virtual servos do not simulate their punch")
        if adjustment.mass and command.virtual:
            return self._record(folder, adjustment, (f"payload:mass={adjustment.mass}",))
        if adjustment.mass:
            ask(f"Hang {1000 * adjustment.mass:g} g on the last link.", f"{change.name} was left out.")
        try:
            return self._record(folder, adjustment)
        finally:
            if adjustment.mass:
                ask("Take the mass off.", "")

    def _record(self, folder: Path, adjustment: Adjustment, effects: tuple[str, ...] = ()) -> Sequence[str]:
        return self._command(folder, adjustment, effects).run().text.splitlines()

    def _command(self, folder: Path, adjustment: Adjustment, effects: tuple[str, ...] = ()) -> RecordChangedErgojr:
        options = self.options
        return RecordChangedErgojr(
            port=options.port,
            rate=options.rate,
            speed=options.speed,
            torque=options.torque,
            p_gain=options.p_gain,
            calibration=options.calibration,
            id=options.id,
            episodes=options.episodes,
            seconds=options.seconds,
            excitation=options.excitation,
            seed=options.seed,
            effect=(*options.effect, *effects),
            lockstep=options.lockstep and options.port == VIRTUAL,
            blind=True,
            out=folder,
            adjustment=adjustment,
        )


def ask(what: str, left_out: str) -> None:
    """Ask a person to do something with the arm, whose torque is off, and wait.

    Raises:
        ChangeNotMade: the person answers `skip`, or there is no terminal; only if `left_out` says what that means.
    """
    if left_out and not sys.stdin.isatty():
        raise ChangeNotMade(f"{left_out} It needs a person at a terminal.")
    say(f"{what} Then press Enter{', or type skip' if left_out else ''}.")
    if sys.stdin.isatty() and sys.stdin.readline().strip().lower() == "skip" and left_out:
        raise ChangeNotMade(f"{left_out} It was skipped.")
