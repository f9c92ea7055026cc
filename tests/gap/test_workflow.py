"""The whole workflow, through the program, on a small arm whose missing effect is hidden."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.evidence_samples import measured
from support.two_joint_arm import ARM, recorded

from nas_data.cli import main
from nas_data.effects.base import parse
from nas_data.gap.output_folder import clear_report, stage_report
from nas_data.gap.residual_correlates import find_residual_correlate
from nas_data.gap.write_model import add_position_sensor, write_effects

BACKLASH = "backlash:joint=elbow,half_width=0.03"


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    return path


@pytest.fixture(scope="module")
def hidden(arm: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    folder = tmp_path_factory.mktemp("hidden")
    dataset = recorded(arm, folder / "data", "--effect", BACKLASH)
    assert main(["gap", str(dataset), "--model", str(arm), "--out", str(folder / "report")]) == 0
    return folder / "report", json.loads((folder / "report" / "report.json").read_text())


@pytest.mark.slow
def test_the_hidden_effect_is_named_and_measured(hidden: tuple[Path, dict]):
    _, report = hidden
    assert [(entry["effect"], entry["joint"]) for entry in report["effects"]] == [("backlash", "elbow")]
    width = report["effects"][0]["parameters"]["half_width"]
    assert width["unit"] == "rad"
    assert width["value"] == pytest.approx(0.03, rel=0.05)
    assert width["interval95"][0] <= width["value"] <= width["interval95"][1]
    assert report["effects"][0]["confidence"] > 0.8


@pytest.mark.slow
def test_the_report_keeps_the_contract(hidden: tuple[Path, dict]):
    folder, report = hidden
    contract = {"schema", "verdict", "effects", "retuned", "unexplained", "gap", "next_experiment", "episodes"}
    assert contract <= set(report)
    assert report["schema"] == 2
    assert report["verdict"] == "explained"
    assert report["gap"]["after"] < 0.3 * report["gap"]["before"]
    assert not set(report["episodes"]["train"]) & set(report["episodes"]["heldout"])
    for name in ("report.html", "effects.json", "model.xml"):
        assert (folder / name).stat().st_size > 100
    assert list((folder / "figures").glob("*.png"))


@pytest.mark.slow
def test_the_delivered_model_explains_fresh_episodes_in_plain_mujoco(
    hidden: tuple[Path, dict], arm: Path, tmp_path: Path
):
    from nas_data.dataset.read import read

    folder, _ = hidden
    fresh = read(recorded(arm, tmp_path / "fresh", "--effect", BACKLASH, "--seed", "7"))
    errors = {path: replayed(path, fresh) for path in (arm, folder / "model.xml")}
    assert errors[folder / "model.xml"] < 0.35 * errors[arm]


def replayed(path: Path, fresh) -> float:
    """Open-loop RMSE [rad] of a model that starts at rest in the first measured pose, by its own sensors."""
    model = mujoco.MjModel.from_xml_path(str(path))
    steps = round(0.01 / model.opt.timestep)
    squares = []
    for rows in fresh.episodes():
        data = mujoco.MjData(model)
        for place, joint in enumerate(("shoulder", "elbow")):
            data.joint(joint).qpos[:] = fresh.states[rows.start, place]
        for row in range(rows.start, rows.stop):
            data.ctrl[:2] = fresh.commands[row]
            mujoco.mj_step(model, data, steps)
            read = [data.joint("shoulder").qpos[0], data.joint("elbow").qpos[0]]
            if "elbow_play" in [model.joint(i).name for i in range(model.njnt)]:
                read[1] += data.joint("elbow_play").qpos[0]
            squares.append((np.array(read) - fresh.next_states[row, :2]) ** 2)
    return float(np.sqrt(np.mean(squares)))


@pytest.mark.slow
def test_pairing_takes_the_result_as_a_source(hidden: tuple[Path, dict], arm: Path, tmp_path: Path):
    folder, _ = hidden
    data = recorded(arm, tmp_path / "data", "--effect", BACKLASH, "--seed", "5")
    assert main(["pair", str(data), "--model", str(folder / "model.xml"), "--out", str(tmp_path / "a")]) == 0
    again = ["--effects", str(folder / "effects.json"), "--episodes", "1", "--out", str(tmp_path / "b")]
    assert main(["record", "sim", "--robot", str(arm), *again]) == 0


def test_stages_can_be_run_one_by_one(arm: Path, tmp_path: Path, capsys):
    folder = tmp_path / "named"
    folder.mkdir()
    write_effects(folder, [parse(BACKLASH)], {})
    data = recorded(arm, tmp_path / "data", "--effect", BACKLASH)
    assert main(["gap", "find", str(data), "--model", str(arm), "--out", str(tmp_path)]) == 0
    assert "elbow" in capsys.readouterr().out
    named = ["--effects", str(folder), "--out", str(tmp_path), "--json"]
    assert main(["gap", "add", str(data), "--model", str(arm), *named]) == 0
    added = json.loads(capsys.readouterr().out)
    assert added["after"] < added["before"]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [("joints", "no joint 'shoulder'"), ("torn", "cannot be used as a robot model"), ("missing", "no model file")],
)
def test_a_wrong_model_gets_a_sentence(change: str, sentence: str, arm: Path, tmp_path: Path, capsys):
    data = recorded(arm, tmp_path / "data", "--episodes", "2")
    path = tmp_path / "model.xml"
    if change != "missing":
        path.write_text(ARM.replace("shoulder", "hip") if change == "joints" else ARM[:400])
    capsys.readouterr()
    assert main(["gap", str(data), "--model", str(path), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert sentence in told
    assert "Traceback" not in told


@pytest.mark.parametrize(
    ("mine", "sentence"),
    [
        ("figures/photo.png", "holds figures, which is not a file of a gap report"),
        ("model.xml", "holds model.xml, which is not a file of a gap report"),
        ("phi/checkpoint/config.json", "holds phi, which is not a file of a gap report"),
        ("report.json", "holds report.json, which is not a file of a gap report"),
        ("assets/link.stl", "holds assets, which is not a file of a gap report"),
    ],
)
def test_a_report_replaces_nothing_but_a_report(mine: str, sentence: str, arm: Path, tmp_path: Path, capsys):
    data = recorded(arm, tmp_path / "data", "--episodes", "2")
    path = tmp_path / "out" / mine
    path.parent.mkdir(parents=True)
    path.write_text("years of work")
    assert main(["gap", str(data), "--model", str(arm), "--out", str(tmp_path / "out")]) == 2
    assert sentence in capsys.readouterr().err
    assert [found for found in (tmp_path / "out").rglob("*") if found.is_file()] == [path]


@pytest.mark.parametrize("stage", ["add", "name"])
def test_a_stage_replaces_nothing_but_a_report(stage: str, arm: Path, tmp_path: Path, capsys):
    data, named = recorded(arm, tmp_path / "data", "--episodes", "2"), tmp_path / "named"
    named.mkdir()
    write_effects(named, [parse(BACKLASH)], {})
    path = tmp_path / "out/model.xml"
    path.parent.mkdir()
    path.write_text("years of work")
    options = ["--effects", str(named)] if stage == "add" else []
    assert main(["gap", stage, str(data), "--model", str(arm), "--out", str(path.parent), *options]) == 2
    assert "holds model.xml, which is not a file of a gap report" in capsys.readouterr().err
    assert list(path.parent.iterdir()) == [path] and path.read_text() == "years of work"


@pytest.mark.parametrize("stage", ["add", "name"])
def test_a_finished_report_is_not_changed_by_a_stage(stage: str, arm: Path, tmp_path: Path, capsys):
    data, out = recorded(arm, tmp_path / "data", "--episodes", "2"), tmp_path / "out"
    out.mkdir()
    effects = write_effects(out, [parse(BACKLASH)], {})
    shutil.copy(effects, out / "report.json")
    options = ["--effects", str(effects)] if stage == "add" else []
    assert main(["gap", stage, str(data), "--model", str(arm), "--out", str(out), *options]) == 2
    assert "holds a finished report" in capsys.readouterr().err
    assert sorted(path.name for path in out.iterdir()) == ["effects.json", "report.json"]


def test_other_effects_than_those_in_the_folder_replace_them(arm: Path, tmp_path: Path):
    data, out = recorded(arm, tmp_path / "data", "--episodes", "2"), tmp_path / "out"
    out.mkdir()
    other = write_effects(out, [parse("viscous_friction:joint=elbow,coefficient=0.02")], {}).rename(out / "other.json")
    effects = write_effects(out, [parse(BACKLASH)], {})
    assert main(["gap", "add", str(data), "--model", str(arm), "--effects", str(other), "--out", str(out)]) == 0
    assert "viscous_friction" in effects.read_text() and "backlash" not in effects.read_text()


def test_effects_of_another_robot_are_refused(arm: Path, tmp_path: Path, capsys):
    data = recorded(arm, tmp_path / "data", "--episodes", "2")
    named = tmp_path / "effects.json"
    named.write_text('{"effects": [], "retuned": {"wrist.solimpfriction": 1.01}}')
    words = ["--model", str(arm), "--effects", str(named), "--out", str(tmp_path / "out")]
    assert main(["gap", "add", str(data), *words]) == 2
    assert "is about another robot: it names the parameter 'wrist.solimpfriction'" in capsys.readouterr().err


@pytest.mark.parametrize("stage", [(), ("add",)])
def test_a_model_is_not_replaced_by_what_explains_it(stage: tuple[str, ...], arm: Path, tmp_path: Path, capsys):
    data = recorded(arm, tmp_path / "data", "--episodes", "2")
    model, effects = tmp_path / "report/model.xml", tmp_path / "report/effects.json"
    model.parent.mkdir()
    model.write_text(ARM)
    effects.write_text('{"effects": []}')
    options = ["--effects", str(effects)] if stage else []
    assert main(["gap", *stage, str(data), "--model", str(model), "--out", str(model.parent), *options]) == 2
    assert "choose another --out" in capsys.readouterr().err
    assert model.read_text() == ARM


def test_a_negative_number_of_updates_is_refused_before_the_search(arm: Path, tmp_path: Path, capsys):
    data = recorded(arm, tmp_path / "data", "--episodes", "2")
    assert main(["gap", str(data), "--model", str(arm), "--out", str(tmp_path / "out"), "--learn", "-1"]) == 2
    assert "--learn is -1" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_one_episode_is_too_few(arm: Path, tmp_path: Path, capsys):
    data = recorded(arm, tmp_path / "data", "--episodes", "1")
    assert main(["gap", str(data), "--model", str(arm), "--out", str(tmp_path / "out")]) == 2
    assert "at least two" in capsys.readouterr().err


def test_an_arm_that_never_moved_gets_no_name(arm: Path, tmp_path: Path):
    commands = tmp_path / "still.csv"
    rows = "\n".join(f"{episode},0.3,-0.2" for episode in range(4) for _ in range(150))
    commands.write_text(f"episode,shoulder.pos,elbow.pos\n{rows}\n")
    data = recorded(arm, tmp_path / "data", "--effect", BACKLASH, "--commands", str(commands))
    assert main(["gap", str(data), "--model", str(arm), "--out", str(tmp_path / "report")]) == 0
    report = json.loads((tmp_path / "report/report.json").read_text())
    assert report["effects"] == []
    assert report["find"]["undecidable"]
    assert (tmp_path / "report/report.html").stat().st_size > 100


@pytest.mark.slow
def test_what_the_data_cannot_tell_apart_is_one_finding_with_its_equals(tmp_path: Path, capsys):
    """Below saturation a servo's velocity feedback does exactly what viscous friction does."""
    damped = tmp_path / "damped.xml"
    damped.write_text(ARM.replace('kp="0.5" forcerange="-0.3 0.3"', 'kp="0.5" kv="0.02"'))
    data = recorded(damped, tmp_path / "data", "--effect", "viscous_friction:joint=elbow,coefficient=0.04")
    assert main(["gap", str(data), "--model", str(damped), "--out", str(tmp_path / "report")]) == 0
    (entry,) = json.loads((tmp_path / "report" / "report.json").read_text())["effects"]
    assert (entry["effect"], entry["joint"]) == ("viscous_friction", "elbow")
    assert entry["equals"] == [{"effect": "servo_damping", "joint": "elbow"}]
    twin = next(other for other in entry["alternatives"] if other["effect"] == "servo_damping")
    assert twin["parameters"]["factor"] == pytest.approx(1 + 0.04 / 0.02, rel=0.1)
    assert "these data cannot distinguish it from" in capsys.readouterr().out


