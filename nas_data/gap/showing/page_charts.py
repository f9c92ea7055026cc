"""Charts of a gap report with captions."""

from collections.abc import Mapping, Sequence

import numpy as np

from nas_data.atomic_file import make_file_names
from nas_data.count_of import join_items
from nas_data.gap.report import GapReport
from nas_data.gap.report_parts import Bin
from nas_data.gap.showing.figures import (
    AFTER,
    BEFORE,
    FLOOR,
    LOOKS,
    PLACEBO,
    PLAIN,
    RETUNED,
    has_torque_commands,
    select_joint_models,
    select_models,
)
from nas_data.gap.showing.page_words import format_value
from nas_data.gap.showing.series import Series
from nas_data.gap.windows import describe_windows
from nas_data.joint_units import JointUnit, find_joint_unit
from nas_data.reports.charts import (
    Trace,
    make_axis,
    make_dots,
    make_level_line,
    make_log_axis,
    make_motion_chart,
    make_spread,
)
from nas_data.reports.page import Chart
from nas_data.reports.style import BLACK, GREEN, LIGHT, STROKES, Stroke

LEARNED = "names + φ"
LOOK_OF = {**STROKES, **LOOKS}
SYMBOLS = {BEFORE: "circle", RETUNED: "square-open", PLAIN: "triangle-down", AFTER: "diamond", PLACEBO: "triangle-up"}
TITLES = {BEFORE: "before (stock model)", RETUNED: "retuned (no name)"}
DELIVERED = {"names and plain": "names and plain fit", "plain": "plain fit", "given": "as given"}
HEAT = [[0.0, "#ffffd9"], [0.3, "#fecc5c"], [0.65, "#f03b20"], [1.0, "#800026"]]
MIN_COLOUR_SCALE = 3.0  # smallest maximum of the colour scale [noise floors], so that small gaps do not look large
WINDOW = 0.1  # [s] over which errors are averaged when drawn over time
QUARTILES = (0.25, 0.5, 0.75)


def draw_model_errors(report: GapReport, series: Series) -> Chart:
    """Return the held-out errors of all models, φ, and the floor."""
    shown = select_models(report, series)
    content = "names" if report.effects and report.gap.delivered == "plain" else report.gap.delivered or "names"
    titles = {**TITLES, AFTER: f"after ({DELIVERED.get(content, 'names')})"}
    made = {titles.get(name, name): (series.by_episode(values), LOOKS[name]) for name, values in shown.items()}
    traces = [make_bar(series, name, values, look) for name, (values, look) in made.items()]
    if report.shares and report.shares.learned is not None and report.shares.left is not None:
        floor = series.overall_floor
        first = float(np.sqrt(np.mean(series.by_episode(series.before) ** 2)))
        left = np.sqrt(floor**2 + report.shares.left * max(first**2 - floor**2, 0.0))
        traces.append(make_bar(series, LEARNED, np.array([left]), Stroke(GREEN)))
    traces.append(make_bar(series, FLOOR, np.array([series.overall_floor]), Stroke(LIGHT)))
    return draw_bar_chart(
        "errors",
        f"Error of each model on {describe_windows(series.episodes, 'held-out')}. Thin lines reach from the best "
        f"{'episode' if len(np.unique(series.episodes)) == len(series.episodes) else 'window'} to the worst. "
        f"{explain_legend(report)}.",
        traces,
        f"RMSE over {series.over}",
    )


def draw_placebo_errors(series: Series) -> list[Chart]:
    """Return the error of the placebo beside before and after; empty without one."""
    if series.placebo is None:
        return []
    made = {BEFORE: series.before, PLACEBO: series.placebo, AFTER: series.after}
    traces = [make_bar(series, name, series.by_episode(values), LOOKS[name]) for name, values in made.items()]
    traces.append(make_bar(series, FLOOR, np.array([series.overall_floor]), Stroke(LIGHT)))
    return [
        draw_bar_chart(
            "placebo",
            "The same episodes, with a wrong name in the right one's place.",
            traces,
            f"RMSE over {series.over}",
        )
    ]


