"""The program end to end: what each command prints, writes and returns."""

import ast
import inspect
import json
import os
import re
import shlex
import subprocess
import sys
import time
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from support.command_samples import FAST, SIMULATED, done, nas
from support.recording_samples import pendulum, positions_only
from support.simulator_samples import SO101, needs_so101

from nas_data.cli import format_overview, list_command_files, load_command_class, main, parse, read_summary, split
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.write import write
from nas_data.models import checkpoint
from nas_data.models.evaluation import evaluate
from nas_data.models.losses import TeacherForcing
from nas_data.robots.base import find_robot
from nas_data.typed_json import make_finite

RECORDINGS = Path(__file__).parents[3] / "shared/realdata/sage_so101"
COMMANDS = list_command_files()
HELP_SECONDS = 0.3  # [s] how long `nas --help` may take
ATTEMPTS = 20  # runs of which the fastest counts: other tests run beside this one
HEAVY = {
    "datasets", "gymnasium", "huggingface_hub", "jinja2", "lerobot", "matplotlib", "mujoco", "numpy", "onnx",
    "onnxruntime", "pandas", "plotly", "pyarrow", "pybullet", "scipy", "stable_baselines3", "tensorboard", "torch",
}  # fmt: skip


# the program itself


def test_help_lists_every_command_by_its_first_line():
    answer = nas("--help")
    assert answer.code == 0
    for name, path in COMMANDS.items():
        assert re.search(rf"^  {name} +{re.escape(read_summary(path))}$", answer.out, re.MULTILINE), name
        assert re.match(r"\w.*[.…]$", read_summary(path)), name
    assert nas().code == 2
    assert "usage" in nas().out
    assert nas("--version").out.startswith("nas_data ")


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_has_help_with_examples_that_it_understands_and_a_word_for_each_option(name, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*name.split(), "--help"])
    assert stop.value.code == 0
    text = re.sub(r"\s+", " ", capsys.readouterr().out)
    kind = load_command_class(name)
    assert f"usage: nas {name}" in text
    assert f"Example: nas {name}" in text
    assert "--json" in text
    assert not re.search(r"\{None\}|\[\w+ \[|\(default: (None|False|True)?\)|''", text)
    for field in fields(kind):
        assert field.name.replace("_", "-").rstrip("-") in text or field.name.upper() in text
    check_examples(name, kind)
    check_docstrings(name, kind)


def check_examples(name: str, kind: type) -> None:
    """Check that each example of a help is a paragraph, and a command that is understood."""
    examples = [paragraph for paragraph in (inspect.getdoc(kind) or "").split("\n\n") if "Example: " in paragraph]
    assert examples
    for example in examples:
        program, *words = shlex.split(example.removeprefix("Example: "))
        assert program == "nas"
        assert split(words)[0] == name
        assert isinstance(parse(*split(words)), kind)


def check_docstrings(name: str, kind: type) -> None:
    """Check that each option of a command is described below it."""
    nodes = ast.parse(COMMANDS[name].read_text()).body
    node = next(node for node in nodes if isinstance(node, ast.ClassDef) and node.name == kind.__name__)
    for field, following in zip(node.body, [*node.body[1:], None], strict=True):
        if isinstance(field, ast.AnnAssign) and "ClassVar" not in ast.unparse(field.annotation):
            described = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
            assert described, f"nas {name}: {ast.unparse(field.target)} has no docstring"


@pytest.mark.parametrize("words", [("train",), ("policy", "--help"), ("fly",), ("train", "gamma"), ("--nonsense",)])
def test_words_that_are_no_command_are_answered(words):
    answer = nas(*words)
    if words == ("policy", "--help"):
        assert answer.code == 0
    else:
        assert answer.code == 2
    assert "Traceback" not in answer.err
    assert format_overview(words[0]) in answer.out or answer.err.startswith("nas: There is no command")


