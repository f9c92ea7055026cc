"""A gap report shown: every number from its files, each verdict in words, pictures that need nothing but the page."""

import copy
import json
import re
import shutil
import warnings
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from support.command_samples import nas
from support.gap_samples import BACKLASH, DELAY, FIND, FLOOR, JOINTS, REPORT, REST, series, written

from nas_data.count_of import join_items
from nas_data.errors import OptionError
from nas_data.gap.report import GapReport
from nas_data.gap.showing.figures import ABOVE, AFTER, BEFORE, RETUNED, draw_error_per_joint, select_models
from nas_data.gap.showing.page import show
from nas_data.gap.showing.page_words import format_figures, format_value, format_with_si, list_effects
from nas_data.gap.showing.series import Series

VERDICTS = {
    "none": {"effects": [], "retuned": [], "placebo": None, "shares": None, "next_experiment": None},
    "retuned": {"effects": [], "placebo": None, "next_experiment": None},
    "explained": {},
    "partly_explained": {"effects": [BACKLASH, DELAY], "unexplained": [REST]},
    "unexplained": {"effects": [], "placebo": None, "unexplained": [REST], "shares": None},
}
SAID = {
    "none": "Nothing is missing: on held-out episodes the model arm.xml has an error of 1.19°",
    "retuned": "Nothing is missing: the model arm.xml only needs 2 numbers that it already has changed",
    "explained": "The gap between the model arm.xml and the recording comes from backlash in m2: with it,",
    "partly_explained": "recording probably comes in part from backlash in m2 and command delay (whole arm): with",
    "unexplained": "Something is missing in the model arm.xml that no effect in the catalogue explains, at m1:",
}


