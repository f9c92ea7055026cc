"""Recordings of a target, paired with a source, as versions of a dataset."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.dataset import versions
from nas_data.dataset.content import hash_content
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.effects.base import Effect
from nas_data.envs.base import SOURCE, find_task
from nas_data.pairing import pair
from nas_data.recorders.recipe import Recipe
from nas_data.robots.base import Robot
from nas_data.simulators.engines import load_simulator
from nas_data.sources import collect_source_files


@dataclass(frozen=True)
class PairedRecording:
    """A paired dataset."""

    path: str  # its folder, relative to that of the work
    content_hash: str
    episodes: int  # number of episodes
    frames: int  # number of transitions

    def describe(self) -> dict[str, object]:
        """Return the recording for JSON."""
        return vars(self)


@dataclass(frozen=True)
class Predictor:
    """Source of a pairing."""

    robot: Robot  # model
    effects: Sequence[Effect] = ()  # additional effects

    @classmethod
    def of(cls, environment: str, dynamics: str = SOURCE) -> "Predictor":
        """Return an environment's robot under one of its dynamics."""
        return cls(*find_task(environment).body(dynamics))


def record_and_pair(recipe: Recipe, source: Predictor, name: str, home: Path, folder: str) -> PairedRecording:
    """Record a target, and pair the recording with a source as its next version.

    Args:
        recipe: Recording recipe.
        source: Source of the pairing.
        name: Name of the dataset.
        home: Folder of the work.
        folder: Folder of its datasets, relative to `home`.
    """
    recorded, provenance = recipe.record()
    root = versions.write_version(recorded, name, provenance, home / folder)
    return pair_again(root, source, name, home, folder)


def pair_again(root: Path, source: Predictor, name: str, home: Path, folder: str) -> PairedRecording:
    """Pair a recording with a source, as the next version of a name; see `record_and_pair`."""
    recorded = read(root)
    simulator = load_simulator(source.robot, 1 / recorded.fps, recorded.joints, source.effects)
    paired = pair(recorded, simulator)
    provenance = replace(
        read_provenance(root) or Provenance(how="paired"),
        how="paired",
        source=simulator.describe(),
        parents=(versions.make_parent(root, recorded),),
    )
    kept = {f"meta/{file}": content for file, content in collect_source_files(source.robot, source.effects).items()}
    path = versions.write_version(paired, name, provenance, home / folder, kept)
    return PairedRecording(str(path.relative_to(home)), hash_content(paired), paired.n_episodes, paired.n_frames)
