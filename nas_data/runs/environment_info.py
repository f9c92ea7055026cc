"""Environment of a result: package versions, and the commit of this package."""

import subprocess
from functools import cache
from pathlib import Path

from nas_data.dataset.provenance import read_installed_versions, read_package_versions

ROOT = Path(__file__).parents[1]
MORE_PACKAGES = ("gymnasium", "onnxruntime", "stable_baselines3")  # in addition to the packages that affect a dataset
CHANGED = "-changed"  # suffix of a commit if files of the package were changed


@cache
def read_versions() -> dict[str, str]:
    """Return the versions of Python and of the installed packages that affect policies."""
    return {**read_package_versions(), **read_installed_versions(MORE_PACKAGES)}


@cache
def find_commit() -> str | None:
    """Return the git commit of this package, cached at the first call; None if it is not a git checkout."""
    head = run_git("rev-parse", "HEAD")
    if head is None or run_git("ls-files", "--error-unmatch", "__init__.py") is None:
        return None  # installed, possibly inside another repository
    return head + (CHANGED if run_git("status", "--porcelain", "--", ".") else "")


def run_git(*words: str) -> str | None:
    """Return the output of git in this package's folder; None if git fails or is not installed."""
    try:
        answer = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False)
    except OSError:
        return None
    return answer.stdout.strip() if answer.returncode == 0 else None
