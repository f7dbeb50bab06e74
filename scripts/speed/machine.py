"""The machine and the libraries that numbers of speed belong to."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

from cutenv.cores import cores

BLAS_THREADS = "OMP_NUM_THREADS"
"""The environment variable that says how many threads linear algebra may use."""
LIBRARIES = ("gymnasium", "numba", "numpy", "scipy")
_CPUINFO = Path("/proc/cpuinfo")


def description() -> dict[str, str | int]:
    """Processor, cores in use, system, Python and libraries."""
    machine: dict[str, str | int] = {
        "cpu": cpu(),
        "cores": cores(),
        BLAS_THREADS: os.environ.get(BLAS_THREADS, "not set"),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }
    return machine | {name: version(name) for name in LIBRARIES}


def cpu(cpuinfo: Path = _CPUINFO) -> str:
    """Name of the processor: Linux's own where it tells, else what Python knows of it."""
    if cpuinfo.is_file():
        for line in cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name" and value.strip():
                return value.strip()
    return platform.processor() or platform.machine() or "unknown"