ORDER = [
    "Changes of the model",
    "How the gap shrinks",
    "Where the gap is largest",
    "The names",
    "Measured, before and after",
    "A wrong name in its place",
    "What remains unexplained",
    "What to record next",
    "The recording",
    "Commands, hashes and versions",
    "How to read this page",
]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Return the page of a report as it is."""
    return show(written(tmp_path_factory.mktemp("plain")))


@pytest.fixture
def words_only(monkeypatch):
    """Leave out the pictures beside a page, which take longest."""
    for name in ("draw_all_joints", "draw_joint"):
        monkeypatch.setattr(f"nas_data.gap.showing.page.{name}", lambda *_: None)
    monkeypatch.setattr("nas_data.gap.showing.page.to_png", lambda _: b"")


def text_of(page):
    """Return the words of a page."""
    content = re.sub(r"<(style|script)\b.*?</\1>", "", page.read_text(), flags=re.DOTALL)
    return unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", content)))


@pytest.mark.usefixtures("words_only")
@pytest.mark.parametrize("verdict", VERDICTS)
def test_each_verdict_reads_well_and_stands_first(tmp_path, verdict):
    folder = written(tmp_path, {"verdict": verdict, **VERDICTS[verdict]}, gap=0.0 if verdict == "none" else 0.02)
    text = text_of(show(folder))
    assert SAID[verdict] in text
    assert not re.search(r"\bnan\b|\binf\b|None|\{|\}", text)
    headings = re.findall(r"<h2.*?>(.*?)</h2>", (tmp_path / "report.html").read_text())
    assert headings == [title for title in ORDER if title in headings]
    assert text.rindex(SAID[verdict]) < text.rindex(headings[0])


def test_rows_that_no_episode_reaches_are_not_drawn(tmp_path):
    drawn = series(np.random.default_rng(0))
    drawn["counts"][:, -3:] = False
    written(tmp_path, drawn=drawn)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        show(tmp_path)


@pytest.mark.usefixtures("words_only")
def test_values_stand_in_friendly_units_beside_si(tmp_path):
    text = text_of(show(written(tmp_path, {"verdict": "partly_explained", **VERDICTS["partly_explained"]})))
    assert "Added: backlash in m2 (half width 0.991° (0.0173 rad))" in text
    assert "half width 0.991° (0.0173 rad) 0.928 … 1.05° 97 % (sure) –" in text
    assert "delay 31.4 ms (0.0314 s)" in text
    assert "64 % (a guess) – rotor inertia in m1" in text
    assert "MJCF cannot express command delay (whole arm) exactly: effects.json has the exact effect" in text
    assert "still 6.3 times the noise; it correlates with position" in text
    assert "−6.6 %" in text
    assert "play and friction look alike" in text
    assert "look: commands look one row late" in text


@pytest.mark.usefixtures("words_only")
def test_every_number_comes_from_the_files(tmp_path):
    gap = {**REPORT["gap"], "before": 0.0345, "after": 0.00234}
    text = text_of(show(written(tmp_path, {"gap": gap})))
    assert f"from {np.degrees(0.0345):.2f}° to {np.degrees(0.00234):.3f}°" in text


@pytest.mark.usefixtures("words_only")
def test_the_placebo_is_told_with_the_error_that_its_chart_draws(tmp_path):
    page = show(written(tmp_path))
    drawn = next(trace["x"][0] for trace in charts(page)["placebo"]["data"] if "placebo" in trace["y"][0])
    assert f"leaves {format_figures(drawn)}° of the" in text_of(page)
    without = show(written(tmp_path / "words", drawn=series(np.random.default_rng(0), placebo=False)))
    assert "leaves 0.636° of the" in text_of(without)


def test_what_the_written_file_alone_leaves_is_told_where_it_is_more(page, tmp_path):
    assert "computed with the written model.xml" in text_of(page)
    gap = {**REPORT["gap"], "after_model_xml": 0.0047}
    assert "its error is 0.269°" in text_of(show(written(tmp_path, {"gap": gap})))


def test_figures_are_written_and_every_chart_stands_on_the_page(page):
    assert {path.stem for path in (page.parent / "figures").glob("*.png")} == {"gap_per_joint", "joint_m2"}
    assert page.name == "report.html"
    drawn = {"errors", "errors_of_hinges", "regimes", "error_over_time", "placebo"}
    assert set(charts(page)) == drawn | {"joint_m1", "joint_m2", "joint_gripper_left"}
    assert page.stat().st_size < 8e6


def charts(page):
    """Return what the charts of a page draw, by name."""
    found = re.findall(
        r'class="chart" id="(.*?)".*?<script type="application/json">(.*?)</script>', page.read_text(), re.S
    )
    return {name: json.loads(text) for name, text in found}


@pytest.mark.usefixtures("words_only")
def test_the_difference_of_the_model_files_can_be_copied_from_the_page(tmp_path):
    changes = '--- arm.xml\n+++ model.xml\n@@ -1 +1 @@\n-<joint name="m2"/>\n+<joint name="m2" damping="0.1"/>\n'
    folder = written(tmp_path)
    (folder / "model.diff").write_text(changes)
    (copied,) = re.findall(r"<pre>(.*?)</pre>", show(folder).read_text(), re.DOTALL)
    assert unescape(re.sub(r"<[^>]+>", "", copied)) == changes


@pytest.mark.usefixtures("words_only")
def test_command_and_hashes_of_a_report_stand_on_its_page(tmp_path):
    source = {"command": "nas gap arm --model arm.xml --out gap", "content_hash": "c0ffee", "model_sha256": "5ha256"}
    text = text_of(show(written(tmp_path, {"made_from": {**source, "versions": {"mujoco": "4.0.0"}}})))
    assert all(value in text for value in (*source.values(), "mujoco 4.0.0"))


def test_a_joint_is_drawn_where_its_gap_is_above_the_floor(tmp_path):
    drawn = series(np.random.default_rng(1), gap=0.02)
    drawn["before"] = drawn["before"] + np.array([0.0, 0.0, 0.01])
    show(written(tmp_path, drawn=drawn))
    assert {path.stem for path in (tmp_path / "figures").glob("joint_*")} == {"joint_m2", "joint_gripper_left"}
    shown = Series.read(tmp_path)
    assert (shown.by_joint(shown.before) / FLOOR > ABOVE).tolist() == [False, True, True]


def test_a_joint_that_never_moved_does_not_stretch_the_axis(tmp_path):
    drawn = series(np.random.default_rng(1))
    drawn["floor"] = np.array([1e-5, *FLOOR[1:]])
    for name in ("before", "retuned", "after", "placebo"):
        drawn[name][..., 0] = drawn["measured"][..., 0] + 1e-17
    shown = Series.read(written(tmp_path, drawn=drawn))
    low, high = draw_error_per_joint(shown, {BEFORE: shown.before, AFTER: shown.after}).axes[0].get_ylim()
    assert 1e-4 < low < high < 10  # [°]


def test_pictures_of_an_earlier_report_go(page, tmp_path):
    shutil.copytree(page.parent, tmp_path, dirs_exist_ok=True)
    (tmp_path / "figures" / "shares.png").write_bytes(b"")
    show(written(tmp_path, {"verdict": "none", **VERDICTS["none"]}, gap=0.0))
    left = {path.stem for path in (tmp_path / "figures").glob("*.png")}
    assert "shares" not in left
    assert len([name for name in left if name.startswith("joint_")]) == 1


@pytest.mark.usefixtures("words_only")
def test_a_report_that_holds_only_the_contract_is_shown(tmp_path):
    extra = ("find", "shares", "placebo", "model", "dataset")
    folder = written(tmp_path, drawn=series(np.random.default_rng(0), placebo=False))
    kept = {key: value for key, value in REPORT.items() if key not in extra}
    (folder / "report.json").write_text(json.dumps(kept))
    assert "The gap between the model and the recording comes from backlash" in text_of(show(folder))


def test_the_same_files_give_the_same_page(page, tmp_path):
    assert page.read_bytes() == show(written(tmp_path)).read_bytes()


def test_torques_are_not_drawn_as_positions(page, tmp_path):
    find = copy.deepcopy(FIND)
    for gap in find["joints"].values():
        gap["open_loop_command"] = None
    torques = show(written(tmp_path, {"find": find}))
    name = "figures/joint_m2.png"
    assert (page.parent / name).read_bytes() != (torques.parent / name).read_bytes()


def test_rmse_counts_recorded_rows_only():
    drawn = series(np.random.default_rng(0))
    parts = {**drawn, "joints": JOINTS}
    shown = Series(**parts)
    far = np.where(shown.counts[..., None], shown.measured + 0.01, 99.0)
    np.testing.assert_allclose(shown.by_joint(far), 0.01)
    np.testing.assert_allclose(shown.by_episode(far), 0.01)
    along = shown.in_time(far, 0.1)
    np.testing.assert_allclose(along[shown.counts], 0.01)
    assert np.isnan(along[~shown.counts]).all()


def test_without_effects_the_written_model_is_the_retuned_one(tmp_path):
    shown = Series.read(written(tmp_path))
    report = GapReport.load(tmp_path)
    assert list(select_models(report, shown)) == [BEFORE, RETUNED, AFTER]
    bare = select_models(replace(report, effects=()), shown)
    assert list(bare) == [BEFORE, RETUNED]
    np.testing.assert_array_equal(bare[RETUNED], shown.after)


def test_numbers_are_said_with_three_digits():
    assert format_figures(0.00012345) == "0.000123"
    assert format_figures(123456.7) == "123457"
    assert format_figures(0.0) == "0"
    assert format_value(0.0017, "kg") == "1.70 g"
    assert format_value(0.012, "N·m") == "0.0120 N·m"
    assert format_with_si(0.8, "") == "0.800"
    assert format_with_si(1.2e-5, "kg·m²") == "120 g·cm² (0.0000120 kg·m²)"
    assert format_with_si(0.0136, "kg·m²") == "0.0136 kg·m²"
    assert join_items(["a", "b", "c"]) == "a, b and c"
    assert join_items(["a"]) == "a"
    assert format_figures(1e-17) == "0", "a joint that never moved errs by rounding"


def test_joints_of_one_effect_are_told_together(tmp_path):
    effect = GapReport.load(written(tmp_path)).effects[0]
    moved = [replace(effect, name="backlash", joint=joint) for joint in ("m3", "m6", "m1")]
    assert list_effects(moved[:1]) == "backlash in m3"
    assert list_effects([*moved, replace(moved[0], name="payload", joint=None)]) == (
        "backlash in m3, m6 and m1; payload (whole arm)"
    )
    many = [replace(effect, name="backlash", joint=f"m{number}") for number in range(5)]
    assert (
        list_effects([*many, replace(effect, name="payload", joint=None)])
        == "backlash in 5 joints; payload (whole arm)"
    )
    assert list_effects([moved[0], replace(moved[0], name="deadband")]) == "backlash in m3 and deadband in m3"


def test_what_is_missing_is_named(tmp_path):
    with pytest.raises(OptionError, match="not a gap report"):
        show(tmp_path)
    written(tmp_path)
    (tmp_path / "series.npz").unlink()
    with pytest.raises(OptionError, match="no series to draw"):
        show(tmp_path)
    report = json.loads((tmp_path / "report.json").read_text())
    (tmp_path / "report.json").write_text(json.dumps({key: report[key] for key in report if key != "gap"}))
    with pytest.raises(OptionError, match="lacks gap"):
        GapReport.load(tmp_path)


def test_the_command_shows_a_folder(tmp_path):
    answer = nas("gap", "show", written(tmp_path))
    assert answer.code == 0
    assert str(tmp_path / "report.html") in answer.out
    assert nas("gap", "show", tmp_path / "nothing").code == 2


@pytest.mark.usefixtures("words_only")
def test_a_page_says_that_the_plain_fit_is_written_in_place_of_the_names(tmp_path):
    gap = {**REPORT["gap"], "delivered": "plain"}
    page = show(written(tmp_path, {"gap": gap, "effects": [{**BACKLASH, "in_model_xml": False}]}))
    text, bars = text_of(page), [trace["y"] for chart in charts(page).values() for trace in chart["data"]]
    assert "model.xml is the plain fit, without named effects" in text and "MJCF cannot express" not in text
    assert any("after (names)" in str(names) for names in bars)