@pytest.mark.parametrize("words", ["--help", "effects"])
def test_a_reader_that_has_seen_enough_ends_the_program_quietly(words: str):
    reading, writing = os.pipe()
    os.close(reading)
    program = [sys.executable, "-m", "nas_data", *words.split()]
    ended = subprocess.run(program, stdout=writing, stderr=subprocess.PIPE, check=False)
    os.close(writing)
    assert (ended.returncode, ended.stderr) == (0, b"")


@pytest.mark.parametrize(
    "locale",
    [
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        pytest.param({"PYTHONIOENCODING": "ascii"}, marks=pytest.mark.slow),
    ],
)
def test_a_locale_that_lacks_a_letter_ends_nothing_in_a_traceback(locale):
    program = [sys.executable, "-m", "nas_data", "effects", "coulomb_friction"]
    ended = subprocess.run(program, capture_output=True, check=False, env=os.environ | locale)
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert b"N?m" in ended.stdout


@pytest.mark.slow
def test_a_training_in_a_locale_without_phi_says_so_in_other_letters_and_is_the_same(place, here):
    locale = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "OMP_NUM_THREADS": "1"}
    program = [sys.executable, "-m", "nas_data", "train", "delta", str(place.paired), "--out", "run", *FAST]
    ended = subprocess.run(program, capture_output=True, check=False, env=os.environ | locale, cwd=here)
    assert ended.returncode == 0, ended.stderr
    assert b"Traceback" not in ended.stderr and "φ".encode() not in ended.stdout + ended.stderr
    done("train", "delta", place.paired, "--out", "plain", *FAST)
    weights = [checkpoint.load_for_inference(here / name / "checkpoint").state_dict() for name in ("run", "plain")]
    assert all(bool((weights[0][key] == weights[1][key]).all()) for key in weights[1])
    program = [sys.executable, "-m", "nas_data", "evaluate", "run", str(place.paired)]
    ended = subprocess.run(program, capture_output=True, check=False, env=os.environ | locale, cwd=here)
    assert (ended.returncode, b"source + ?" in ended.stdout) == (0, True), ended


def test_the_overview_answers_at_once():
    program = Path(sys.executable).with_name("nas")
    command = [str(program)] if program.exists() else [sys.executable, "-m", "nas_data"]
    fastest = float("inf")
    for _ in range(ATTEMPTS):
        begun = time.perf_counter()
        subprocess.run([*command, "--help"], check=True, capture_output=True)
        fastest = min(fastest, time.perf_counter() - begun)
        if fastest < HELP_SECONDS:
            return
    pytest.fail(f"nas --help took {fastest:.2f} s in the fastest of {ATTEMPTS} runs; {HELP_SECONDS} s is the limit")


def test_a_graphics_backend_that_does_not_start_is_one_sentence():
    ended = subprocess.run(
        [sys.executable, "-m", "nas_data", "record", "sim", "--episodes", "1"],
        capture_output=True, text=True, check=False, env=os.environ | {"MUJOCO_GL": "nonsense"},
    )  # fmt: skip
    assert ended.returncode == 2
    assert ended.stderr.startswith("nas: MuJoCo does not start with MUJOCO_GL=nonsense (")
    assert "leave it unset" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from nas_data.cli import list_command_files, load_command_class, main\n"
        "def loaded(): return {name.split('.')[0] for name in sys.modules}\n"
        f"main(['--help']); print(*loaded() & {HEAVY | {'tyro'}}, sep=',', file=sys.stderr)\n"
        "for name in list_command_files(): load_command_class(name)\n"
        f"print(*loaded() & {HEAVY}, sep=',', file=sys.stderr)"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stderr
    assert told == "\n\n"


def test_importing_the_package_loads_only_the_standard_library():
    def loaded_by(code: str) -> set[str]:
        code = f"{code}\nimport sys\nprint(*{{name.split('.')[0] for name in sys.modules}})"
        run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
        return set(run.stdout.split())

    before = loaded_by("")
    assert loaded_by("import nas_data") - before - set(sys.stdlib_module_names) == {"nas_data"}


def test_json_says_only_what_json_can():
    odd = {"nan": float("nan"), "inf": [np.inf], "path": Path("a/b"), "array": np.arange(2), "number": np.float32(0.5)}
    assert make_finite(odd) == {"nan": None, "inf": [None], "path": "a/b", "array": [0, 1], "number": 0.5}
    json.dumps(make_finite(odd), allow_nan=False)


