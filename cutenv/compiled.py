"""The one door to Numba: a typed decorator whose on-disk cache never outlives the source.

Numba's cache watches only the file of the function that it stores.  A kernel that inlines the cutting law from
another file would keep running yesterday's law after an edit or an upgrade, so the first import after any change of
a compiled source clears the package's cached kernels.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

_PACKAGE = Path(__file__).parent


def compiled(function: Function) -> Function:
    """Compile ``function`` with Numba: float64, no fast-math (bit-for-bit repeatable), cached on disk.

    With the environment variable ``NUMBA_DISABLE_JIT=1`` it stays plain Python, which the tests compare with.
    """
    return cast(Function, numba.njit(cache=True, fastmath=False, error_model="python")(function))


def compiled_parallel(function: Function) -> Function:
    """Like :func:`compiled`, with ``numba.prange`` loops spread over the cores."""
    return cast(Function, numba.njit(cache=True, fastmath=False, error_model="python", parallel=True)(function))


def clear_stale_kernels(package: Path = _PACKAGE) -> bool:
    """Delete cached kernels below ``package`` if a compiled source changed; return whether it did.

    A read-only installation is left alone: Numba caches elsewhere then, keyed by the path and time of each file.
    """
    sources = sorted(path for path in package.rglob("*.py") if b"compiled" in path.read_bytes())
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
    stamp = package / "__pycache__" / "compiled_sources.sha256"
    try:
        if stamp.is_file() and stamp.read_text() == digest:
            return False
        for suffix in ("*.nbi", "*.nbc"):
            for kernel in package.rglob(suffix):
                kernel.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(digest)
    except OSError:
        return False
    return True


clear_stale_kernels()
