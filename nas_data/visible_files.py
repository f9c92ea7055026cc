"""The files of a folder that are somebody's data: those whose names do not hide them."""

from pathlib import Path

# Systems and tools leave files beside data: `._x` (macOS on foreign disks), `.ipynb_checkpoints`, `.~lock.x#`
# (LibreOffice), `.nfs…`, `~$x` (Microsoft Office). The shell's `*` passes over most of them, `Path.glob` does not.
HIDDEN = (".", "~$")


def list_visible_files(folder: Path, pattern: str = "*") -> list[Path]:
    """Return what a pattern finds below a folder, sorted, without hidden files and what lies in hidden folders."""
    found = folder.glob(pattern)
    return sorted(path for path in found if not any(part.startswith(HIDDEN) for part in path.relative_to(folder).parts))
