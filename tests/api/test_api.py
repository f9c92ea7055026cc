"""The functions for notebooks, as DESIGN.md's section on Python writes them, on tiny data."""

import json
import re
import subprocess
import sys
import time
from dataclasses import FrozenInstanceError, astuple, dataclass, is_dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

import gymnasium
import mujoco
import numpy as np
import pandas
import pytest
from support.recording_samples import pendulum, wander
from support.report_samples import gap_report

import nas_data as nas
from nas_data.api.arguments import find_folder
from nas_data.dataset.content import hash_content
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.verify import verify
from nas_data.effects.base import Effect, Parameter, parse
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.errors import DatasetInvalid, JointMismatch, MissingPackage, OptionError, OutputExists, UnknownName
from nas_data.models.presets import TrainingOptions, preset
from nas_data.policies.policy import Hyperparameters
from nas_data.policies.policy import load_policy as read_policy
from nas_data.policies.ppo import PolicyTraining, train
from nas_data.robots.base import find_robot

PAGE = Path(__file__).parents[2] / "docs/python.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
JOINTS = ["pendulum"]


@pytest.fixture(scope="module")
def log() -> dict[str, np.ndarray]:
    """Return positions [rad] and commands of a pendulum with play, four episodes."""
    target = pendulum(parse("backlash:joint=pendulum,half_width=0.08"))
    commands = np.stack(wander((70,) * 4, seed=1))
    first = np.concatenate([commands[:, 0], np.zeros((4, 1))], axis=1)
    states = np.concatenate([first[:, None], target.rollout_settled(first, commands)], axis=1)
    noise = np.random.default_rng(0).normal(0, 2e-4, states[..., :1].shape)
    return {"positions": states[..., :1] + noise, "commands": commands}


@pytest.fixture(scope="module")
def ds(log) -> nas.Dataset:
    return nas.Dataset.from_arrays(log["positions"], log["commands"], rate=50, joints=JOINTS)


