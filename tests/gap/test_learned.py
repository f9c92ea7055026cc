"""φ on top of the names: its share of the gap, trained on what the written model leaves."""

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import pytest
from support.report_samples import gap_report
from support.two_joint_arm import ARM, recorded

from nas_data.cli import main
from nas_data.effects.base import parse
from nas_data.gap.problem import Problem
from nas_data.gap.summary import summarise
from nas_data.gap.workflow import train_on_top
from nas_data.gap.write_model import write_model
from nas_data.models.checkpoint import find_checkpoint, load_for_inference
from nas_data.models.presets import preset
from nas_data.simulators.mujoco import MujocoSimulator

HIDDEN = "viscous_friction:joint=shoulder,coefficient=0.05"


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Mapping[str, float]]:
    """The folder of an arm's model with the effect that it lacks; ten updates of φ on the rest."""
    folder = tmp_path_factory.mktemp("learned")
    arm = folder / "arm.xml"
    arm.write_text(ARM)
    problem = Problem.load(recorded(arm, folder / "data", "--effect", HIDDEN), arm)
    out = folder / "report"
    out.mkdir()
    model, _ = write_model(out, problem.train.nominal, [parse(HIDDEN)], {})
    with pytest.MonkeyPatch.context() as patch:
        small = partial(preset, hidden=8, layers=1, horizon=20, frames=400)
        patch.setattr("nas_data.gap.phi_shares.preset", small)
        return out, train_on_top(problem, model, 10, lambda _: None)


def check_parts(shares: Mapping[str, float]) -> None:
    """Check the shares of an arm whose effect is named."""
    assert shares["names"] + shares["learned"] + shares["left"] == pytest.approx(1.0)
    assert shares["names"] > 0.95, "the friction is named"
    assert abs(shares["learned"]) < 0.05, "ten updates on noise neither help nor harm much"


def test_the_shares_are_parts_of_the_gap(taught: tuple[Path, Mapping[str, float]]):
    check_parts(taught[1])


def test_the_checkpoint_knows_the_model_with_the_names(taught: tuple[Path, Mapping[str, float]]):
    folder, _ = taught
    model = load_for_inference(find_checkpoint(folder / "phi"))
    assert model.kind == "delta"
    assert model.provenance["source"] == MujocoSimulator.load(folder / "model.xml", 0.01).describe()


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
    check_parts(json.loads((out / "report.json").read_text())["shares"])
    assert find_checkpoint(out / "phi").is_dir()
