"""Result of a policy's training and evaluation, as `result.json` holds it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from nas_data.atomic_file import write_atomic
from nas_data.typed_json import as_object, from_json

RESULT = "result.json"


@dataclass(frozen=True)
class PolicyScore:
    """Score over the episodes of an evaluation."""

    mean_return: float = field(metadata={"key": "return"})
    return_median: float  # median return
    success_rate: float  # share of episodes that reached the goal
    mean_length: float  # mean number of control steps
    diverged: int  # number of episodes that ended because the simulation diverged
    episodes: int  # number of episodes


@dataclass(frozen=True)
class EvaluationTime:
    """Wall time and processor time of an evaluation [s]."""

    wall_seconds: float
    cpu_seconds: float


@dataclass(frozen=True)
class DivergedEpisodes:
    """Number of diverged episodes in the training and in the evaluation."""

    learning: int
    judging: int


@dataclass(frozen=True)
class PolicyResult:
    """Result of one method with one seed."""

    question: Mapping[str, object]  # what the result depends on; see `Run.question`
    circumstances: Mapping[str, object]  # versions, commit and files behind it
    score: PolicyScore  # score on the target
    returns: tuple[float, ...]  # return of each episode
    wall_seconds: float  # wall time of the training [s]
    cpu_seconds: float  # processor time of the training [s]
    judging: EvaluationTime  # time of the evaluation
    diverged: DivergedEpisodes  # diverged episodes

    def write(self, folder: Path) -> None:
        """Write the result into the folder of the policy."""
        write_atomic(folder / RESULT, (json.dumps(as_object(self), indent=1) + "\n").encode())


def read_result(folder: Path) -> PolicyResult | None:
    """Return the result in the folder of a policy; None if there is no valid one."""
    try:
        return from_json(PolicyResult, json.loads((folder / RESULT).read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return None
