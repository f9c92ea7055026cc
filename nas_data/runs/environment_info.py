"""What a result was made with, beside what decides it: versions of packages, and the commit of this package's code."""

import subprocess
from functools import cache
from pathlib import Path

from nas_data.dataset.provenance import installed_versions, package_versions

ROOT = Path(__file__).parents[1]
MORE = ("gymnasium", "onnxruntime", "stable_baselines3")  # beside the packages that shape a dataset
CHANGED = "-changed"  # after a commit: files of the package are not as they were committed


@cache
def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that shape policies, as far as they are installed."""
    return {**package_versions(), **installed_versions(MORE)}


@cache
def commit() -> str | None:
    """Return the git commit of this package as it was when first asked for; None where it is no checkout of its own."""
    head = git("rev-parse", "HEAD")
    if head is None or git("ls-files", "--error-unmatch", "__init__.py") is None:
        return None  # installed, perhaps inside someone else's repository
    return head + (CHANGED if git("status", "--porcelain", "--", ".") else "")


def git(*words: str) -> str | None:
    """Return what git answers about this package's folder; None where it refuses, or is not there."""
    try:
        answer = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False)
    except OSError:
        return None
    return answer.stdout.strip() if answer.returncode == 0 else None
