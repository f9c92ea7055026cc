"""Make known changes in real recordings, or in the models handed over with them, and let `nas gap` name them blind.

Run `python docs/results/known_changes.py RECORDINGS OUT`; a run that is interrupted goes on where it stopped.
"""

import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from pathlib import Path

import mujoco
import numpy as np
import tyro
from pages import HERE, read_table, write_table

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.provenance import read_provenance
from nas_data.dataset.read import read
from nas_data.dataset.write import write
from nas_data.effects.base import Effect, add_effects, make_effect
from nas_data.gap import workflow
from nas_data.gap.problem import Problem
from nas_data.gap.report import GapReport
from nas_data.gap.write_model import MODEL
from nas_data.runs.environment_info import find_commit
from nas_data.runs.progress import say

TABLE = "known_changes.csv"  # in the folder of the results
POSITIONS = ("observation.state", "next.observation.state")
GAINS = (100, 200, 400, 800)  # P gains of the XL330 logs
XL330_MODEL_GAIN = 400  # P gain of docs/results/xl330.xml
SO101_MOTIONS = ("figure_eight", "multisine", "step_response", "triangle_wave")
SAMPLES, DEGREES = (1, 2, 3), (1.0, 2.0, 4.0)
MASSES = (0.8, 0.6)  # factors on the mass of the double pendulum's last link
LEAST_FRICTION = 0.001  # [N·m; N·m·s/rad] below which a joint of the named model has none
PIECE = 3.2  # [s] pieces that the double pendulum's chaotic motion is cut into
SO101_PIECE = 6.0  # [s] pieces of these motions, so that a part of each is held out


@dataclass(frozen=True)
class Change:
    """A known change: the recording differs by `truth` from the model handed over."""

    name: str  # of the change
    dataset: Path  # recording
    model: Path  # model handed over
    baseline: tuple[Path, Path]  # recording and model without the change
    truth: Effect  # difference of the recording from the model


def import_logs(files: Sequence[Path], mapping: str | Path, out: Path, *options: str) -> Path:
    """Return the dataset of some logs, imported once by a map."""
    if not out.exists():
        words = [sys.executable, "-m", "nas_data", "import", *files, "--map", mapping, "--out", out, *options]
        subprocess.run([str(word) for word in words], check=True, stdout=subprocess.DEVNULL)
    return out


def investigate(dataset: Path, model: Path, out: Path, baseline: tuple[Path, Path] | None = None) -> GapReport:
    """Return the report of `nas gap`, made once, without the proposal of an experiment.

    What the baseline's model leaves unexplained in the baseline's recording counts as noise.
    """

    def load() -> Problem:
        problem = Problem.load(dataset, model)
        return problem.compare_with(Problem.load(*baseline)) if baseline else problem

    if not (out / "report.json").exists():
        workflow.investigate_problem(load, model, out, propose=False)
    return GapReport.read(out / "report.json")


def write_changed_model(model: Path, edit: Callable[[mujoco.MjSpec], None], file: Path) -> Path:
    """Write a copy of a model with an edit."""
    spec = mujoco.MjSpec.from_file(str(model))
    edit(spec)
    spec.compile()
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(spec.to_xml(), encoding="utf-8")
    return file


def import_xl330(recordings: Path, out: Path) -> tuple[dict[int, Path], Path]:
    """Return the XL330's logs at each P gain as datasets, and the named model of all of them, at `XL330_MODEL_GAIN`.

    The register is left out of these datasets, so that it is inferred.
    """
    files, data = sorted((recordings / "bam_xl330").glob("[0-9]*.json")), out / "datasets"
    known = (Path(workflow.__file__).parents[1] / "importing" / "maps" / "xl330_json.toml").read_text("utf-8")
    blind = out / "xl330_blind.toml"
    register = '[signals.p_gain]\nconstant = "kp"\nunit = "register"\n'
    assert register in known
    hidden = known.replace('"kp", ', "").replace(" kp={kp}", "").replace(register, "")
    blind.write_text(hidden, encoding="utf-8")
    base = out / "xl330_base"
    investigate(import_logs(files, "xl330_json", data / "xl330"), HERE / "xl330.xml", base)
    logs = {}
    for gain in GAINS:
        chosen = [file for file in files if f'"kp": {gain},' in file.read_text("utf-8")]
        logs[gain] = import_logs(chosen, blind, data / f"xl330_{gain}")
    return logs, base / MODEL


