"""Input of the workflow: a recording and a model, split into fitted and held-out episodes."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from nas_data.count_of import count_of
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.external import audit_external
from nas_data.dataset.position_gains import P_GAIN_COLUMN
from nas_data.dataset.read import read
from nas_data.dataset.torque_off import keep_torque_on_and_fall
from nas_data.dataset.versions import VERSION, resolve
from nas_data.errors import DatasetInvalid, JointMismatch
from nas_data.gap.episode_batch import EpisodeBatch, split_episodes
from nas_data.gap.floor import estimate_noise_floor, measure_step_errors
from nas_data.gap.gains import RELATIVE_GAIN, with_relative_gains
from nas_data.gap.nominal import Nominal
from nas_data.gap.nominal_parameters import FITTED_TOLERANCE
from nas_data.gap.overlaps import Overlap, exclude_contacts, find_overlaps
from nas_data.gap.repeated_motion import RepeatedMotion
from nas_data.gap.search.contrast import Contrast
from nas_data.gap.search.objective import FitTask
from nas_data.gap.usual_error import UsualError
from nas_data.gap.windows import cut_windows
from nas_data.log import warn
from nas_data.pairing import check_fits, warn_of_ranges
from nas_data.robots.base import TORQUES
from nas_data.simulators.register_kinds import P_GAIN
from nas_data.simulators.servo_registers import NO_REGISTERS, ServoRegisters

EACH_GAIN = f"Each episode is simulated at the position gain that its frames hold ({P_GAIN_COLUMN})."
TRAIN_STEPS = 120_000  # most physics steps of one rollout of all training episodes, about 0.5 s
HELD_STEPS = 60_000  # the same for the held-out episodes


@dataclass(frozen=True)
class Problem:
    """Prepared input of the workflow.

    Attributes:
        dataset: Transitions as recorded.
        evidence: Their episodes.
        train: Model and fitted episodes.
        held: Model and held-out episodes.
        as_given: Given model; `train` and `held` exclude contacts that the recording contradicts.
        overlaps: These contacts.
        names: Names of dataset and model in the report.
        model_file: Robot's name or model file.
        root: Folder of the dataset; None if it is only in memory.
        baseline: Recording before a change, and the model that describes it; see `compare_with`.
        contrast: Episodes of the baseline in which no hypothesis may gain.
        subtracts_baseline: Whether errors of the baseline are subtracted, so that errors are those beyond them.
    """

    dataset: Dataset
    evidence: EpisodeBatch
    train: FitTask
    held: FitTask
    as_given: Nominal
    overlaps: tuple[Overlap, ...]
    names: tuple[str, str]
    model_file: str | Path
    root: Path | None
    baseline: "Problem | None" = None
    contrast: Contrast | None = None
    subtracts_baseline: bool = False

    @classmethod
    def load(
        cls,
        dataset: str | Path,
        model: str | Path,
        baseline: str | Path | None = None,
        registers: ServoRegisters = NO_REGISTERS,
    ) -> "Problem":
        """Read both files.

        Args:
            dataset: Folder of the recording.
            model: Robot's name or model file.
            baseline: Folder of a recording that `model` describes; see `compare_with`.
            registers: Servo registers that the recording does not store.

        Raises:
            NasError: one of them cannot be used; the message names it.
        """
        root = resolve(Path(dataset))
        recorded, _, noticed = audit_external(root, read(root))
        warn(noticed)
        problem = cls.of(recorded, model, root, registers)
        if baseline is None:
            return problem
        with name_baseline(baseline):
            before = cls.load(baseline, model)
        return problem.compare_with(before)

    @classmethod
    def of(
        cls, recorded: Dataset, model: str | Path, root: Path | None, registers: ServoRegisters = NO_REGISTERS
    ) -> "Problem":
        """Prepare transitions and a model.

        Args:
            recorded: Transitions with 2n-states.
            model: Robot's name or model file.
            root: Folder of the dataset, for names and errors; None if it is only in memory.
            registers: Servo registers that the recording does not store.

        Raises:
            NasError: one of the two cannot be used; the message names it.
        """
        own = ServoRegisters.of(recorded, root).over(registers)
        transitions = recorded
        if P_GAIN_COLUMN in recorded.columns and P_GAIN in own.changing:  # simulated episode by episode
            transitions = with_relative_gains(recorded, model, root or "The dataset")
            own = own.without(P_GAIN)
        kept = keep_torque_on_and_fall(transitions)
        evidence = EpisodeBatch.of(kept)
        if len(evidence) < 2:
            part = min(3.0, evidence.mask.sum() // 2 * evidence.period)
            cut = (
                f"cut it in time: nas split {root} --seconds {part:.4g}"
                if root is not None
                else "give Dataset.from_arrays a list of arrays, one an episode: numpy.array_split(positions, 2)"
            )
            raise DatasetInvalid(
                f"{root or 'The dataset'} has {count_of(len(evidence), 'episode')}; at least two are needed, one to "
                f"fit and one to test: record more, or {cut}."
            )
        as_given = Nominal.load(model, evidence, own)
        if RELATIVE_GAIN in transitions.columns:
            as_given = replace(as_given, known=(*as_given.known, EACH_GAIN))
        check_fits(transitions, as_given.simulator())
        overlaps = find_overlaps(as_given, kept)
        nominal = exclude_contacts(as_given, overlaps)
        simulator = nominal.simulator()
        warn_of_ranges(transitions, nominal.robot)
        evidence = evidence.with_objects(kept, simulator)
        floor = estimate_noise_floor(evidence, measure_step_errors(kept, simulator))
        train, held = split_episodes(evidence)
        train, held = (
            cut_windows(part, steps // simulator.substeps) for part, steps in ((train, TRAIN_STEPS), (held, HELD_STEPS))
        )
        folder = root or Path("dataset")
        shown = Path(str(model).removesuffix(TORQUES)).name
        names = (folder.parent.name if VERSION.fullmatch(folder.name) else folder.name, shown)
        fitted, judged = (FitTask(nominal, part, floor).infer_initial_loads((), {}) for part in (train, held))
        return cls(transitions, evidence, fitted, judged, as_given, tuple(overlaps.values()), names, model, root)

    def compare_with(self, baseline: "Problem") -> "Problem":
        """Return the problem of naming what differs from a baseline, which best has the same motions.

        Errors of the model in the same motion of the baseline are subtracted, as far as both recordings agree. Beyond
        that, errors as large as in the baseline, for the motion of the joint in an episode, count as noise. Base
        parameters have a small tolerance, because they fit the baseline.

        Args:
            baseline: Recording before a change, with the model that describes it.

        Raises:
            JointMismatch: it has other joints.
        """
        joints, others = self.evidence.joints, baseline.evidence.joints
        if joints != others:
            raise JointMismatch(
                f"The baseline {baseline.root or 'dataset'} has the joints {', '.join(others)}, and the recording "
                f"{', '.join(joints)}: give a baseline with the same joints, in the same order."
            )
        tasks = baseline.train.settle(), baseline.held.settle()
        squares = np.concatenate([task.mean_squares(task.roll_out(task.evidence, (), {})) for task in tasks])
        motions = np.concatenate([task.evidence.motions for task in tasks])
        usual = UsualError.fit(np.sqrt(squares), motions, baseline.train.floor)
        nominal = self.train.nominal.with_tolerance(FITTED_TOLERANCE)
        before = replace(baseline.train, evidence=baseline.evidence)
        repeated = [RepeatedMotion.find(task, before) for task in (self.train, self.held)]
        train, held = (
            same.subtract(replace(task, nominal=nominal), usual)
            for same, task in zip(repeated, (self.train, self.held), strict=True)
        )
        as_given = self.as_given.with_tolerance(FITTED_TOLERANCE)
        is_repeated = np.concatenate([same.is_alike for same in repeated])
        numbers = np.concatenate([self.train.evidence.numbers, self.held.evidence.numbers])
        as_given = replace(as_given, known=(*as_given.known, describe_repeated(numbers, is_repeated)))
        contrast = Contrast(replace(tasks[1], usual_error=usual.predict(tasks[1].evidence.motions)))
        changed = replace(self, train=train, held=held, as_given=as_given, baseline=baseline, contrast=contrast)
        return replace(changed, subtracts_baseline=bool(is_repeated.any()))

    def number_episodes(self, evidence: EpisodeBatch) -> np.ndarray:
        """Return the number of each episode in the recording from which the dataset's were selected, shape (E,)."""
        return np.array(self.dataset.episode_numbers)[evidence.numbers]

    @cached_property
    def without_registers(self) -> Nominal:
        """Given model as its file is, without the registers of the recording."""
        return Nominal.load(self.model_file, self.evidence)

    def with_contacts(self) -> "Problem":
        """Return the problem with all contacts of the given model."""
        train, held = (replace(task, nominal=self.as_given) for task in (self.train, self.held))
        return replace(self, train=train, held=held)


def describe_repeated(numbers: np.ndarray, is_repeated: np.ndarray) -> str:
    """Describe in how many episodes a recording has the motion of its baseline, from episode numbers of windows."""
    count, total = len(np.unique(numbers[is_repeated])), len(np.unique(numbers))
    if not count:
        return "No episode repeats a motion of the baseline, so that its errors count as noise."
    return (
        f"{count} of {count_of(total, 'episode')} repeat a motion of the baseline: what the model leaves there, too, "
        "is subtracted, in this report's errors and pictures as well."
    )


@contextmanager
def name_baseline(baseline: str | Path) -> Iterator[None]:
    """Name the baseline in errors about its joints, which otherwise name the model only."""
    try:
        yield
    except JointMismatch as error:
        raise JointMismatch(f"The baseline {baseline}: {error}") from None
