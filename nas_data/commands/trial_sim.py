"""Try the names on a simulated arm: known effects, one at a time, each named blind against a baseline."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data.commands._trial import TryNames

if TYPE_CHECKING:
    from nas_data.studies.trial.recorder import ArmRecorder


@dataclass(frozen=True, kw_only=True)
class TrialSim(TryNames):
    """Record a simulated arm as it is, then with known changes; name each with `nas gap`, and count the right names.

    The same command resumes an interrupted trial.

    Example: nas trial sim --robot ergojr --effect backlash:joint=m3,half_width=0.02 --out runs/trial_sim
    """

    robot: str = "ergojr"
    """A robot's name, or any MJCF file with position servos."""
    model: str | None = None
    """Model that the baseline is compared with: an MJCF file, or a robot's name; the robot's own by default."""
    rate: float | None = 50.0
    """Control rate [Hz]."""
    noise: float = 0.0
    """Standard deviation of the measured positions [rad]."""
    mass: float | None = None
    """Mass that is hung on the last link [kg], 0 for none; that of the last link by default."""
    out: Path = Path("runs/trial_sim")
    """Folder of recordings, gap reports and page."""

    @property
    def baseline_model(self) -> str:
        """Model that the baseline is compared with."""
        return self.model or self.robot

    def recorder(self) -> "ArmRecorder":
        """Return the simulated arm."""
        from nas_data.studies.trial.simulated import SimulatedArm

        return SimulatedArm(
            robot=self.robot,
            effects=self.effect,
            excitation=self.excitation,
            episodes=self.episodes,
            seconds=self.seconds,
            rate=self.rate,
            noise=self.noise,
            seed=self.seed,
            hung=self.mass,
        )
