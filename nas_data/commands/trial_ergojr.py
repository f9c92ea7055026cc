"""Try the names on an ErgoJr, or a virtual one: known changes, one at a time, each named blind against a baseline."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data.commands._trial import TryNames

if TYPE_CHECKING:
    from nas_data.studies.trial.recorder import ArmRecorder


@dataclass(frozen=True, kw_only=True)
class TrialErgojr(TryNames):
    """Record an ErgoJr as it is, then with known changes; name each with `nas gap`, and count the right names.

    Changed are registers of single servos, the time and the zero of commands, and a mass that you are asked to hang on.
    All recordings come first, then the search for names. Every change is undone after its recording, also at Ctrl-C.
    The same command resumes an interrupted trial.

    Example: nas trial ergojr --port virtual --out runs/trial_ergojr
    """

    port: str
    """Serial port of the adapter; 'virtual' for a simulated arm."""
    model: str = "ergojr"
    """Model that the baseline is compared with: an MJCF file, or a robot's name."""
    rate: float = 50.0
    """Control rate [Hz]."""
    speed: float = 0.0
    """Speed limit in the servos of the baseline [rad/s]; 0 for none, as the default commands are slow themselves."""
    torque: float = 1.0
    """Torque limit in the servos of the baseline, as a share of the largest."""
    p_gain: int = 32
    """Proportional gain in the servos of the baseline; 32 corresponds to the simulated arm."""
    mass: float = 0.02
    """Mass that you hang on the last link when asked [kg]; 0 to leave this change out."""
    lockstep: bool = True
    """Whether a virtual arm is simulated as fast as the machine can, or in real time."""
    calibration: Path | None = None
    """Calibration file; LeRobot's file of --id by default."""
    id: str = "ergojr"
    """Name of this arm: LeRobot's robot id."""
    out: Path = Path("runs/trial_ergojr")
    """Folder of recordings, gap reports and page."""

    @property
    def baseline_model(self) -> str:
        """Model that the baseline is compared with."""
        return self.model

    def recorder(self) -> "ArmRecorder":
        """Return the arm."""
        from nas_data.commands._changed_ergojr import RecordedErgojr

        return RecordedErgojr(self)
