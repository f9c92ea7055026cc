"""Charts of a dataset's page: coverage of states and commands, steps of the clock, episodes."""

from collections.abc import Sequence

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.joint_units import JointUnit, find_joint_unit
from nas_data.reports.charts import Trace, make_axes, make_axis, make_dots, make_level_line, make_line
from nas_data.reports.page import Chart
from nas_data.reports.style import BLUE, LIGHT, STROKES, VERMILION, Stroke

BINS = 40  # of histograms of positions and speeds
STEP_BINS = 60  # of the histogram of the clock's steps
COLUMNS = 2  # panels per row
GAP = 0.08  # margin of a panel towards the panel beside it, for the numbers of an axis, as a share of the width
COMMAND = Stroke(VERMILION, width=1.4)  # a solid line: dots, as in other figures, would hide the steps
DENSITY = [[0.0, "#0072b200"], [0.02, "#0072b233"], [1.0, "#0072b2ff"]]


class Panels:
    """A chart of several panels, one per joint, two per row."""

    def __init__(self, count: int) -> None:
        """Lay out `count` panels."""
        self.rows = -(-count // COLUMNS)
        self.height = 90 + 190 * self.rows
        self.layout: dict[str, object] = {}

    def place(self, number: int) -> dict[str, object]:
        """Return the axes of a panel as keys of a trace."""
        mark = str(number + 1) if number else ""
        return {"xaxis": f"x{mark}", "yaxis": f"y{mark}"}

    def title(self, number: int, text: str) -> None:
        """Position a panel and set the title of its horizontal axis."""
        mark, (row, column) = str(number + 1) if number else "", divmod(number, COLUMNS)
        width, height = 1 / COLUMNS, 1 / self.rows
        top = 1 - row * height
        across = [column * width + (GAP if column else 0.0), (column + 1) * width - (0.0 if column else GAP)]
        upwards = [top - height + 62 / self.height, top]
        self.layout[f"xaxis{mark}"] = {
            "title": {"text": text, "standoff": 2, "font": {"size": 12}},
            "domain": across,
            "anchor": f"y{mark}",
        }
        self.layout[f"yaxis{mark}"] = {"domain": upwards, "anchor": f"x{mark}"}


def list_joint_units(dataset: Dataset) -> dict[str, JointUnit]:
    """Return the unit of each joint's positions."""
    return {joint: find_joint_unit(joint, dataset.slides) for joint in dataset.joints}


def make_coverage_chart(dataset: Dataset) -> Chart:
    """Return a histogram of position and speed for each joint."""
    n = len(dataset.joints)
    traces, panels = [], Panels(n)
    for place, (joint, unit) in enumerate(list_joint_units(dataset).items()):
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
        "One panel per joint: position on the horizontal axis, speed [the same unit per second] on the vertical one. "
        "The stronger the colour, the more rows. An effect that acts where nothing was recorded cannot be found."
    )
    room = {"l": 10, "r": 10, "t": 34, "b": 10}  # [px] above the panels for the buttons, without a legend there
    layout = {**panels.layout, "hovermode": "closest", "margin": room}
    return Chart("states", caption, traces, layout, panels.height)


def make_command_chart(dataset: Dataset) -> Chart:
    """Return a histogram of each joint's commands, with its positions if commands are positions."""
    traces, panels = [], Panels(len(dataset.joints))
    for place, (joint, unit) in enumerate(list_joint_units(dataset).items()):
        is_position = dataset.kinds[place] == ".pos"
        factor = unit.factor if is_position else 1.0
        shown = {"command": (factor * dataset.commands[:, place], COMMAND)}
        if is_position:
            shown = {"measured": (factor * dataset.states[:, place], STROKES["measured"]), **shown}
        edges = np.histogram_bin_edges(np.concatenate([values for values, _ in shown.values()]), BINS)
        for name, (values, look) in shown.items():
            share = 100 * np.histogram(values, edges)[0] / len(values)
            steps = {"line": {"color": look.colour, "width": 1.4, "shape": "hv"}, "showlegend": place == 0}
            traces.append(make_line(edges, np.append(share, share[-1]), name, look, **steps, **panels.place(place)))
        unit_name = unit.mark.strip() if is_position else dataset.features["action"].units[place]
        panels.title(place, f"{joint} [{unit_name}]")
    caption = "Share of the rows [%] by command, and by measured position."
    return Chart("commands", caption, traces, panels.layout, panels.height)


def make_step_charts(steps: Sequence[np.ndarray], period: float) -> list[Chart]:
    """Return a histogram of the clock's steps [s], and the longest step of each episode with the control period [s]."""
    counts, edges = np.histogram(1e3 * np.concatenate(steps), STEP_BINS)
    bars = {
        "type": "bar", "x": (edges[1:] + edges[:-1]) / 2, "y": counts, "marker": {"color": BLUE}, "showlegend": False,
        "name": "steps",
    }  # fmt: skip
    layout = make_axes("time from one row to the next [ms]", "steps", bargap=0.0)
    layout["yaxis"] = make_axis("steps", type="log", tickformat="~g")
    worst = np.array([1e3 * part.max() if len(part) else np.nan for part in steps])
    longest = make_dots(np.arange(len(steps)), worst, "longest", STROKES["source"])
    along = make_axes("episode", "longest step [ms]", shapes=[make_level_line(1e3 * period, "control period", LIGHT)])
    return [
        Chart("steps", "Time steps of the recorder's clock.", [bars], layout),
        Chart("longest", "The longest step of each episode.", [longest], along),
    ]


def make_episode_chart(dataset: Dataset, episode: int) -> Chart:
    """Return the positions and commands of all joints in an episode."""
    rows = dataset.episode(episode)
    time = np.arange(int(dataset.lengths[episode])) / dataset.fps
    traces: list[Trace] = []
    panels = Panels(len(dataset.joints))
    for place, (joint, unit) in enumerate(list_joint_units(dataset).items()):
        where = {**panels.place(place), "showlegend": place == 0}
        traces.append(
            make_line(time, unit.factor * dataset.states[rows, place], "measured", STROKES["measured"], **where)
        )
        if dataset.kinds[place] == ".pos":
            stroke = {"line": {"color": COMMAND.colour, "width": COMMAND.width, "shape": "hv"}}
            command = unit.factor * dataset.commands[rows, place]
            traces.append(make_line(time, command, "command", COMMAND, **stroke, **where))
        panels.title(place, f"{joint} [{unit.mark.strip()}]")
    return Chart(
        f"episode_{episode}", f"Episode {episode}: positions over time [s].", traces, panels.layout, panels.height
    )
