"""Comparison of model and recording by joint and condition, with an audit of the recording."""

from collections.abc import Callable, Sequence

import numpy as np

from nas_data.dataset.audits import audit_dataset
from nas_data.dataset.dataset import Dataset
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.finding import audits
from nas_data.gap.finding.command_shift import check_command_shift
from nas_data.gap.finding.conditions import ConditionInputs, find_loads, list_conditions
from nas_data.gap.finding.joint_gaps import find_joint_gaps
from nas_data.gap.finding.recorded import RecordedRows
from nas_data.gap.finding.regimes import find_regimes
from nas_data.gap.finding.torque_off import keep_torque_on
from nas_data.gap.finding.undecidable import list_undecidable
from nas_data.gap.nominal import Nominal
from nas_data.gap.overlaps import Overlap
from nas_data.gap.report_parts import Check, GapFindings

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
) -> GapFindings:
    """Compare a recording with a model.

    Args:
        dataset: Transitions with 2n-states, as recorded.
        evidence: All or some of its episodes; rows with the torque off are removed here.
        nominal: Model.
        floor: Noise floor of each joint [rad; m], shape (n,).
        overlaps: Contacts of the model that the recording contradicts.

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
    examined = audits.Examined(dataset, audit_dataset(dataset), recorded, nominal, floor, predicted, loads, overlaps)
    return GapFindings(
        joints=find_joint_gaps(recorded, nominal, floor, predicted),
        regimes=regimes,
        audit=tuple(check(examined) for check in AUDITS),
        undecidable=list_undecidable(recorded, floor, regimes),
    )
