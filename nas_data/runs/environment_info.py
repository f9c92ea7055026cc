"""Environment of a result: package versions, and the commit of this package."""

import subprocess
from functools import cache
from pathlib import Path

from nas_data.dataset.provenance import installed_versions, package_versions

ROOT = Path(__file__).parents[1]
MORE = ("gymnasium", "onnxruntime", "stable_baselines3")  # in addition to the packages that affect a dataset
CHANGED = "-changed"  # suffix of a commit if files of the package were changed


@cache
def versions() -> dict[str, str]:
    """Return the versions of Python and of the installed packages that affect policies."""
    return {**package_versions(), **installed_versions(MORE)}


@cache
def commit() -> str | None:
    """Return the git commit of this package, cached at the first call; None if it is not a git checkout."""
    head = git("rev-parse", "HEAD")
    if head is None or git("ls-files", "--error-unmatch", "__init__.py") is None:
        return None  # installed, possibly inside another repository
    return head + (CHANGED if git("status", "--porcelain", "--", ".") else "")


def git(*words: str) -> str | None:
    """Return the output of git in this package's folder; None if git fails or is not installed."""
    try:
        answer = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False)
    except OSError:
        return None
    return answer.stdout.strip() if answer.returncode == 0 else None
