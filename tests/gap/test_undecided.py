"""Where nothing is certain enough to be named, the report says what to record to decide it."""

from pathlib import Path

import pytest

from nas_data.api.gap import identify
from nas_data.cli import main

HIDDEN = "joint_compliance:joint=pendulum,stiffness=10"


def record(folder: Path, *options: str) -> Path:
    command = ["record", "sim", "--robot", "pendulum", "--effect", HIDDEN, "--noise", "0.0009", "--rate", "50"]
    assert main([*command, *options, "--out", str(folder)]) == 0
    return folder


@pytest.mark.slow
def test_the_proposed_experiment_decides(tmp_path: Path):
    """Six seconds of slow motion do not decide; with the experiment, the name is certain."""
    slow = ("--excitation", "multisine:fastest=0.5,share=0.25", "--episodes", "2", "--seed", "100")
    first = record(tmp_path / "slow", *slow)
    report = identify(first, "pendulum", out=tmp_path / "before")
    assert report.verdict == "unexplained" and not report.effects
    assert "joint compliance from no further effect" in report.next_experiment
    more = record(tmp_path / "more", "--commands", str(tmp_path / "before" / "next_experiment.csv"))
    assert main(["merge", str(first), str(more), "--out", str(tmp_path / "both")]) == 0
    report = identify(tmp_path / "both", "pendulum", out=tmp_path / "after")
    (found,) = report.effects
    assert (found.name, found.joint) == ("joint_compliance", "pendulum")
    assert found.confidence > 0.8 and report.next_experiment is None
