"""Audits of a recording before the search; each checks one error that may look like an effect.

Those that need no model summarise the audits of every recording (`dataset/audits/`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.count_of import join_items
from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import TIME
from nas_data.dataset.recording import has_derived_velocities
from nas_data.dataset.torque_off import TORQUE, find_torque_on, keep_torque_on
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.finding.conditions import Loads
from nas_data.gap.finding.recorded import RESTING_FLOORS, RecordedRows
from nas_data.gap.nominal import Nominal
from nas_data.gap.overlaps import Overlap
from nas_data.gap.report_parts import Check
from nas_data.simulators.against_model import check_signs as check_against_gravity
from nas_data.simulators.limits import command_limits


@dataclass(frozen=True)
class Examined:
    """A recording with predictions of the model."""

    dataset: Dataset  # dataset as recorded, including rows with the torque off
    findings: tuple[AuditFinding, ...]  # findings of the audits of every recording
    recorded: RecordedRows  # rows with the torque on
    nominal: Nominal  # model
    floor: np.ndarray  # noise floor [rad; m], shape (n,)
    predicted: np.ndarray  # the model's open-loop positions [rad; m], shape (E, T, n)
    loads: Loads  # the model's torques in measured states
    overlaps: Sequence[Overlap] = ()  # contacts of the model that the recording contradicts


def summarise_audits(name: str, examined: Examined, checks: Sequence[str], sound: str, advice: str = "") -> Check:
    """Summarise audits of every recording, one sentence for each kind of finding.

    Args:
        name: Name of the check.
        examined: Recording with findings.
        checks: Kinds of findings to include.
        sound: Text without findings.
        advice: Remedy for findings that are not minor; by default that of each kind of finding.
    """
    kinds: dict[str, list[AuditFinding]] = {}
    for finding in examined.findings:
        if finding.check in checks:
            kinds.setdefault(finding.check, []).append(finding)
    if not kinds:
        return Check(name, sound)
    ok = all(finding.minor for members in kinds.values() for finding in members)
    notes = [
        describe_audit_findings(members, examined.dataset.n_episodes, remedies=not advice) for members in kinds.values()
    ]
    if advice and not ok:
        notes.append(f"{advice[0].upper()}{advice[1:]}.")
    return Check(name, " ".join(notes), ok)


def describe_audit_findings(members: Sequence[AuditFinding], episodes: int, remedies: bool) -> str:
    """Return the first serious finding of a kind, the number of episodes with one, and perhaps its remedy."""
    grave = [finding for finding in members if not finding.minor] or list(members)
    places = len({finding.file for finding in grave})
    first = grave[0]
    more = f" (so in {places} of {episodes} episodes)" if places > 1 else ""
    remedy = f"; {first.remedy}" if remedies and first.remedy else ""
    return f"In {first.file} {first.what}{more}{remedy}."


def format_percent(share: float) -> str:
    """Return a share in percent, small ones with more digits."""
    return f"{100 * share:.2g} %" if share < 0.1 else f"{100 * share:.0f} %"


TIMING_CHECKS = ("time_backwards", "repeated_time", "rate", "irregular_time", "time_gap")


def check_timing(examined: Examined) -> Check:
    """Report where the recorder's clock contradicts evenly spaced rows."""
    if TIME not in examined.dataset.columns:
        return Check("timing", "The recording has no clock (nas.time): rows are treated as evenly spaced.")
    advice = (
        "import the recording again with [resample] in its map, or, if only the time stamps of a LeRobot dataset are "
        "uneven, with --uniform"
    )
    return summarise_audits(
        "timing", examined, TIMING_CHECKS, "The rows are evenly spaced, at the dataset's rate.", advice
    )


def check_repeated_samples(examined: Examined) -> Check:
    """Report readings that repeat earlier ones."""
    return summarise_audits(
        "repeated samples",
        examined,
        ("repeated_samples", "frozen_reading"),
        "No reading repeats the previous one while the arm moves.",
    )


VELOCITIES_CHECKS = ("velocity_scale", "velocity_lag", "position_contradicts_velocity")


def check_velocities(examined: Examined) -> Check:
    """Report joints whose velocities do not match their positions."""
    if has_derived_velocities(examined.dataset):
        return Check("velocities", "Velocities were derived from the positions; one-step errors carry their noise.")
    advice = "one-step predictions start from wrong states: import again with velocity = 'derive'"
    sound = "The recorded velocities are those of the positions, in size and in time."
    return summarise_audits("velocities", examined, VELOCITIES_CHECKS, sound, advice)


READINGS_CHECKS = ("jump", "unit_slip", "command_scale", "command_sign", "command_is_position", "joints_swapped")


def check_readings(examined: Examined) -> Check:
    """Report readings and commands that contradict their name or unit."""
    return summarise_audits(
        "readings", examined, READINGS_CHECKS, "No reading jumps, and positions and commands belong together."
    )


SHOWN_PAIRS = 3  # pairs of bodies that are named


def check_contacts(examined: Examined) -> Check:
    """Report bodies of the model that penetrate in measured poses."""
    found = sorted(examined.overlaps, key=lambda overlap: (-overlap.share, -overlap.depth))
    if not found:
        return Check("contacts", "The contacts of the model agree with the recording.")
    each = [
        f"{one.text} by up to {1000 * one.depth:.0f} mm in {format_percent(one.share)} of the rows" for one in found
    ]
    more = [f"{len(each) - SHOWN_PAIRS} more pairs"] if len(each) > SHOWN_PAIRS else []
    return Check(
        "contacts",
        "In measured poses, shapes of the model overlap: "
        f"{join_items([*each[:SHOWN_PAIRS], *more])}. "
        "The arm moves as if they did not touch. These contacts are disabled in the search and in model.xml; check the "
        "zeros of the joints, what the arm stands on, and the model's shapes.",
        ok=False,
    )


