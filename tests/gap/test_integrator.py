"""Integrators that stiff effects upset are replaced, and that is said."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.delivery_samples import delivered, nominal
from support.report_samples import gap_report
from support.two_joint_arm import ARM, recorded

from nas_data.cli import main
from nas_data.effects.base import make_effect
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.integrator import find_longest_step
from nas_data.gap.summary import summarise
from nas_data.gap.write_model import write_difference, write_model
from nas_data.simulators.mujoco import MujocoSimulator

JOINTS = ("shoulder", "elbow")
INTEGRATORS = {
    "RK4": 'integrator="RK4"/>',
    "Euler without implicit damping": 'integrator="Euler"><flag eulerdamp="disable"/></option>',
}
STIFF = (
    make_effect("deadband", "elbow", {"half_width": 0.03}),
    make_effect("stribeck_friction", "elbow", {"torque": 0.05, "kinetic_ratio": 0.4, "stribeck_velocity": 0.2}),
)


def arm(tmp_path: Path, integrator: str, timestep: float = 0.002) -> Path:
    path = tmp_path / "arm.xml"
    text = ARM.replace('integrator="implicitfast"/>', INTEGRATORS.get(integrator, f'integrator="{integrator}"/>'))
    path.write_text(text.replace('timestep="0.002"', f'timestep="{timestep}"'))
    return path


def commanded() -> EpisodeBatch:
    commands = np.repeat(np.random.default_rng(0).uniform(-0.8, 0.8, (2, 4, 2)), 50, axis=1)
    empty = np.zeros_like(commands)
    return EpisodeBatch(JOINTS, 0.01, np.zeros((2, 2)), commands, empty, np.ones((2, 200), bool), np.arange(2))


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("effect", STIFF, ids=lambda effect: effect.name())
def test_stiff_effects_act_as_they_do_in_a_model_that_bears_them(integrator: str, effect, tmp_path: Path):
    usual = nominal(arm(tmp_path, "implicitfast"), JOINTS).predict(commanded(), [effect])
    given = nominal(arm(tmp_path, integrator), JOINTS)
    assert given.predict(commanded(), [effect]) == pytest.approx(usual, abs=0.02)
    model = delivered(tmp_path, given, effect)
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST


@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_the_model_moves_as_it_did(timestep: float, tmp_path: Path):
    path, evidence = arm(tmp_path, "RK4", timestep), commanded()
    as_given = MujocoSimulator.load(path, 0.01, JOINTS).rollout(evidence.initial, evidence.commands)[..., :2]
    error = nominal(path, JOINTS).predict(evidence) - as_given
    assert np.sqrt(np.mean(error**2)) < np.radians(0.1)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_it_is_said_in_a_line(integrator: str, tmp_path: Path, capsys):
    path = arm(tmp_path, integrator)
    data = recorded(path, tmp_path / "data", "--episodes", "2")
    capsys.readouterr()
    assert main(["gap", "find", str(data), "--model", str(path)]) == 0
    told = capsys.readouterr().out
    assert "(hold): predicts that nothing moves; (command): predicts" in told
    assert f"The model's integrator, {integrator}, diverges with stiff effects" in told
    assert main(["gap", "find", str(data), "--model", str(arm(tmp_path, "implicitfast"))]) == 0
    assert "It is simulated as given." in capsys.readouterr().out


def test_the_summary_repeats_it(tmp_path: Path):
    note = nominal(arm(tmp_path, "RK4"), JOINTS).notes[0]
    audit = [{"check": "timing", "finding": "late", "ok": False}, {"check": "model", "finding": note, "ok": False}]
    told = summarise(gap_report(find={"joints": {}, "regimes": [], "audit": audit}), tmp_path)
    assert note in told.splitlines() and "late" not in told


@pytest.mark.parametrize("integrator", ["implicitfast", *INTEGRATORS])
def test_the_difference_starts_from_the_options_as_given(integrator: str, tmp_path: Path):
    given = nominal(arm(tmp_path, integrator, 0.003), JOINTS)
    assert given.spec.option.timestep < 0.003, "ours divides a control period"
    (folder := tmp_path / "report").mkdir()
    write_model(folder, given, [STIFF[0]], {})
    lines = write_difference(folder, given, "arm.xml").read_text().splitlines()
    (before,) = (line for line in lines if line.startswith("-  <option"))
    assert 'timestep="0.003"' in before
    assert ('integrator="RK4"' in before) == (integrator == "RK4")


@pytest.mark.parametrize(("constraint", "longest"), [("", np.inf), ('solreflimit="0.004 1"', 0.002)])
def test_the_stiffest_constraint_limits_the_physics_step(constraint, longest):
    limit = f'range="-1 1" {constraint}' if constraint else ""
    text = f"""<mujoco><worldbody><body><joint name="j" {limit}/><geom size="0.1"/></body></worldbody></mujoco>"""
    assert find_longest_step(mujoco.MjModel.from_xml_string(text)) == longest


def test_a_hard_contact_pair_limits_the_physics_step():
    bodies = '<geom name="a" size="0.1"/><body pos="0 0 1"><freejoint/><geom name="b" size="0.1"/></body>'
    pair = '<contact><pair geom1="a" geom2="b" solref="0.001 1"/></contact>'
    text = f"<mujoco><worldbody>{bodies}</worldbody>{pair}</mujoco>"
    assert find_longest_step(mujoco.MjModel.from_xml_string(text)) == 0.0005
