"""Base of the commands that try the names on an arm: known changes, each named blind."""

from abc import abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.runs.progress import say

if TYPE_CHECKING:
    from nas_data.studies.trial.recorder import ArmRecorder


@dataclass(frozen=True, kw_only=True)
class TryNames(Command):
    """Base of the commands that try the names on an arm."""

    episodes: int = 8
    """Number of episodes of each recording."""
    seconds: float = 6.0
    """Length of an episode [s]."""
    excitation: str = "sine:slowest=0.2,fastest=0.6,share=0.5"
    """Command signal of every recording, NAME or NAME:PARAMETER=NUMBER,…; the default begins at rest and stays below
    3 rad/s."""
    seed: int = 0
    """Seed of the commands."""
    effect: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """An effect that a simulated arm has from the start, NAME:joint=JOINT,PARAMETER=NUMBER; may be given several
    times."""
    out: Path
    rate: float | None

    @abstractmethod
    def recorder(self) -> "ArmRecorder":
        """Return the arm."""

    @property
    @abstractmethod
    def baseline_model(self) -> str:
        """Model that the baseline is compared with."""

    def run(self) -> CommandResult:
        """Run every stage that is not finished yet."""
        from nas_data.studies.trial.plan import PAGE, RESULT, TrialPlan, run_trial
        from nas_data.typed_json import as_object

        outcome = run_trial(TrialPlan(self.recorder(), self.baseline_model), self.out, say)
        files = {"result": str(self.out / RESULT), "page": str(self.out / PAGE)}
        counts = {
            "changes_made": len(outcome.changes),
            "named": len(outcome.right),
            "right_sizes": len(outcome.right_sizes),
        }
        text = "\n".join([*outcome.lines(), f"page → {files['page']}"])
        return CommandResult(text, {**counts, **as_object(outcome), **files})
