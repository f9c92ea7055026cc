"""Record of a finished case, as its JSON file holds it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from nas_data.benchmarks.blind.case import Identity
from nas_data.benchmarks.blind.findings import Name
from nas_data.benchmarks.blind.fresh import FreshErrors, ModelErrors
from nas_data.benchmarks.blind.grade import CaseGrade, NamesGrade
from nas_data.dataset.staging import write_synced
from nas_data.errors import OutputExists
from nas_data.typed_json import FormError, as_object, from_json, make_finite

FAILED = "failed"  # verdict of a workflow that raised an error
INLINE = {"inline": True}


@dataclass(frozen=True)
class CaseFailure:
    """Error that a workflow or a baseline raised.

    Attributes:
        fault: The error as a sentence.
    """

    fault: str
    verdict: str = FAILED
    exact: bool = False


@dataclass(frozen=True)
class GradedCase:
    """What the workflow under test found.

    Attributes:
        grade: Grade of its report.
        seconds: Its wall time [s].
        fresh: Errors of its model on the fresh episodes.
    """

    grade: CaseGrade = field(metadata=INLINE)
    seconds: float
    fresh: ModelErrors


@dataclass(frozen=True)
class GradedAnswer:
    """What a baseline found.

    Attributes:
        grade: Grade of the effects that it named.
        true: Hidden effects of the catalogue.
        named: Named effects.
        seconds: Its wall time [s].
        fresh: Errors of its prediction of the fresh episodes.
    """

    grade: NamesGrade = field(metadata=INLINE)
    true: tuple[Name, ...]
    named: tuple[Name, ...]
    seconds: float
    fresh: FreshErrors


@dataclass(frozen=True)
class BaselineRecord:
    """A baseline on a case.

    Attributes:
        outcome: What it found, or its error.
        code: Hash of the code that answered.
    """

    outcome: CaseFailure | GradedAnswer = field(metadata=INLINE)
    code: str | None = None


@dataclass(frozen=True, kw_only=True)
class CaseRecord:
    """A finished case.

    Attributes:
        case: Its name.
        identity: What names it.
        arm: Name of the arm.
        excitation: Name of the command signal.
        code: Hash of the code that decided it; None if the file names none.
        commit: Commit of this package; None if unknown.
        drawing_seconds: Wall time of its drawing [s].
        outcome: What the workflow found, or its error.
        baselines: Baselines by name.
    """

    case: str
    identity: Identity = field(metadata=INLINE)
    arm: str
    excitation: str
    code: str | None = None
    commit: str | None = None
    drawing_seconds: float
    outcome: CaseFailure | GradedCase = field(metadata=INLINE)
    baselines: Mapping[str, BaselineRecord] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> "CaseRecord | None":
        """Read a finished case; None if there is none, or its file is damaged.

        Raises:
            OutputExists: the file holds something else.
        """
        try:
            return from_json(cls, json.loads(path.read_text(encoding="utf-8")))
        except FormError as error:
            raise OutputExists(f"{path} is no finished case ({error}); choose another --out.") from None
        except (OSError, ValueError):
            return None

    def store(self, path: Path) -> "CaseRecord":
        """Write the case, whole or not at all on the disk, and return it as it reads back."""
        content = make_finite(as_object(self))
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_suffix(".unfinished")
        write_synced(unfinished, json.dumps(content, indent=1, allow_nan=False).encode())
        unfinished.replace(path)
        return from_json(CaseRecord, content)