# the pipeline


def test_training_says_what_it_did_and_where_the_result_lies(place, here):
    answer = done("train", "delta", place.paired, "--out", "run", *FAST)
    assert "run/checkpoint" in answer.out
    for word in ("source + φ", "source", "hold", "command", "One step", "Open loop", "pendulum", "deg"):
        assert word in answer.out
    assert "8 episodes" in answer.err
    assert sorted(path.name for path in Path("run").iterdir()) == ["checkpoint", "history.json", "tensorboard"]


def test_a_checkpoint_names_its_data_and_keeps_its_source(place):
    for run, kind in ((place.phi, "delta"), (place.psi, "forward")):
        model = checkpoint.load_for_inference(run / "checkpoint")
        assert model.kind == kind
        assert model.provenance["dataset"]["content_hash"] == read_provenance(place.paired).content_hash
        assert model.provenance["dataset"]["name"] == f"swing/{place.paired.name}"
        assert model.provenance["source"] == read_provenance(place.paired).source
        assert model.provenance["source"]["name"] == "pendulum"
        assert (run / "checkpoint/source.xml").read_bytes() == (place.paired / "meta/source.xml").read_bytes()
        config = (run / "checkpoint/config.json").read_text()
        assert str(place.root) not in config, "no machine's path"


def test_training_tells_machines_the_same(place, here):
    for kind, name in (("delta", "source + φ"), ("forward", "ψ")):
        answer = done("train", kind, place.paired, "--out", f"run-{kind}", *FAST, "--json")
        content = answer.json
        assert Path(content["checkpoint"]) == Path(f"run-{kind}/checkpoint")
        assert Path(content["history"]).is_file()
        for loop in ("one_step", "open_loop"):
            assert set(content["errors"][loop]) == {name, "source", "hold", "command"}


def test_training_without_out_writes_under_runs(place, here):
    done("train", "forward", place.paired, "--seed", "3", *FAST)
    assert [str(path) for path in Path().glob("*/*")] == ["runs/forward-swing-seed3"]


def test_the_same_command_gives_the_same_weights(place, here):
    for name in ("one", "two"):
        done("train", "delta", place.paired, "--out", name, *FAST)
    assert (
        Path("one/checkpoint/model.safetensors").read_bytes() == Path("two/checkpoint/model.safetensors").read_bytes()
    )


def test_some_episodes_train_and_that_is_recorded(place, here):
    done("train", "forward", place.paired, "--out", "run", "--episodes", "5", "2", *FAST)
    model = checkpoint.load_for_inference(Path("run/checkpoint"))
    assert model.provenance["dataset"]["episodes"] == [5, 2]
    whole = checkpoint.load_for_inference(place.psi / "checkpoint")
    assert not np.array_equal(model.input_mean.numpy(), whole.input_mean.numpy())


def test_a_training_stopped_by_ctrl_c_goes_on(place, here, monkeypatch):
    command = ("train", "delta", place.paired, "--hidden", "8", "--updates", "0", "--epochs", "4", "--device", "cpu")
    done(*command, "--out", "whole")
    plain = TeacherForcing.loss

    def loss(self, update):
        if update == 2:
            raise KeyboardInterrupt
        return plain(self, update)

    monkeypatch.setattr(TeacherForcing, "loss", loss)
    answer = nas(*command, "--out", "broken")
    assert answer.code == 130
    assert answer.err.splitlines()[-1].startswith("nas: interrupted")
    monkeypatch.setattr(TeacherForcing, "loss", plain)
    again = done(*command, "--out", "broken")
    assert "continuing at update" in again.err
    weights = [Path(name, "checkpoint/model.safetensors").read_bytes() for name in ("whole", "broken")]
    assert weights[0] == weights[1]