@pytest.fixture(scope="module")
def arm(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_bytes(find_robot("pendulum").mjcf.read_bytes())
    return path


@pytest.fixture(scope="module")
def paired(ds, arm) -> nas.Dataset:
    return nas.pair(ds, model=arm)


@pytest.fixture(scope="module")
def policy(tmp_path_factory) -> Path:
    """Return a policy after one short rollout."""
    folder = tmp_path_factory.mktemp("policy") / "seed3"
    small = Hyperparameters(arms=4, rollout=64, minibatches=2, epochs=1)
    return train(PolicyTraining(DynamicsSpec("ErgoReacher"), 3, 64, small), folder, lambda line: None)


@pytest.fixture(scope="module")
def page(log, arm, policy, tmp_path_factory) -> dict[str, object]:
    """Run every block of the page in one folder; return what they leave."""
    place = tmp_path_factory.mktemp("page")
    np.savez(place / "log.npz", **log)
    (place / "arm.xml").write_bytes(arm.read_bytes())
    (place / "runs").mkdir()
    (place / "runs/policy").symlink_to(policy)
    left: dict[str, object] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        patch.setattr("nas_data.api.training.find_preset", partial(preset, hidden=8, layers=1, frames=200))
        for block in BLOCKS:
            exec(compile(block, str(PAGE), "exec"), left)
    return {**left, "place": place}


def spent(code: str) -> float:
    """Return how long a fresh Python takes for some code, beyond its own start [s]: the best of three."""

    def once(text: str) -> float:
        began = time.perf_counter()
        subprocess.run([sys.executable, "-c", text], check=True)
        return time.perf_counter() - began

    return min(once(code) - once("import json") for _ in range(3))


# --- one import


@pytest.mark.slow
def test_the_import_takes_less_than_a_tenth_of_a_second():
    assert spent("import nas_data") < 0.1


def test_a_dataset_is_made_without_torch_and_lerobot():
    code = (
        "import sys, numpy as np, nas_data as nas; rows = np.zeros((9, 1)); rows[:, 0] = np.linspace(0, 1, 9);"
        "nas.Dataset.from_arrays(rows, rows, rate=50, joints=['a']).to_pandas();"
        "print([name for name in ('torch', 'lerobot', 'mujoco') if name in sys.modules])"
    )
    said = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert said.stdout.strip() == "[]"


def test_every_name_is_there_and_no_other():
    assert set(nas.__all__) == set(nas.HOMES)
    assert set(nas.__all__) <= set(dir(nas))
    for name in nas.__all__:
        assert getattr(nas, name).__doc__
    with pytest.raises(AttributeError, match="has no attribute 'identfy'"):
        nas.identfy  # noqa: B018


# --- datasets


def test_what_is_returned_is_frozen_and_says_what_it_is_in_a_line(ds, paired, page):
    values = [ds, paired, page["report"], page["effect"], page["phi"], page["psi"], page["errors"]]
    for value in [*values, page["errors"].open_loop["hold"]]:
        assert is_dataclass(value)
        assert len(repr(value)) < 200 and "\n" not in repr(value)
        with pytest.raises(FrozenInstanceError):
            value.joints = ()
    assert repr(ds) == "Dataset(unknown: 4 episodes, 280 frames at 50 Hz, 5.6 s; joints pendulum)"
    assert repr(paired).endswith("paired)")


def test_arrays_become_transitions_whose_next_state_is_the_following_row(ds, log):
    np.testing.assert_allclose(ds.states[:70, 0], log["positions"][0, :70, 0], atol=1e-6)
    np.testing.assert_allclose(ds.next_states[:70, 0], log["positions"][0, 1:, 0], atol=1e-6)
    np.testing.assert_array_equal(ds.commands[:70], log["commands"][0].astype(np.float32))
    one = nas.Dataset.from_arrays(log["positions"][0], log["commands"][0], rate=50, joints=JOINTS)
    uneven = nas.Dataset.from_arrays(
        [log["positions"][0], log["positions"][1][:31]],
        [*log["commands"][:1], log["commands"][1][:31]],
        rate=50,
        joints=JOINTS,
    )
    assert one.lengths.tolist() == [70]
    assert uneven.lengths.tolist() == [70, 30]


def test_measured_velocities_and_a_clock_are_taken_as_they_are(log):
    positions, n = log["positions"][0], len(log["positions"][0])
    more = {"velocities": np.full((n, 1), 0.25), "times": 7.0 + np.arange(n) / 50}
    made = nas.Dataset.from_arrays(positions, log["commands"][0], rate=50, joints=JOINTS, kind="torque", **more)
    assert (made.states[:, 1] == 0.25).all()
    assert made.kinds == (".effort",)
    np.testing.assert_allclose(made.columns["nas.time"][:, 0], np.arange(70) / 50)


def test_torques_that_were_taken_for_positions_are_answered_with_the_kind(log, capsys):
    positions = log["positions"][0]
    nas.Dataset.from_arrays(positions, -positions, rate=50, joints=JOINTS)
    assert "against its command" in (told := capsys.readouterr().err)
    assert "kind='torque'" in told


def test_each_joint_may_be_commanded_in_a_kind_of_its_own():
    rows, kinds = np.linspace(0, 0.02, 90).reshape(30, 3), ["position", "torque", "velocity"]
    made = nas.Dataset.from_arrays(rows, rows, rate=50, joints=("a", "b", "c"), slides=("b",), kind=kinds)
    assert made.kinds == (".pos", ".effort", ".vel")
    assert made.features["action"].units == ("rad", "N", "rad/s")


def test_a_table_and_rows_of_one_joint_are_taken_as_arrays(log):
    positions, commands = log["positions"][0], log["commands"][0]
    wanted = nas.Dataset.from_arrays(positions, commands, rate=50, joints=JOINTS, times=np.arange(71) / 50)
    rows = [column[:, 0] for column in (positions, commands)]
    tables = [pandas.DataFrame(column, index=range(9, 9 + len(column))) for column in rows]
    clock = pandas.Series(np.arange(71) / 50, index=range(9, 80))
    for given, times in (
        (rows, clock),
        ([column.tolist() for column in rows], clock.tolist()),
        (tables, clock),
        ([[table] for table in tables], [clock]),
    ):
        made = nas.Dataset.from_arrays(*given, rate=50, joints=JOINTS, times=times)
        for key, column in wanted.columns.items():
            np.testing.assert_array_equal(made.columns[key], column)


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"joints": ["a", "b"]}, DatasetInvalid, r"shape \(71, 1\); \(T, 2\) is needed"),
        ({"joints": ["a", "a"]}, JointMismatch, "one name of its own"),
        ({"slides": ["z"]}, JointMismatch, "slides name 'z'"),
        ({"rate": 0}, OptionError, "control rate"),
        ({"kind": "effort"}, OptionError, "position, velocity, torque"),
        ({"kind": ["velocity", "torque"]}, OptionError, "one kind, or one for each joint: pendulum"),
        ({"commands": np.zeros((4, 60, 1))}, DatasetInvalid, "71 rows of positions and 60 of commands"),
        ({"commands": np.zeros((3, 70, 1))}, DatasetInvalid, "positions are of 4 episodes, the commands of 3"),
        ({"positions": np.full((4, 71, 1), np.nan)}, DatasetInvalid, "in memory.* is nan in episode 0"),
        (
            {"positions": []},
            DatasetInvalid,
            r"positions has no rows \(shape \(0, 1\)\); leave it out, or give its rows",
        ),
        ({"commands": np.empty((0, 70, 1))}, DatasetInvalid, "commands has no rows"),
        ({"positions": [np.zeros((71, 1)), np.zeros((0, 1))]}, DatasetInvalid, "positions has no rows"),
        ({"times": []}, DatasetInvalid, "times has no rows"),
        ({"positions": [np.zeros(70), np.zeros(30)]}, DatasetInvalid, "positions are not numbers in rows of 1"),
        ({"commands": [["up"], ["down"]]}, DatasetInvalid, "commands are not numbers"),
        ({"tasks": ["swing"]}, DatasetInvalid, "1 task for 4 episodes; give one for each, or none"),
    ],
)
def test_arrays_that_cannot_be_are_refused_in_a_sentence(log, changes, error, words):
    given = {**log, "rate": 50, "joints": JOINTS, **changes}
    with pytest.raises(error, match=words) as caught:
        nas.Dataset.from_arrays(given.pop("positions"), given.pop("commands"), **given)
    assert isinstance(caught.value, nas.NasError)