def change_servo_gains(recordings: Path, out: Path) -> Iterator[Change]:
    """Yield logs of an XL330 at one P gain, with the named model at another: a register changed on the real servo."""
    logs, named = import_xl330(recordings, out)
    for given, changed in permutations(GAINS, 2):
        effect = make_effect("servo_stiffness", "pendulum", {"factor": given / XL330_MODEL_GAIN})
        model = out / "models" / f"xl330_{given}.xml"
        write_changed_model(named, lambda spec, effect=effect: add_effects(spec, [effect]), model)
        truth = make_effect("servo_stiffness", "pendulum", {"factor": changed / given})
        yield Change(f"XL330: P gain {given} to {changed}", logs[changed], model, (logs[given], model), truth)


def change_xl330_recordings(recordings: Path, out: Path) -> Iterator[Change]:
    """Yield logs of an XL330 at the model's P gain with the commands earlier, or with the readings shifted."""
    logs, named = import_xl330(recordings, out)
    given = logs[XL330_MODEL_GAIN]
    for size in range(len(SAMPLES)):
        yield from change_recording("XL330", given, "pendulum", size, out / "datasets", named)


def change_pendulum_model(recordings: Path, out: Path) -> Iterator[Change]:
    """Yield recordings of the double pendulum, with named models that lack a part of a mass, or a joint's friction."""
    folder, base = recordings / "dfki_double_pendulum", out / "pendulum_base"
    files = sorted(folder.glob("*.csv"))
    dataset = import_logs(files, folder / "map.toml", out / "datasets" / "pendulum", "--cut", str(PIECE))
    investigate(dataset, folder / "model.xml", base)
    spec = mujoco.MjSpec.from_file(str(base / MODEL))

    def change(name: str, edit: Callable[[mujoco.MjSpec], None], truth: Effect) -> Change:
        model = write_changed_model(base / MODEL, edit, out / "models" / f"{name.replace(' ', '_')}.xml")
        return Change(f"double pendulum: {name}", dataset, model, (dataset, base / MODEL), truth)

    for factor in MASSES:

        def lighten(edited: mujoco.MjSpec, factor: float = factor) -> None:
            edited.bodies[-1].mass *= factor

        truth = make_effect("payload", None, {"mass": (1 - factor) * float(spec.bodies[-1].mass)})
        yield change(f"mass of the last link × {factor:g}", lighten, truth)
    for joint in spec.joints:
        for attribute, effect, parameter in (
            ("damping", "viscous_friction", "coefficient"),
            ("frictionloss", "coulomb_friction", "torque"),
        ):

            def remove(edited: mujoco.MjSpec, name: str = joint.name, attribute: str = attribute) -> None:
                setattr(edited.joint(name), attribute, 0.0 * np.asarray(getattr(edited.joint(name), attribute)))

            size = float(np.ravel(getattr(joint, attribute))[0])
            if size > LEAST_FRICTION:
                truth = make_effect(effect, joint.name, {parameter: size})
                yield change(f"no {attribute} of {joint.name}", remove, truth)


def change_so101_recordings(recordings: Path, out: Path) -> Iterator[Change]:
    """Yield recordings of an SO-101 with the commands of a joint earlier, or with its readings shifted."""
    folder, data, base = recordings / "sage_so101", out / "datasets", out / "so101_base"
    files = [folder / f"{motion}.npz" for motion in SO101_MOTIONS]
    given = import_logs(files, "so101_npz", data / "so101", "--cut", str(SO101_PIECE))
    investigate(given, folder / "model" / "so101_new_calib_nomesh.xml", base)
    joints = read(given).joints
    turns = product(range(len(SAMPLES)), enumerate(joints))  # an unfinished run has all sizes and joints
    for joint, size in ((joint, (turn + place) % len(SAMPLES)) for turn, (place, joint) in turns):
        yield from change_recording("SO-101", given, joint, size, data, base / MODEL)


