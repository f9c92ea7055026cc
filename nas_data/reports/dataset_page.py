"""The page of a dataset: which states and commands it covers, rates and jitter, holes, episodes to look at."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.dataset.audits import audit_dataset
from nas_data.dataset.audits.timing import find_holes
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import TIME
from nas_data.dataset.summary import DatasetSummary, summarize
from nas_data.dataset.timing import LATE
from nas_data.errors import NasError
from nas_data.joint_units import JointUnit, joint_unit
from nas_data.reports.charts import Trace, axes, axis, dots, level, line
from nas_data.reports.page import Block, Chart, Facts, HtmlPage, HtmlTable, PageSection, Text
from nas_data.reports.style import BLACK, BLUE, LIGHT, ORANGE, STROKES, VERMILION, Stroke

BINS = 40  # of positions and of speeds
COLUMNS = 2  # joints side by side in a chart
OUTLYING = 4.0  # median absolute deviations of all episodes from which one is worth a look
SAME = 1e-6  # [s] spread of the steps below which they are even
MOST_EPISODES = 500  # rows of the table of episodes
SHOWN = 3  # episodes that are drawn
DENSITY = [[0.0, "#0072b200"], [0.02, "#0072b233"], [1.0, "#0072b2ff"]]


@dataclass(frozen=True)
class EpisodeFigures:
    """What is looked at in every episode, shape (E,) each.

    Attributes:
        seconds: Length [s].
        travel: Largest range of a joint, as a share of its range in the whole dataset.
        speed: Largest speed of a joint, as a share of its largest in the whole dataset.
        following: RMS of command minus position over joints, each over its range in the dataset; NaN where commands
            are no positions.
        late: Share of the steps that are off by more than 0.3 control periods; NaN without a clock.
    """

    seconds: np.ndarray
    travel: np.ndarray
    speed: np.ndarray
    following: np.ndarray
    late: np.ndarray

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """What they are called in tables, those that are known."""
        named = {
            "length [s]": self.seconds, "travel": self.travel, "top speed": self.speed,
            "command − position": self.following, "uneven steps": self.late,
        }  # fmt: skip
        return {name: values for name, values in named.items() if np.isfinite(values).all()}


def page_of_folder(folder: Path) -> HtmlPage:
    """Return the page of a dataset.

    Args:
        folder: A version's, or `datasets/NAME` for the newest version.

    Raises:
        DatasetNotFound: there is none.
        DatasetInvalid: it cannot be read.
    """
    summary = summarize(folder)
    title = f"Dataset {summary.name}"
    if summary.unusable:
        reason = PageSection("Not usable as it is", [Text(summary.unusable)])
        return HtmlPage(title, [PageSection("", [Text(lead(summary), lead=True)]), reason, rests_on(summary)])
    dataset = Dataset.load(summary.dataset)
    steps = time_steps(dataset)
    sections = [
        PageSection("", [Text(lead(summary), lead=True), *map(Text, summary.warnings)]),
        PageSection("Coverage of states", [*coverage_charts(dataset), ranges_table(dataset)]),
        PageSection("Coverage of commands", command_charts(dataset)),
        PageSection("Rates and jitter", timing_blocks(dataset, steps)),
        PageSection("Holes", hole_blocks(dataset, steps)),
        PageSection("Episodes to look at", episode_blocks(dataset, episode_figures(dataset, steps))),
        rests_on(summary),
    ]
    return HtmlPage(title, [section for section in sections if section.blocks])


def lead(summary: DatasetSummary) -> str:
    """Say in one sentence what was recorded."""
    frames, count = sum(summary.lengths), len(summary.lengths)
    joints = f" with {len(summary.joints)} joints" if summary.joints else ""
    commands = f", commanded in {summary.commands}" if summary.commands else ""
    paired = ", paired with a source's predictions" if summary.paired else ""
    return (
        f"{count} episode{'' if count == 1 else 's'} of {summary.robot}{joints}, {frames / summary.rate:.4g} s at "
        f"{summary.rate:g} Hz{commands}{paired}."
    )


def time_steps(dataset: Dataset) -> list[np.ndarray]:
    """Return the steps of the recorder's clock in each episode [s], shape (T − 1,) each; empty without a clock."""
    clock = dataset.columns.get(TIME)
    return [] if clock is None else [np.diff(clock[rows, 0]) for rows in dataset.episodes()]


