"""Rollouts as a dataset: each stretch from one reset to the next is an episode, on the disk before the next begins."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nas_data.dataset.alone import alone
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ENVIRONMENT, NEXT_ENVIRONMENT, Feature
from nas_data.dataset.growing import Growing
from nas_data.dataset.provenance import Provenance, now, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.versions import FOLDER, check_place, save
from nas_data.errors import OutputExists
from nas_data.recorders.ergojr_dataset import to_dataset
from nas_data.rollouts.robot_stepper import Bout
from nas_data.xl320.joints import Joints


@dataclass
class Saved:
    """What became of a recording.

    Attributes:
        path: Its dataset, once it is complete; None where nothing was recorded.
        episodes: How many are saved.
    """

    path: Path | None = None
    episodes: int = 0


@dataclass(frozen=True, kw_only=True)
class Recorder:
    """How bouts become a dataset.

    Attributes:
        name: Of the dataset.
        joints: The arm's.
        rate: Control rate [Hz].
        task: Name of the environment.
        objects: What is known of the defender; of no width where there is none.
        provenance: Where the episodes come from.
    """

    name: str
    joints: Joints
    rate: float
    task: str
    objects: Feature
    provenance: Provenance

    @contextmanager
    def recording(self) -> Iterator[tuple[Callable[[Bout], None], Saved]]:
        """Yield what takes bouts, and what became of them; whatever ends this context, they are a dataset then.

        Raises:
            OutputExists: a recording of that name is under way.
            BeingWritten: another program records under that name.
        """
        check_place(name=self.name)
        root, saved = FOLDER / self.name / "recording", Saved()
        with alone(root):
            growing = Growing(root)
            if growing.episodes:
                raise OutputExists(f"{root} holds a recording under way; finish it first, or choose another --record.")

            def take(bout: Bout) -> None:
                growing.append(self._dataset(bout), self.provenance)
                saved.episodes = growing.episodes

            try:
                yield take, saved
            finally:
                if growing.episodes:
                    saved.path = self._finish(growing)

    def _dataset(self, bout: Bout) -> Dataset:
        dataset = to_dataset(bout, self.joints, self.rate, self.task)
        if not self.objects.width:
            return dataset
        opponents = np.array(bout.opponents, dtype=np.float32)
        dataset = dataset.with_column(ENVIRONMENT, self.objects, opponents[:-1])
        return dataset.with_column(NEXT_ENVIRONMENT, self.objects, opponents[1:])

    def _finish(self, growing: Growing) -> Path:
        provenance = read_provenance(growing.root)
        assert provenance is not None
        path = save(read(growing.root), replace(provenance, when=now(), files={}), name=self.name)
        growing.remove()
        return path
