"""Hardware of a benchmark: processor, cores, versions."""

import os
import platform
from pathlib import Path

from nas_data.dataset.provenance import read_package_versions

CPUINFO = Path("/proc/cpuinfo")


def describe_hardware() -> dict[str, object]:
    """Return the processor model, the number of usable cores, the load average, and versions."""
    return {
        "processor": read_processor_model(),
        "cores": len(os.sched_getaffinity(0)),
        "load": round(os.getloadavg()[0], 1),
        "system": f"{platform.system()} {platform.machine()}",
        "versions": read_package_versions(),
    }


def read_processor_model() -> str:
    """Return the processor model; the architecture if the model is unknown."""
    if CPUINFO.is_file():
        for line in CPUINFO.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