@pytest.mark.parametrize("kind", ["delta", "forward"])
def test_evaluation_needs_no_model_where_a_source_is_kept(place, here, kind):
    run, name = {"delta": (place.phi, "source + φ"), "forward": (place.psi, "ψ")}[kind]
    content = done("evaluate", run, place.raw, "--json").json
    assert content["unit"] == "rad"
    for loop in ("one_step", "open_loop"):
        assert set(content[loop]) == {name, "source", "hold", "command"}
        for errors in content[loop].values():
            assert np.isfinite([errors["overall"], *errors["per_episode"], *errors["per_joint"].values()]).all()
            assert len(errors["per_episode"]) == 8
            assert list(errors["per_joint"]) == ["pendulum"]
    assert content["trained_on"]["content_hash"] == read_provenance(place.paired).content_hash
    expected = evaluate(read(place.raw), pendulum(), checkpoint.load_for_inference(run / "checkpoint")).to_json()
    for loop in ("one_step", "open_loop"):
        assert content[loop][name]["overall"] == pytest.approx(expected[loop][name]["overall"], rel=1e-5)
        assert content[loop]["source"]["overall"] == pytest.approx(expected[loop]["source"]["overall"], rel=1e-5)
    # the checkpoint's folder or the training's, by the model or without, say the same
    for other in (("evaluate", run / "checkpoint", place.raw), ("evaluate", run, place.paired, "--model", "pendulum")):
        same = done(*other, "--json").json
        assert same["open_loop"] == content["open_loop"]


def test_a_model_file_is_evaluated_by_itself_or_beside_its_source(place, here):
    model = find_robot("pendulum").mjcf
    content = done("evaluate", model, place.raw, "--json").json
    beside = done("evaluate", place.phi, place.raw, "--model", "pendulum", "--json").json
    for loop in ("one_step", "open_loop"):
        assert set(content[loop]) == {"source", "hold", "command"}
        assert content[loop]["source"] == beside[loop]["source"]
    both = done("evaluate", model, place.raw, "--model", "pendulum", "--json").json["open_loop"]
    assert set(both) == {"model", "source", "hold", "command"} and both["model"] == both["source"]
    missing = nas("evaluate", here / "absent.xml", place.raw)
    assert missing.code and "absent.xml" in missing.err


def test_evaluation_reads_as_text_and_takes_some_episodes(place, here):
    answer = done("evaluate", place.phi, place.raw, "--episodes", "1", "4")
    assert "2 episodes" in answer.out
    for word in ("One step", "Open loop", "source + φ", "hold", "command", "deg"):
        assert word in answer.out
    rows = answer.out.partition("Open loop, each episode")[2].splitlines()
    assert [row.split()[0] for row in rows[2:4]] == ["1", "4"]
    assert not list(here.iterdir()), "evaluating writes nothing"


def test_psi_is_evaluated_without_any_source(place, here):
    checkpoint.save(checkpoint.load_for_inference(place.psi / "checkpoint"), here / "psi")
    content = done("evaluate", "psi", place.raw, "--json").json
    assert set(content["open_loop"]) == {"ψ", "hold", "command"}


def test_positions_alone_go_the_whole_way(place, here):
    bare = write(positions_only(read(place.raw)), here / "bare", Provenance(how="imported"))
    (bare / "meta/nas.json").unlink()
    paired = done("pair", bare, "--model", "pendulum", "--out", "paired", "--json").json
    assert set(paired["derived"]) >= {"observation.state", "next.observation.state"}
    done("train", "delta", "paired", "--out", "phi", *FAST)
    content = done("evaluate", "phi", bare, "--json").json
    assert set(content["derived"]) >= {"observation.state", "next.observation.state"}
    assert content["open_loop"]["source + φ"]["overall"] < content["open_loop"]["source"]["overall"]
    # ψ learns from LeRobot's own dataset, without a source
    answer = done("train", "forward", bare, "--out", "psi", *FAST, "--json")
    assert set(answer.json["errors"]["open_loop"]) == {"ψ", "hold", "command"}
    assert "derived" in answer.err


