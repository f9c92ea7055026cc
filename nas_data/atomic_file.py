"""Names of files, and atomic writing."""

import os
import re
import secrets
from collections.abc import Iterable
from itertools import count
from pathlib import Path


def make_file_names(names: Iterable[str]) -> dict[str, str]:
    """Return a file name for each name, for example a joint's.

    It has `_` for characters that separate folders or need quoting, and a number where two would be equal.
    """
    found: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"[^\w.-]", "_", name)
        free = (f"{plain}{number or ''}" for number in count())
        found[name] = next(each for each in free if each not in found.values())
    return found


def write_atomic(path: Path, content: bytes) -> None:
    """Write a hidden temporary file in the same folder, then rename it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}.partial")  # also of other machines
    partial.write_bytes(content)
    partial.replace(path)
