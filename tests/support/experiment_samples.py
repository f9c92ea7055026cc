"""Experiments so small that one takes seconds."""

from dataclasses import replace
from pathlib import Path

from nas_data.models.presets import preset
from nas_data.studies.experiments.base import Request
from nas_data.studies.experiments.pipeline.sizes import QUICK, Sizes

NETWORK = preset("fast", hidden=8, layers=1, updates=4, horizon=20, frames=200)
TINY = replace(
    QUICK,
    name="tiny",
    heldout=4,
    delta=NETWORK,
    forward=NETWORK,
    presets={"few": NETWORK, "symmetric": preset("symmetric", hidden=8, updates=4, frames=200)},
    frames=256,
    seeds=(0, 1),
    judged=2,
    counts=(2, 4),
    trajectories=8,
    named=4,
    rollout=256,
    minibatches=2,
    epochs=1,
)


def tiny(folder: Path, *environments: str, said: list[str] | None = None, **changes) -> Request:
    """Return a request for a tiny experiment; sizes may be changed by name."""
    sizes = {name: changes.pop(name) for name in list(changes) if name in Sizes.__dataclass_fields__}
    report = (lambda _: None) if said is None else said.append
    dynamics = changes.pop("dynamics", "backlash")
    sized = TINY.with_counts(sizes.pop("counts")) if "counts" in sizes else TINY
    return Request(environments, dynamics, replace(sized, **sizes), folder, report, full_sizes=TINY, **changes)


def times(folder: Path) -> dict[Path, int]:
    """When each file was last written."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