def test_degrees_are_refused(log):
    with pytest.raises(DatasetInvalid, match="give radians"):
        nas.Dataset.from_arrays(np.degrees(log["positions"]), np.degrees(log["commands"]), rate=50, joints=JOINTS)


def test_a_table_has_a_row_a_frame_and_a_column_a_component(ds):
    table = ds.to_pandas()
    assert table.shape == (280, 5)
    assert table.index.names == ["episode", "frame"]
    assert list(table["observation.state"].columns) == ["pendulum.pos", "pendulum.vel"]
    rows = table.loc[2, ("action", "pendulum.pos")]
    np.testing.assert_array_equal(rows.to_numpy(), ds.commands[ds.episode(2), 0])


def test_saving_makes_versions_that_name_their_parents(ds, paired, arm, tmp_path):
    first = ds.save(tmp_path / "arm")
    assert ds.save(tmp_path / "arm") == ds.save(first) == first
    loaded = nas.Dataset.load(tmp_path / "arm")
    assert hash_content(loaded) == hash_content(ds)
    second = nas.pair(loaded, model=arm).save(tmp_path / "arm")
    assert [first.name[:3], second.name[:3]] == ["v1-", "v2-"]
    provenance = read_provenance(second)
    assert (provenance.how, provenance.source["engine"]) == ("paired", "mujoco")
    assert [parent.name for parent in provenance.parents] == [f"arm/{first.name}"]
    assert (second / "meta/source.xml").read_bytes() == arm.read_bytes()
    assert hash_content(nas.Dataset.load(second)) == hash_content(paired)
    third = nas.Dataset.load(second).select([0, 2]).save(tmp_path / "arm")
    provenance = read_provenance(third)
    assert (provenance.how, provenance.parents[0].name) == ("edited", f"arm/{second.name}")
    assert nas.Dataset.load(second, [0, 2]).save(tmp_path / "arm") == third
    fourth = nas.Dataset.load(second, [1, 3]).save(tmp_path / "arm")
    provenance = read_provenance(fourth)
    assert (provenance.how, provenance.parents[0].name) == ("edited", f"arm/{second.name}")
    assert [verify(root) for root in (first, second, third, fourth)] == [[], [], [], []]


