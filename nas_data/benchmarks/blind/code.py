"""Which code decides a case's record: records of other code are refused, so that no table mixes them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from nas_data.benchmarks.blind.case import Identity
from nas_data.benchmarks.blind.plants.base import SUFFIX
from nas_data.benchmarks.blind.record import CaseRecord
from nas_data.benchmarks.blind.sampling import SCREEN
from nas_data.benchmarks.blind.settings.base import find_setting
from nas_data.count_of import count_of
from nas_data.errors import OutputExists
from nas_data.runs.code_hash import hash_code, list_gap_modules


def hash_case_code(identity: Identity) -> str:
    """Return the hash of what draws a case, plays it, names what hides in it and grades the names."""
    played_on = {identity.plant, SCREEN, find_setting(identity.setting).screen}
    plants = (f"nas_data.benchmarks.blind.plants.{plant}{SUFFIX}" for plant in played_on)
    setting = f"nas_data.benchmarks.blind.settings.{identity.setting}"
    return hash_code(*list_gap_modules(), *plants, setting, "nas_data.benchmarks.blind.run_case")


def hash_baseline_code(name: str) -> str:
    """Return the hash of what a baseline answers; what grades it is the case's."""
    return hash_code(f"nas_data.benchmarks.blind.baselines.{name}")


def check_code(records: Mapping[Identity, CaseRecord], folder: Path) -> None:
    """Refuse records of other code, before hours are spent.

    Args:
        records: Finished cases.
        folder: Where they lie.

    Raises:
        OutputExists: some were judged by other code, or by code that they do not name.
    """
    other = [record for identity, record in records.items() if not is_by_this_code(identity, record)]
    if other:
        raise OutputExists(
            f"{folder} holds {count_of(len(other), 'case')} judged by other code of nas_data "
            f"({tell_commits(other)}): the search, the cases or the grading were changed since; "
            f"remove {folder} or choose another --out."
        )


def is_by_this_code(identity: Identity, record: CaseRecord) -> bool:
    """Whether a case and all baselines on it were judged by the present code."""
    same = all(answer.code == hash_baseline_code(name) for name, answer in record.baselines.items())
    return same and record.code == hash_case_code(identity)


def tell_commits(records: Sequence[CaseRecord]) -> str:
    """Name the commits of records."""
    commits = sorted({record.commit[:12] for record in records if record.commit})
    return f"commit {', '.join(commits)}" if commits else "they name no commit"
