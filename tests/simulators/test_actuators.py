"""A URDF does not say what moves its joints: position servos, or motors where that is asked for."""

import numpy as np
import pytest
from support.simulator_samples import EACH_ENGINE
from support.urdf_samples import URDF

from nas_data.cli import main
from nas_data.dataset.read import read
from nas_data.errors import ModelFileError
from nas_data.gap.problem import Problem
from nas_data.robots.base import find_robot
from nas_data.simulators.engines import load_simulator

RECORD = "--excitation babbling --episodes 4 --seconds 1 --rate 50 --noise 0.001"


@pytest.fixture
def urdf(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "lever.urdf"
    path.write_text(URDF)
    return path


def run(line: str) -> int:
    return main(line.split())


def test_motors_of_a_urdf_take_torques_and_forces_within_its_effort_limits(urdf):
    arm = load_simulator(f"{urdf}:torque", 0.02)
    assert arm.kinds == (".effort", ".effort")
    assert arm.model.actuator_ctrlrange.tolist() == [[-0.5, 0.5], [-2.0, 2.0]]
    moved = arm.predict(np.zeros((1, 4)), np.array([[0.1, 0.2]]))[0]
    # one period of constant torque on the lever with the slider in its axis, and of force on the slider
    assert moved[2] == pytest.approx(0.1 * 0.02 / (0.001 + 0.3 * 0.1**2 + 0.0001), rel=0.2)
    assert moved[3] == pytest.approx(0.2 * 0.02 / 0.2, rel=0.2)


@pytest.mark.parametrize("engine", EACH_ENGINE)
def test_torques_recorded_of_a_urdf_are_refused_by_its_servos_and_the_remedy_works(urdf, engine, capsys):
    if engine == "bullet":
        pytest.importorskip("pybullet")
    assert run(f"record sim --robot lever.urdf --actuators torque {RECORD} --out lever") == 0
    assert read(urdf.parent / "lever").kinds == (".effort", ".effort")
    assert Problem.load("lever", f"{urdf}:torque").names == ("lever", "lever.urdf")
    pair = f"pair lever --out paired --model lever.urdf --engine {engine}"
    assert run(pair) == 2
    said = capsys.readouterr().err
    assert "commands torques of turn" in said
    remedy = said[said.index("--actuators") :].strip().rstrip(".")
    assert remedy == "--actuators torque"
    assert run(f"{pair} {remedy}") == 0
    paired = read(urdf.parent / "paired")
    if engine == "mujoco":  # which recorded, exactly but for the noise
        assert np.abs(paired.sim_states - paired.next_states)[:, :2].mean() < 0.002


def test_the_source_that_is_kept_has_the_motors(urdf, capsys):
    assert run(f"record sim --robot lever.urdf --actuators torque {RECORD} --out lever") == 0
    assert run("pair lever --out paired --model lever.urdf --actuators torque") == 0
    assert run("train delta paired --updates 2 --hidden 4 --horizon 8 --out runs/phi") == 0
    assert run("evaluate runs/phi lever") == 0
    assert run("evaluate lever.urdf lever --actuators torque") == 0
    assert run("evaluate lever.urdf lever") == 2
    capsys.readouterr()
    assert run("train delta paired --actuators torque") == 2
    assert "Actuators are for a URDF that is given as the model" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        "gap find lever --model lever.urdf",
        "train delta paired --updates 2 --hidden 4 --model lever.urdf",
    ],
)
def test_each_command_with_a_model_takes_motors(command, urdf):
    assert run(f"record sim --robot lever.urdf --actuators torque {RECORD} --out lever") == 0
    assert run("pair lever --out paired --model lever.urdf --actuators torque") == 0
    assert run(command) == 2
    assert run(f"{command} --actuators torque") == 0


def test_positions_are_refused_by_motors_and_the_remedy_works(urdf, capsys):
    assert run(f"record sim --robot lever.urdf {RECORD} --out lever") == 0
    assert run("pair lever --out paired --model lever.urdf --actuators torque") == 2
    assert "give --actuators position" in capsys.readouterr().err
    assert run("pair lever --out paired --model lever.urdf --actuators position") == 0


def test_only_a_urdf_is_given_actuators(urdf, tmp_path, capsys):
    with pytest.raises(ModelFileError, match="ergojr defines its own actuators; leave out --actuators"):
        find_robot("ergojr:torque")
    assert run("record sim --robot ergojr --actuators torque") == 2
    assert run("record sim --env ErgoReacher --actuators torque") == 2
    assert "--actuators cannot be combined with --env" in capsys.readouterr().err


def test_a_written_model_is_judged_and_drawn_beside_the_urdf_that_it_came_from(urdf, capsys):
    assert run(f"record sim --robot lever.urdf --actuators torque {RECORD} --out lever") == 0
    spec = find_robot(f"{urdf}:torque").spec()
    spec.compile()
    (urdf.parent / "model.xml").write_text(spec.to_xml())
    assert run("evaluate model.xml lever --model lever.urdf --actuators torque") == 0
    assert run("render lever --model lever.urdf --model model.xml --actuators torque --out picture.png") == 0
    capsys.readouterr()
    assert run("evaluate model.xml lever --actuators torque") == 2
    assert "model.xml defines its own actuators" in capsys.readouterr().err
