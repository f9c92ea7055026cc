"""Split a dataset into two, by episodes or by a random share, or cut its episodes in time."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.errors import OptionError
from nas_data.runs.progress import begin


@dataclass(frozen=True, kw_only=True)
class Split(Command):
    """Split a dataset into two disjoint ones: train on one, test on the other.

    Example: nas split datasets/so101 --episodes 0-11 --names so101_train so101_test

    Example: nas split datasets/arm --share 0.8 --seed 0

    With --seconds the result is one dataset with more, shorter episodes.

    Example: nas split datasets/arm --seconds 3
    """

    dataset: tyro.conf.Positional[Path]
    """Dataset: a folder, or datasets/NAME for its newest version."""
    episodes: str | None = None
    """Episodes of the first part, such as 0,1,2 or 0-11,14; the others form the second. Give this, --share or
    --seconds."""
    share: float | None = None
    """Share of the episodes, drawn at random, for the first part, such as 0.8; instead of --episodes."""
    seed: int = 0
    """Seed of the draw."""
    seconds: float | None = None
    """Cut every episode into segments of this length [s] instead, such as 3."""
    name: str | None = None
    """Name of the result of --seconds; NAME_cut by default."""
    names: tuple[str, str] | None = None
    """Names of the two parts; NAME_train and NAME_test by default."""

    def run(self) -> CommandResult:
        """Split the dataset and write both parts."""
        from nas_data.dataset.derive_provenance import Original
        from nas_data.dataset.split import draw, parse_episodes, split
        from nas_data.dataset.versions import check_name, find_home, write_version

        if self.seconds is not None and self.episodes is None and self.share is None and self.names is None:
            return self._cut(self.seconds)
        if (self.episodes is None) == (self.share is None) or self.seconds is not None or self.name is not None:
            raise OptionError(
                "Give --episodes 0,1,2 or --share 0.8 (with --names) to divide the dataset, or --seconds 3 (with "
                "--name) to cut its episodes."
            )
        original = Original.read(self.dataset)
        if self.episodes is not None:
            chosen, how = parse_episodes(self.episodes), ""
        else:
            chosen = draw(original.dataset.n_episodes, self.share or 0.0, self.seed)
            how = f"a share of {self.share:g} drawn with seed {self.seed}"
        parts = split(original, chosen, how)
        folder, name = find_home(original.root)
        names = self.names or (f"{name}_train", f"{name}_test")
        if names[0] == names[1]:
            raise OptionError(f"Both parts would be named '{names[0]}'; give two names.")
        for item in names:
            check_name(item)
        begin(f"writing {count_of(original.dataset.n_frames, 'frame')}")
        written = [
            write_version(part.dataset, item, part.provenance, folder, part.attachments)
            for part, item in zip(parts, names, strict=True)
        ]
        notes = list(original.remarks())
        lines = [
            f"{count_of(part.dataset.n_episodes, 'episode')}, {count_of(part.dataset.n_frames, 'frame')} → {path}"
            for part, path in zip(parts, written, strict=True)
        ]
        rest = sorted(set(range(original.dataset.n_episodes)) - set(chosen))
        data = [
            {"dataset": path, "episodes": episodes, "frames": part.dataset.n_frames}
            for part, path, episodes in zip(parts, written, (sorted(chosen), rest), strict=True)
        ]
        return CommandResult(
            "\n".join([*lines, *(f"  note: {note}" for note in notes)]), {"parts": data, "notes": notes}
        )

    def _cut(self, seconds: float) -> CommandResult:
        """Cut the episodes in time and write the result."""
        from nas_data.dataset.cutting import cut_every, find_original_episodes
        from nas_data.dataset.derive_provenance import Original, inherit
        from nas_data.dataset.versions import check_name, find_home, write_version

        original = Original.read(self.dataset)
        folder, name = find_home(original.root)
        target = self.name or f"{name}_cut"
        check_name(target)
        dataset = cut_every(original.dataset, seconds)
        deed = f"episodes of {original.parent.name} cut every {seconds:g} s"
        provenance = inherit([original], deed, find_original_episodes(original.dataset, dataset))
        begin(f"writing {count_of(dataset.n_frames, 'frame')}")
        path = write_version(dataset, target, provenance, folder, original.attachments)
        text = f"{count_of(dataset.n_episodes, 'episode')}, {count_of(dataset.n_frames, 'frame')} → {path}"
        return CommandResult(text, {"dataset": path, "episodes": dataset.n_episodes, "frames": dataset.n_frames})