@pytest.mark.parametrize("quantity", ["position", "speed", "time"])
def test_what_is_left_is_told_by_what_it_goes_with(quantity: str):
    _, evidence = measured(seed=3)
    q = evidence.measured
    extra = {
        "position": 0.02 * np.sin(9 * q),
        "speed": 0.01 * np.gradient(q, 0.01, axis=1),
        "time": np.broadcast_to(0.01 * np.linspace(0, 1, q.shape[1])[None, :, None] ** 2, q.shape),
    }[quantity]
    assert find_residual_correlate(evidence, extra, 2) == quantity


def test_noise_goes_with_nothing_and_a_single_joint_with_no_other():
    _, evidence = measured(seed=3)
    rng = np.random.default_rng(0)
    alone = replace(
        evidence,
        joints=evidence.joints[:1],
        **{name: getattr(evidence, name)[..., :1] for name in ("measured", "commands")},
    )
    for _ in range(5):
        noise = rng.normal(scale=1e-3, size=alone.measured.shape)
        assert find_residual_correlate(alone, noise, 0) == "nothing"


def test_positions_are_not_commanded_to_torque_motors(
    arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = recorded(arm, tmp_path / "data")
    motors = tmp_path / "motors.xml"
    motors.write_text(ARM.replace("<position name", "<motor name"))
    assert main(["gap", str(data), "--model", str(motors), "--out", str(tmp_path / "out")]) == 2
    assert "commands positions of shoulder, the model's actuator takes torques" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_interrupted_report_leaves_the_earlier_one_and_a_finished_one_replaces_it(tmp_path: Path):
    earlier = {"report.json": "{}", "next_experiment.csv": "m1.pos", "phi/config.json": "φ", "assets/own.stl": "mesh"}
    for name, text in earlier.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)

    def read_files() -> dict[str, str]:
        return {str(path.relative_to(tmp_path)): path.read_text() for path in tmp_path.rglob("*") if path.is_file()}

    (tmp_path / "figures").write_text("no folder")
    with pytest.raises(FileExistsError), stage_report(tmp_path) as staged:
        (staged / "figures").mkdir()
        for name in ("report.json", "figures/gap.png"):
            (staged / name).write_text("new")
    (tmp_path / "figures").unlink()
    assert (tmp_path / "report.json").read_text() == "{}"
    shutil.rmtree(tmp_path / ".unfinished")
    with pytest.raises(KeyboardInterrupt), stage_report(tmp_path) as staged:
        (staged / "report.json").write_text("half")
        raise KeyboardInterrupt
    assert read_files() == earlier
    with stage_report(tmp_path) as staged:
        (staged / "assets").mkdir()
        for name in ("report.json", "model.xml", "assets/new.stl"):
            (staged / name).write_text("new")
    del earlier["next_experiment.csv"]
    assert read_files() == earlier | dict.fromkeys(("report.json", "model.xml", "assets/new.stl"), "new")


def test_figures_of_others_stay(tmp_path: Path):
    (tmp_path / "figures").mkdir()
    for name in ("gap_per_joint.png", "joint_m1.png", "mine.png"):
        (tmp_path / "figures" / name).write_text("picture")
    clear_report(tmp_path)
    assert [path.name for path in (tmp_path / "figures").iterdir()] == ["mine.png"]


def test_a_position_sensor_of_the_model_is_made_exact():
    sensor = '<sensor><jointpos name="elbow.pos" joint="elbow" cutoff="0.2"/></sensor></mujoco>'
    spec = mujoco.MjSpec.from_string(ARM.replace("</mujoco>", sensor))
    add_position_sensor(spec, "elbow")
    model = spec.compile()
    assert model.sensor("elbow.pos").cutoff[0] == 0 and model.nsensor == 1
