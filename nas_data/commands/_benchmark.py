"""Base of the timing benchmarks: options are sizes, the folder is temporary, the result is a table of times."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from nas_data.commands.base import Command, CommandResult
from nas_data.errors import OptionError
from nas_data.registry import to_snake_case

if TYPE_CHECKING:
    from nas_data.benchmarks.result import BenchmarkResult


@dataclass(frozen=True, kw_only=True)
class Benchmark(Command):
    """Base of the timing benchmarks; `BenchmarkPairing` runs `benchmark` of `nas_data/benchmarks/pairing.py`."""

    def run(self) -> CommandResult:
        """Run the benchmark in a temporary folder.

        Raises:
            OptionError: a size is below one.
        """
        shared = {field.name for field in fields(Command)}
        sizes: dict[str, int] = {field.name: getattr(self, field.name) for field in fields(self)}
        sizes = {name: size for name, size in sizes.items() if name not in shared}
        for name, size in sizes.items():
            if size < 1:
                raise OptionError(f"--{name} is {size}; at least 1 is needed.")
        name = to_snake_case(type(self).__name__).removeprefix("benchmark_")
        benchmark: Callable[..., BenchmarkResult] = import_module(f"nas_data.benchmarks.{name}").benchmark
        with TemporaryDirectory(prefix="nas-benchmark-") as folder:
            result = benchmark(Path(folder), **sizes)
        return CommandResult(result.to_text(), result.to_json())
