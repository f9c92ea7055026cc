"""Sections of a page about runs: training of models and policies, and the policies' scores on the target."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from nas_data.joint_units import SHARE
from nas_data.policies.compare import EXPERT_METHOD, SOURCE_METHOD
from nas_data.policies.intervals import compute_share
from nas_data.reports.charts import Trace, make_axes, make_axis, make_band, make_dots, make_line
from nas_data.reports.page import Block, Chart, HtmlTable, PageSection, Text
from nas_data.reports.runs import NAMED, NAMED_AND_LEARNED, LearningCurve, ModelRun, PolicyRun, collect_scores
from nas_data.reports.style import Stroke, choose_strokes

LEARNED_ON = {
    EXPERT_METHOD: "the target itself",
    SOURCE_METHOD: "the plain simulator",
    "augmented": "the simulator corrected by φ",
    "forward": "ψ alone",
    NAMED: "the simulator with the named effects",
    NAMED_AND_LEARNED: "the simulator with the named effects, corrected by φ",
}

OF_BOTH = ", each joint's over the spread of the positions of its kind, hinges or slides [%]"
MODELS_NOTE = "source + φ: the simulator, corrected by a network after each control step. ψ: a network in its place."


def make_models_chart(models: Sequence[ModelRun]) -> Chart:
    """Return the validation errors of models during training."""
    units = list(dict.fromkeys(model.unit for model in models))
    label = f"validation error [{units[0].mark.strip()}]" if len(units) == 1 and units[0] else "validation error"
    names = make_distinct_names(models)
    looks = choose_strokes(names)
    traces = []
    for name, model in zip(names, models, strict=True):
        updates, errors = np.array(model.errors, float).reshape(-1, 2).T
        traces.append(make_line(updates, errors, name, looks[name], mode="lines+markers"))
    what = "; or ".join(
        f"RMS position error of open-loop rollouts{OF_BOTH if unit is SHARE else f' [{unit.mark.strip()}]'}"
        if unit
        else "normalised error of one step, after teacher forcing"
        for unit in units
    )
    caption = f"Error while the models learned, on episodes held out for early stopping: {what}. The best is kept."
    layout = {"xaxis": make_axis("updates"), "yaxis": make_axis(label, rangemode="tozero")}
    return Chart("model_training", caption, traces, layout)


def make_distinct_names(models: Sequence[ModelRun]) -> list[str]:
    """Return a unique name for each model; equal names get their folder's name added."""
    names = [model.name for model in models]
    return [
        name if names.count(name) == 1 else f"{name} ({model.folder.name})"
        for name, model in zip(names, models, strict=True)
    ]


def make_models_section(models: Sequence[ModelRun]) -> PageSection:
    """Return the section about models."""
    rows = [
        (
            name,
            f"{model.best:.3f}{model.unit.mark if model.unit else ''}",
            f"{model.history[-1]['update']:.0f}" if model.history else "",
            f"{model.seconds:.0f} s",
            model.dataset,
            model.content_hash[:8],
        )
        for name, model in zip(make_distinct_names(models), models, strict=True)
    ]
    headers = ("model", "best validation error", "updates", "time", "learned from", "content hash")
    return PageSection("Models", [make_models_chart(models), HtmlTable(headers, rows, MODELS_NOTE)])


def make_learning_charts(groups: Mapping[str, Sequence[PolicyRun]]) -> list[Chart]:
    """Return return and success rate of policies during training: median over seeds, band from minimum to maximum."""
    looks = choose_strokes(list(groups))
    curves = {method: [run.curve for run in runs] for method, runs in groups.items()}
    caption = (
        "Return of the exploring policies, each in the environment in which it learned: median over seeds, and a band "
        "from the lowest to the highest."
    )
    steps = "control steps learned from [thousand]"
    returns = [
        trace
        for name, seeds in curves.items()
        for trace in make_learning_traces(name, seeds, "returns", 1, looks[name])
    ]
    success = [
        trace
        for name, seeds in curves.items()
        for trace in make_learning_traces(name, seeds, "success", 100, looks[name])
    ]
    return [
        Chart("learning_curves", caption, returns, make_axes(steps, "return of an episode")),
        Chart(
            "success",
            "Share of the episodes that reach the goal, likewise.",
            success,
            make_axes(steps, "episodes that reach the goal [%]"),
        ),
    ]


def make_learning_traces(
    name: str, seeds: Sequence[LearningCurve], what: str, factor: float, look: Stroke
) -> list[Trace]:
    """Return the median of several seeds and a band between their extremes, truncated to the shortest seed."""
    shortest = min(len(seed.frames) for seed in seeds)
    values = factor * np.stack([getattr(seed, what)[:shortest] for seed in seeds])
    known = ~np.isnan(values).all(axis=0)
    values, thousands = values[:, known], seeds[0].frames[:shortest][known] / 1000
    low, middle, high = np.nanmin(values, axis=0), np.nanmedian(values, axis=0), np.nanmax(values, axis=0)
    mode = "lines" if len(middle) > 1 else "markers"  # a single point makes no line
    return [*make_band(thousands, low, high, name, look), make_line(thousands, middle, name, look, mode=mode)]


