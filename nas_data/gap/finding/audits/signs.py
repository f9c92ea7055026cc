"""Signs: whether a resting joint is held against the model's gravity, or hangs upwards."""

from nas_data.count_of import join_items
from nas_data.gap.finding.audits.base import Examined
from nas_data.gap.finding.torque_off import keep_torque_on
from nas_data.gap.report_parts import Check
from nas_data.simulators.against_model import check_signs

NAME = "signs"


def check(examined: Examined) -> Check:
    """Compare the position errors of resting servos with the model's gravity."""
    dataset = examined.dataset
    if not dataset.positional.any():
        return Check(NAME, "Not compared with gravity: the commands are no positions.")
    skipped = [joint for joint, positional in zip(dataset.joints, dataset.positional, strict=True) if not positional]
    rest = f" Not compared, as their commands are no positions: {join_items(skipped)}." if skipped else ""
    found = check_signs(keep_torque_on(dataset), examined.nominal.spec.copy().compile())
    if not found:
        return Check(NAME, f"Servos at rest hold the loads that the model's gravity makes.{rest}")
    what = join_items([finding.what for finding in found])
    remedy = "Check sign and zero of these joints in the map, or their axis in the model, before you look for effects."
    return Check(NAME, f"{what}. {remedy}{rest}", ok=False)
