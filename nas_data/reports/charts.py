"""Elements of charts: lines, bands, dots and axes in the house colours, thinned to screen resolution."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from nas_data.reports.style import Stroke

MOST_POINTS = 2000  # points of a curve; more than the pixels of a screen, so that zooming in shows detail
DASHES = {"-": "solid", "--": "dash", "-.": "dashdot", ":": "dot"}
MEASURED_WIDTH = 4.0  # [px] width of a measured curve, so that it remains visible below a coinciding prediction
BAND_ALPHA = "2b"  # alpha of bands, as a colour's fourth byte

Trace = dict[str, object]


def make_line(x: np.ndarray, y: np.ndarray, name: str, look: Stroke, **more: object) -> Trace:
    """Return a curve.

    Args:
        x: Shape (T,).
        y: Shape (T,); NaN for gaps.
        name: Name in the legend; curves with one name are shown and hidden together.
        look: Colour and stroke.
        more: Further keys of plotly's `scatter`.
    """
    x, y = thin(x, y)
    stroke = {"color": look.colour, "width": look.width, "dash": DASHES[look.line]}
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "name": name,
        "legendgroup": name,
        "line": stroke,
        **more,
    }


def make_band(x: np.ndarray, low: np.ndarray, high: np.ndarray, name: str, look: Stroke) -> list[Trace]:
    """Return the area between two curves, shape (T,) each; it is shown and hidden with the curve of that name."""
    hidden = Stroke(look.colour, look.line, 0)
    kept = np.isfinite(low) & np.isfinite(high)
    quiet = {"showlegend": False, "hoverinfo": "skip"}
    below, above = (make_line(x[kept], edge[kept], name, hidden, **quiet) for edge in (low, high))
    return [below, {**above, "fill": "tonexty", "fillcolor": look.colour + BAND_ALPHA}]


def make_dots(
    x: Sequence[object] | np.ndarray, y: Sequence[object] | np.ndarray, name: str, look: Stroke, **more: object
) -> Trace:
    """Return one dot for each pair of values; other arguments as for `make_line`."""
    marker = {"color": look.colour, "size": 9}
    return {
        "type": "scatter", "mode": "markers", "x": np.asarray(x), "y": np.asarray(y), "name": name,
        "legendgroup": name, "marker": marker, **more,
    }  # fmt: skip


def make_axes(x: str, y: str, **more: object) -> dict[str, object]:
    """Return a layout with titled axes; further keys are plotly's."""
    return {"xaxis": make_axis(x), "yaxis": make_axis(y), **more}


def make_axis(title: str, **more: object) -> dict[str, object]:
    """Return an axis with its title; further keys are plotly's."""
    return {"title": {"text": title}, **more}


def make_log_axis(title: str, **more: object) -> dict[str, object]:
    """Return a logarithmic axis with plain numbers."""
    return make_axis(title, type="log", tickformat="~g", dtick="D2", **more)


def make_level_line(value: float, text: str, colour: str) -> dict[str, object]:
    """Return a shape of the layout: a horizontal line with a label."""
    label = {"text": text, "textposition": "end", "font": {"size": 11}}
    stroke = {"color": colour, "width": 1.4, "dash": "dot"}
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": value, "y1": value, "line": stroke, "label": label}


def thin(x: np.ndarray, y: np.ndarray, most: int = MOST_POINTS) -> tuple[np.ndarray, np.ndarray]:
    """Return at most `most` points of a curve (T,): minimum and maximum of each section, so that extremes survive."""
    if len(y) <= most:
        return x, y
    edges = np.linspace(0, len(y), most // 2 + 1).astype(int)
    low, high = np.where(np.isnan(y), np.inf, y), np.where(np.isnan(y), -np.inf, y)
    kept = [
        start + place
        for start, end in pairwise(edges)
        for place in sorted({int(low[start:end].argmin()), int(high[start:end].argmax())})
    ]
    return x[kept], y[kept]


def make_spread(x: np.ndarray, values: Mapping[str, np.ndarray], looks: Mapping[str, Stroke]) -> list[Trace]:
    """Return the median of rows (3, T) with a band between its quartiles (first and last row), by name."""
    bands = [trace for name, (low, _, high) in values.items() for trace in make_band(x, low, high, name, looks[name])]
    return bands + [make_line(x, middle, name, looks[name]) for name, (_, middle, _) in values.items()]


def make_motion_chart(
    time: np.ndarray,
    measured: np.ndarray,
    predicted: Mapping[str, np.ndarray],
    command: np.ndarray | None,
    labels: tuple[str, str],
    looks: Mapping[str, Stroke],
    floor: float = 0.0,
) -> tuple[list[Trace], dict[str, object]]:
    """Return measured and predicted motion of one joint, with the errors below, and the layout.

    Args:
        time: Time since the start [s], shape (T,).
        measured: Measured positions in display units, shape (T,).
        predicted: Predicted positions by name, shape (T,) each.
        command: Commanded positions in display units, shape (T,); None for other commands.
        labels: Title of the upper vertical axis, and unit of the errors.
        looks: Strokes by name, including `measured` and `command`.
        floor: Noise floor in display units, drawn as a band about zero.
    """
    steps = {"line": {"color": looks["command"].colour, "width": 1.2, "shape": "hv"}}
    traces = [] if command is None else [make_line(time, command, "command", looks["command"], **steps)]
    wide = {"line": {"color": looks["measured"].colour, "width": MEASURED_WIDTH}}
    traces.append(make_line(time, measured, "measured", looks["measured"], **wide))
    for name, values in predicted.items():
        traces.append(make_line(time, values, name, looks[name]))
        traces.append(make_line(time, values - measured, name, looks[name], yaxis="y2", showlegend=False))
    noise = {
        "type": "rect",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "yref": "y2",
        "y0": -floor,
        "y1": floor,
        "layer": "below",
    }
    layout: dict[str, object] = {
        "xaxis": make_axis("time since the start of the episode [s]", anchor="y2"),
        "yaxis": make_axis(labels[0], domain=[0.42, 1.0]),
        "yaxis2": make_axis(f"error [{labels[1]}]", domain=[0.0, 0.35]),
        "shapes": [{**noise, "line": {"width": 0}, "fillcolor": "#99999955"}] if floor else [],
    }
    return traces, layout
