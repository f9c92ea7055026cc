"""Comparison of model and recording by joint and condition, with an audit of the recording and open questions."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from nas_data.count_of import count_of
from nas_data.dataset.audits import audit_dataset
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.external import add_remedy
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.torque_off import keep_torque_on
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.finding import audits
from nas_data.gap.finding.audits import find_unmoved_joints, join_chosen
from nas_data.gap.finding.command_shift import check_command_shift
from nas_data.gap.finding.conditions import ConditionInputs, find_loads, list_conditions
from nas_data.gap.finding.joint_gaps import find_joint_gaps
from nas_data.gap.finding.recorded import RecordedRows
from nas_data.gap.finding.regimes import count_episodes_needed, find_regimes
from nas_data.gap.nominal import Nominal
from nas_data.gap.overlaps import Overlap
from nas_data.gap.report_parts import Bin, Check, GapFindings

SHORT = 5.0  # [s] duration below which effects cannot be distinguished
RATES = 0.02  # relative difference above which episodes have different rates


def list_undecidable(recorded: RecordedRows, floor: np.ndarray, regimes: Sequence[Bin]) -> tuple[str, ...]:
    """Return a sentence for each question that cannot be decided, with the remedy."""
    notes = [*check_motion(recorded, floor), *check_time(recorded), *check_episodes(recorded, regimes)]
    return tuple(notes)


def check_motion(recorded: RecordedRows, floor: np.ndarray) -> list[str]:
    """Name the joints that were not commanded or did not move."""
    evidence = recorded.evidence
    still = find_unmoved_joints(evidence, floor)
    if still.all():
        return ["No joint moves in any episode, so no gap can be explained: record the arm in motion."]
    steady = evidence.find_constant_commands()
    notes = []
    if steady.any():
        notes.append(
            f"What is missing at {join_chosen(evidence, steady)} cannot be decided, because the command never "
            "changes: record motion there."
        )
    if (still & ~steady).any():
        notes.append(
            f"{join_chosen(evidence, still & ~steady)} never moves although it is commanded to, so an effect there "
            "cannot be distinguished from a servo that is released, stuck or not connected."
        )
    return notes


def check_time(recorded: RecordedRows) -> list[str]:
    """Report a recording that is too short or has several rates."""
    notes = []
    seconds = float(recorded.evidence.mask.sum()) * recorded.evidence.period
    if seconds < SHORT:
        notes.append(
            f"The recording lasts {seconds:.2g} s, which is too short to distinguish effects: record a minute."
        )
    steps = measure_periods(recorded)
    if steps is not None:
        rates = measure_rates(recorded, steps)
        if rates.max() / rates.min() > 1 + RATES:
            hertz = rates / recorded.evidence.period
            notes.append(
                f"Episodes run at different rates, {hertz.min():.4g} to {hertz.max():.4g} Hz by their clock, so delays "
                "and speeds cannot be decided: divide the dataset by rate, or import it with [resample]."
            )
    return notes


def measure_periods(recorded: RecordedRows) -> np.ndarray | None:
    """Return the time between rows in control periods, shape (E, T − 1); None without a clock."""
    if recorded.times is None:
        return None
    return np.asarray(np.diff(recorded.times, axis=1) / recorded.evidence.period)


def measure_rates(recorded: RecordedRows, steps: np.ndarray) -> np.ndarray:
    """Return each episode's rate over the dataset's, shape (E,)."""
    pairs = zip(steps, recorded.evidence.mask[:, 1:], strict=True)
    medians = [float(np.median(row[seen])) if seen.any() else 1.0 for row, seen in pairs]
    return 1 / np.maximum(np.array(medians), 1e-3)


def check_episodes(recorded: RecordedRows, regimes: Sequence[Bin]) -> list[str]:
    """Report too few episodes."""
    tested = sum(measured.chance < 1 for measured in regimes)
    count, needed = len(recorded.evidence), count_episodes_needed(tested)
    if count < 2:
        return ["There is one episode only, so no episode can be held out: record several, or divide it."]
    if tested and count < needed:
        return [
            f"{count_of(count, 'episode')} are too few to decide in which regimes the gap is significantly larger; "
            f"{needed} would be enough."
        ]
    return []


AUDITS: tuple[Callable[[audits.Examined], Check], ...] = (
    audits.check_timing,
    audits.check_repeated_samples,
    check_command_shift,
    audits.check_velocities,
    audits.check_readings,
    audits.check_contacts,
    audits.check_excitation,
    audits.check_model,
    audits.check_saturation,
    audits.check_signs,
    audits.check_torque,
)


def find(
    dataset: Dataset,
    evidence: EpisodeBatch,
    nominal: Nominal,
    floor: np.ndarray,
    overlaps: Sequence[Overlap] = (),
    root: Path | None = None,
) -> GapFindings:
    """Compare a recording with a model.

    Args:
        dataset: Transitions with 2n-states, as recorded.
        evidence: All or some of its episodes; rows with the torque off are removed here.
        nominal: Model.
        floor: Noise floor of each joint [rad; m], shape (n,).
        overlaps: Contacts of the model that the recording contradicts.
        root: Folder of the recording, for remedies of its audits.

    Raises:
        DatasetInvalid: the torque is off throughout.
        ModelFileError: the model diverges.
    """
    powered = keep_torque_on(dataset)
    if powered is not dataset:
        rows = EpisodeBatch.of(powered).with_objects(powered, nominal.simulator())
        evidence = rows.select(np.flatnonzero(np.isin(rows.numbers, evidence.numbers)))
    evidence = nominal.infer_initial_loads(evidence)
    recorded = RecordedRows.of(powered, evidence)
    predicted = nominal.predict(evidence)
    loads = find_loads(nominal, recorded)
    regimes = find_regimes(
        evidence, predicted, list_conditions(ConditionInputs(recorded, loads, nominal, floor)), floor
    )
    findings = tuple(audit_dataset(dataset))
    if root is not None:
        provenance = read_provenance(root)
        findings = tuple(add_remedy(root, provenance, finding, dataset) for finding in findings)
    examined = audits.Examined(dataset, findings, recorded, nominal, floor, predicted, loads, overlaps)
    return GapFindings(
        joints=find_joint_gaps(recorded, nominal, floor, predicted),
        regimes=regimes,
        audit=tuple(check(examined) for check in AUDITS),
        undecidable=list_undecidable(recorded, floor, regimes),
    )
