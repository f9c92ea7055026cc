"""Reports: figures show what was measured, pages need nothing but themselves, runs are read as they were written."""

import itertools
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.colors import to_hex, to_rgb
from support.command_samples import nas
from support.first_order_arm import FirstOrderArm
from support.policy_samples import scored
from support.recording_samples import paired_pendulum
from support.training_samples import TINY, train

from nas_data.atomic_file import write_atomic
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.errors import CheckpointError
from nas_data.joint_units import HINGE, SLIDE
from nas_data.policies import policy, ppo
from nas_data.reports.charts import thin
from nas_data.reports.figures import compute_joint_errors, draw_error_growth, draw_trajectory, quartiles
from nas_data.reports.page import (
    Chart,
    Facts,
    HtmlPage,
    HtmlTable,
    ModelDifference,
    PageSection,
    ShortFilm,
    Text,
    is_ours,
)
from nas_data.reports.run_sections import (
    make_learning_charts,
    make_models_section,
    make_policies_section,
    make_target_chart,
)
from nas_data.reports.runs import LearningCurve, PolicyRun, find_runs
from nas_data.reports.style import OTHERS, STROKES, choose_strokes, to_png

SMALL = policy.Hyperparameters(arms=4, rollout=256, minibatches=2, epochs=1)
# Machado, Oliveira and Fernandes (2009), severity 1, on linear RGB.
BLINDNESS = {
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
}


def curve(*returns):
    values = np.array(returns, dtype=float)
    return LearningCurve(100.0 * np.arange(1, len(values) + 1), values, np.clip(-1 / values, 0, 1))


# --- figures


@settings(deadline=None)
@given(arrays(float, st.tuples(st.integers(1, 6), st.integers(1, 9)), elements=st.floats(0, 10)))
def test_quartiles_are_those_of_the_episodes_that_reach_a_step(values):
    equal = quartiles(list(values))
    np.testing.assert_allclose(equal, np.quantile(values, [0.25, 0.5, 0.75], axis=0))
    longer = quartiles([*values, np.append(values[0], 3.0)])
    assert longer.shape == (3, values.shape[1] + 1)
    np.testing.assert_allclose(longer[:, -1], 3.0)


@settings(deadline=None)
@given(arrays(float, (4, 6), elements=st.floats(-3, 3)), st.floats(0.01, 1))
def test_the_error_of_joints_that_are_all_off_by_as_much_is_that_much(states, offset):
    wrong = states.copy()
    wrong[:, :3] += offset
    np.testing.assert_allclose(compute_joint_errors(wrong, states, 3), offset)
    assert not compute_joint_errors(states, states, 3).any()


def test_a_trajectory_shows_the_positions_in_degrees_and_the_errors_below():
    measured = np.array([0.0, 0.1, 0.2])
    figure = draw_trajectory(measured, {"source": measured + 0.1, "ψ": measured}, measured, 0.5, "m3")
    above, below = figure.axes
    drawn = {line.get_label(): line for line in above.lines}
    assert list(drawn) == ["measured", "source", "ψ", "command"]
    np.testing.assert_allclose(drawn["source"].get_xdata(), [0.5, 1.0, 1.5])
    np.testing.assert_allclose(drawn["source"].get_ydata(), np.degrees(measured + 0.1))
    np.testing.assert_allclose(below.lines[0].get_ydata(), np.degrees(0.1))
    assert above.get_ylabel() == "position of m3 [°]"
    assert below.get_xlabel().endswith("[s]")


def test_a_slide_is_drawn_in_millimetres():
    measured = np.array([0.0, 0.001, 0.002])
    above, below = draw_trajectory(measured, {"source": measured + 0.0005}, measured, 0.5, "finger", SLIDE).axes
    drawn = {line.get_label(): line for line in above.lines}
    np.testing.assert_allclose(drawn["measured"].get_ydata(), [0, 1, 2])
    np.testing.assert_allclose(below.lines[0].get_ydata(), 0.5)
    assert (above.get_ylabel(), below.get_ylabel()) == ("position of finger [mm]", "error [mm]")


def test_a_joint_that_takes_torques_has_no_command_in_its_trajectory():
    figure = draw_trajectory(np.zeros(3), {"source": np.ones(3)}, None, 0.1, "a")
    assert "command" not in {line.get_label() for line in figure.axes[0].lines}


def test_error_growth_draws_the_median_between_the_quartiles():
    episodes = [np.radians([1.0, value]) for value in (1.0, 2.0, 3.0, 4.0, 5.0)]
    axes = draw_error_growth({"source": episodes}, 0.01).axes[0]
    np.testing.assert_allclose(axes.lines[0].get_ydata(), [1.0, 3.0])
    corners = axes.collections[0].get_paths()[0].vertices
    assert {2.0, 4.0} <= set(corners[corners[:, 0] == 0.02][:, 1].round(6))


