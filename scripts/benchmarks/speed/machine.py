"""Description of the machine and the libraries on which speed was measured."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

from cutenv._engine.parallel import cores

BLAS_THREADS = "OMP_NUM_THREADS"  # environment variable with the number of threads of linear algebra
LIBRARIES = ("gymnasium", "numba", "numpy", "scipy")
_CPUINFO = Path("/proc/cpuinfo")


def description() -> dict[str, str | int]:
    """Return processor, cores in use, system, versions of Python and of libraries."""
    machine: dict[str, str | int] = {
        "cpu": cpu(),
        "cores": cores(),
        BLAS_THREADS: os.environ.get(BLAS_THREADS, "not set"),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }
    return machine | {name: version(name) for name in LIBRARIES}


def cpu(cpuinfo: Path = _CPUINFO) -> str:
    """Return the name of the processor, from /proc/cpuinfo if it has one, else from Python."""
    if cpuinfo.is_file():
        for line in cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name" and value.strip():
                return value.strip()
    return platform.processor() or platform.machine() or "unknown"
