"""φ on top of the names: its share of the gap, trained on what the written model leaves; left out where it harms."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from support.report_samples import gap_report
from support.two_joint_arm import ARM, recorded

from nas_data.cli import main
from nas_data.effects.base import parse
from nas_data.gap import phi_shares
from nas_data.gap.problem import Problem
from nas_data.gap.report import GapReport
from nas_data.gap.report_parts import LearnedCorrection
from nas_data.gap.showing.page import describe_shares
from nas_data.gap.summary import describe_learned, list_findings, summarise
from nas_data.gap.workflow import train_on_top
from nas_data.gap.write_model import write_model
from nas_data.models.checkpoint import find_checkpoint, load_for_inference
from nas_data.models.predictions import roll_out_model
from nas_data.models.presets import preset
from nas_data.simulators.mujoco import MujocoSimulator

HIDDEN = "viscous_friction:joint=shoulder,coefficient=0.05"
HALF = "viscous_friction:joint=shoulder,coefficient=0.025"


@pytest.fixture(scope="module")
def named(tmp_path_factory: pytest.TempPathFactory) -> tuple[Problem, Path]:
    """The problem of an arm that lacks friction, and its model with that friction half as large."""
    folder = tmp_path_factory.mktemp("learned")
    arm = folder / "arm.xml"
    arm.write_text(ARM)
    problem = Problem.load(recorded(arm, folder / "data", "--effect", HIDDEN), arm)
    out = folder / "report"
    out.mkdir()
    model, _ = write_model(out, problem.train.nominal, [parse(HALF)], {})
    return problem, model


def learn(
    named: tuple[Problem, Path], patch: pytest.MonkeyPatch, updates: int = 10
) -> tuple[LearnedCorrection, list[str]]:
    """Train a small φ; return its errors and the messages."""
    problem, model = named
    said: list[str] = []
    patch.setattr(phi_shares, "preset", partial(preset, hidden=8, layers=1, horizon=20, frames=400))
    return train_on_top(problem, model, updates, said.append), said


def test_a_phi_that_helps_is_delivered_with_its_source(named: tuple[Problem, Path], monkeypatch: pytest.MonkeyPatch):
    found, said = learn(named, monkeypatch)
    assert found.helps
    assert found.corrected < found.written < found.given
    shares = found.shares
    assert shares.names + shares.learned + shares.left == pytest.approx(1.0)
    assert shares.learned > 0.01
    assert any("φ reduces the error in:" in line for line in said)
    assert "→" in describe_learned(found)
    folder = named[1].parent
    model = load_for_inference(find_checkpoint(folder / "phi"))
    assert model.kind == "delta"
    assert model.provenance["source"] == MujocoSimulator.load(folder / "model.xml", 0.01).describe()


@pytest.mark.parametrize(("change", "sentence"), [(1.0, "with it"), (np.nan, "it diverges")])
def test_a_phi_that_harms_is_left_out(named: tuple[Problem, Path], monkeypatch: pytest.MonkeyPatch, change, sentence):
    def harm(held, source, phi):
        return [states + change for states in roll_out_model(held, source, phi)]

    monkeypatch.setattr(phi_shares, "roll_out_model", harm)
    found, _ = learn(named, monkeypatch, updates=1)
    assert not found.helps
    assert not (named[1].parent / "phi").exists()
    assert found.shares.learned is None
    assert found.shares.names + found.shares.left == pytest.approx(1.0)
    assert describe_learned(found).startswith("φ is left out")
    assert sentence in describe_learned(found)


def test_the_report_says_that_phi_is_left_out(tmp_path: Path):
    left_out = LearnedCorrection(given=0.03, written=0.01, corrected=0.02)
    report = replace(gap_report(), phi=left_out, shares=left_out.shares)
    assert "φ is left out, as it does not help: on held-out episodes the error is 1.15° with it, 0.57° without it" in (
        list_findings(report)
    )
    on_page = describe_shares(replace(report, verdict="partly_explained"))
    assert any("φ is left out" in str(block) for block in on_page)
    report.write(tmp_path)
    assert GapReport.load(tmp_path).phi == left_out


def test_an_earlier_phi_is_called_one(tmp_path: Path):
    (tmp_path / "phi").mkdir()
    shares = {"names": 0.97, "learned": 0.01, "left": 0.02}
    assert "earlier report" not in summarise(gap_report(shares=shares), tmp_path)
    assert "earlier report" in summarise(gap_report(shares={**shares, "learned": None}), tmp_path)


@pytest.mark.slow
def test_the_command_learns_on_top_of_what_it_names(tmp_path: Path):
    arm, out = tmp_path / "arm.xml", tmp_path / "report"
    arm.write_text(ARM)
    dataset = recorded(arm, tmp_path / "data", "--effect", HIDDEN)
    assert main(["gap", str(dataset), "--model", str(arm), "--out", str(out), "--learn", "10"]) == 0
    report = GapReport.load(out)
    assert report.shares.names > 0.95, "the friction is named"
    assert report.phi.helps == (out / "phi").is_dir()
