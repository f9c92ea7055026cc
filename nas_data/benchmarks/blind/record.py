"""Record of a finished case, stored as a JSON file."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from nas_data.benchmarks.blind.case import Identity, Name
from nas_data.benchmarks.blind.fresh import FreshErrors, ModelErrors
from nas_data.benchmarks.blind.grade import CaseGrade, NamesGrade
from nas_data.dataset.staging import write_synced
from nas_data.errors import OutputExists
from nas_data.typed_json import FormError, as_object, from_json, make_finite

FAILED = "failed"  # verdict of a workflow that raised an error
INLINE = {"inline": True}


@dataclass(frozen=True)
class CaseFailure:
    """Error that a workflow or a baseline raised."""

    fault: str  # the error as a sentence
    verdict: str = FAILED
    exact: bool = False


@dataclass(frozen=True)
class GradedCase:
    """Result of the workflow under test."""

    grade: CaseGrade = field(metadata=INLINE)  # grade of its report
    seconds: float  # its wall time [s]
    fresh: ModelErrors  # errors of its model on the fresh episodes


@dataclass(frozen=True)
class GradedAnswer:
    """Result of a baseline."""

    grade: NamesGrade = field(metadata=INLINE)  # grade of the effects that it named
    true: tuple[Name, ...]  # hidden effects of the catalogue
    named: tuple[Name, ...]  # named effects
    seconds: float  # its wall time [s]
    fresh: FreshErrors  # errors of its prediction of the fresh episodes


@dataclass(frozen=True)
class BaselineRecord:
    """Record of a baseline on a case."""

    outcome: CaseFailure | GradedAnswer = field(metadata=INLINE)  # its result, or its error
    code: str | None = None  # hash of the code that produced it


@dataclass(frozen=True, kw_only=True)
class CaseRecord:
    """Record of a finished case."""

    case: str  # its name
    identity: Identity = field(metadata=INLINE)  # identity of the case
    arm: str  # name of the arm
    excitation: str  # name of the command signal
    code: str | None = None  # hash of the code that produced it; None if the file has none
    commit: str | None = None  # commit of this package; None if unknown
    drawing_seconds: float  # wall time of its drawing [s]
    outcome: CaseFailure | GradedCase = field(metadata=INLINE)  # result of the workflow, or its error
    baselines: Mapping[str, BaselineRecord] = field(default_factory=dict)  # baselines by name

    @classmethod
    def read(cls, path: Path) -> "CaseRecord | None":
        """Read a finished case; None if there is none, or its file is damaged.

        Raises:
            OutputExists: the file holds something else.
        """
        try:
            return from_json(cls, json.loads(path.read_text(encoding="utf-8")))
        except FormError as error:
            raise OutputExists(f"{path} is not a record of a finished case ({error}); choose another --out.") from None
        except (OSError, ValueError):
            return None

    def store(self, path: Path) -> "CaseRecord":
        """Write the case atomically and return it as read back."""
        content = make_finite(as_object(self))
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_suffix(".unfinished")
        write_synced(unfinished, json.dumps(content, indent=1, allow_nan=False).encode())
        unfinished.replace(path)
        return from_json(CaseRecord, content)