def make_bar(series: Series, name: str, errors: np.ndarray, look: Stroke) -> Trace:
    """Return the bar of a model: its RMSE, with a line from its best to its worst episode.

    Args:
        series: Decides the unit.
        name: Name of the model.
        errors: Error of each episode, shape (E,).
        look: Style.
    """
    shown = series.shown(errors)
    whole = float(np.sqrt(np.mean(shown**2)))
    whisker = {"type": "data", "symmetric": False, "array": [float(shown.max()) - whole]}
    whisker |= {"arrayminus": [whole - float(shown.min())], "thickness": 1.2, "color": LIGHT}
    return {
        "type": "bar",
        "orientation": "h",
        "x": [whole],
        "y": [f"{name}: {whole:.3g}{series.kinds[0][0].mark}"],
        "name": name,
        "marker": {"color": look.colour},
        "showlegend": False,
        **({"error_x": whisker} if len(shown) > 1 else {}),
    }


def draw_bar_chart(name: str, caption: str, traces: Sequence[Trace], title: str) -> Chart:
    """Return a chart of horizontal bars, the first on top."""
    layout = {
        "xaxis": make_axis(title, rangemode="tozero"),
        "yaxis": {"autorange": "reversed", "ticksuffix": " "},
        "hovermode": "closest",
    }
    return Chart(name, caption, traces, layout, height=90 + 42 * len(traces))


def explain_legend(report: GapReport) -> str:
    """Explain the names in the legends."""
    parts = ["Before: the given model", "retuned: its own parameters fitted, nothing added"]
    parts += ["plain fit: every smooth parameter of every joint fitted, no name given"]
    return "; ".join(parts + (["after: with the named effects"] if report.effects else []))


def draw_joint_errors(report: GapReport, series: Series) -> list[Chart]:
    """Return the held-out error of each joint and model; hinges and slides have separate charts."""
    shown = select_models(report, series)
    return [draw_errors_of_kind(series, shown, unit, chosen) for unit, chosen in series.kinds]


def draw_errors_of_kind(series: Series, shown: Mapping[str, np.ndarray], unit: JointUnit, chosen: np.ndarray) -> Chart:
    """Return the errors of joints of one kind."""
    names = [series.joints[joint] for joint in chosen]
    rows = {name: unit.factor * series.drawn_by_joint(made)[chosen] for name, made in shown.items()}
    traces = [
        make_dots(
            names, values, name, LOOKS[name], marker={"color": LOOKS[name].colour, "size": 10, "symbol": SYMBOLS[name]}
        )
        for name, values in rows.items()
    ]
    floor = {"color": BLACK, "size": 26, "symbol": "line-ew", "line": {"width": 2, "color": BLACK}}
    traces.append(make_dots(names, unit.factor * series.floor[chosen], FLOOR, Stroke(BLACK), marker=floor))
    layout = {"xaxis": {}, "yaxis": make_log_axis(f"RMSE [{unit.mark.strip()}]")}
    return Chart(
        f"errors_of_{unit.kind}", f"Error of each joint on the held-out episodes: {unit.kind}.", traces, layout
    )


def draw_errors_over_time(report: GapReport, series: Series) -> Chart:
    """Return errors over the time since the start of an episode."""
    shown = {
        name: series.shown(series.in_time(made, WINDOW)) for name, made in select_joint_models(report, series).items()
    }
    reached = series.counts.any(axis=0)  # the recording may have held longer episodes, which are not drawn
    quartiles = {name: np.nanquantile(rows[:, reached], QUARTILES, axis=0) for name, rows in shown.items()}
    layout = {
        "xaxis": make_axis("time since the start of an episode [s]"),
        "yaxis": make_log_axis(f"RMS error over {series.over}"),
        "shapes": [make_level_line(float(series.shown(np.array(series.overall_floor))), FLOOR, BLACK)],
    }
    caption = (
        "Error over the time since the start of an episode: median over the held-out episodes, band from the lower to "
        "the upper quartile. Every episode is predicted from its first pose and its commands alone."
    )
    return Chart("error_over_time", caption, make_spread(series.time[reached], quartiles, LOOKS), layout)