def learned(method, *curves, judged=()):
    """Return policies of a method, one a seed."""
    scores = [scored(value).score for value in judged] or [None] * max(1, len(curves))
    seeds = list(curves) or [curve(-1, -1)] * len(scores)
    return [
        PolicyRun(Path(method), method, seed, "Arm", 300, one, 1.0, score)
        for seed, (one, score) in enumerate(zip(seeds, scores, strict=True))
    ]


def test_learning_curves_band_reaches_from_the_lowest_to_the_highest_seed():
    runs = learned("source", curve(-3, -2, -1), curve(-5, -4, -3), curve(-4, -2, -1))
    low, high, median = make_learning_charts({"source": runs})[0].traces
    np.testing.assert_allclose(median["y"], [-4, -2, -1])
    np.testing.assert_allclose(low["y"], [-5, -4, -3])
    np.testing.assert_allclose(high["y"], [-3, -2, -1])


def test_learning_curves_leave_out_rollouts_in_which_no_episode_ended():
    runs = learned("source", curve(np.nan, -2, -1), curve(np.nan, -4, -3))
    median = make_learning_charts({"source": runs})[0].traces[-1]
    np.testing.assert_allclose(median["y"], [-3, -2])
    np.testing.assert_allclose(median["x"], [0.2, 0.3])


def test_every_policy_is_a_dot_and_every_method_a_row():
    groups = {"expert": learned("expert", judged=(0.3, 0.1)), "augmented": learned("augmented", judged=(-0.2,))}
    (chart,) = make_target_chart(groups)
    dots, medians = chart.traces[::2], chart.traces[1::2]
    assert [(list(trace["x"]), set(trace["y"])) for trace in dots] == [
        ([0.3, 0.1], {"expert"}),
        ([-0.2], {"augmented"}),
    ]
    np.testing.assert_allclose([trace["x"][0] for trace in medians], [0.2, -0.2])


@settings(deadline=None)
@given(st.integers(1, 9000), st.integers(0, 1000))
def test_a_thinned_curve_keeps_its_extremes_and_its_order(length, seed):
    x, y = np.arange(length), np.random.default_rng(seed).standard_normal(length)
    few, kept = thin(x, y, 200)
    assert len(few) == len(kept) <= max(200, min(length, 200))
    assert (np.diff(few) >= 0).all()
    assert {y.min(), y.max()} <= set(kept)
    np.testing.assert_array_equal(y[few], kept)


def test_a_predictor_and_the_method_that_learns_on_it_share_their_colour_in_every_figure():
    measured = np.zeros(3)
    pictures = [
        draw_trajectory(measured, {"source": measured, "source + φ": measured, "ψ": measured}, measured, 0.1, "a").axes[
            0
        ],
        draw_error_growth({name: [np.ones(3)] for name in ("source", "source + φ", "ψ", "command")}, 0.1).axes[0],
    ]
    for axes in pictures:
        for line in axes.lines:
            name = line.get_label()
            assert to_hex(line.get_color()) == STROKES[name].colour.lower(), name
    assert STROKES["augmented"].colour == STROKES["source + φ"].colour
    assert STROKES["forward"].colour == STROKES["ψ"].colour
    assert STROKES["named"].colour == STROKES["source + names"].colour
    assert STROKES["expert"].colour == STROKES["measured"].colour


@pytest.mark.parametrize("kind", [None, *BLINDNESS])
def test_predictors_differ_in_stroke_or_colour_for_every_kind_of_sight(kind):
    seen = {}
    for name in ("measured", "source", "source + φ", "ψ", "source + names", "command"):
        rgb = np.array(to_rgb(STROKES[name].colour)) ** 2.2
        seen[name] = np.clip(rgb if kind is None else BLINDNESS[kind] @ rgb, 0, 1) ** (1 / 2.2)
    for one, other in itertools.combinations(seen, 2):
        apart = float(np.linalg.norm(seen[one] - seen[other]))
        strokes_differ = STROKES[one].line != STROKES[other].line
        assert strokes_differ or apart > 0.2, f"{one} and {other} look alike: {apart:.2f}"


def test_names_without_a_colour_of_their_own_get_different_ones():
    looks = choose_strokes(["source", "a", "b", "c"])
    assert [looks[name].colour for name in "abc"] == list(OTHERS[:3])
    assert looks["source"] == STROKES["source"]


