"""Page of a dataset: coverage of states and commands, rates and jitter, gaps, unusual episodes."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from nas_data.count_of import count_of
from nas_data.dataset.audits import audit_dataset
from nas_data.dataset.audits.timing import find_holes
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import TIME
from nas_data.dataset.summary import DatasetSummary, describe_source, summarize
from nas_data.dataset.timing import LATE
from nas_data.errors import NasError
from nas_data.reports.dataset_charts import (
    list_joint_units,
    make_command_chart,
    make_coverage_chart,
    make_episode_chart,
    make_step_charts,
)
from nas_data.reports.page import Block, Facts, HtmlPage, HtmlTable, PageSection, Text

OUTLYING = 4.0  # median absolute deviations above which an episode is unusual


def measure_steps(dataset: Dataset) -> list[np.ndarray]:
    """Return the steps of the recorder's clock in each episode [s], shape (T − 1,) each; empty without a clock."""
    clock = dataset.columns.get(TIME)
    return [] if clock is None else [np.diff(clock[rows, 0]) for rows in dataset.episodes()]


def measure_episodes(dataset: Dataset, steps: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Return quantities of every episode, by name in tables, shape (E,) each.

    They are: its length; the largest range and speed of a joint, relative to those of the dataset; for position
    commands, the RMS of command minus position, relative to the joints' ranges; with a clock, the share of steps that
    are off by more than `LATE` control periods.

    Args:
        dataset: E episodes.
        steps: Steps of the clock from `measure_steps`.
    """
    n, period = len(dataset.joints), 1 / dataset.fps
    positions, speeds = dataset.states[:, :n], np.abs(dataset.states[:, n : 2 * n])
    ranges, fastest = np.maximum(np.ptp(positions, axis=0), 1e-9), np.maximum(speeds.max(axis=0), 1e-9)
    episodes = list(dataset.episodes())
    measured = {
        "length [s]": dataset.lengths * period,
        "travel": np.array([float((np.ptp(positions[rows], axis=0) / ranges).max()) for rows in episodes]),
        "top speed": np.array([float((speeds[rows] / fastest).max()) for rows in episodes]),
    }
    if dataset.positional.any() and dataset.commands.shape[1] == n:
        errors = np.square((dataset.commands - positions) / ranges)[:, dataset.positional]
        measured["command − position"] = np.array([np.sqrt(errors[rows].mean()) for rows in episodes])
    if steps:
        late = [float((np.abs(part - period) > LATE * period).mean()) if len(part) else 0.0 for part in steps]
        measured["uneven steps"] = np.array(late)
    return {name: values for name, values in measured.items() if np.isfinite(values).all()}


def find_differing(measured: Mapping[str, np.ndarray]) -> dict[int, list[str]]:
    """Return the unusual episodes, the most unusual first, with their unusual quantities."""
    found: dict[int, list[str]] = {}
    strength: dict[int, float] = {}
    for name, values in measured.items():
        middle = float(np.median(values))
        scale = max(1.4826 * float(np.median(np.abs(values - middle))), 0.05 * abs(middle), 1e-3)
        for episode in np.flatnonzero(np.abs(values - middle) > OUTLYING * scale):
            direction = "high" if values[episode] > middle else "low"
            found.setdefault(int(episode), []).append(f"{direction} {name.partition(' [')[0]}")
            far = float(abs(values[episode] - middle) / scale)
            strength[int(episode)] = max(strength.get(int(episode), 0.0), far)
    return {episode: found[episode] for episode in sorted(found, key=lambda episode: -strength[episode])}


STEP_TOLERANCE = 1e-6  # [s] spread of the steps below which they are even
MOST_EPISODES = 500  # rows of the table of episodes
SHOWN = 3  # episodes that are drawn


def read_page(folder: Path) -> HtmlPage:
    """Return the page of a dataset: of a version's folder, or of `datasets/NAME`, its newest version.

    Raises:
        DatasetNotFound: there is no dataset.
        DatasetInvalid: it cannot be read.
    """
    summary = summarize(folder)
    title = f"Dataset {summary.name}"
    if summary.unusable:
        reason = PageSection("Not usable as it is", [Text(summary.unusable)])
        return HtmlPage(
            title, [PageSection("", [Text(format_lead(summary), lead=True)]), reason, make_provenance_section(summary)]
        )
    dataset = Dataset.load(summary.dataset)
    steps = measure_steps(dataset)
    sections = [
        PageSection("", [Text(format_lead(summary), lead=True), *map(Text, summary.warnings)]),
        PageSection("Coverage of states", [make_coverage_chart(dataset), make_ranges_table(dataset)]),
        PageSection("Coverage of commands", [make_command_chart(dataset)]),
        PageSection("Rates and jitter", make_timing_blocks(dataset, steps)),
        PageSection("Missing rows", make_hole_blocks(dataset, steps)),
        PageSection("Episodes to look at", make_episode_blocks(dataset, measure_episodes(dataset, steps))),
        make_provenance_section(summary),
    ]
    return HtmlPage(title, [section for section in sections if section.blocks])


def format_lead(summary: DatasetSummary) -> str:
    """Describe the recording in one sentence."""
    frames, count = sum(summary.lengths), len(summary.lengths)
    joints = f" with {count_of(len(summary.joints), 'joint')}" if summary.joints else ""
    commands = f", with {summary.commands} commands" if summary.commands else ""
    paired = ", paired with a source's predictions" if summary.paired else ""
    return (
        f"{count_of(count, 'episode')} of {summary.robot}{joints}, {frames / summary.rate:.4g} s at "
        f"{summary.rate:g} Hz{commands}{paired}."
    )


def make_ranges_table(dataset: Dataset) -> HtmlTable:
    """Return the ranges of each joint's positions, speeds and commands."""
    n, rows = len(dataset.joints), []
    for place, (joint, unit) in enumerate(list_joint_units(dataset).items()):
        positions, speeds = unit.factor * dataset.states[:, place], unit.factor * np.abs(dataset.states[:, n + place])
        factor = unit.factor if dataset.kinds[place] == ".pos" else 1.0
        commands = factor * dataset.commands[:, place]
        turns = int((np.diff(np.sign(dataset.states[:, n + place])) != 0).sum())
        rows.append(
            (
                joint,
                unit.mark.strip(),
                format_range(positions, 1),
                f"{np.quantile(speeds, 0.95):.1f}",
                f"{speeds.max():.1f}",
                format_range(commands, 2),
                f"{turns}",
            )
        )
    headers = ("", "unit", "positions", "95 % of speeds below", "top speed", "commands", "reversals")
    return HtmlTable(headers, rows, "Speeds are in this unit per second. Reversals are changes of the speed's sign.")


def format_range(values: np.ndarray, digits: int) -> str:
    """Return the smallest and the largest value."""
    return f"{values.min():.{digits}f} … {values.max():.{digits}f}".replace("-", "−")


def make_timing_blocks(dataset: Dataset, steps: Sequence[np.ndarray]) -> list[Block]:
    """Return how even the rows are in time."""
    if not steps or not sum(map(len, steps)):
        return [Text("The recording has no clock of its own (nas.time): rows count as evenly spaced.")]
    period, whole = 1 / dataset.fps, np.concatenate(steps)
    if np.ptp(whole) < STEP_TOLERANCE:
        apart = f"{1e3 * period:.4g} ms apart ({dataset.fps:g} Hz)"
        return [Text(f"All rows are {apart}, as in a simulation or a resampled log.")]
    uneven = np.abs(whole - period) > LATE * period
    facts = {
        "Rate": f"{dataset.fps:g} Hz given, {1 / float(np.median(whole)):.4g} Hz measured (median)",
        "Jitter": f"{1e3 * float(whole.std()):.3g} ms standard deviation of the steps",
        "Steps": f"{1e3 * float(whole.min()):.3g} to {1e3 * float(whole.max()):.3g} ms",
        "Uneven": f"{100 * float(uneven.mean()):.2g} % of the steps are off by more than {LATE:g} control periods",
    }
    return [Facts(facts), *make_step_charts(steps, period)]


def make_hole_blocks(dataset: Dataset, steps: Sequence[np.ndarray]) -> list[Block]:
    """Return the gaps in the measurement and the findings of the audits."""
    rows = [
        (f"episode {episode}", f"{part[:place].sum():.2f} s", f"{1e3 * part[place]:.0f} ms")
        for episode, part in enumerate(steps)
        for place in np.flatnonzero(find_holes(part, 1 / dataset.fps))
    ]
    blocks: list[Block] = [HtmlTable(("", "after", "length"), rows)] if rows else [Text("There are none.")]
    try:
        found = audit_dataset(dataset)
    except NasError as error:
        return [*blocks, Text(str(error))]
    noticed = [(finding.file, finding.check.replace("_", " "), finding.message) for finding in found]
    return [*blocks, HtmlTable(("", "check", "what the audits notice"), noticed)] if noticed else blocks


def make_episode_blocks(dataset: Dataset, measured: Mapping[str, np.ndarray]) -> list[Block]:
    """Return the unusual episodes, charts of the first ones, and a table of all episodes."""
    striking = find_differing(measured)
    names = [f"episode {episode} ({', '.join(why)})" for episode, why in striking.items()]
    lead = f"These differ from the others: {'; '.join(names)}." if names else "No episode differs much from the others."
    listed = range(min(dataset.n_episodes, MOST_EPISODES))
    rows = [
        (str(place), *(f"{values[place]:.3f}" for values in measured.values()), ", ".join(striking.get(place, [])))
        for place in listed
    ]
    width = 1 + len(measured) + bool(striking)  # without unusual episodes, the last column is empty
    note = (
        "Travel and command − position are relative to the range of a joint in the whole dataset, top speed to its "
        "largest speed; travel and top speed are those of the joint with the largest value. Uneven steps are a share."
    )
    if len(listed) < dataset.n_episodes:
        note += f" Only the first {MOST_EPISODES} of {dataset.n_episodes} episodes."
    drawn = [make_episode_chart(dataset, episode) for episode in (list(striking) or [0])[:SHOWN]]
    return [
        Text(lead),
        *drawn,
        HtmlTable(("episode", *measured, "differs in")[:width], [row[:width] for row in rows], note),
    ]


def make_provenance_section(summary: DatasetSummary) -> PageSection:
    """Return hashes, versions and origin of the dataset."""
    entries: dict[str, str] = {
        "Folder": str(summary.dataset),
        "Content hash": summary.content_hash,
        "Joints": ", ".join(summary.joints),
        "Tasks": ", ".join(f"{task or 'unnamed'} ({count})" for task, count in summary.tasks.items()),
        "Derived when used": "; ".join(f"{key}: {how}" for key, how in summary.derived.items()),
        "Source": describe_source(summary.source),
    }
    for name, provenance in summary.provenance:
        entries[f"Made: {name}"] = f"{provenance.how}, {provenance.when}"
    packages: Mapping[str, str] = summary.provenance[0][1].packages if summary.provenance else {}
    entries["Versions"] = ", ".join(f"{name} {version}" for name, version in packages.items())
    return PageSection("Hashes and versions", [Facts({name: value for name, value in entries.items() if value})])
