"""What the commands that time something have in common."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data.commands.base import CommandResult
from nas_data.errors import OptionError

if TYPE_CHECKING:
    from nas_data.benchmarks.result import BenchmarkResult


def run_in_temporary_folder(benchmark: "Callable[..., BenchmarkResult]", **sizes: int) -> CommandResult:
    """Run a benchmark in a folder that is removed afterwards.

    Args:
        benchmark: Takes the folder and the sizes.
        sizes: How much of everything.

    Raises:
        OptionError: a size is below one.
    """
    for name, size in sizes.items():
        if size < 1:
            raise OptionError(f"--{name} is {size}; at least 1 is needed.")
    with tempfile.TemporaryDirectory(prefix="nas-benchmark-") as folder:
        result = benchmark(Path(folder), **sizes)
    return CommandResult(result.to_text(), result.to_json())
