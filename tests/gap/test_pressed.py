"""A written model holds friction under load by itself, or the nearest effect that it can, and the report says which."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from nas_data.cli import main
from nas_data.effects.base import parse
from nas_data.gap import score_model as added_file
from nas_data.gap.confidence import Support
from nas_data.gap.deliver import Delivery, are_similar, deliver, keep_confirmed_names, write_plain_fit
from nas_data.gap.name import Finding, Naming
from nas_data.gap.nominal import find_fine_timestep
from nas_data.gap.problem import Problem
from nas_data.gap.score_model import HeldOutResult, Prediction, predict_episodes, score_model
from nas_data.gap.search.final import FinalFit
from nas_data.gap.search.hypothesis import Description
from nas_data.robots import ergojr
from nas_data.runs.progress import silence

LOAD, PLAY = "load_friction:joint=m2,ratio=0.3", "backlash:joint=m2,half_width=0.03"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pressed")


@pytest.fixture(scope="module")
def given(folder: Path) -> Problem:
    """A recording of an arm that rubs under load, and its model."""
    return problem(folder / "arm", LOAD)


def problem(folder: Path, *effects: str, robot: str = "ergojr", more: tuple[str, ...] = ()) -> Problem:
    options = [option for text in effects for option in ("--effect", text)]
    out = str(folder)
    command = ["record", "sim", "--robot", robot, *options, "--noise", "0.0009", "--out", out]
    assert main([*command, "--episodes", "6", "--seconds", "1.5", *more]) == 0
    return Problem.load(out, "ergojr")


def outcome(given: Problem, folder: Path, *effects: str) -> HeldOutResult:
    folder.mkdir()
    known = FinalFit(tuple(parse(text) for text in effects), {}, ())
    return score_model(given, known, FinalFit((), {}, ()), FinalFit((), {}, ()), folder)


def error(given: Problem, predicted: Prediction) -> float:
    return float(np.degrees(np.sqrt(given.held.evidence.mean_squares(predicted.positions).mean())))


def flags(folder: Path) -> dict[str, bool]:
    entries = json.loads((folder / "effects.json").read_text())["effects"]
    return {entry["effect"]: entry["in_model_xml"] for entry in entries}


def test_the_file_rubs_under_load_by_itself(given: Problem, folder: Path, tmp_path: Path):
    found = outcome(given, tmp_path / "report", LOAD)
    assert found.expresses_all
    assert flags(tmp_path / "report") == {"load_friction": True}
    assert found.after is found.written
    assert error(given, found.before) > 1.5
    floor = float(np.degrees(np.sqrt((given.held.floor**2).mean())))
    assert error(given, found.written) < 1.4 * floor
    again = Problem.load(folder / "arm", found.model)
    assert not again.held.nominal.notes
    assert error(again, predict_episodes(again.held, again.held.nominal)) == pytest.approx(
        error(given, found.written), rel=0.05
    )


@pytest.mark.slow
def test_beside_play_the_file_has_the_nearest_effect(tmp_path: Path):
    given = problem(tmp_path / "arm", LOAD, PLAY)
    found = outcome(given, tmp_path / "report", LOAD, PLAY)
    assert not found.expresses_all
    assert flags(tmp_path / "report") == {"load_friction": False, "backlash": True}
    assert error(given, found.after) < 0.5 * error(given, found.written) < 0.5 * error(given, found.before)


def test_pads_made_for_a_wrong_size_are_made_anew(given: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    wrong = ((0.05, 20.0),)
    monkeypatch.setattr(added_file, "SIZES", wrong)
    assert not outcome(given, tmp_path / "wrong", LOAD).expresses_all
    assert flags(tmp_path / "wrong") == {"load_friction": False}
    monkeypatch.setattr(added_file, "SIZES", (*wrong, (1.0, 1.0)))
    found = outcome(given, tmp_path / "anew", LOAD)
    assert found.expresses_all
    assert error(given, found.written) < 1.4 * float(np.degrees(np.sqrt((given.held.floor**2).mean())))


@pytest.mark.slow
def test_a_file_that_does_not_do_quite_the_same_is_still_the_nearest(
    given: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(added_file, "MAX_ERROR_RATIO", 0.5)
    found = outcome(given, tmp_path / "report", LOAD)
    assert not found.expresses_all
    assert flags(tmp_path / "report") == {"load_friction": False}
    assert mujoco.MjModel.from_xml_path(str(found.model)).joint("m2_pressed_pad")
    assert error(given, found.after) <= error(given, found.written) < 0.3 * error(given, found.before)


def named(load: str, plain: str) -> Naming:
    """Names found with the model's own physics steps, beside a plain fit with finer ones."""
    (effect, stand_in), nothing = (parse(text) for text in (load, plain)), FinalFit((), {}, ())
    found = FinalFit((effect,), {}, ({},), fine=False)
    free, freed = Description((effect,)), Description((stand_in,))
    return Naming((), found, nothing, FinalFit((stand_in,), {}, ({},)), free, freed, {})