def test_the_same_figure_gives_the_same_bytes_and_a_readme_wide_picture():
    one, other = (to_png(draw_error_growth({"source": [np.ones(3)]}, 0.1)) for _ in range(2))
    assert one == other
    assert int.from_bytes(one[16:20], "big") == 988  # [px] width in the PNG's header


# --- pages


class Links(HTMLParser):
    """Collects what a page would load, its text, and whether its tags are closed in order."""

    VOID = frozenset({"meta", "img", "br", "link"})

    def __init__(self, page: str):
        super().__init__()
        self.sources, self.text, self.open = [], [], []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.sources += [value for key, value in attrs if key in {"src", "href", "srcset", "data"} and value[:1] != "#"]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def page_of(*blocks):
    return HtmlPage("A < B", [PageSection("Where & what", blocks)])


def test_a_page_needs_nothing_but_itself_and_holds_its_films_and_charts():
    chart = Chart("a", "shows", [{"x": np.array([1.0, 2.0]), "y": np.array(["</script>", "b"])}])
    page = page_of(
        Text("one", lead=True), chart, HtmlTable(("", "x"), [("row", "1")], "note"), ShortFilm(b"mp4", "moves")
    )
    links = Links(page.to_html())
    assert not links.open
    assert links.sources == ["data:,", "data:video/mp4;base64,bXA0"]
    assert page.charts() == [chart]
    read = json.loads(chart.to_json())["data"][0]
    assert read == {"x": {"dtype": "f4", "bdata": "AACAPwAAAEA="}, "y": ["</script>", "b"]}


def test_of_two_charts_with_one_name_the_first_has_it_as_id():
    charts = [Chart("a", "of one run", []), Chart("a", "of another run", []), Chart("b", "alone", [])]
    html = page_of(*charts).to_html()
    assert [html.count(f'id="{name}"') for name in "ab"] == [1, 1]


def test_a_page_without_charts_does_without_their_library():
    assert len(page_of(Text("one")).to_html()) < 20_000


def test_the_lines_of_a_difference_are_told_apart():
    text = "--- a\n+++ b\n@@ -1 +1 @@\n same\n-old\n+new\n"
    kinds = [kind for kind, _ in ModelDifference(text).lines]
    assert kinds == ["head", "head", "place", "same", "removed", "added"]


@settings(max_examples=50)
@given(st.text(alphabet=st.characters(codec="utf-8", exclude_categories=("Cc", "Cs")), min_size=1))
def test_text_appears_as_it_is_given_whatever_it_holds(text):
    page = page_of(Text(text), HtmlTable((text,), [(text, text)], text), Facts({text: text}), ShortFilm(b"", text))
    links = Links(page.to_html())
    assert not links.open
    assert links.text.count(text) >= 8
    assert len(links.sources) == 2


def test_a_file_appears_whole_and_replaces_the_one_before(tmp_path):
    path = tmp_path / "a" / "page.html"
    for content in (b"one", b"two"):
        write_atomic(path, content)
        assert path.read_bytes() == content
    assert [file.name for file in path.parent.iterdir()] == ["page.html"]


# --- runs


def a_policy(folder: Path, seed: int, plant="ErgoReacher", dynamics="source", score=None):
    """Train a policy on two rollouts, and write the result that a comparison would have written."""
    training = ppo.PolicyTraining(DynamicsSpec(plant, dynamics), seed, 512, SMALL)
    ppo.train(training, folder, lambda _: None, FirstOrderArm(SMALL.arms))
    if score is not None:
        scored(score).write(folder)


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    """A folder with both models and a comparison of two methods with two seeds."""
    root = tmp_path_factory.mktemp("runs")
    dataset = paired_pendulum((40,) * 4)
    identity = {"dataset": {"name": "swing/v1-0a1b2c3d", "content_hash": "0a1b2c3d" * 8}}
    train(dataset, root / "phi", "delta", provenance=identity)
    train(dataset, root / "psi", "forward", options=type(TINY)(**{**vars(TINY), "updates": 3}), provenance=identity)
    for seed in (0, 1):
        a_policy(root / "study" / "source" / f"seed{seed}", seed, score=-2.0 - seed)
        a_policy(root / "study" / "expert" / f"seed{seed}", seed, dynamics="backlash", score=-1.0 + seed)
    return root


def test_runs_are_read_as_they_were_written(runs):
    found = find_runs([runs])
    phi, psi = sorted(found.models, key=lambda model: model.kind)
    assert (phi.name, psi.name) == ("source + φ", "ψ")
    assert (phi.dataset, phi.content_hash[:8]) == ("swing/v1-0a1b2c3d", "0a1b2c3d")
    assert phi.unit is None
    assert psi.unit is HINGE
    rows = json.loads((runs / "psi/history.json").read_text())
    np.testing.assert_allclose([error for _, error in psi.errors], np.degrees([row["validation"] for row in rows]))
    assert psi.best == min(error for _, error in psi.errors)
    groups = found.groups()
    assert list(groups) == ["expert", "source"]
    assert [(run.seed, run.frames) for run in groups["source"]] == [(0, 512), (1, 512)]
    assert [run.target_score.mean_return for run in groups["source"]] == [-2.0, -3.0]


