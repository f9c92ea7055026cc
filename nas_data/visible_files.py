"""Listing of data files, without hidden ones."""

from pathlib import Path

# Systems and tools leave files beside data: `._x` (macOS on foreign disks), `.ipynb_checkpoints`, `.~lock.x#`
# (LibreOffice), `.nfs…`, `~$x` (Microsoft Office). The shell's `*` skips most of them, `Path.glob` does not.
HIDDEN = (".", "~$")


def list_visible_files(folder: Path, pattern: str = "*") -> list[Path]:
    """Return the files that match a pattern below a folder, sorted, without hidden files and folders."""
    found = folder.glob(pattern)
    return sorted(path for path in found if not any(part.startswith(HIDDEN) for part in path.relative_to(folder).parts))
