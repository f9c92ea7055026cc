"""Atomic writing of files."""

import os
from pathlib import Path


def write_atomic(path: Path, content: bytes) -> None:
    """Write a hidden temporary file in the same folder, then rename it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    partial.write_bytes(content)
    partial.replace(path)