def check_excitation(examined: Examined) -> Check:
    """Name the joints without enough excitation."""
    evidence = examined.recorded.evidence
    steady, still = evidence.find_constant_commands(), find_unmoved_joints(evidence, examined.floor)
    found = [(steady, "the command never changes"), (still & ~steady, "the joint never moves although commanded to")]
    notes = [f"{join_chosen(evidence, chosen)}: {text}" for chosen, text in found if chosen.any()]
    if notes:
        return Check("excitation", "; ".join(notes) + ".", False)
    return Check("excitation", "Every joint is commanded to move, and moves.")


def join_chosen(evidence: EpisodeBatch, chosen: np.ndarray) -> str:
    """Return the names of chosen joints (n,)."""
    return join_items([joint for joint, is_chosen in zip(evidence.joints, chosen, strict=True) if is_chosen])


def find_unmoved_joints(evidence: EpisodeBatch, floor: np.ndarray) -> np.ndarray:
    """Return a mask of the joints that do not move in any episode, shape (n,)."""
    span = np.ptp(np.concatenate([evidence.initial_positions[:, None], evidence.measured], axis=1), axis=1)
    return np.asarray(span.max(axis=0) <= RESTING_FLOORS * floor)


def check_model(examined: Examined) -> Check:
    """Repeat the notes from loading the model, and what the recording's registers say."""
    notes, known = examined.nominal.notes, examined.nominal.known
    return Check("model", " ".join((*notes, *known)) or "It is simulated as given.", ok=not notes)


REPORTED_SHARE = 0.01  # share of the rows above which a joint is reported
EXCESSIVE_SHARE = 0.5  # share of the rows at the limit above which the gain is too high
ROUNDING = 1e-5  # [the commands' unit]; commands are stored as float32


def check_saturation(examined: Examined) -> Check:
    """Report the joints at their limits."""
    counts = examined.recorded.evidence.mask
    saturated = examined.loads.saturated[counts].mean(axis=0)
    beyond = find_out_of_range(examined)[counts].mean(axis=0)
    notes = []
    if (saturated > REPORTED_SHARE).any():
        notes.append(f"the model's servo is at its torque limit in {describe_shares(examined, saturated)}")
    if (saturated > EXCESSIVE_SHARE).any():
        notes.append(
            "a servo that is at its limit most of the time has too high a gain (kp) for its torque: check the model"
        )
    if (beyond > REPORTED_SHARE).any():
        notes.append(
            f"commands leave the model's range in {describe_shares(examined, beyond)}: the model clips them, the robot "
            "may not have"
        )
    if not notes:
        return Check(
            "saturation", "The model's servos are below their torque limits and the commands within its ranges."
        )
    text = "; ".join(notes)
    return Check(
        "saturation",
        text[0].upper() + text[1:] + ".",
        not ((saturated > EXCESSIVE_SHARE) | (beyond > REPORTED_SHARE)).any(),
    )


def describe_shares(examined: Examined, values: np.ndarray) -> str:
    """Return joints with their shares of the rows, above `REPORTED_SHARE`."""
    pairs = zip(examined.nominal.joints, values, strict=True)
    return join_items(
        [f"{format_percent(value)} of the rows of {joint}" for joint, value in pairs if value > REPORTED_SHARE]
    )


def find_out_of_range(examined: Examined) -> np.ndarray:
    """Return a mask of the commands outside the model's range, shape (E, T, n)."""
    simulator = examined.nominal.simulator()
    low, high = command_limits(simulator.model, simulator.joints, str(simulator.robot.mjcf))
    commands = examined.recorded.evidence.commands
    return np.asarray((commands < low - ROUNDING) | (commands > high + ROUNDING))


def check_signs(examined: Examined) -> Check:
    """Compare the position errors of resting servos with the model's gravity."""
    dataset = examined.dataset
    if not dataset.positional.any():
        return Check("signs", "Not compared with gravity: the commands are not positions.")
    skipped = [joint for joint, positional in zip(dataset.joints, dataset.positional, strict=True) if not positional]
    rest = f" Not compared, because their commands are not positions: {join_items(skipped)}." if skipped else ""
    found = check_against_gravity(keep_torque_on(dataset), examined.nominal.spec.copy().compile())
    if not found:
        return Check("signs", f"The loads of servos at rest agree with the model's gravity.{rest}")
    what = join_items([finding.what for finding in found])
    remedy = (
        "Check sign and zero of these joints in the map, or their axis in the model, before you search for effects."
    )
    return Check("signs", f"{what}. {remedy}{rest}", ok=False)


def check_torque(examined: Examined) -> Check:
    """Report how many rows are left out."""
    dataset = examined.dataset
    if TORQUE not in dataset.columns:
        return Check("torque off", "The recording does not say whether the servos were powered; this is assumed.")
    off = ~find_torque_on(dataset)
    if not off.any():
        return Check("torque off", "The servos were powered in every row.")
    episodes = sum(bool(off[rows].any()) for rows in dataset.episodes())
    kept = int(examined.recorded.evidence.mask.sum())
    noun = "episode" if episodes == 1 else "episodes"
    return Check(
        "torque off",
        f"The torque is off in {format_percent(float(off.mean()))} of the rows, in {episodes} {noun}: "
        f"each episode is cut to its longest stretch with the torque on, "
        f"which leaves {kept} of {dataset.n_frames} rows.",
    )