def test_phi_without_its_source_at_hand_is_trained_by_teacher_forcing_and_says_so(place, here):
    alone = write(read(place.paired), here / "alone", SIMULATED)  # keeps no source
    answer = done("train", "delta", alone, "--out", "phi", "--hidden", "8", "--epochs", "2", "--device", "cpu")
    assert "--model" in answer.err
    assert "teacher forcing" in answer.err
    refused = nas("evaluate", "phi", place.raw)
    assert refused.code == 2
    assert "--model" in refused.err
    done("evaluate", "phi", place.raw, "--model", "pendulum")


def test_a_source_given_to_training_is_kept_with_the_checkpoint(place, here):
    alone = write(read(place.paired), here / "alone", SIMULATED)
    done("train", "delta", alone, "--model", "pendulum", "--out", "phi", *FAST)
    content = done("evaluate", "phi", alone, "--json").json
    assert content["open_loop"]["source + φ"]["overall"] < content["open_loop"]["source"]["overall"]


@pytest.mark.bullet
def test_the_engine_of_a_source_is_remembered(place, here):
    raw = write(read(place.raw).select([0, 1]), here / "raw", SIMULATED)
    done("pair", raw, "--model", "pendulum", "--engine", "bullet", "--out", "paired")
    done("train", "delta", "paired", "--out", "phi", *FAST)
    model = checkpoint.load_for_inference(Path("phi/checkpoint"))
    assert model.provenance["source"]["engine"] == "bullet"
    kept, given = (
        done("evaluate", "phi", raw, *options, "--json").json["one_step"]["source"]["overall"]
        for options in ((), ("--model", "pendulum", "--engine", "bullet"))
    )
    assert kept == pytest.approx(given, rel=1e-3)


@needs_so101
def test_real_recordings_go_the_whole_way(here):
    logs = [RECORDINGS / f"{name}.npz" for name in ("step_response", "hold_under_gravity")]
    if not all(log.is_file() for log in logs):
        pytest.skip("the SO-101 recordings of ../shared/realdata are absent")
    done("import", *logs, "--map", "so101_npz", "--out", "arm")
    told = done("pair", "arm", "--model", SO101, "--out", "paired", "--json").json
    dataset = read(Path("paired"))
    assert dataset.fps == pytest.approx(49.85, abs=0.05)
    assert told["source"]["substeps"] == 11
    assert (Path("paired") / "meta/source.xml").read_bytes() == SO101.read_bytes()
    done("train", "forward", "paired", "--out", "psi", *FAST)
    content = done("evaluate", "psi", "paired", "--episodes", "0", "--json").json
    assert list(content["open_loop"]["ψ"]["per_joint"]) == list(dataset.joints)
    # the stock model, released once per episode, is degrees off; one step is not
    assert np.radians(1) < content["open_loop"]["source"]["overall"] < np.radians(10)
    assert content["one_step"]["source"]["overall"] < np.radians(2)


# machines


@pytest.mark.parametrize("words", ["info", "verify", "pair", "train delta", "train forward", "evaluate"])
def test_json_on_stdout_is_json_and_nothing_else(place, here, words):
    arguments = {
        "info": (place.raw,),
        "verify": (place.raw,),
        "pair": (place.raw, "--model", "pendulum", "--out", "paired"),
        "train delta": (place.paired, "--out", "run", *FAST),
        "train forward": (place.raw, "--out", "run", *FAST),
        "evaluate": (place.phi, place.raw),
    }
    content = done(*words.split(), *arguments[words], "--json").json
    assert isinstance(content, dict)
    assert content


def test_who_paired_a_recording_in_its_own_folder_is_shown_the_pairs(place, here):
    """`datasets/NAME` may be a dataset itself; `nas pair` then puts the pairs below it."""
    recording = write(read(place.raw), Path("datasets/swings"), SIMULATED)
    answer = nas("train", "delta", recording, "--out", "phi", *FAST)
    assert answer.code == 2 and "nas pair datasets/swings" in answer.err
    paired = done("pair", recording, "--model", "pendulum", "--json").json["dataset"]
    answer = nas("train", "delta", recording, "--out", "phi", *FAST)
    assert answer.code == 2 and f"give its paired version, {paired}" in answer.err
    done("train", "delta", paired, "--out", "phi", *FAST)
