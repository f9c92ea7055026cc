"""Hardware of a benchmark: processor, cores, versions."""

import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from nas_data.dataset.provenance import read_package_versions
from nas_data.runs.parallel import count_cores

CPUINFO = Path("/proc/cpuinfo")


@dataclass(frozen=True)
class Hardware:
    """The machine of a benchmark."""

    processor: str  # its model
    cores: int  # number of usable cores
    load: float  # load average
    system: str  # operating system and architecture
    versions: Mapping[str, str]  # versions of Python and of the packages


def read_hardware() -> Hardware:
    """Return the hardware of this machine, and its load."""
    return Hardware(
        processor=read_processor_model(),
        cores=count_cores(),
        load=round(os.getloadavg()[0], 1),
        system=f"{platform.system()} {platform.machine()}",
        versions=read_package_versions(),
    )


def read_processor_model() -> str:
    """Return the processor model; the architecture if the model is unknown."""
    if CPUINFO.is_file():
        for line in CPUINFO.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