@pytest.mark.slow
def test_what_needs_fine_steps_in_a_file_is_fitted_with_them(tmp_path: Path):
    load = "load_friction:joint=m5,ratio=0.42"
    fine = mujoco.MjSpec.from_file(str(ergojr.ROBOT.mjcf))
    fine.option.timestep = 0.0005
    (tmp_path / "fine.xml").write_text(fine.to_xml(), encoding="utf-8")
    more = ("--rate", "100", "--excitation", "steps")
    given = problem(tmp_path / "arm", load, robot=str(tmp_path / "fine.xml"), more=more)
    names = named(load, load.replace("0.42", "0.416"))
    as_found = score_model(given, names.final, names.null, names.plain, tmp_path)
    assert error(given, as_found.written) > 1.05 * error(given, as_found.plain)
    naming, found = deliver(given, names, tmp_path, silence)
    assert error(given, found.written) < error(given, found.plain)
    assert naming.final.effects[0].name() == "load_friction" and naming.final.fine
    assert found.expresses_all and found.delivered == "names"


@pytest.mark.slow
def test_friction_that_falls_with_speed_is_written_as_a_fit_of_one_that_does_not(given: Problem, tmp_path: Path):
    """It is named as it was found all the same, and no name is said to be in the file."""
    wanted = named(f"{LOAD},kinetic_ratio=0.2,stribeck_velocity=0.3", LOAD.replace("0.3", "0.22"))
    wanted = replace(wanted, final=replace(wanted.final, fine=True))
    (tmp_path / "report").mkdir()
    naming, found = deliver(given, wanted, tmp_path / "report", silence)
    assert naming is wanted and not found.expresses_all and found.delivered == "names"
    assert flags(tmp_path / "report") == {"load_friction": False}
    assert mujoco.MjModel.from_xml_path(str(found.model)).joint("m2_pressed_pad")
    assert error(given, found.written) < 0.5 * error(given, found.plain)


