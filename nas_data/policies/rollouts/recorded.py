"""Recording of rollouts as a dataset: each is saved before the next begins, and a later run resumes."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import (
    DONE,
    ENVIRONMENT,
    NEXT_ENVIRONMENT,
    REWARD,
    SUCCESS,
    Feature,
    flag_feature,
    make_reward_feature,
)
from nas_data.dataset.incremental_writer import IncrementalWriter
from nas_data.dataset.merge import concatenate
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.versions import check_destination
from nas_data.dataset.write_lock import hold_write_lock
from nas_data.errors import OptionError
from nas_data.policies.evaluate import Returns
from nas_data.policies.rollouts.robot_stepper import ArmAttempt, RolloutTally
from nas_data.policies.rollouts.rollout import RolloutScore, read_rollout_scores
from nas_data.recorders.arm_dataset import to_dataset
from nas_data.recorders.recording_folder import (
    choose_recording_folder,
    complete,
    describe_progress,
    make_other_recording_error,
)

FEATURES = {REWARD: make_reward_feature(), DONE: flag_feature(DONE), SUCCESS: flag_feature(SUCCESS)}
WORDS = {  # names for the user of settings in which two series of rollouts may differ
    "how": "kind of arm",
    "kind": "kind of arm",
    "arms": "arm",
    "robot": "robot",
    "environment": "task",
    "weights": "policy",
    "seeds": "seed",
    "episodes": "number of episodes",
    "configuration": "servo configuration",
    "largest_step": "largest step",
    "hits": "source of hits",
    "missed": "share of missed touches",
    "apart": "contacts to avoid (--apart)",
}


@dataclass(frozen=True, kw_only=True)
class Recorder:
    """Converts rollouts to a dataset."""

    joints: tuple[str, ...]  # names of the arm's joints
    rate: float  # control rate [Hz]
    task: str  # name of the environment
    objects: Feature  # feature of the defender's state; width 0 without a defender
    # origin of the episodes, without statistics. Only rollouts of equal provenance can be resumed.
    provenance: Provenance

    def dataset(self, attempts: Sequence[ArmAttempt], score: RolloutScore) -> Dataset:
        """Return a rollout of T steps as a dataset, with one episode per reset."""
        dataset = concatenate([self._convert_attempt(attempt) for attempt in attempts])
        for key, column in score.columns().items():
            dataset = dataset.with_column(key, FEATURES[key], column)
        return dataset

    def _convert_attempt(self, attempt: ArmAttempt) -> Dataset:
        dataset = to_dataset(attempt, self.joints, self.rate, self.task, self.provenance.robot)
        if not self.objects.width:
            return dataset
        opponents = np.array(attempt.opponents, dtype=np.float32)
        dataset = dataset.with_column(ENVIRONMENT, self.objects, opponents[:-1])
        return dataset.with_column(NEXT_ENVIRONMENT, self.objects, opponents[1:])


class Saved:
    """Saved rollouts, to which more may be added."""

    def __init__(self, name: str, growing: IncrementalWriter) -> None:
        """Read the rollouts of an earlier run.

        Raises:
            OptionError: the folder holds another kind of recording.
        """
        self.name, self.growing, self.scores = name, growing, list[Returns]()
        self._known = read_provenance(growing.root) if growing.episodes else None
        self.tally = RolloutTally.of(self._known.target if self._known else None)
        self._recorder: Recorder | None = None
        if self._known:
            dataset = read(growing.root)
            if not FEATURES.keys() <= dataset.features.keys():
                raise make_other_recording_error(growing.root, "another command", "--record")
            self.scores = [score.to_returns() for score in read_rollout_scores(dataset)]

    def resume(self, recorder: Recorder) -> None:
        """Begin or resume a recording.

        Raises:
            OptionError: the saved rollouts have other settings; the message names them.
        """
        self._recorder = recorder
        if self._known:
            earlier, now = list_shared_settings(self._known), list_shared_settings(recorder.provenance)
            other = dict.fromkeys(word for key, word in WORDS.items() if earlier[key] != now[key])
            if other:
                raise make_other_recording_error(self.growing.root, f"another {' and '.join(other)}", "--record")

    def save(self, attempts: Sequence[ArmAttempt], score: RolloutScore) -> None:
        """Save a rollout and flush it to the disk. Call `resume` first."""
        assert self._recorder is not None
        provenance = self._recorder.provenance
        target = {**(provenance.target or {}), "tally": asdict(self.tally)}
        self.growing.append(self._recorder.dataset(attempts, score), replace(provenance, target=target))
        self.scores.append(score.to_returns())

    def describe_progress(self, wanted: int) -> str:
        """Return a sentence on how many of the wanted episodes are saved, and how to resume."""
        return describe_progress(self.growing.root, len(self.scores), wanted)

    def finish(self, notes: str) -> Path:
        """Save the rollouts as a dataset, and return its folder.

        Raises:
            OptionError: no rollout is saved.
        """
        if not self.growing.episodes:
            raise OptionError(
                f"There are no saved episodes in {self.growing.root}; record some before you use --finish."
            )
        return complete(self.growing, read(self.growing.root), notes, name=self.name)


@contextmanager
def saved_as(name: str) -> Iterator[Saved]:
    """Open the rollouts saved under a name, with a write lock.

    Raises:
        BeingWritten: another program records under this name.
        OptionError: the name is invalid, or the folder holds another kind of recording.
    """
    check_destination(name=name)
    with hold_write_lock(root := choose_recording_folder(name)):
        yield Saved(name, IncrementalWriter(root))


def list_shared_settings(provenance: Provenance) -> dict[str, object]:
    """Return the settings that all rollouts of a recording must share, by the keys of `WORDS`."""
    values = {**provenance.to_json(), **(provenance.target or {}), **(provenance.signal or {})}
    return {key: json.loads(json.dumps(values.get(key))) for key in WORDS}
