"""Pages in a browser: every chart is drawn, nothing is complained of, tables sort, and no request leaves the page."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from support import chromium
from support.command_samples import done
from support.gap_samples import written

from nas_data.errors import MissingPackage
from nas_data.gap.showing.page import read_page
from nas_data.reports.page import ShortFilm, Text
from nas_data.robots.base import find_robot
from nas_data.simulators import offscreen
from nas_data.studies.ablation.summary import Cell, Spread, SweepSummary
from nas_data.studies.ablation.sweep_data import Amount
from nas_data.studies.ablation.write import write

DATASET = Path(__file__).parents[2] / "datasets/ergojr_sample"
CHARTS = {"gap": 8, "dataset": 3, "sweep": 2}
DRAWN = (
    "[...document.querySelectorAll('.chart')].filter((chart) => chart.querySelector('.trace path, .hm image')).length"
)
WIDTH = "document.documentElement.scrollWidth"
PAPER = "getComputedStyle(document.body).backgroundColor"
WIDEST = "document.querySelector('.chart .main-svg').getBoundingClientRect().width"
INK = "getComputedStyle(document.querySelector('.chart text')).fill"


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, Path]:
    """Return a page of each kind, as `nas report` writes it."""
    root = tmp_path_factory.mktemp("pages")
    written(root / "gap")
    errors = {"open_loop": Spread((0.02, 0.03, 0.03)), "one_step": Spread((0.01, 0.012, float("inf")))}
    cells = [Cell("delta", Amount(count, "episodes"), count, errors) for count in (10.0, 20.0)]
    source = {"open_loop": Spread((0.1,)), "one_step": Spread((0.02,))}
    write(root / "sweep", SweepSummary("episodes", {"delta": cells}, {"source": source}, []), {})
    folders = {"gap": root / "gap", "dataset": DATASET, "sweep": root / "sweep"}
    for name, folder in folders.items():
        done("report", folder, "--out", root / f"{name}.html")
    return {name: root / f"{name}.html" for name in folders}


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Return a browser, where there is one."""
    if chromium.find() is None:
        pytest.skip("Chromium is not installed: apt install chromium")
    with chromium.Chromium(tmp_path_factory.mktemp("browser")) as browser:
        yield browser


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow if kind != "gap" else ()) for kind in CHARTS]
)
def test_a_page_is_drawn_at_both_widths_and_asks_nobody_for_anything(pages, browser, kind):
    browser.requests.clear()
    browser.complaints.clear()
    browser.open(pages[kind], 400)
    assert browser.value(DRAWN) == CHARTS[kind]
    assert browser.value(WIDTH) == 400, "nothing sticks out"
    paper, ink = browser.value(PAPER), browser.value(INK)
    browser.look(1400, dark=True)
    assert browser.wait(f"{PAPER} !== '{paper}' && {INK} !== '{ink}'"), "charts are drawn anew in the dark"
    assert browser.wait(f"{WIDEST} > 900"), "charts take the room that there is"
    assert browser.value(WIDTH) == 1400
    assert browser.complaints == []
    assert set(browser.requests) == {pages[kind].as_uri()}
    assert pages[kind].stat().st_size < 8e6


def test_a_click_on_a_header_sorts_and_another_one_turns_round(pages, browser):
    browser.open(pages["dataset"], 1400)
    table = "document.querySelector('.sorted')"
    for turn in (1, -1):
        browser.value(f"{table}.tHead.rows[0].cells[4].click()")
        speeds = browser.value(f"[...{table}.tBodies[0].rows].map((row) => parseFloat(row.cells[4].textContent))")
        assert speeds == sorted(speeds, reverse=turn < 0)
        assert len(set(speeds)) > 1


def arm_film(tmp_path):
    """Write a report about the pendulum, whose model lies beside it."""
    robot, time = find_robot("pendulum"), 0.02 * np.arange(1, 41)
    swing = np.sin(3 * time)[None, :, None]
    parts = {"before": 1.2 * swing, "retuned": 1.1 * swing, "after": swing, "measured": swing, "command": swing}
    about = {"time": time, "joints": np.array(robot.joints), "episodes": np.array([3]), "floor": np.array([0.001])}
    folder = written(tmp_path, drawn={**parts, **about, "counts": np.ones((1, 40), bool)})
    (folder / "model.xml").write_bytes(robot.mjcf.read_bytes())
    return folder


def test_the_gap_page_carries_a_short_film(tmp_path):
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    try:
        offscreen.OffscreenRenderer(model, mujoco.MjData(model), (16, 16)).close()
    except MissingPackage as error:
        pytest.skip(str(error))
    page = read_page(arm_film(tmp_path))
    (shown,) = [block for section in page.sections for block in section.blocks if isinstance(block, ShortFilm)]
    assert shown.mp4[4:8] == b"ftyp"
    assert len(shown.mp4) < 1e6
    assert "Episode 3" in shown.caption


def test_where_nothing_draws_the_page_names_the_package(tmp_path, monkeypatch):
    def refuse(width, height):
        raise MissingPackage("Install a package that draws: apt install libegl1.")

    monkeypatch.setattr(offscreen, "open_context", refuse)
    page = read_page(arm_film(tmp_path))
    told = [block.text for section in page.sections for block in section.blocks if isinstance(block, Text)]
    assert any("apt install libegl1" in text and "nas gap show" in text for text in told)
