"""Recordings of an ErgoJr for a trial, through the command that records it: as it is, or with a known change."""

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data.commands.record_ergojr import RecordErgojr
from nas_data.commands.trial_ergojr import TrialErgojr
from nas_data.hardware.xl320.arm import Xl320
from nas_data.runs.progress import say
from nas_data.studies.trial.change import KnownChange, TestedArm
from nas_data.studies.trial.changed_arm import Adjustment, ChangedXl320
from nas_data.studies.trial.recorder import ChangeNotMade

if TYPE_CHECKING:
    from nas_data.hardware.arms.base import Driver


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
        return f"{self.options.id} on port {self.options.port}"

    @property
    def mass(self) -> float:
        """Mass that is hung on the last link [kg]; 0 for none."""
        return self.options.mass

    def describe(self) -> Mapping[str, object]:
        """Return the settings of the recordings for JSON."""
        own = {key: value for key, value in vars(self.options).items() if key not in ("json", "out", "model")}
        return {**own, "effect": list(self.options.effect), "calibration": str(self.options.calibration or "")}

    def record_baseline(self, folder: Path) -> None:
        """Record the arm as it is."""
        self._record(folder, Adjustment())

    def record_change(self, folder: Path, change: KnownChange, arm: TestedArm) -> None:
        """Record the arm with a change; see `ArmRecorder.record_change`."""
        command = self._command(folder, Adjustment())
        adjustment = Adjustment.of(change, arm, command.configuration)
        if not adjustment.mass:
            self._record(folder, adjustment)
        elif command.virtual:
            self._record(folder, adjustment, (f"payload:mass={adjustment.mass}",))
        else:
            ask(f"Hang {1000 * adjustment.mass:g} g on the last link.", f"{change.name} was left out.")
            self._record(folder, adjustment)
            ask("Take the mass off.", "")

    def _record(self, folder: Path, adjustment: Adjustment, effects: tuple[str, ...] = ()) -> None:
        self._command(folder, adjustment, effects).run()

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
            lockstep=options.lockstep and options.port == "virtual",
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