def test_lerobots_own_recording_is_read_with_what_it_lacks_derived(ds, tmp_path):
    from support.recording_samples import positions_only

    from nas_data.dataset.provenance import Provenance
    from nas_data.dataset.write import write

    folder = write(positions_only(ds), tmp_path / "theirs", Provenance(how="lerobot"))
    (folder / "meta/nas.json").unlink()
    made = nas.Dataset.from_lerobot(folder)
    assert made.states.shape == (276, 2)  # without the last frame of each episode, whose next is not known
    saved = read_provenance(made.save(tmp_path / "ours"))
    assert "savgol" in saved.derived["observation.state"]
    assert saved.parents[0].name == "theirs"


# --- recordings and logs


def test_a_recording_is_what_the_command_writes(arm, tmp_path):
    from nas_data.cli import main

    effect, rate = "backlash:joint=pendulum,half_width=0.05", 50
    made = nas.record(arm, effects=[effect], rate=rate, episodes=2, seconds=1, noise=1e-3, seed=3)
    amount = ("--episodes", "2", "--seconds", "1", "--noise", "1e-3", "--seed", "3")
    command = ("record", "sim", "--robot", str(arm), "--effect", effect, "--rate", str(rate), *amount)
    assert main([*command, "--out", str(tmp_path / "written")]) == 0
    written = nas.Dataset.load(tmp_path / "written")
    assert hash_content(made) == hash_content(written)
    saved = read_provenance(made.save(tmp_path / "made"))
    assert saved.target == read_provenance(tmp_path / "written").target
    assert saved.target["effects"][0]["effect"] == "backlash"


def test_logs_come_by_a_map(tmp_path):
    seconds = np.arange(101) / 50
    table = np.column_stack([seconds, *(np.degrees(0.5 * np.sin(seconds + ahead)) for ahead in (0.0, 0.02))])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="time,q,goal", comments="")
    columns = {"position": "q", "command": "goal"}
    read = "".join(f'[read.{what}]\ncolumns = ["{name}"]\nunit = "deg"\n' for what, name in columns.items())
    (tmp_path / "map.toml").write_text(
        'format = "csv"\nrobot = "my_arm"\njoints = ["shoulder"]\nrate = 50.0\nalignment = "action_follows_state"\n'
        f'velocity = "derive"\n[read.time]\ncolumn = "time"\nunit = "s"\n{read}'
    )
    made = nas.import_logs(tmp_path / "log.csv", map=tmp_path / "map.toml", cut=1)
    assert (made.robot_type, made.joints, made.n_episodes) == ("my_arm", ("shoulder",), 2)
    np.testing.assert_allclose(made.states[:50, 0], 0.5 * np.sin(seconds[:50]), atol=1e-6)
    saved = made.save(tmp_path / "arm")
    assert (saved / "meta/import_map.toml").read_text() == (tmp_path / "map.toml").read_text()
    with pytest.raises(OptionError, match="not a LeRobot dataset"):
        nas.import_logs(tmp_path / "log.csv")


