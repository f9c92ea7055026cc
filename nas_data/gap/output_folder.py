"""Where a gap report is written: in the place of an earlier one, never of anything else."""

import shutil
from pathlib import Path

from nas_data.errors import OutputExists

FILES = ("report.json", "report.html", "effects.json", "model.xml", "model.diff", "series.npz", "next_experiment.csv")
FOLDERS = ("figures", "phi")
ASSETS = "assets"  # files that `model.xml` needs; others may lie there, too
MARKS = ("report.json", "effects.json")  # one of them is there as soon as a report is begun


def check_place(folder: Path, model: str | Path) -> None:
    """Refuse a folder in which a report would replace what no report wrote.

    Args:
        folder: Of the report, which need not exist.
        model: A robot's name or a model file, which the report must not replace either.

    Raises:
        OutputExists: says what would be lost.
    """
    check_model(folder, model)
    check_free(folder)


def check_free(folder: Path) -> None:
    """Refuse a folder in which a report would replace what no report wrote.

    Raises:
        OutputExists: says what would be lost.
    """
    strange = [name for name in (*FILES, *FOLDERS) if (folder / name).exists()]
    if strange and not any((folder / name).is_file() for name in MARKS):
        raise OutputExists(f"{folder} holds {strange[0]}, which no gap report wrote; choose another --out.")


def check_model(folder: Path, model: str | Path) -> None:
    """Refuse a folder in which `model.xml` is the very model that is to be explained.

    Raises:
        OutputExists: it would be replaced.
    """
    if Path(model).is_file() and Path(model).resolve() == (folder / "model.xml").resolve():
        raise OutputExists(f"{model} is where the model with the effects would be written; choose another --out.")


def clear(folder: Path) -> None:
    """Remove what an earlier report left; its φ stays until another is learned."""
    for name in FILES:
        (folder / name).unlink(missing_ok=True)
    shutil.rmtree(folder / "figures", ignore_errors=True)
