"""Interface of what a trial records with: an arm that can be recorded as it is, and with a known change."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from nas_data.studies.trial.change import KnownChange, TestedArm


class ArmRecorder(Protocol):
    """Records an arm; equal recorders play equal commands in every recording."""

    @property
    def name(self) -> str:
        """Name of the arm."""

    @property
    def mass(self) -> float:
        """Mass that is hung on the last link [kg]; 0 for none."""

    def describe(self) -> Mapping[str, object]:
        """Return the settings of the recordings for JSON."""

    def record_baseline(self, folder: Path) -> Sequence[str]:
        """Record the arm as it is into a folder; return lines about the recording. Raises NasError."""

    def record_change(self, folder: Path, change: KnownChange, arm: TestedArm) -> Sequence[str]:
        """Record the arm with a change into a folder, whose metadata do not tell the change; return lines about it.

        Raises:
            ChangeNotMade: it cannot be made.
            NasError: the arm cannot be recorded.
        """
