"""What the workflow is given: a recording and a model, divided into episodes to fit and episodes to judge by."""

from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.foreign import take_in, warn
from nas_data.dataset.read import read
from nas_data.dataset.versions import resolve
from nas_data.errors import DatasetInvalid
from nas_data.gap.episode_batch import EpisodeBatch, divide, windows
from nas_data.gap.finding.torque_off import until_driven_again
from nas_data.gap.floor import noise_floor, step_errors
from nas_data.gap.gains import with_relative_gains
from nas_data.gap.nominal import Nominal
from nas_data.gap.overlaps import Overlap, find_overlaps, without_contacts
from nas_data.gap.search.objective import FitTask
from nas_data.pairing import check_fits, warn_of_ranges

TRAIN_STEPS = 120_000  # physics steps that one rollout of all training episodes may take, half a second of work
HELD_STEPS = 60_000  # the same for the held-out episodes


@dataclass(frozen=True)
class Problem:
    """What the workflow is given, ready to work on.

    Attributes:
        dataset: Transitions, as recorded.
        evidence: Its episodes.
        train: Model and episodes that are fitted.
        held: Model and episodes that judge.
        as_given: The model as handed over; `train` and `held` leave out the contacts that the recording contradicts.
        overlaps: Those contacts.
        names: How report and page call dataset and model.
        given: The model as handed over.
        root: Folder of the dataset.
    """

    dataset: Dataset
    evidence: EpisodeBatch
    train: FitTask
    held: FitTask
    as_given: Nominal
    overlaps: tuple[Overlap, ...]
    names: tuple[str, str]
    given: str | Path
    root: Path

    @classmethod
    def load(cls, dataset: str | Path, model: str | Path) -> "Problem":
        """Read both files.

        Raises:
            NasError: one of them cannot be used; the sentence names it.
        """
        root = resolve(Path(dataset))
        recorded, _, noticed = take_in(root, read(root))
        warn(noticed)
        return cls.of(recorded, model, root)

    @classmethod
    def of(cls, recorded: Dataset, model: str | Path, root: Path) -> "Problem":
        """Prepare transitions.

        Args:
            recorded: Transitions with 2n-states.
            model: A robot's name or a model file.
            root: Folder of the dataset that they are from, for names and errors.

        Raises:
            NasError: one of the two cannot be used; the sentence names it.
        """
        transitions = with_relative_gains(recorded, model, root)
        kept = until_driven_again(transitions)
        evidence = EpisodeBatch.of(kept)
        if len(evidence) < 2:
            half = evidence.counts.sum() // 2 * evidence.period
            raise DatasetInvalid(
                f"{root} has {len(evidence)} episode; at least two are needed, one to fit and one to judge by: "
                f"record more, or cut it in time: nas split {root} --seconds {half:.4g}."
            )
        as_given = Nominal.load(model, evidence)
        check_fits(transitions, as_given.simulator())
        overlaps = find_overlaps(as_given, kept)
        nominal = without_contacts(as_given, overlaps)
        simulator = nominal.simulator()
        warn_of_ranges(transitions, nominal.robot.spec().compile())
        evidence = evidence.with_objects(kept, simulator)
        floor = noise_floor(evidence, step_errors(kept, simulator))
        train, held = divide(evidence)
        train, held = (
            windows(part, steps // simulator.substeps) for part, steps in ((train, TRAIN_STEPS), (held, HELD_STEPS))
        )
        names = (root.parent.name if root.name.startswith("v") else root.name, Path(model).name)
        tasks = FitTask(nominal, train, floor), FitTask(nominal, held, floor)
        return cls(transitions, evidence, *tasks, as_given, tuple(overlaps.values()), names, model, root)

    def with_contacts(self) -> "Problem":
        """Return the same with the model as handed over throughout."""
        train, held = (replace(task, nominal=self.as_given) for task in (self.train, self.held))
        return replace(self, train=train, held=held)
