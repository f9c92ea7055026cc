"""Bad input costs one sentence and exit code 2: no traceback, nothing printed besides, nothing written."""

import errno
import json
import os
import shutil
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import pytest
from support.command_samples import FAST, SIMULATED, Place
from support.linear_samples import network
from support.recording_samples import pendulum, recorded_on, wander
from support.simulator_samples import CONTACTS, hinge, motors, unstable

from nas_data.cli import main
from nas_data.dataset.layout import list_data_files
from nas_data.dataset.read import read
from nas_data.dataset.write import write
from nas_data.models import checkpoint


def tree(folder: Path) -> dict[str, bytes | None]:
    """Return every path below a folder with its content."""
    found = folder.rglob("*")
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in found}


@pytest.fixture(scope="module")
def spoilt(place: Place, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the wrong things that bad input names."""
    aside = tmp_path_factory.mktemp("spoilt")
    half = write(read(place.paired), aside / "half", SIMULATED)
    file = list_data_files(half)[0]
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    (aside / "nothing").mkdir()
    (aside / "photo.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(64))
    (aside / "page.xml").write_text("<!DOCTYPE html><html><body>Not found</body></html>")
    (aside / "empty.xml").write_text("")
    (aside / "other.xml").write_text(CONTACTS)
    (aside / "torque.xml").write_text(motors().replace('"hinge"', '"pendulum"'))
    (aside / "wild.xml").write_text(unstable().replace('"hinge"', '"pendulum"'))
    (aside / "slow.xml").write_text(hinge().replace('"hinge"', '"pendulum"'))
    (aside / "nan.xml").write_text(hinge(options='kp="nan"').replace('"hinge"', '"pendulum"'))
    (aside / "whole.xml").write_text(hinge().replace("<worldbody>", '<include file="part.xml"/><worldbody>'))
    mesh = '<asset><mesh name="m" file="assets/m.stl"/></asset><worldbody>'
    (aside / "meshed.xml").write_text(hinge().replace("<worldbody>", mesh))
    (aside / "taken").mkdir()
    (aside / "taken/thesis.tex").write_text("years of work")
    (aside / "effects.json").write_text('{"effects": [{"effect": "gremlins"}]}')
    checkpoint.save(network("delta", ("elbow", "wrist")), aside / "elsewhere")
    checkpoint.save(network("delta", ("pendulum",), fps=200.0), aside / "faster")
    damaged = checkpoint.save(checkpoint.load_for_inference(place.phi / "checkpoint"), aside / "damaged")
    (damaged / "model.safetensors").write_bytes(b"no weights")
    still = recorded_on(pendulum(), wander((1, 1)))
    write(still, aside / "blink", SIMULATED)
    write(replace(still, fps=200.0), aside / "quick", SIMULATED)
    return aside


BAD = {
    "pair: no dataset": (("pair", "../absent", "--model", "pendulum"), "absent"),
    "pair: an empty folder": (("pair", "../nothing", "--model", "pendulum"), "nothing"),
    "pair: a half-written dataset": (("pair", "../half", "--model", "pendulum"), "half"),
    "pair: no such robot": (("pair", "RAW", "--model", "asimo"), "ergojr"),
    "pair: no such file": (("pair", "RAW", "--model", "../asimo.xml"), "asimo.xml"),
    "pair: a picture": (("pair", "RAW", "--model", "../photo.png"), "photo.png"),
    "pair: a web page": (("pair", "RAW", "--model", "../page.xml"), "page.xml"),
    "pair: an empty file": (("pair", "RAW", "--model", "../empty.xml"), "empty.xml"),
    "pair: a folder": (("pair", "RAW", "--model", "../nothing"), "nothing"),
    "pair: a model without the joint": (("pair", "RAW", "--model", "../other.xml"), "pendulum"),
    "pair: torques": (("pair", "RAW", "--model", "../torque.xml"), "torque"),
    "pair: a model that diverges": (("pair", "RAW", "--model", "../wild.xml"), "wild.xml"),
    "pair: a taken folder": (("pair", "RAW", "--model", "pendulum", "--out", "../taken"), "taken"),
    "pair: NaN in the model": (("pair", "RAW", "--model", "../nan.xml"), "nan.xml has NaN"),
    "pair: a missing part": (("pair", "RAW", "--model", "../whole.xml"), "'part.xml', which is missing: put it beside"),
    "pair: a missing mesh": (("pair", "RAW", "--model", "../meshed.xml"), "'assets/m.stl', which is missing"),
    "pair: a file as folder": (("pair", "RAW", "--model", "pendulum", "--out", "../photo.png/x"), "photo.png/x"),
    "record: a file as folder": (("record", "sim", "--episodes", "1", "--out", "../photo.png/x"), "photo.png/x"),
    "record: a name too long": (("record", "sim", "--episodes", "1", "--out", "x" * 250), "too long"),
    "record: a negative seed": (("record", "sim", "--episodes", "1", "--seed", "-1", "--out", "x"), "--seed is -1"),
    "split: a negative seed": (("split", "RAW", "--share", "0.5", "--seed", "-1"), "--seed is -1"),
    "split: no number": (("split", "RAW", "--seconds", "nan"), "The length of a segment is nan s; give a number"),
    "split: no end": (("split", "RAW", "--seconds", "inf"), "The length of a segment is inf s; give a number"),
    "compare: a negative seed": (("policy", "compare", "--seed", "0", "-1"), "--seed -1"),
    "pack: a file as folder": (("pack", "RAW", "--out", "../photo.png/x.tar"), "photo.png"),
    "pair: no such engine": (("pair", "RAW", "--model", "pendulum", "--engine", "unity"), "bullet"),
    "pair: no such effect": (("pair", "RAW", "--model", "pendulum", "--effect", "gremlins:joint=pendulum"), "gremlins"),
    "pair: an effect elsewhere": (
        ("pair", "RAW", "--model", "pendulum", "--effect", "backlash:joint=knee,half_width=0.01"),
        "knee",
    ),
    "pair: a file of unknown effects": (
        ("pair", "RAW", "--model", "pendulum", "--effects", "../effects.json"),
        "gremlins",
    ),
    "train: no dataset": (("train", "forward", "../absent"), "absent"),
    "train: a half-written dataset": (("train", "delta", "../half"), "half"),
    "train: φ unpaired": (("train", "delta", "RAW"), "nas pair"),
    "train: a taken folder": (("train", "forward", "RAW", "--out", "../taken", *FAST), "taken"),
    "train: a file as folder": (("train", "forward", "RAW", "--out", "../photo.png", *FAST), "photo.png"),
    "train: no such preset": (("train", "forward", "RAW", "--preset", "nas2018"), "paper"),
    "train: ψ of torques": (("train", "forward", "RAW", "--preset", "symmetric"), "ψ corrects nothing"),
    "train: torques of a servo": (("train", "delta", "PAIRED", "--preset", "symmetric"), "does not take torques"),
    "train: stiction of ψ": (("train", "forward", "RAW", "--preset", "stiction"), "not for ψ; use the preset fast"),
    "train: no such device": (("train", "forward", "RAW", "--device", "abacus"), "abacus"),
    "train: no such episode": (("train", "forward", "RAW", "--episodes", "99"), "99"),
    "train: an episode twice": (("train", "forward", "RAW", "--episodes", "0", "0"), "Episode 0 is given twice"),
    "train: nothing to learn from": (("train", "forward", "../blink"), "transitions"),
    "train: no units": (("train", "forward", "RAW", "--hidden", "0"), "Hidden"),
    "train: a negative seed": (("train", "forward", "RAW", "--seed", "-1"), "seed"),
    "train: everything held out": (("train", "forward", "RAW", "--validation", "1.5"), "1.5"),
    "train: another source": (("train", "delta", "PAIRED", "--model", "../slow.xml"), "paired"),
    "train: a picture as source": (("train", "delta", "PAIRED", "--model", "../photo.png"), "photo.png"),
    "evaluate: no checkpoint": (("evaluate", "../absent", "RAW"), "absent"),
    "evaluate: a folder without one": (("evaluate", "../taken", "RAW"), "taken"),
    "evaluate: a damaged one": (("evaluate", "../damaged", "RAW"), "damaged"),
    "evaluate: no dataset": (("evaluate", "PHI", "../absent"), "absent"),
    "evaluate: a half-written dataset": (("evaluate", "PHI", "../half"), "half"),
    "evaluate: a checkpoint for another robot": (("evaluate", "../elsewhere", "RAW"), "elbow, wrist"),
    "evaluate: a checkpoint for another rate": (("evaluate", "../faster", "RAW"), "200 Hz"),
    "evaluate: a model without the joint": (("evaluate", "PHI", "RAW", "--model", "../other.xml"), "pendulum"),
    "evaluate: a web page": (("evaluate", "PHI", "RAW", "--model", "../page.xml"), "page.xml"),
    "evaluate: ψ with a picture": (("evaluate", "PSI", "RAW", "--model", "../photo.png"), "photo.png"),
    "evaluate: no such episode": (("evaluate", "PHI", "RAW", "--episodes", "-3"), "-3"),
    "evaluate: an episode twice": (("evaluate", "PHI", "RAW", "--episodes", "0", "0"), "Episode 0 is given twice"),
    "evaluate: data of another rate": (("evaluate", "PHI", "../quick"), "200 Hz"),
}


# in turn for people and for machines, which are told the same sentence
@pytest.mark.parametrize(("case", "as_json"), list(zip(BAD, cycle([False, True]), strict=False)))
def test_bad_input_costs_one_sentence_and_writes_nothing(place, spoilt, here, capfd, case, as_json):
    words, named = BAD[case]
    shutil.copytree(spoilt, here.parent, symlinks=True, copy_function=os.link, dirs_exist_ok=True)
    known = {"RAW": place.raw, "PAIRED": place.paired, "PHI": place.phi, "PSI": place.psi}
    before = tree(here.parent), tree(place.root)
    capfd.readouterr()
    code = main([*(str(known.get(word, word)) for word in words), *(["--json"] if as_json else [])])
    output = capfd.readouterr()
    assert code == 2
    assert "Traceback" not in output.err
    lines = output.err.splitlines()
    assert len(lines) == 1, output.err
    assert lines[0].startswith("nas: ")
    assert named in lines[0]
    if as_json:
        assert json.loads(output.out) == {"error": lines[0].removeprefix("nas: ")}
    else:
        assert output.out == ""
    assert (tree(here.parent), tree(place.root)) == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("pair",), "Missing from nas pair: DATASET --model STR; see: nas pair --help"),
        (("pair", "x", "--modell", "y"), "nas pair --help"),
        (("record", "sim", "--wings", "2"), "Unrecognized options: --wings, 2; see: nas record sim --help"),
        (("record", "sim", "--episodes", "many"), "'many'; see: nas record sim --help"),
        (("nosuch",), "There is no command 'nosuch'; see: nas --help"),
    ],
)
def test_wrong_options_are_told_machines_in_a_sentence(here, capfd, words, said):
    assert main([*words, "--json"]) == 2
    output = capfd.readouterr()
    error = json.loads(output.out)["error"]
    assert error.endswith(said)
    assert output.err == f"nas: {error}\n"


def test_wrong_options_are_told_people_in_a_box(here, capfd):
    with pytest.raises(SystemExit) as stopped:
        main(["record", "sim", "--wings", "2"])
    assert stopped.value.code == 2
    assert "Unrecognized options" in capfd.readouterr().err


@pytest.mark.parametrize("command", ["record", "import", "pair"])
def test_a_place_that_cannot_be_written_is_found_before_the_work(place, here, capfd, monkeypatch, command):
    def never(*_: object, **__: object) -> None:
        raise AssertionError("the work was begun")

    for work in ("recording.play_session", "importing.import_by_map", "pairing.pair_with"):
        monkeypatch.setattr(f"nas_data.api.{work}", never)
    Path("file").write_text("")
    words = {
        "record": ("record", "sim", "--out", "file/x"),
        "import": ("import", "log.npz", "--map", "so101_npz", "--out", "file/x"),
        "pair": ("pair", str(place.raw), "--model", "pendulum", "--out", "file/x"),
    }
    assert main([*words[command], "--json"]) == 2
    assert "file/x cannot be written" in json.loads(capfd.readouterr().out)["error"]


def test_a_full_disk_is_one_sentence_that_names_the_place(here, capfd, monkeypatch):
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("nas_data.dataset.staging.os.fsync", full)
    assert main(["record", "sim", "--episodes", "1", "--seconds", "0.1", "--out", "full"]) == 2
    said = capfd.readouterr().err.splitlines()[-1]
    assert said.startswith("nas: full cannot be written: no space left on device")
    assert not list(here.iterdir())