# --- pairing


def test_pairs_are_what_the_command_writes(ds, paired, arm, tmp_path):
    from nas_data.cli import main

    root = ds.save(tmp_path / "arm")
    assert main(["pair", str(root), "--model", str(arm), "--out", str(tmp_path / "pairs")]) == 0
    assert hash_content(nas.Dataset.load(tmp_path / "pairs")) == hash_content(paired)


def test_a_source_may_have_effects(ds, arm, paired):
    changed = nas.pair(ds, model=arm, effects=["viscous_friction:joint=pendulum,coefficient=0.1"])
    assert changed.origin.provenance.source["effects"][0]["effect"] == "viscous_friction"
    assert not np.array_equal(changed.sim_states, paired.sim_states)


@dataclass(frozen=True, kw_only=True)
class CablePull(Effect):
    """An effect of one's own."""

    stiffness: float

    parameters: ClassVar = (Parameter("stiffness", "N·m/rad", 0.0, 1.0, 0.0),)

    def edit(self, spec) -> None:
        spec.joint(self.joint).stiffness[0] += self.stiffness


def test_an_effect_of_ones_own_goes_by_the_name_of_its_class(ds, arm, paired):
    by_name = nas.pair(ds, model=arm, effects=["cable_pull:joint=pendulum,stiffness=0.2"])
    as_object = nas.pair(ds, model=arm, effects=[CablePull(joint="pendulum", stiffness=0.2)])
    assert hash_content(by_name) == hash_content(as_object) != hash_content(paired)
    assert by_name.origin.provenance.source["effects"][0]["effect"] == "cable_pull"
    with pytest.raises(UnknownName, match="no effect 'cable_push'"):
        parse("cable_push:joint=pendulum,stiffness=0.2")


# --- the gap report


def test_the_hidden_play_is_named(page):
    report = page["report"]
    assert [(effect.name, effect.joint) for effect in report.effects] == [("backlash", "pendulum")]
    low, high = page["half_width"].interval95
    assert low <= page["half_width"].value <= high
    assert page["half_width"].value == pytest.approx(0.08, rel=0.1)
    assert page["half_width"].unit == "rad"


def test_a_saved_report_is_what_it_was_and_plain_mujoco_loads_its_model(page):
    import mujoco

    folder, report = page["place"] / "runs/gap", page["report"]
    again = nas.GapReport.load(folder)
    assert again == report
    assert again.files == report.files
    assert json.loads((folder / "report.json").read_text()) == report.to_json()
    for name in ("report.html", "effects.json", "model.xml", "series.npz"):
        assert (folder / name).is_file()
    assert list((folder / "figures").glob("*.png"))
    assert mujoco.MjModel.from_xml_path(str(folder / "model.xml")).sensor("pendulum.pos").id >= 0


def test_report_json_has_the_keys_of_the_contract(page):
    content = page["report"].to_json()
    keys = "schema verdict effects retuned joints unexplained gap next_experiment episodes seed seconds"
    assert set(keys.split()) <= set(content)
    effect = content["effects"][0]
    assert {"effect", "joint", "parameters", "confidence", "evidence", "alternatives", "in_model_xml"} <= set(effect)
    assert set(effect["parameters"]["half_width"]) == {"value", "unit", "interval95"}
    gap = {"metric", "unit", "noise_floor", "before", "plain", "after", "per_joint", "conditioning"}
    assert gap <= set(content["gap"])
    assert set(content["joints"]["pendulum"]) == {"complete", "ratio_to_noise", "stable"}
    assert content["schema"] == 2
    assert content["conditioning"] == content["gap"]["conditioning"] > 1


def test_parts_of_a_report_have_short_reprs(page):
    report = page["report"]
    assert max(len(repr(part)) for part in (report, report.gap, report.find, report.effects[0])) < 120


