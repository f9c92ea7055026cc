"""Friction of a model that creeps where the arm's holds is made firm, and no effect is named."""

import mujoco
import numpy as np
import pytest
from support.mujoco_loop import play

import nas_data as nas
from nas_data.cli import main
from nas_data.effects.base import add_effects, parse
from nas_data.effects.coulomb_friction import CoulombFriction
from nas_data.effects.load_friction import LoadFriction
from nas_data.gap.problem import Problem
from nas_data.gap.search.firm_friction import make_friction_firm
from nas_data.gap.search.hypothesis import Description
from nas_data.gap.search.search import Search

ARM = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody><body pos="0 0 .5">
<joint name="j" axis="0 1 0" range="-2 2" damping=".05" armature=".004" frictionloss=".3" {firm}/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".01" mass=".15"/></body></worldbody>
<actuator><position name="j" joint="j" kp="8" kv=".4"/></actuator></mujoco>"""
FIRM = 'solimpfriction="0.999 0.999 0.001 0.5 2" solreffriction="0.004 1"'
RATE, ROWS, HELD = 50, 150, 25


def record(hidden: str, friction: float = 0.3) -> nas.Dataset:
    """Record motions with stops of an arm whose friction [N m] holds."""
    spec = mujoco.MjSpec.from_string(ARM.format(firm=FIRM))
    spec.joint("j").frictionloss = friction
    add_effects(spec, [parse(hidden)] if hidden else [])
    model, rng, positions, commands = spec.compile(), np.random.default_rng(0), [], []
    times = np.arange(ROWS) / RATE
    for _ in range(5):
        asked = sum(0.4 * (np.sin(times * w + p) - np.sin(p)) for w, p in rng.uniform(1.5, 7.0, (3, 2)))
        stop = np.arange(ROWS) // HELD
        asked = np.where((stop % 2 == 1) | (stop == 0), asked[stop * HELD], asked)
        positions.append(play(model, asked[:, None], 300) + rng.normal(scale=3e-4, size=(ROWS + 1, 1)))
        commands.append(asked[:, None])
    return nas.Dataset.from_arrays(positions, commands, rate=RATE, joints=["j"])


def identify(folder, hidden: str) -> nas.GapReport:
    (folder / "arm.xml").write_text(ARM.format(firm=""))
    return nas.identify(record(hidden), model=folder / "arm.xml")


def test_friction_that_only_has_to_hold_is_retuned_and_not_named(tmp_path):
    report = identify(tmp_path, "")
    assert report.verdict == "retuned" and report.effects == ()
    (firm,) = [entry for entry in report.retuned if entry.parameter == "j.solimpfriction"]
    assert firm.factor > 1.05
    report.save(tmp_path / "gap")
    root = record("").save(tmp_path / "datasets/arm")
    for file in ("effects.json", "report.json"):
        words = ["gap", "add", root, "--model", tmp_path / "arm.xml", "--effects", tmp_path / "gap" / file]
        assert main([*map(str, words), "--out", str(tmp_path / file)]) == 0
        again = mujoco.MjModel.from_xml_path(str(tmp_path / file / "model.xml"))
        assert again.dof_solimp[0, 0] == pytest.approx(0.9 * firm.factor, rel=1e-3)


def test_friction_that_the_robot_lacks_is_unexplained_because_no_effect_removes_it(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM.format(firm=FIRM))
    report = nas.identify(record("", friction=0.03), model=tmp_path / "arm.xml")
    assert report.verdict == "unexplained" and report.effects == ()
    (rest,) = report.unexplained
    assert (rest.joint, rest.goes_with) == ("j", "j.frictionloss")
    assert rest.ratio_to_noise < 1.5
    (friction,) = [entry for entry in report.retuned if entry.parameter == "j.frictionloss"]
    assert friction.factor == pytest.approx(0.1, rel=0.3)
    assert "check its value in the model" in str(report) and "more than 25 %" in str(report)
    text = report.save(tmp_path / "gap").joinpath("report.html").read_text()
    assert "only if numbers that it already has change by more than 25 %" in text


@pytest.mark.slow
def test_more_friction_is_named_with_its_size(tmp_path):
    report = identify(tmp_path, "coulomb_friction:joint=j,torque=0.2")
    (found,) = report.effects
    assert (found.name, found.joint) == ("coulomb_friction", "j")
    assert found.parameters["torque"].value == pytest.approx(0.2, rel=0.15)


def test_two_effects_without_size_in_one_joint_are_both_left_out(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM.format(firm=""))
    problem = Problem.of(record(""), tmp_path / "arm.xml", None)
    search = Search.begin(problem.train, problem.held)
    effects = (CoulombFriction(joint="j", torque=1e-9), LoadFriction(joint="j", ratio=1e-9))
    kept = search.fit_description(Description(effects), {}, steps=1)
    kept, firm = make_friction_firm(search, kept)
    assert kept.effects == () and firm == pytest.approx({"j.solimpfriction": 0.999 / 0.9})