def draw_joint_charts(report: GapReport, series: Series) -> list[Chart]:
    """Return the motion of every joint, largest gap first."""
    ratios = series.by_joint(series.before) / series.floor
    return [draw_joint_chart(report, series, int(place)) for place in np.argsort(-ratios)]


def draw_joint_chart(report: GapReport, series: Series, joint: int) -> Chart:
    """Return the motion of one joint in its worst held-out episode."""
    shown, name, episode = select_joint_models(report, series), series.joints[joint], series.worst_episode(joint)
    unit, rows = find_joint_unit(name, series.slides), series.counts[episode]
    curves = {label: unit.factor * values[episode, rows, joint] for label, values in shown.items()}
    command = None if has_torque_commands(report) else unit.factor * series.command[episode, rows, joint]
    traces, layout = make_motion_chart(
        series.time[rows],
        unit.factor * series.measured[episode, rows, joint],
        curves,
        command,
        (f"{name} [{unit.mark.strip()}]", unit.mark.strip()),
        LOOK_OF,
        unit.factor * float(series.floor[joint]),
    )
    aside = [{**trace, "visible": "legendonly"} if trace["name"] == PLACEBO else trace for trace in traces]
    errors = [f"{label} {format_value(series.by_joint(values)[joint], unit.si)}" for label, values in shown.items()]
    caption = (
        f"{name} in episode {series.episodes[episode]}, the held-out episode that the given model predicts worst. The "
        f"grey band is the noise floor. Error over all held-out episodes: {join_items(errors)}."
    )
    return Chart("joint_" + make_file_names(series.joints)[name], caption, aside, layout, height=520)


def draw_regimes_chart(report: GapReport) -> list[Chart]:
    """Return the heat map of errors by joint and condition; empty without data."""
    bins: Sequence[Bin] = report.find.regimes if report.find else ()
    if not bins:
        return []
    joints = list(dict.fromkeys(entry.joint for entry in bins))
    places = list(dict.fromkeys(f"{entry.regime}: {entry.bin}" for entry in bins))
    ratios, texts = np.full((len(places), len(joints)), np.nan), np.full((len(places), len(joints)), "", object)
    for entry in bins:
        where = places.index(f"{entry.regime}: {entry.bin}"), joints.index(entry.joint)
        ratios[where] = entry.ratio_to_noise
        digits = 1 if entry.ratio_to_noise < 100 else 0
        texts[where] = f"{entry.ratio_to_noise:.{digits}f}{'*' if entry.significant else ''}"
    top = max(MIN_COLOUR_SCALE, float(np.nanmax(ratios)))
    ticks = [value for value in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if value <= top]
    scale = {
        "tickvals": np.log10(ticks),
        "ticktext": list(map(str, ticks)),
        "thickness": 12,
        "title": {"text": "× noise"},
    }
    heat: Trace = {
        "type": "heatmap", "x": joints, "y": places, "z": np.log10(np.clip(ratios, 1.0, None)), "text": texts,
        "texttemplate": "%{text}", "hovertemplate": "%{x}<br>%{y}<br>%{text} × noise<extra></extra>",
        "zmin": 0.0, "zmax": float(np.log10(top)), "colorscale": HEAT, "xgap": 1, "ygap": 1, "colorbar": scale,
    }  # fmt: skip
    layout = {
        "xaxis": {"side": "top", "showgrid": False},
        "yaxis": {"autorange": "reversed", "showgrid": False},
        "hovermode": "closest",
    }
    caption = (
        "Error of the given model under each condition, in noise floors; 1 is perfect. A star marks a significant "
        "difference from the joint's other rows."
    )
    return [Chart("regimes", caption, [heat], layout, height=110 + 26 * len(places))]