def test_a_dataset_that_was_changed_after_it_was_written_says_so_and_so_do_its_pairs(ds, arm, tmp_path, capsys):
    root = ds.save(tmp_path / "datasets/arm")
    content = json.loads((root / "meta/nas.json").read_text())
    (root / "meta/nas.json").write_text(json.dumps({**content, "content_hash": "0" * 64}))
    paired = nas.pair(nas.Dataset.load(root), model=arm)
    assert "was changed after nas wrote it" in capsys.readouterr().err
    assert "its provenance may not hold" in read_provenance(paired.save(tmp_path / "datasets/paired")).notes


def test_a_dataset_cannot_be_changed_and_equals_itself_only(ds):
    for array in (ds.states, ds.commands):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 3.0
    assert ds == ds and ds != nas.Dataset.from_arrays(np.zeros((2, 9, 1)), np.zeros((2, 9, 1)), rate=50, joints=["a"])
    assert {ds: 1}[ds] == 1


def test_a_report_is_drawn_and_unknown_joints_are_refused(page):
    for figure in (page["report"].plot("pendulum"), page["report"].plot()):
        assert figure.axes[0].lines
    assert (page["place"] / "pendulum.png").stat().st_size > 1000
    with pytest.raises(UnknownName, match="no joint 'm9'; choose one of: pendulum"):
        page["report"].plot("m9")
    with pytest.raises(OptionError, match=r"no series\.npz"):
        gap_report().plot()


def test_a_report_replaces_no_strangers_files(page, tmp_path):
    (tmp_path / "model.xml").write_text("<mujoco/>")
    with pytest.raises(nas.NasError, match="not a file of a gap report"):
        page["report"].save(tmp_path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("[1]", "is not a gap report"),
        ('{"verdict": 3}', "lacks effects, episodes, gap"),
        (json.dumps({**gap_report().to_json(), "verdict": 3}), "verdict is '3', not a text"),
        (json.dumps({**gap_report().to_json(), "retuned": [{"parameter": "a.gain", "factor": "x"}]}), r"retuned\[0\]"),
    ],
)
def test_a_file_that_is_no_report_is_refused(tmp_path, content, words):
    (tmp_path / "report.json").write_text(content)
    with pytest.raises(OptionError, match=words):
        nas.GapReport.load(tmp_path)


def test_a_report_serves_as_a_source(page, ds, arm, paired):
    folder = page["place"] / "runs/gap"
    for report in (page["report"], folder, str(folder / "effects.json")):
        changed = nas.pair(ds, model=arm, report=report)
        assert changed.origin.provenance.source["effects"][0]["effect"] == "backlash"
        assert not np.array_equal(changed.sim_states, paired.sim_states)


# --- learning


def test_models_are_judged_beside_what_needs_no_learning(page):
    names = {"source + φ", "source", "hold", "command", "plain fit"}
    errors = page["errors"]
    assert set(errors.open_loop) == set(errors.one_step) == names
    assert errors.open_loop["plain fit"].overall < errors.open_loop["source"].overall
    assert "fitted to the training data of the model" in str(errors)


def test_models_say_how_they_were_trained_and_are_saved(page, ds, arm, tmp_path):
    phi, psi = page["phi"], page["psi"]
    assert (phi.kind, psi.kind, phi.joints) == ("delta", "forward", ("pendulum",))
    assert phi.history[-1]["update"] == 2
    assert "source + φ" in phi.held_out.open_loop
    again = nas.LearnedModel.load(page["place"] / "runs/phi")
    assert again.network.provenance["kinds"] == [".pos"]
    given = {"model": arm, "plain_fit": False}
    first, second = (nas.evaluate(one, ds, **given) for one in (phi, again))
    assert first.to_json() == second.to_json()
    assert "another source" not in str(first)
    spec = mujoco.MjSpec.from_file(str(arm))
    spec.actuators[0].set_to_position(kp=1.0)
    (soft := tmp_path / "soft.xml").write_text(spec.to_xml())
    assert "was trained with another source" in str(nas.evaluate(again, ds, model=soft, plain_fit=False))
    for plain_fit in (False, True):
        without = nas.evaluate(psi, ds, plain_fit=plain_fit)
        assert set(without.open_loop) == {"ψ", "hold", "command"}
        assert ("no plain fit: it needs the model that it fits" in str(without)) == plain_fit