def units(dataset: Dataset) -> list[JointUnit]:
    """Return the unit of each joint's positions."""
    return [joint_unit(joint, dataset.slides) for joint in dataset.joints]


def coverage_charts(dataset: Dataset) -> list[Chart]:
    """Return how often each joint was at which position at which speed."""
    n = len(dataset.joints)
    traces, panels = [], Panels(n)
    for place, (joint, unit) in enumerate(zip(dataset.joints, units(dataset), strict=True)):
        positions, speeds = (unit.factor * dataset.states[:, column] for column in (place, n + place))
        counts, x, y = np.histogram2d(positions, speeds, BINS)
        share = np.where(counts > 0, np.log10(np.maximum(counts, 1.0)), np.nan)
        traces.append(
            {
                "type": "heatmap",
                "x": (x[1:] + x[:-1]) / 2,
                "y": (y[1:] + y[:-1]) / 2,
                "z": share.T,
                "text": counts.T,
                "hovertemplate": "%{x:.3g}, %{y:.3g}<br>%{text:.0f} rows<extra></extra>",
                "colorscale": DENSITY,
                "showscale": False,
                "zmin": 0,
                **panels.place(place),
            }
        )
        panels.title(place, f"{joint} [{unit.mark.strip()}]")
    caption = (
        "Position (across) and speed in the same unit a second (upwards) of each joint; darker is more often. An "
        "effect that acts where nothing was recorded cannot be found."
    )
    return [Chart("states", caption, traces, {**panels.layout, "hovermode": "closest"}, panels.height)]


def command_charts(dataset: Dataset) -> list[Chart]:
    """Return how often each joint was commanded what, beside where it was, where commands are positions."""
    traces, panels = [], Panels(len(dataset.joints))
    for place, (joint, unit) in enumerate(zip(dataset.joints, units(dataset), strict=True)):
        is_position = dataset.kinds[place] == ".pos"
        factor = unit.factor if is_position else 1.0
        shown = {"command": (factor * dataset.commands[:, place], ORANGE)}
        if is_position:
            shown = {"measured": (factor * dataset.states[:, place], BLACK), **shown}
        edges = np.histogram_bin_edges(np.concatenate([values for values, _ in shown.values()]), BINS)
        for name, (values, colour) in shown.items():
            share = 100 * np.histogram(values, edges)[0] / len(values)
            steps = {"line": {"color": colour, "width": 1.6, "shape": "hvh"}, "showlegend": place == 0}
            traces.append(
                line((edges[1:] + edges[:-1]) / 2, share, name, STROKES[name], **steps, **panels.place(place))
            )
        unit_name = unit.mark.strip() if is_position else dataset.features["action"].units[place]
        panels.title(place, f"{joint} [{unit_name}]")
    return [
        Chart(
            "commands",
            "Share of the rows [%] with each command, and with each measured position.",
            traces,
            panels.layout,
            panels.height,
        )
    ]


