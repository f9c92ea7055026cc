"""Input of a sweep: datasets, source and effects with their hashes, and the subsets that trials learn from."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from nas_data.dataset.content import hash_content
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.read import read
from nas_data.dataset.torque_off import drop_rows_without_torque
from nas_data.dataset.transitions import as_transitions
from nas_data.errors import DatasetInvalid, ModelFileError, OptionError
from nas_data.gap.write_model import EFFECTS
from nas_data.simulators.servo_registers import ServoRegisters
from nas_data.sources import SourceModel, locate_source

Unit = Literal["episodes", "minutes"]
ALL = "all"


@dataclass(frozen=True, order=True)
class Amount:
    """An amount of training data."""

    value: float  # number of episodes or minutes; infinite for all
    unit: Unit

    @classmethod
    def of(cls, word: object, unit: Unit) -> "Amount":
        """Read the number, or `all`, from JSON."""
        return cls(math.inf if word == ALL else float(str(word)), unit)

    @property
    def is_all(self) -> bool:
        """Whether the amount is all data."""
        return math.isinf(self.value)

    @property
    def word(self) -> float | str:
        """The number, or `all`, for JSON."""
        return ALL if self.is_all else self.value

    def __str__(self) -> str:
        """Return the amount with its unit."""
        return f"{ALL if self.is_all else f'{self.value:g}'} {self.unit[:-1] if self.value == 1 else self.unit}"


def parse(texts: Sequence[str], unit: Unit) -> tuple[Amount, ...]:
    """Parse amounts such as `10,25,all`, in one or several words; sorted, without duplicates.

    Raises:
        OptionError: there is no amount, one is not positive, or a number of episodes is not an integer.
    """
    option = "--counts" if unit == "episodes" else "--minutes"
    found = {Amount(parse_number(word, option, unit), unit) for word in split_words(texts)}
    if not found:
        raise OptionError(f"{option} is empty; give amounts separated by commas, such as 1,2,5,{ALL}.")
    return tuple(sorted(found))


def split_words(texts: Sequence[str]) -> list[str]:
    """Split texts at commas."""
    return [word.strip() for text in texts for word in text.split(",") if word.strip()]


def parse_number(word: str, option: str, unit: Unit) -> float:
    """Read one amount; infinite for `all`."""
    if word == ALL:
        return math.inf
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if 0 < value < math.inf and (unit == "minutes" or value.is_integer()):
        return value
    kind = "whole numbers" if unit == "episodes" else "numbers"
    raise OptionError(f"{option} has '{word}'; give {kind} above 0, or {ALL}, separated by commas.")


STRETCH = 10.0  # [s] length of a drawn segment: longer than any memory of the arm, yet many per minute
HOLDING_OUT, DRAWING = 0, 1  # independent random streams

Run = tuple[int, int]  # first frame, and the frame after the last


def divide(episodes: int, share: float, seed: int) -> tuple[list[int], list[int]]:
    """Draw a share of two or more episodes to hold out, the same for all trials of a seed; one at least is left.

    Returns:
        Training episodes and held-out episodes, each in order.
    """
    order = np.random.default_rng([seed, HOLDING_OUT]).permutation(episodes)
    held = min(episodes - 1, max(1, round(share * episodes)))
    return sorted(order[held:].tolist()), sorted(order[:held].tolist())


def draw(dataset: Dataset, train: Sequence[int], amount: Amount, seed: int) -> list[Run]:
    """Draw training data; for equal seeds, smaller amounts are subsets of larger ones.

    Returns:
        Runs of consecutive frames in order: whole episodes, or segments of some.

    Raises:
        OptionError: there is less data, or the amount is less than a frame.
    """
    check_enough(dataset, train, amount)
    rng = np.random.default_rng([seed, DRAWING])
    if amount.unit == "episodes":
        count = len(train) if amount.is_all else int(amount.value)
        chosen = sorted(int(train[place]) for place in rng.permutation(len(train))[:count])
        return [(rows.start, rows.stop) for rows in map(dataset.episode, chosen)]
    frames = count_available_frames(dataset, train) if amount.is_all else round(amount.value * 60 * dataset.fps)
    return merge_adjacent_runs(take(cut_stretches(dataset, train), rng, frames), dataset)


def check_enough(dataset: Dataset, train: Sequence[int], amount: Amount) -> None:
    """Raise OptionError if the training episodes hold less than an amount, or it is less than a frame."""
    if amount.unit == "minutes" and not amount.is_all and round(amount.value * 60 * dataset.fps) < 1:
        raise OptionError(
            f"--minutes asks for {amount}, which is less than a frame at {dataset.fps:g} Hz; ask for more."
        )
    there = len(train) if amount.unit == "episodes" else count_available_frames(dataset, train) / dataset.fps / 60
    if amount.is_all or amount.value <= there * (1 + 1e-9):
        return
    option = "--counts" if amount.unit == "episodes" else "--minutes"
    raise OptionError(
        f"{option} asks for {amount}, but {len(train)} training episodes hold {there:.4g} {amount.unit} "
        f"(of {dataset.n_episodes} recorded episodes); ask for less, or for all."
    )


def count_available_frames(dataset: Dataset, train: Sequence[int]) -> int:
    """Return the frames of the training episodes."""
    return int(dataset.lengths[list(train)].sum())


def cut_stretches(dataset: Dataset, train: Sequence[int]) -> list[Run]:
    """Cut each training episode into segments of nearly equal length."""
    cuts: list[Run] = []
    for rows in map(dataset.episode, train):
        parts = max(1, round((rows.stop - rows.start) / dataset.fps / STRETCH))
        ends = np.linspace(rows.start, rows.stop, parts + 1).round().astype(int).tolist()
        cuts.extend(pairwise(ends))
    return cuts


def take(runs: Sequence[Run], rng: np.random.Generator, frames: int) -> list[Run]:
    """Take runs in random order up to a number of frames; the last one is truncated."""
    taken: list[Run] = []
    for place in rng.permutation(len(runs)):
        start, stop = runs[place]
        length = min(stop - start, frames)
        if length <= 0:
            break
        taken.append((start, start + length))
        frames -= length
    return taken


def merge_adjacent_runs(runs: Sequence[Run], dataset: Dataset) -> list[Run]:
    """Sort runs, and join consecutive ones within an episode."""
    starts = set(dataset.starts.tolist())
    result: list[Run] = []
    for start, stop in sorted(runs):
        if result and result[-1][1] == start and start not in starts:
            result[-1] = (result[-1][0], stop)
        else:
            result.append((start, stop))
    return result


@dataclass(frozen=True)
class Content:
    """Identity of the data, independent of the machine."""

    dataset: str  # content hash of the dataset
    test: str | None  # content hash of the held-out dataset; None if episodes of the first one are held out
    source: str | None  # SHA-256 of the source's model, engine and effects; None without a source
    effects: str | None  # SHA-256 of the given named effects; None without

    def to_json(self, named: bool = True) -> dict[str, str | None]:
        """Return the hashes for JSON; without effects for a trial that names none."""
        return asdict(self if named else replace(self, effects=None))


@dataclass(frozen=True)
class SweepData:
    """Location of the data of a sweep."""

    root: Path  # folder of the dataset
    test: Path | None = None  # folder of the held-out dataset; None if episodes of the first one are held out
    model: str | None = None  # source model; None for the one kept with the dataset
    engine: str | None = None  # engine of the source; None for the one of the pairing
    effects: Path | None = None  # folder of a gap report, or its effects.json, to use instead of naming

    def read(self) -> Dataset:
        """Read the dataset as transitions, without rows in which the torque is off."""
        return read_powered(self.root)

    def source(self) -> SourceModel | None:
        """Return the source; None if none is given and the dataset keeps none."""
        try:
            return locate_source(self.model, (), [self.root], self.engine)
        except ModelFileError:
            if self.model is not None:
                raise
            return None

    def list_register_changes(self) -> list[str]:
        """Return what the recording's servo registers change in the source, as phrases: named kinds have them."""
        source = self.source()
        if source is None:
            return []
        return ServoRegisters.of(self.read(), self.root).list_changes(source.robot)

    def divide(self, dataset: Dataset, share: float | None, seed: int) -> tuple[list[int], Dataset]:
        """Return the training episodes, and the held-out data: the test dataset, or a share of the episodes."""
        if self.test is not None:
            return list(range(dataset.n_episodes)), read_powered(self.test)
        assert share is not None
        train, held = divide(dataset.n_episodes, share, seed)
        return train, dataset.select(held)

    def content(self) -> Content:
        """Return the identity of the present data."""
        return Content(
            dataset=hash_content(read(self.root)),
            test=None if self.test is None else hash_content(read(self.test)),
            source=self._hash_source(),
            effects=None if self.effects is None else hash_effects_file(self.effects),
        )

    def _hash_source(self) -> str | None:
        source = self.source()
        if source is None:
            return None
        described = source.simulator(self.read(), threads=1).describe()
        values = [str(described.get(key)) for key in ("sha256", "engine", "effects")]
        return hashlib.sha256("\n".join(values).encode()).hexdigest()

    def check(self, content: Content) -> None:
        """Raise DatasetInvalid if the data changed since a sweep began."""
        changed = [key for key, value in self.content().to_json().items() if value != content.to_json()[key]]
        if changed:
            raise DatasetInvalid(
                f"The {changed[0]} of the sweep on {self.root} changed while it ran; start it again with another --out."
            )


def read_powered(root: Path) -> Dataset:
    """Read a dataset as transitions, without rows in which the torque is off."""
    return drop_rows_without_torque(as_transitions(read(root))[0])[0]


def hash_effects_file(path: Path) -> str:
    """Return the SHA-256 of an effects file, or of the one in a gap report."""
    file = path / EFFECTS if path.is_dir() else path
    return hashlib.sha256(file.read_bytes()).hexdigest()