def change_recording(robot: str, given: Path, joint: str, size: int, data: Path, model: Path) -> Iterator[Change]:
    """Yield a recording with the commands of a joint earlier, and with its readings shifted.

    Args:
        robot: Its name in the table.
        given: Recording without the change.
        joint: Joint.
        size: Place in `SAMPLES` and `DEGREES`.
        data: Folder of the changed recordings.
        model: Model of the recording without the change.
    """
    dataset, provenance = read(given), read_provenance(given)
    assert provenance, "nas import writes it"
    samples, angle = SAMPLES[size], float(np.radians(DEGREES[size]))
    for name, changed, truth in (
        (f"{robot}, commands of {joint} {samples} samples late", make_late(dataset, joint, samples),
         make_effect("command_delay", joint, {"delay": samples / dataset.fps})),
        (f"{robot}, readings of {joint} {DEGREES[size]:g}° larger", shift_readings(dataset, joint, angle),
         make_effect("joint_offset", joint, {"offset": angle})),
    ):  # fmt: skip
        target = data / name.replace(",", "").replace(" ", "_").replace("°", "deg")
        if not target.exists():
            write(changed, target, provenance)
        yield Change(name, target, model, (given, model), truth)


def make_late(dataset: Dataset, joint: str, samples: int) -> Dataset:
    """Return a dataset in which a joint's commands are some samples earlier, so that it seems to receive them late."""
    commands, place = dataset.columns["action"].copy(), dataset.joints.index(joint)
    for rows in dataset.episodes():
        own = commands[rows, place].copy()
        commands[rows, place] = np.concatenate([own[samples:], np.repeat(own[-1:], samples)])
    return replace(dataset, columns={**dataset.columns, "action": commands})


def shift_readings(dataset: Dataset, joint: str, angle: float) -> Dataset:
    """Return a dataset in which a joint reads more by an angle [rad]."""
    columns, place = dict(dataset.columns), dataset.joints.index(joint)
    for key in POSITIONS:
        columns[key] = columns[key].copy()
        columns[key][:, place] += angle
    return replace(dataset, columns=columns)


def grade(change: Change, report: GapReport) -> dict[str, object]:
    """Return a row of the table."""
    truth = change.truth
    parameter = truth.parameters[0].name
    found = [one for one in report.effects if (one.name, one.joint) == (truth.name(), truth.joint)]
    size = found[0].parameters[parameter] if found else None
    low, high = size.interval95 if size else (None, None)
    return {
        "change": change.name,
        "effect": truth.name(),
        "joint": truth.joint or "",
        "size": getattr(truth, parameter),
        "found": size.value if size else "",
        "low": low if size else "",
        "high": high if size else "",
        "confidence": found[0].confidence if found else "",
        "beside": "; ".join(f"{one} {one.confidence:.2f}" for one in report.effects if one not in found),
        "commit": find_commit()[:8],
    }


SOURCES: Sequence[Callable[[Path, Path], Iterator[Change]]] = (
    change_servo_gains,
    change_pendulum_model,
    change_xl330_recordings,
    change_so101_recordings,
)


def main(recordings: tyro.conf.Positional[Path], out: tyro.conf.Positional[Path]) -> None:
    """Make and name every change.

    Args:
        recordings: Folder with `bam_xl330`, `dfki_double_pendulum` and `sage_so101`.
        out: Folder of datasets, models, reports and `known_changes.csv`.
    """
    workflow.show = lambda *_: None  # no pictures
    out.mkdir(parents=True, exist_ok=True)
    table = out / TABLE
    for source in SOURCES:
        for change in source(recordings, out):
            rows = read_table(table) if table.exists() else []
            if change.name in {row["change"] for row in rows}:
                continue
            folder = out / "reports" / change.name.replace(" ", "_").replace(":", "").replace(",", "")
            row = grade(change, investigate(change.dataset, change.model, folder, change.baseline))
            write_table(table, [*rows, row])
            found, beside = row["found"] or "nothing", row["beside"] or "nothing"
            say(f"{change.name}: {row['size']:.4g}, found {found}; beside {beside}")


if __name__ == "__main__":
    tyro.cli(main)