class Panels:
    """A chart of several panels, one a joint, in rows of two."""

    def __init__(self, count: int) -> None:
        """Lay out a number of panels."""
        self.rows = -(-count // COLUMNS)
        self.height = 90 + 190 * self.rows
        self.layout: dict[str, object] = {}

    def place(self, number: int) -> dict[str, object]:
        """Return the axes of a panel, as a trace names them."""
        mark = str(number + 1) if number else ""
        return {"xaxis": f"x{mark}", "yaxis": f"y{mark}"}

    def title(self, number: int, text: str) -> None:
        """Place a panel and write below what it shows."""
        mark, (row, column) = str(number + 1) if number else "", divmod(number, COLUMNS)
        width, height = 1 / COLUMNS, 1 / self.rows
        top = 1 - row * height
        across = [column * width + (0.06 if column else 0.0), (column + 1) * width - (0.0 if column else 0.06)]
        upwards = [top - height + 62 / self.height, top]
        self.layout[f"xaxis{mark}"] = {
            "title": {"text": text, "standoff": 2, "font": {"size": 12}},
            "domain": across,
            "anchor": f"y{mark}",
        }
        self.layout[f"yaxis{mark}"] = {"domain": upwards, "anchor": f"x{mark}"}


def ranges_table(dataset: Dataset) -> HtmlTable:
    """Return the ranges of each joint's positions, speeds and commands."""
    n, rows = len(dataset.joints), []
    for place, (joint, unit) in enumerate(zip(dataset.joints, units(dataset), strict=True)):
        positions, speeds = unit.factor * dataset.states[:, place], unit.factor * np.abs(dataset.states[:, n + place])
        factor = unit.factor if dataset.kinds[place] == ".pos" else 1.0
        commands = factor * dataset.commands[:, place]
        turns = int((np.diff(np.sign(dataset.states[:, n + place])) != 0).sum())
        rows.append(
            (
                joint,
                unit.mark.strip(),
                f"{positions.min():.1f} … {positions.max():.1f}",
                f"{np.quantile(speeds, 0.95):.1f}",
                f"{speeds.max():.1f}",
                f"{commands.min():.2f} … {commands.max():.2f}",
                f"{turns}",
            )
        )
    headers = ("", "unit", "positions", "speed, 95 % below", "top speed", "commands", "reversals")
    return HtmlTable(headers, rows, "Speeds in the unit a second. Reversals: how often the speed changed its sign.")


def timing_blocks(dataset: Dataset, steps: Sequence[np.ndarray]) -> list[Block]:
    """Return how evenly the rows came."""
    if not steps or not sum(map(len, steps)):
        return [Text("The recording has no clock of its own (nas.time): rows count as evenly spaced.")]
    period, whole = 1 / dataset.fps, np.concatenate(steps)
    if np.ptp(whole) < SAME:
        return [
            Text(
                f"All rows are {1e3 * period:.4g} ms apart ({dataset.fps:g} Hz), as in a simulation or a resampled log."
            )
        ]
    uneven = np.abs(whole - period) > LATE * period
    counts, edges = np.histogram(1e3 * whole, 60)
    bars = {
        "type": "bar", "x": (edges[1:] + edges[:-1]) / 2, "y": counts, "marker": {"color": BLUE}, "showlegend": False,
        "name": "steps",
    }  # fmt: skip
    worst = np.array([1e3 * part.max() if len(part) else np.nan for part in steps])
    layout = axes("time from one row to the next [ms]", "steps", bargap=0.0)
    layout["yaxis"] = axis("steps", type="log", tickformat="~g")
    numbers = np.arange(len(steps))
    along = axes("episode", "longest step [ms]", shapes=[level(1e3 * period, "control period", LIGHT)])
    said = {
        "Rate": f"{dataset.fps:g} Hz promised, {1 / float(np.median(whole)):.4g} Hz measured (median)",
        "Jitter": f"{1e3 * float(whole.std()):.3g} ms standard deviation of the steps",
        "Steps": f"{1e3 * float(whole.min()):.3g} to {1e3 * float(whole.max()):.3g} ms",
        "Uneven": f"{100 * float(uneven.mean()):.2g} % of the steps are off by more than {LATE:g} control periods",
    }
    return [
        Facts(said),
        Chart("steps", "Time steps of the recorder's clock.", [bars], layout),
        Chart(
            "longest", "The longest step of each episode.", [dots(numbers, worst, "longest", STROKES["source"])], along
        ),
    ]


def hole_blocks(dataset: Dataset, steps: Sequence[np.ndarray]) -> list[Block]:
    """Return where nothing was measured for a while, and what the audits notice."""
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


def episode_figures(dataset: Dataset, steps: Sequence[np.ndarray]) -> EpisodeFigures:
    """Return what is looked at in every episode."""
    n, period = len(dataset.joints), 1 / dataset.fps
    positions, speeds = dataset.states[:, :n], np.abs(dataset.states[:, n : 2 * n])
    ranges, fastest = np.maximum(np.ptp(positions, axis=0), 1e-9), np.maximum(speeds.max(axis=0), 1e-9)
    episodes = list(dataset.episodes())
    if dataset.commands_positions and dataset.commands.shape[1] == n:
        errors = np.square((dataset.commands - positions) / ranges)
        following = np.array([np.sqrt(errors[rows].mean()) for rows in episodes])
    else:
        following = np.full(len(episodes), np.nan)
    late = [float((np.abs(part - period) > LATE * period).mean()) if len(part) else 0.0 for part in steps]
    return EpisodeFigures(
        seconds=dataset.lengths * period,
        travel=np.array([float((np.ptp(positions[rows], axis=0) / ranges).max()) for rows in episodes]),
        speed=np.array([float((speeds[rows] / fastest).max()) for rows in episodes]),
        following=following,
        late=np.array(late) if steps else np.full(len(episodes), np.nan),
    )


def reasons(figures: EpisodeFigures) -> dict[int, list[str]]:
    """Return the episodes that differ from the others, the most striking first, and in what."""
    found: dict[int, list[str]] = {}
    strength: dict[int, float] = {}
    for name, values in figures.columns.items():
        middle = float(np.median(values))
        scale = max(1.4826 * float(np.median(np.abs(values - middle))), 0.05 * abs(middle), 1e-3)
        for episode in np.flatnonzero(np.abs(values - middle) > OUTLYING * scale):
            direction = "high" if values[episode] > middle else "low"
            found.setdefault(int(episode), []).append(f"{direction} {name.partition(' [')[0]}")
            far = float(abs(values[episode] - middle) / scale)
            strength[int(episode)] = max(strength.get(int(episode), 0.0), far)
    return {episode: found[episode] for episode in sorted(found, key=lambda episode: -strength[episode])}


def episode_blocks(dataset: Dataset, figures: EpisodeFigures) -> list[Block]:
    """Return which episodes differ from the others, the most striking ones drawn, and all in a table."""
    striking = reasons(figures)
    told = [f"episode {episode} ({', '.join(why)})" for episode, why in striking.items()]
    said = f"These differ from the others: {'; '.join(told)}." if told else "No episode differs much from the others."
    columns = figures.columns
    rows = [
        (str(episode), *(f"{values[episode]:.3g}" for values in columns.values()), ", ".join(striking.get(episode, [])))
        for episode in range(min(dataset.n_episodes, MOST_EPISODES))
    ]
    note = (
        "Travel, top speed and command − position are shares of the joint's range, or of its largest speed, in the "
        "whole dataset; the joint with the largest share counts."
        + (
            f" Only the first {MOST_EPISODES} of {dataset.n_episodes} episodes."
            if dataset.n_episodes > len(rows)
            else ""
        )
    )
    drawn = [episode_chart(dataset, episode) for episode in (list(striking) or [0])[:SHOWN]]
    return [Text(said), *drawn, HtmlTable(("episode", *columns, "differs in"), rows, note)]


def episode_chart(dataset: Dataset, episode: int) -> Chart:
    """Return the positions and commands of all joints in an episode."""
    rows = dataset.episode(episode)
    time = np.arange(int(dataset.lengths[episode])) / dataset.fps
    traces: list[Trace] = []
    panels = Panels(len(dataset.joints))
    for place, (joint, unit) in enumerate(zip(dataset.joints, units(dataset), strict=True)):
        where = {**panels.place(place), "showlegend": place == 0}
        traces.append(line(time, unit.factor * dataset.states[rows, place], "measured", STROKES["measured"], **where))
        if dataset.kinds[place] == ".pos":
            stroke = {"line": {"color": VERMILION, "width": 1.2, "shape": "hv"}}
            command = unit.factor * dataset.commands[rows, place]
            traces.append(line(time, command, "command", Stroke(VERMILION), **stroke, **where))
        panels.title(place, f"{joint} [{unit.mark.strip()}]")
    return Chart(
        f"episode_{episode}", f"Episode {episode}: positions over time [s].", traces, panels.layout, panels.height
    )


def rests_on(summary: DatasetSummary) -> PageSection:
    """Return hashes, versions and where the dataset comes from."""
    entries: dict[str, str] = {
        "Folder": str(summary.dataset),
        "Content hash": summary.content_hash,
        "Joints": ", ".join(summary.joints),
        "Tasks": ", ".join(f"{task or 'unnamed'} ({count})" for task, count in summary.tasks.items()),
        "Derived when used": "; ".join(f"{key}: {how}" for key, how in summary.derived.items()),
        "Source": ", ".join(
            f"{key} {value}" for key, value in (summary.source or {}).items() if isinstance(value, str)
        ),
    }
    for name, provenance in summary.provenance:
        entries[f"Made: {name}"] = f"{provenance.how}, {provenance.when}"
    packages: Mapping[str, str] = summary.provenance[0][1].packages if summary.provenance else {}
    entries["Versions"] = ", ".join(f"{name} {version}" for name, version in packages.items())
    return PageSection("Hashes and versions", [Facts({name: value for name, value in entries.items() if value})])
