"""HTML page of a trial: how many names are right, each name beside the truth, and the sizes with their intervals."""

from nas_data.gap.showing.page_words import capitalise, format_value
from nas_data.reports.charts import make_axis, make_dots
from nas_data.reports.page import Block, Chart, HtmlPage, HtmlTable, PageSection, Text
from nas_data.reports.style import BLUE, LIGHT, Stroke
from nas_data.studies.trial.outcome import NOTHING, RIGHT_SIZE, SURE, ChangeOutcome, TrialOutcome

HEADERS = ("change", "what was changed", "true", "named", "size off by", "unsure")
ROW_HEIGHT, FRAME = 34, 130  # [px] of a row of the chart, and of its axis and margins
NONE = "–"


def build(outcome: TrialOutcome) -> HtmlPage:
    """Return the page of a trial."""
    explanation = (
        "A baseline of the arm was recorded, and its own model was made from it. Then known changes were made, one "
        "at a time. Each was recorded under the same commands and named by nas gap, which was not told the change. "
        f"A name is right if it is the only one of at least {SURE:.0%} confidence and has the right joint."
    )
    sections = [
        PageSection(
            "",
            [
                Text(outcome.sentence(), lead=True),
                Text(explanation),
                Text(capitalise(outcome.describe_baseline()) + "."),
            ],
        ),
        PageSection("Sizes", draw_sizes(outcome)),
        PageSection("Every change", [make_table(outcome)]),
        PageSection("Changes that were not made", [Text(reason) for reason in outcome.skipped]),
    ]
    return HtmlPage(f"Trial of the names: {outcome.arm}", [section for section in sections if section.blocks])


def make_table(outcome: TrialOutcome) -> HtmlTable:
    """Return a table with a row for each change."""
    note = f"Off by: relative error of the size. Unsure: names of less than {SURE:.0%} confidence."
    return HtmlTable(HEADERS, [make_row(change) for change in outcome.changes], note)


def make_row(change: ChangeOutcome) -> tuple[str, ...]:
    """Return the cells of a change."""
    named = ", ".join(map(change.describe_given, change.sure)) or NOTHING
    unsure = ", ".join(change.describe_given(given) for given in change.named if given not in change.sure) or NONE
    error = NONE if change.relative_error is None else f"{100 * change.relative_error:.1f} %"
    mark = "✓" if change.is_right else "✗"
    true = f"{change.true} {format_value(change.size, change.unit)}"
    return f"{mark} {change.change}", change.does, true, named, error, unsure


def draw_sizes(outcome: TrialOutcome) -> list[Block]:
    """Return the chart of the rightly named sizes relative to the true ones; nothing if no name is right."""
    found = [(change, match) for change in outcome.right if (match := change.match) is not None and match.value]
    if not found:
        return []
    names = [f"{change.change}: {change.true}" for change, _ in found]
    ratios = [float(match.value or 0.0) / change.size for change, match in found]
    ends = [match.interval95 or (match.value, match.value) for _, match in found]
    scaled = [
        sorted(float(end or 0.0) / change.size for end in pair) for (change, _), pair in zip(found, ends, strict=True)
    ]
    below = [ratio - low for ratio, (low, _) in zip(ratios, scaled, strict=True)]
    above = [high - ratio for ratio, (_, high) in zip(ratios, scaled, strict=True)]
    bars = {"type": "data", "symmetric": False, "array": above, "arrayminus": below}
    band = {"type": "rect", "yref": "paper", "y0": 0, "y1": 1, "x0": 1 - RIGHT_SIZE, "x1": 1 + RIGHT_SIZE}
    layout = {
        "xaxis": make_axis("named size over true size"),
        "yaxis": {"autorange": "reversed", "automargin": True},
        "shapes": [{**band, "layer": "below", "line": {"width": 0}, "fillcolor": LIGHT + "55"}],
        "showlegend": False,
    }
    caption = (
        f"Size of each rightly named effect over its true size, with its 95 % interval; the band is ±{RIGHT_SIZE:.0%}."
    )
    dots = make_dots(ratios, names, "size", Stroke(BLUE), error_x=bars)
    return [Chart("sizes", caption, [dots], layout, height=FRAME + ROW_HEIGHT * len(found))]
