"""Output folder of a gap report, which may only replace an earlier report."""

import json
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from nas_data.errors import OutputExists

FILES = ("report.json", "report.html", "effects.json", "model.xml", "model.diff", "series.npz", "next_experiment.csv")
PHI = "phi"  # checkpoint on top of the names
FOLDERS = ("figures", PHI)
UNFINISHED = ".unfinished"  # folder of a report that is being written
ASSETS = "assets"  # files that `model.xml` needs; the folder may hold others
EXPORTS = ("parameters.csv", "bam")
FIGURES = ("gap_per_joint.png", "joint_*.png")
MARKS = ("report.json", "effects.json")  # one of them exists from the start of a report


def check_output_folder(folder: Path, model: str | Path) -> None:
    """Refuse a folder in which a report would replace other files.

    Args:
        folder: Folder of the report, which need not exist.
        model: Robot's name or model file, which the report must not replace.

    Raises:
        OutputExists: names the file that would be lost.
    """
    check_model(folder, model)
    check_free(folder)


def check_free(folder: Path) -> None:
    """Refuse a folder with files that the report would replace and no report wrote.

    Raises:
        OutputExists: names the file that would be lost.
    """
    strange = [name for name in (*FILES, *FOLDERS, ASSETS, *EXPORTS) if (folder / name).exists()]
    if strange and not any(is_ours(folder / name) for name in MARKS):
        raise OutputExists(f"{folder} holds {strange[0]}, which is not a file of a gap report; choose another --out.")


def is_ours(path: Path) -> bool:
    """Return whether a file is the `report.json` or `effects.json` of a report, by its content."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and isinstance(content.get("effects"), list)


def refuse_finished_report(folder: Path) -> None:
    """Refuse a folder with a finished report, whose page would describe another model.

    Raises:
        OutputExists: it holds one.
    """
    if is_ours(folder / MARKS[0]):
        raise OutputExists(f"{folder} holds a finished report, which would describe other files; choose another --out.")


def check_model(folder: Path, model: str | Path) -> None:
    """Refuse a folder whose `model.xml` is the given model.

    Raises:
        OutputExists: it would be replaced.
    """
    if Path(model).is_file() and Path(model).resolve() == (folder / "model.xml").resolve():
        raise OutputExists(f"{model} would be overwritten by the model with the effects; choose another --out.")


@contextmanager
def stage_report(folder: Path) -> Iterator[Path]:
    """Yield a folder whose files replace an earlier report in the end, which an interrupted run thus keeps.

    The φ of an earlier report stays if there is no new one.
    """
    place = folder / UNFINISHED
    shutil.rmtree(place, ignore_errors=True)  # of a killed run
    place.mkdir(parents=True)
    try:
        yield place
    except BaseException:
        shutil.rmtree(place, ignore_errors=True)
        raise
    new = [path.relative_to(place) for path in place.rglob("*") if path.is_file()]
    if any(path.parts[0] == PHI for path in new):
        shutil.rmtree(folder / PHI, ignore_errors=True)
    for path in sorted(new, key=lambda path: path.name == MARKS[0]):  # the report itself last
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (place / path).replace(folder / path)
    clear_report(folder, keep=[str(path) for path in new])
    shutil.rmtree(place, ignore_errors=True)


def clear_report(folder: Path, keep: Collection[str] = ()) -> None:
    """Remove the files of an earlier report, except its φ and some names."""
    for name in set(FILES).difference(keep):
        (folder / name).unlink(missing_ok=True)
    for pattern in FIGURES:
        for path in (folder / "figures").glob(pattern):
            path.unlink()
    with suppress(OSError):  # it is absent, or holds other files
        (folder / "figures").rmdir()