@pytest.mark.slow
def test_names_hold_where_no_file_can_express_them(given: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(added_file, "SIZES", ((0.05, 20.0),))
    monkeypatch.setattr(added_file, "fit_model_effects", lambda problem, final: FinalFit((), {}, ()))
    wanted = named(LOAD, "coulomb_friction:joint=m2,torque=0.03")
    (tmp_path / "report").mkdir()
    naming, found = deliver(given, wanted, tmp_path / "report", silence)
    assert naming is wanted and not found.expresses_all and found.delivered == "names of MJCF and plain"
    assert flags(tmp_path / "report") == {"load_friction": False}
    assert error(given, found.after) < error(given, found.written) <= error(given, found.plain)


def test_right_names_are_kept_where_the_plain_fit_predicts_a_little_better(given: Problem, tmp_path: Path):
    """The plain fit is then what is written, and no name is said to be in the file."""
    found = named("coulomb_friction:joint=m2,torque=0.029", "coulomb_friction:joint=m2,torque=0.03")
    effect = found.final.effects[0]
    support = Support(closest_rival=0.2, chosen=1.0, rest=1.0, left=0.1)
    finding = Finding(effect, {}, support, before=1.0, after=0.1)
    as_found = score_model(given, found.final, found.null, found.plain, tmp_path)
    assert error(given, as_found.plain) < error(given, as_found.written) < error(given, as_found.before)
    names = replace(found, findings=(finding,))
    naming, outcome = write_plain_fit(Delivery(given, names, tmp_path, as_found))
    assert naming is names and outcome.delivered == "plain" and not outcome.contains(effect)
    assert error(given, outcome.written) == pytest.approx(error(given, as_found.plain), rel=0.05)  # longer steps
    assert error(given, outcome.after) == error(given, as_found.after)
    assert flags(tmp_path) == {"coulomb_friction": False}


def test_a_name_is_kept_where_a_better_plain_fit_confirms_it(tmp_path: Path):
    """The plain fit halves the same gain and has the same offset; of the third name it knows nothing."""
    given = problem(tmp_path / "arm", "servo_stiffness:joint=m2,factor=0.5")
    right, wrong = parse("servo_stiffness:joint=m2,factor=0.45"), parse("deadband:joint=m3,half_width=0.05")
    shift, shifted = (parse(f"joint_offset:joint=m1,offset={size}") for size in (0.004, 0.005))
    support = Support(closest_rival=0.2, chosen=1.0, rest=1.0, left=0.1)
    findings = tuple(Finding(effect, {}, support, 1.0, 0.1) for effect in (right, wrong, shift))
    final = FinalFit(
        (right, wrong, shift), {}, ({"factor": (0.44, 0.46)}, {"half_width": (0.04, 0.06)}, {"offset": (0.003, 0.0055)})
    )
    plain, freed = FinalFit((shifted,), {"m2.gain": 0.51, "m1.gain": 1.0}, ()), frozenset({"m1.gain", "m2.gain"})
    names = Naming(
        findings,
        final,
        FinalFit((), {}, ()),
        plain,
        Description((right, wrong, shift)),
        Description((shifted,), freed),
        {},
    )
    as_found = score_model(given, final, names.null, plain, tmp_path)
    assert error(given, as_found.written) > 1.1 * error(given, as_found.plain)
    naming, found = keep_confirmed_names(Delivery(given, names, tmp_path, as_found))
    assert [finding.effect for finding in naming.findings] == [parse("servo_stiffness:joint=m2,factor=0.51"), shifted]
    assert [finding.interval for finding in naming.findings] == [{"factor": (0.44, 0.51)}, {"offset": (0.003, 0.0055)}]
    assert naming.final.factors == {"m1.gain": 1.0}
    assert error(given, found.written) == pytest.approx(error(given, as_found.plain), rel=0.1)  # longer steps
    assert flags(tmp_path) == {"servo_stiffness": True, "joint_offset": True}
    assert not are_similar(shift, parse("joint_offset:joint=m1,offset=-0.004"))
    nothing = replace(
        names, plain=FinalFit((), {"m2.gain": 0.9, "m1.gain": 1.0}, ()), plain_description=Description((), freed)
    )
    assert keep_confirmed_names(Delivery(given, nothing, tmp_path, as_found)) is None


@pytest.mark.parametrize(("ratio", "is_own"), [(1.5, True), (0.9, False)])
def test_the_file_keeps_the_given_timestep_unless_shorter_steps_predict_better(
    ratio: float, is_own: bool, given: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(added_file, "LONGER_STEP_RATIO", ratio)
    effect, nothing = parse("coulomb_friction:joint=m2,torque=0.03"), FinalFit((), {}, ())
    found = score_model(given, FinalFit((effect,), {}, ({},), fine=True), nothing, nothing, tmp_path)
    nominal = given.held.nominal
    own, fine = float(nominal.spec.option.timestep), find_fine_timestep(nominal)
    assert fine < own
    assert mujoco.MjModel.from_xml_path(str(found.model)).opt.timestep == pytest.approx(own if is_own else fine)
