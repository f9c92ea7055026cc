"""Which code decides a trial: results of other code are not those of the present one."""

from nas_data.runs.code_hash import code_hash
from nas_data.runs.gap_code import effect_modules
from nas_data.sources import SourceModel
from nas_data.studies.ablation.kinds.base import FOLDER, find_kind


def trial_code(kind: str, source: SourceModel | None) -> str:
    """Return the hash of what draws the subset, learns from it and judges.

    Args:
        kind: What learns.
        source: Plain source; None where there is none.
    """
    effects = effect_modules() if find_kind(kind).names else ()  # what may be named, and what a source has
    moves = () if source is None else source.modules()
    return code_hash("nas_data.studies.ablation.trial", f"nas_data.{FOLDER}.{kind}", *moves, *effects)