def make_target_chart(groups: Mapping[str, Sequence[PolicyRun]]) -> list[Chart]:
    """Return every policy's mean return on the target: a row per method, a dot per seed; empty without evaluations."""
    returns = {method: collect_scores(runs) for method, runs in groups.items()}
    returns = {method: values for method, values in returns.items() if len(values)}
    if not returns:
        return []
    looks = choose_strokes(list(returns))
    traces = []
    for method, values in returns.items():
        bar = {"width": 3, "color": looks[method].colour}
        middle = {"size": 22, "symbol": "line-ns", "line": bar}
        traces.append(make_dots(values, [method] * len(values), method, looks[method], showlegend=False, opacity=0.75))
        median = f"{method}, median"
        traces.append(make_dots([np.median(values)], [method], median, looks[method], marker=middle, showlegend=False))
    layout = {
        "xaxis": make_axis("mean return of an episode on the target"),
        "yaxis": {"autorange": "reversed", "ticksuffix": " "},
        "hovermode": "closest",
    }
    caption = "The same policies on the target: one dot per seed, a bar at the median."
    return [Chart("returns_on_target", caption, traces, layout, height=120 + 42 * len(returns))]


def make_policies_table(
    groups: Mapping[str, Sequence[PolicyRun]], extra: Mapping[str, Mapping[str, float]]
) -> HtmlTable:
    """Return the policies' scores on the target, or of training if not evaluated; `extra` are untrained baselines."""
    judged = any(len(collect_scores(runs)) for runs in groups.values())
    headers = ["learned on", "return: median", "success", "lowest … highest", "seeds", "distance closed"]
    rows = [make_method_row(method, runs, groups, judged) for method, runs in groups.items()]
    rows += [
        (f"no learning: {name}", f"{score['return']:.2f}", f"{score['success_rate']:.0%}", "", "", "")
        for name, score in extra.items()
    ]
    note = (
        "On the target. Distance closed is the share of the way from source to expert, with a bootstrap interval over "
        "seeds, which is unreliable with few seeds."
        if judged
        else "In the last rollout of training, with exploration; no policy was evaluated on a target."
    )
    return HtmlTable(headers if judged else headers[:-1], rows if judged else [row[:-1] for row in rows], note)


def make_method_row(
    method: str, runs: Sequence[PolicyRun], groups: Mapping[str, Sequence[PolicyRun]], judged: bool
) -> tuple[str, ...]:
    """Return the table row of a method."""
    if judged:
        returns, success = collect_scores(runs), collect_scores(runs, "success_rate")
    else:
        returns = np.array([take_last(run.curve.returns) for run in runs])
        success = np.array([take_last(run.curve.success) for run in runs])
    if not len(returns):
        return (format_method(method), "", "", "", "", "")
    return (
        format_method(method),
        f"{np.median(returns):.2f}",
        f"{np.median(success):.0%}",
        f"{returns.min():.2f} … {returns.max():.2f}",
        str(len(returns)),
        format_share(method, groups) if judged else "",
    )


def format_method(method: str) -> str:
    """Return a method's name with its training environment."""
    word, _, rest = method.partition(" ")
    return f"{method}: {LEARNED_ON[word]}" if word in LEARNED_ON and not rest else method


def format_share(method: str, groups: Mapping[str, Sequence[PolicyRun]]) -> str:
    """Return the relative score of a method between source and expert as text."""
    if method in (SOURCE_METHOD, EXPERT_METHOD) or not {SOURCE_METHOD, EXPERT_METHOD} <= set(groups):
        return ""
    values, source, expert = (collect_scores(groups[name]) for name in (method, SOURCE_METHOD, EXPERT_METHOD))
    return str(compute_share(values, source, expert)) if len(values) and len(source) and len(expert) else ""


def take_last(values: np.ndarray) -> float:
    """Return the last value that is not NaN; NaN if there is none."""
    numbers = values[~np.isnan(values)]
    return float(numbers[-1]) if len(numbers) else math.nan


def make_policies_section(groups: Mapping[str, Sequence[PolicyRun]]) -> PageSection:
    """Return the section about policies."""
    runs = [run for group in groups.values() for run in group]
    environments = ", ".join(sorted({run.environment for run in runs}))
    frames = sorted({run.frames for run in runs})
    sizes = f"{frames[0]:,}" if len(frames) == 1 else f"{frames[0]:,} to {frames[-1]:,}"
    blocks: list[Block] = [
        Text(f"Policies: {len(runs)}, in {environments}, each learned from {sizes} control steps."),
        *make_learning_charts(groups),
        *make_target_chart(groups),
        make_policies_table(groups, {}),
    ]
    return PageSection("Policies", blocks)
