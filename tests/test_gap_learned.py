"""φ on top of the names: its share of the gap, trained on what the written model leaves."""

import json
from pathlib import Path

import pytest
from test_gap_workflow import ARM, recorded

from nas_data.cli import main
from nas_data.gap.summary import summary
from nas_data.models.checkpoint import find, load_frozen
from nas_data.simulators.mujoco import MujocoSimulator


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """An arm with an effect that is named; ten updates of φ on the rest."""
    folder = tmp_path_factory.mktemp("learned")
    arm = folder / "arm.xml"
    arm.write_text(ARM)
    dataset = recorded(arm, folder / "data", "--effect", "viscous_friction:joint=shoulder,coefficient=0.05")
    out = folder / "report"
    assert main(["gap", str(dataset), "--model", str(arm), "--out", str(out), "--learn", "10"]) == 0
    return out, json.loads((out / "report.json").read_text())


def test_the_shares_are_parts_of_the_gap(report: tuple[Path, dict]):
    _, content = report
    shares = content["shares"]
    assert shares["names"] + shares["learned"] + shares["left"] == pytest.approx(1.0)
    assert shares["names"] > 0.95, "the friction is named"
    assert abs(shares["learned"]) < 0.05, "ten updates on noise neither help nor harm much"


def test_the_checkpoint_knows_the_model_with_the_names(report: tuple[Path, dict]):
    folder, _ = report
    model = load_frozen(find(folder / "phi"))
    assert model.kind == "delta"
    assert model.provenance["source"] == MujocoSimulator.load(folder / "model.xml", 0.01).describe()


def test_an_earlier_phi_is_called_one(report: tuple[Path, dict]):
    folder, content = report
    assert "earlier" not in summary(content, folder)
    assert "earlier report" in summary({**content, "shares": {**content["shares"], "learned": None}}, folder)
