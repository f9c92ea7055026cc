"""The program run in this process, and a folder in which it has recorded, paired and trained."""

import contextlib
import io
import json
import os
from dataclasses import dataclass
from pathlib import Path

from support.recording_samples import GAP, pendulum, recorded_on, wander

from nas_data.cli import main
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.versions import write_version

SIMULATED = Provenance(how="simulated", robot="pendulum")
FAST = ("--hidden", "8", "--updates", "0", "--epochs", "2", "--device", "cpu")


@dataclass
class Answer:
    """What the program said."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, object]:
        return json.loads(self.out)


def nas(*arguments: object) -> Answer:
    """Run the program in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(argument) for argument in arguments])
    return Answer(code, out.getvalue(), err.getvalue())


def refused(*arguments: object) -> str:
    """Run the program on what it must refuse, and return what it says."""
    answer = nas(*arguments)
    assert answer.code == 2, answer
    return answer.err.strip()


def done(*arguments: object) -> Answer:
    """Run the program, which must succeed."""
    answer = nas(*arguments)
    assert answer.code == 0, answer.err
    return answer


@dataclass(frozen=True)
class Place:
    """A folder with one recording, its pairing, and both models trained on it."""

    root: Path
    raw: Path
    paired: Path
    phi: Path
    psi: Path


def furnish(root: Path) -> Place:
    """Record, pair and train in an empty folder, through the program."""
    import torch

    torch.set_num_threads(1)
    before = Path.cwd()
    os.chdir(root)
    try:
        raw = write_version(recorded_on(pendulum(*GAP), wander((60,) * 8)), "swing", SIMULATED)
        paired = Path(done("pair", "datasets/swing", "--model", "pendulum", "--json").json["dataset"])
        done("train", "delta", "datasets/swing", "--out", "runs/phi", *FAST)
        done("train", "forward", "datasets/swing", "--out", "runs/psi", *FAST)
    finally:
        os.chdir(before)
    return Place(root, root / raw, root / paired, root / "runs/phi", root / "runs/psi")