def test_a_run_named_twice_counts_once(runs):
    found = find_runs([runs, runs / "phi", runs / "study" / ".." / "study"])
    assert len(found.models) == 2
    assert len(found.policies) == 4


def test_policies_of_one_method_in_two_folders_are_not_mixed(runs, tmp_path):
    a_policy(tmp_path / "other" / "seed0", 0, score=-7.0)
    groups = find_runs([runs / "study", tmp_path]).groups()
    assert set(groups) == {"expert", "source (source)", "source (other)"}


def test_the_table_says_what_the_records_say_and_how_much_of_the_distance_is_closed(runs):
    found = find_runs([runs])
    table = next(block for block in make_policies_section(found.groups()).blocks if isinstance(block, HtmlTable))
    cells = {row[0].partition(":")[0]: row for row in table.rows}
    assert cells["source"][1:5] == ("-2.50", "50%", "-3.00 … -2.00", "2")
    assert cells["expert"][1:5] == ("-0.50", "50%", "-1.00 … 0.00", "2")


def test_policies_that_were_not_judged_are_shown_as_they_ended_training(tmp_path):
    a_policy(tmp_path / "seed0", 0)
    section = make_policies_section(find_runs([tmp_path]).groups())
    names = [block.name for block in section.blocks if isinstance(block, Chart)]
    assert names == ["learning_curves", "success"]
    table = next(block for block in section.blocks if isinstance(block, HtmlTable))
    assert "no policy was evaluated on a target" in table.note
    assert len(table.headers) == len(table.rows[0])


def test_models_that_share_a_name_are_told_apart(runs, tmp_path):
    train(paired_pendulum((40,) * 4, seed=1), tmp_path / "again", "delta")
    table = make_models_section(find_runs([runs / "phi", tmp_path]).models).blocks[1]
    assert {row[0] for row in table.rows} == {"source + φ (phi)", "source + φ (again)"}


def test_a_damaged_run_is_refused_by_its_folder(runs, tmp_path):
    folder = tmp_path / "phi"
    train(paired_pendulum((40,) * 4), folder)
    (folder / "history.json").write_text("[{")
    with pytest.raises(CheckpointError, match="phi is a damaged training"):
        find_runs([folder])


# --- nas report


def test_nas_report_writes_one_page_about_all_runs(runs, tmp_path):
    page = tmp_path / "report.html"
    answer = nas("report", runs / "phi", runs / "psi", runs / "study", "--out", page, "--json")
    assert answer.code == 0, answer.err
    assert answer.json == {"page": str(page), "models": 2, "policies": 4, "gaps": 0, "sweeps": 0, "datasets": 0}
    links = Links(page.read_text(encoding="utf-8"))
    text = " ".join(links.text)
    for expected in ("swing/v1-0a1b2c3d", "source + φ", "ErgoReacher", "-2.50"):
        assert expected in text
    assert links.sources == ["data:,"]
    assert is_ours(page)
    assert nas("report", runs, "--out", page).code == 0  # its own page may be replaced


@pytest.mark.parametrize("what", ["nothing", "missing", "empty", "foreign page", "folder"])
def test_nas_report_refuses_what_it_cannot_show_and_writes_nothing(runs, tmp_path, what):
    page, run = tmp_path / "report.html", runs
    (tmp_path / "empty").mkdir()
    if what == "foreign page":
        page.write_text("<html>my own</html>")
    if what == "folder":
        page.mkdir()
    if what in {"missing", "empty"}:
        run = tmp_path / what
    answer = nas("report", *([] if what == "nothing" else [run]), "--out", page)
    assert answer.code == 2
    assert answer.err.startswith("nas: ")
    assert answer.err.count("\n") == 1
    assert page.exists() == (what in {"foreign page", "folder"})
    assert what != "foreign page" or page.read_text() == "<html>my own</html>"


def test_sections_of_one_title_are_linked_one_by_one():
    html = HtmlPage("several", [PageSection(title, []) for title in ("Errors", "Joints", "Errors", "Files")]).to_html()
    links, ids = re.findall(r'<a href="#([^"]+)"', html), re.findall(r'<h2 id="([^"]+)"', html)
    assert links == ids == ["Errors", "Joints", "Errors%201", "Files"]
