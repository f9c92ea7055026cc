"""Friction under load that falls with speed is named with its size, and kept although no file expresses it."""

from pathlib import Path

import pytest

from nas_data.api.gap import identify
from nas_data.cli import main

HIDDEN = {"ratio": 0.5, "kinetic_ratio": 0.4, "stribeck_velocity": 0.8}


@pytest.mark.slow
def test_friction_under_load_that_falls_with_speed_is_named(tmp_path: Path):
    effect = "load_friction:joint=pendulum," + ",".join(f"{name}={value}" for name, value in HIDDEN.items())
    command = ["record", "sim", "--robot", "pendulum", "--effect", effect, "--noise", "0.0009", "--blind"]
    assert main([*command, "--out", str(tmp_path / "arm"), "--episodes", "6", "--seconds", "2"]) == 0
    report = identify(tmp_path / "arm", "pendulum", out=tmp_path / "gap")
    (found,) = report.effects
    assert (found.name, found.joint) == ("load_friction", "pendulum") and not found.in_model_xml
    for name, value in HIDDEN.items():
        assert found.parameters[name].value == pytest.approx(value, rel=0.15)
    assert report.gap.after < 1.5 * report.gap.noise_floor < 0.5 * report.gap.plain