def test_a_corrected_model_stands_beside_the_one_that_it_came_from(page, ds, arm):
    corrected = page["place"] / "runs/gap/model.xml"
    both = nas.evaluate(corrected, ds, model=arm, plain_fit=False)
    assert list(both.open_loop) == ["model", "source", "hold", "command"]
    for name, alone in (("model", corrected), ("source", arm)):
        assert both.open_loop[name].overall == nas.evaluate(alone, ds, plain_fit=False).open_loop["source"].overall
    assert both.open_loop["model"].overall < both.open_loop["source"].overall


def test_phi_needs_pairs(ds):
    with pytest.raises(DatasetInvalid, match="pair it first"):
        nas.train_delta(ds)


@pytest.mark.parametrize("name", ["runs/gap/model.xml", "so102_follower"])
def test_what_is_not_there_is_called_so(ds, name):
    with pytest.raises(OptionError, match=rf"no file or folder '{name}', and no robot of that name \(.*pendulum"):
        nas.evaluate(name, ds)


def test_progress_is_told(ds):
    lines: list[str] = []
    small = TrainingOptions(hidden=8, layers=1, frames=200)
    nas.train_forward(ds, preset=small, updates=1, seed=1, progress=lines.append)
    assert any("validation" in line for line in lines)


def test_a_training_goes_on_with_the_episodes_that_it_began_with_only(ds, tmp_path):
    folder, small = ds.save(tmp_path / "arm"), TrainingOptions(hidden=8, layers=1, frames=200, updates=2)

    def interrupt(line: str) -> None:
        if "validation " in line and " s" in line:
            raise KeyboardInterrupt

    def train_on(episodes, progress=None):
        part = nas.Dataset.load(folder, episodes)
        return nas.train_forward(part, preset=small, out=tmp_path / "psi", progress=progress)

    with pytest.raises(KeyboardInterrupt):
        train_on([2, 3], interrupt)
    with pytest.raises(OutputExists, match="unfinished training with other options, data"):
        train_on([0, 1])
    seen = train_on([2, 3]).network.provenance["dataset"]
    assert (seen["content_hash"], seen["episodes"]) == (hash_content(ds), [2, 3])


def test_a_part_of_a_folder_is_not_taken_for_the_folder(ds, tmp_path):
    folder = ds.save(tmp_path / "arm")
    assert find_folder(nas.Dataset.load(folder)) == folder
    assert find_folder(nas.Dataset.load(folder, [0, 1])) is None, "a gap report would name another recording"
    with pytest.raises(DatasetInvalid, match=r"nas pair .*arm/v1-"):
        nas.train_delta(nas.Dataset.load(folder, [0, 1]))


def test_numpy_selects_episodes_as_a_list_does(ds, tmp_path):
    folder = ds.save(tmp_path / "arm")
    loaded = nas.Dataset.load(folder, np.array([3, 1]))
    assert hash_content(loaded) == hash_content(ds.select(np.array([3, 1]))) == hash_content(ds.select([3, 1]))
    result = nas.evaluate("pendulum", ds, episodes=np.arange(2), plain_fit=False)
    assert result.open_loop["source"].lengths.tolist() == [70, 70]


@pytest.mark.parametrize(
    ("episodes", "words"),
    [
        ([], "No episodes are given"),
        ([0.0], "give their numbers"),
        (1, "give their numbers"),
        ([1, 0, 1], "1 is given twice"),
    ],
)
def test_episodes_that_are_none_or_no_numbers_are_refused_in_a_sentence(ds, tmp_path, episodes, words):
    folder = ds.save(tmp_path / "arm")
    with pytest.raises(OptionError, match=words):
        nas.Dataset.load(folder, episodes)
    for dataset in (ds, folder):
        with pytest.raises(OptionError, match=words):
            nas.evaluate("pendulum", dataset, episodes=episodes, plain_fit=False)


