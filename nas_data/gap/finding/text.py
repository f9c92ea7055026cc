"""Text summary of the findings, in degrees and millimetres."""

from collections.abc import Mapping, Sequence

from nas_data.gap.report_parts import Bin, Check, JointGap
from nas_data.joint_units import SLIDE, JointUnit, find_display_unit, format_table_unit
from nas_data.text_table import align_columns

MAX_REGIMES = 3  # most regimes per joint
SHOWN_RATIO = 1.2  # ratio of errors inside over outside a bin above which it is shown
SHOWN_FLOORS = 1.5  # noise floors above which a joint's regimes are shown
SIGNED_RATIO = 0.3  # ratio of mean over RMS error above which its sign is shown
COMMAND_LEGEND = "; (command): predicts that every joint is where it is told to be"
COLUMNS = {
    "noise": "floor",
    "one step": "one_step",
    "(hold)": "one_step_hold",
    "open loop": "open_loop",
    "(hold) ": "open_loop_hold",
    "(command)": "open_loop_command",
    "repeats": "repeatability",
}


def describe_findings(
    joints: Mapping[str, JointGap], regimes: Sequence[Bin], audit: Sequence[Check], undecidable: Sequence[str]
) -> str:
    """Return audits, gaps, regimes and open questions."""
    parts = [
        "Recording\n"
        + "\n".join(f"  {'ok   ' if check.ok else 'LOOK '}{check.check}: {check.finding}" for check in audit),
        format_joint_table(joints),
        "Where the error is significantly larger (open loop)\n" + format_regimes(joints, regimes),
    ]
    if undecidable:
        parts.append("What cannot be decided\n" + "\n".join(f"  {sentence}" for sentence in undecidable))
    return "\n\n".join(parts)


def format_joint_table(joints: Mapping[str, JointGap]) -> str:
    """Return the gap of each joint, a row each."""
    slides = [joint for joint, gap in joints.items() if gap.unit == SLIDE.si]
    used = {head: key for head, key in COLUMNS.items() if any(getattr(gap, key) is not None for gap in joints.values())}
    rows = [["", *used, "open loop / noise"]]
    for joint, gap in joints.items():
        cells = [format_cell(getattr(gap, key), gap.unit) for key in used.values()]
        rows.append([joint, *cells, f"{gap.ratio_to_noise:.1f}"])
    heading = f"Gap: RMSE of positions [{format_table_unit(list(joints), slides)}]"
    legend = [
        "one step: simulated from every measured state; open loop: from the first pose and the commands alone",
        "(hold): predicts that nothing moves" + COMMAND_LEGEND * ("(command)" in used),
    ]
    return "\n".join([heading, *(f"  {line}" for line in [*align_columns(rows, least=9), *legend])])


def format_cell(value: float | None, unit: str) -> str:
    """Return a position in display units, a dash without a value."""
    return "–" if value is None else f"{find_display_unit(unit).factor * value:.3f}"


def format_regimes(joints: Mapping[str, JointGap], regimes: Sequence[Bin]) -> str:
    """Return each joint's significant bins with the largest errors, and errors that depend on direction."""
    lines = []
    for joint, gap in joints.items():
        bins = [measured for measured in regimes if measured.joint == joint]
        worst = [b for b in bins if b.significant and b.rmse > SHOWN_RATIO * b.rest]
        worst = sorted(worst, key=lambda measured: -measured.rmse / max(measured.rest, 1e-9))[:MAX_REGIMES]
        unit = find_display_unit(gap.unit)
        notes = [describe_bin(measured, unit) for measured in worst] + describe_direction_errors(bins, gap.floor, unit)
        if notes and gap.ratio_to_noise > SHOWN_FLOORS:
            lines.append(f"  {joint}  " + "; ".join(notes))
    return "\n".join(lines) if lines else "  nowhere"


def describe_bin(measured: Bin, unit: JointUnit) -> str:
    """Return a bin with its error and that of the other rows."""
    here, rest = unit.text(measured.rmse), unit.text(measured.rest)
    return (
        f"{measured.regime}: {measured.bin} {here} (other rows {rest}; {100 * measured.share:.0f} % of the squared "
        "error)"
    )


def describe_direction_errors(bins: Sequence[Bin], floor: float, unit: JointUnit) -> list[str]:
    """Return a joint's mean errors in both directions if they have opposite signs and exceed the noise."""
    ways = {measured.bin: measured for measured in bins if measured.regime == "direction"}
    if len(ways) < 2:
        return []
    back, forth = ways["negative"], ways["positive"]
    small = any(abs(way.mean) < max(SHOWN_FLOORS * floor, SIGNED_RATIO * way.rmse) for way in (back, forth))
    if small or back.mean * forth.mean > 0:
        return []
    ahead = "is ahead of" if forth.mean > 0 else "lags"
    ends = ", ".join(f"{unit.factor * way.mean:+.2f}{unit.mark}" for way in (back, forth))
    return [f"the model {ahead} the motion in both directions ({ends})"]