@pytest.mark.parametrize("episodes", [[], range(0), [0.0], 1, ["0"]])
def test_a_selection_of_nothing_is_refused_in_a_sentence(ds, episodes):
    with pytest.raises(OptionError, match="give their numbers"):
        ds.select(episodes)


# --- environments and policies


def test_an_environment_draws_what_it_shows(page):
    assert page["picture"].shape == (480, 640, 3)
    assert page["picture"].dtype == np.uint8
    env = page["env"]
    env.reset(seed=1)
    assert not np.array_equal(env.render(), page["picture"])


@pytest.mark.parametrize("task", ["ErgoShield", "Pusher", "Striker"])
def test_every_environment_has_pictures_that_move(task):
    env = gymnasium.make(f"nas_data:nas/{task}-v0", render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    for _ in range(20):
        env.step(env.action_space.high)
    assert first.std() > 1
    assert not np.array_equal(env.render(), first)
    env.close()


def test_an_environment_without_pictures_says_so():
    env = gymnasium.make("nas_data:nas/ErgoReacher-v0").unwrapped
    assert env.metadata["render_modes"] == ["human", "rgb_array"]
    with pytest.raises(OptionError, match="render_mode='rgb_array'"):
        env.render()
    with pytest.raises(OptionError, match="choose 'rgb_array', 'human' or None"):
        gymnasium.make("nas_data:nas/ErgoReacher-v0", render_mode="ansi").reset()


def test_a_window_needs_a_screen(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(OptionError, match="needs a screen"):
        gymnasium.make("nas_data:nas/ErgoReacher-v0", render_mode="human").reset()


def test_a_machine_that_cannot_draw_is_told_what_to_install(monkeypatch):
    from nas_data.simulators import offscreen

    monkeypatch.setattr(offscreen, "BACKENDS", {})
    monkeypatch.setattr(offscreen.importlib, "import_module", lambda name: object())
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    with pytest.raises(MissingPackage, match="libegl1"):
        offscreen.open_context(8, 8)


def test_ppo_acts_as_the_policy_that_was_trained(page, policy):
    observations = np.random.default_rng(0).uniform(-1, 1, (5, 10)).astype(np.float32)
    actions, _ = page["ppo"].predict(observations, deterministic=True)
    np.testing.assert_allclose(actions, read_policy(policy).act(observations), atol=1e-6)


def test_ppo_learns_on_and_survives_its_own_file(page, tmp_path):
    from stable_baselines3 import PPO

    ppo, observation = page["ppo"], page["observation"]
    assert isinstance(ppo, PPO)
    ppo.save(tmp_path / "ppo.zip")
    again = PPO.load(tmp_path / "ppo.zip")
    wanted, _ = ppo.predict(observation, deterministic=True)
    np.testing.assert_array_equal(again.predict(observation, deterministic=True)[0], wanted)
    again.set_env(gymnasium.make("nas_data:nas/ErgoReacher-v0"))
    again.learn(16)
    assert not np.array_equal(again.predict(observation, deterministic=True)[0], wanted)


def test_of_several_seeds_one_is_chosen(policy, tmp_path):
    for seed in ("seed3", "seed4"):
        (tmp_path / seed).symlink_to(policy)
    with pytest.raises(OptionError, match="policies of the seeds 3, 3"):
        nas.load_policy(tmp_path)
    with pytest.raises(OptionError, match="give one of them"):
        nas.load_policy(tmp_path, seed=9)
    with pytest.raises(JointMismatch, match="the environment has"):
        nas.load_policy(policy, env=gymnasium.make("nas_data:nas/Pusher-v0"))
    assert astuple(Hyperparameters())[0] == 16
