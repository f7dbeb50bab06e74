"""Decorators of kernels.

Taken from the library that a wheel brings, or compiled by Numba and kept on disk.

The library is used where it was built from this very source (:mod:`cutenv._engine.native`).  Where there is none, and
for kernels that it lacks, such as those of a task of one's own, Numba compiles.  Numba's cache watches only the file of
the function that it stores.  A kernel that inlines the cutting law from another file would keep running yesterday's law
after an edit or an upgrade, so the kernels of a module are kept in a folder that is named after the source of all that
it imports.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import sys
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from cutenv._base.imports import extra_named
from cutenv._engine import native

if TYPE_CHECKING:
    from types import ModuleType

Function = TypeVar("Function", bound=Callable[..., Any])

_PACKAGE = Path(__file__).parents[1]
_PREFIX = "kernels-"
_DOCUMENTED = ("nogil",)  # of the options that the decorators below give to Numba
_unregistered: list[Callable[[], object]] = []  # calls that register functions with Numba, once it is needed


def sources(module: str, package: Path = _PACKAGE) -> set[Path]:
    """Return files of a module and all its imports in the package."""
    found: set[Path] = set()
    waiting = set(_files(module, package))
    while waiting:
        found |= waiting
        waiting = set().union(*(_imports(path, package) for path in waiting)) - found
    return found


def _files(name: str, package: Path) -> list[Path]:
    """Return a module's file and its packages' files, also run."""
    root, *parts = name.split(".")
    if root != package.name:  # a task that somebody declares elsewhere
        file = getattr(sys.modules.get(name), "__file__", None)
        return [] if file is None else [Path(file)]
    places = [package.joinpath(*parts[:depth]) for depth in range(len(parts) + 1)]
    files = [place / "__init__.py" for place in places] + [place.with_suffix(".py") for place in places[-2:]]
    return [path for path in files if path.is_file()]


@cache
def _imports(path: Path, package: Path) -> set[Path]:
    """Return files that a file imports, or names in quotes."""
    text, root = path.read_text(encoding="utf-8"), package.name
    modules = set(re.findall(rf'"({root}\.[\w.]+)"', text))
    for line in re.finditer(rf"^ *(?:from|import) ({root}\b[\w.]*)(?: import (\([^)]*\)|.*))?", text, re.MULTILINE):
        modules |= {line[1], *(f"{line[1]}.{name}" for name in re.findall(r"\b[a-z]\w*", line[2] or ""))}
    return {file for name in modules for file in _files(name, package)}


def source_digest(module: str, package: Path = _PACKAGE) -> str:
    """Return a source digest of a module and its imports."""
    content = hashlib.sha256()
    for path in sorted(sources(module, package)):
        content.update(_content(path))
    return content.hexdigest()[:16]


@cache
def _content(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).digest()


@cache
def kernel_folder(module: str, package: Path = _PACKAGE, maker: str | None = None) -> Path | None:
    """Return a module's folder of compiled kernels, or None if unwritable.

    ``maker`` is the module that makes kernels for declarations of the other one: their code depends on both.

    Below ``NUMBA_CACHE_DIR`` if that is set, else beside the source, else in the user's cache.  Its folders for earlier
    versions of the source are removed.
    """
    if not sources(module, package):  # typed into a shell: nothing says when it changes
        return None
    name = module if maker is None else f"{module}-{maker.rpartition('.')[2]}"
    digest = "".join(source_digest(each, package) for each in (module, maker) if each is not None)
    given = os.environ.get("NUMBA_CACHE_DIR")
    for place in _places(package)[: 1 if given else None]:
        folder = place / f"{_PREFIX}{name}-{digest}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if not os.access(folder, os.W_OK):
            continue
        for earlier in place.glob(f"{_PREFIX}{name}-*"):
            if earlier != folder and "-" not in earlier.name.removeprefix(f"{_PREFIX}{name}-"):
                shutil.rmtree(earlier, ignore_errors=True)
        return folder
    return None


def _places(package: Path) -> list[Path]:
    """Return folders of compiled kernels, ``NUMBA_CACHE_DIR`` first."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    return [*([Path(given) / package.name] if given else []), package / "__pycache__", *_user_caches(package.name)]


def remove_kernels(package: Path = _PACKAGE) -> list[Path]:
    """Remove this machine's compiled kernels or raise OSError; return where they were."""
    held = {place: [*place.glob(f"{_PREFIX}*")] for place in _places(package)}
    for place, folders in held.items():
        for folder in folders:
            shutil.rmtree(folder)
        if folders and not any(place.iterdir()):
            place.rmdir()
    return [place for place, folders in held.items() if folders]


def _user_caches(name: str) -> list[Path]:
    """Return the user's cache folder of a package, if any."""
    try:
        return [Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / name]
    except RuntimeError:
        return []


def njit(function: Function) -> Function:
    """Compile ``function``: float64, no fast-math (bit-for-bit repeatable), kept on disk.

    With the environment variable ``NUMBA_DISABLE_JIT=1`` it stays plain Python, against which the tests compare.
    """
    return _compile(function)


def njit_nogil(function: Function) -> Function:
    """Compile like :func:`njit`, releasing the GIL for :mod:`cutenv._engine.parallel`."""
    return _compile(function, nogil=True)


def njit_internal(function: Function) -> Function:
    """Compile ``function`` for callers inside kernels only.

    From Python it stays plain Python, also for arrays.

    Most functions are called only from compiled code.  The wrapper with which Numba makes one callable from Python
    costs a quarter to a third of the compile time.
    """
    return _compile_internal(function)


def njit_inline(function: Function) -> Function:
    """Compile like :func:`njit_internal` and force-inline into every kernel that calls it.

    For functions called in inner loops over many cuts: LLVM vectorises only loops without calls, and array arguments
    cost atomic reference counts, over which threads contend.
    """
    return _compile_internal(function, forceinline=True)


def njit_fused(function: Function) -> Function:
    """Compile like :func:`njit_inline` a function without a file, from :func:`cutenv._engine.declared.fuse`."""
    return _compile_internal(function, forceinline=True, cache=False)


def warn_before_first_compile(*kernels: Callable[..., Any]) -> None:
    """Announce, once, seconds of compiling, if ``kernels`` are not stored.

    The line goes to stderr.  A line before it tells of a Numba with which this package was not tested, and is slower.
    """
    if os.environ.get("NUMBA_DISABLE_JIT"):
        return
    waiting = [kernel for kernel in kernels if not _is_compiled(kernel)]
    if (waiting or native.LIBRARY is None) and not (shortcuts := _compiler()).are_tested():
        major, minor = shortcuts.TESTED
        _print_once(
            f"Numba {shortcuts.numba.__version__} is newer than {major}.{minor}, which was tested: compiling and steps "
            f"take longer. To avoid that: pip install 'numba<{major}.{minor + 1}'."
        )
    if any(_folder_of(kernel) is None for kernel in waiting):
        _print_once(
            "compiling for this machine; takes about half a minute, at every start, for nothing can be kept: set "
            "NUMBA_CACHE_DIR to a folder that can be written to."
        )
    elif waiting:
        _print_once("compiling what this needs for this machine; takes up to half a minute, and is then kept.")


@cache
def _print_once(notice: str) -> None:
    line = f"{_PACKAGE.name}: {notice}"
    if (progress := sys.modules.get("tqdm")) is not None:  # a bar of it may stand on the line
        progress.tqdm.write(line, file=sys.stderr)
    else:
        print(line, file=sys.stderr, flush=True)


def _is_compiled(kernel: Any) -> bool:
    """Return True if a kernel is stored, or cannot be."""
    if isinstance(kernel, native.Kernel) and kernel.is_built:
        return True
    folder = _folder_of(kernel)
    if folder is None:
        return not sources(kernel.__module__)
    return hasattr(kernel, "py_func") and any(folder.rglob(f"*.{kernel.__name__}-*.nbi"))


def _folder_of(kernel: Any) -> Path | None:
    return kernel_folder(kernel.__module__, maker=getattr(kernel, "made_in", None))


def _compile_internal(function: Function, **options: bool) -> Function:
    compiler_is_loaded = bool(_compiler.cache_info().currsize)
    if native.covers(function) and not compiler_is_loaded:
        _unregistered.append(partial(_compiled_inside, function, **options))
        return function
    return _compiled_inside(function, **options)


def _compiled_inside(function: Function, **options: bool) -> Function:
    inside: Any = _compiled(function, no_cpython_wrapper=True, **options)
    if inside is function or not _compiler().are_tested():
        return cast(Function, inside)
    # Python must not call what lacks the wrapper; Numba looks for the type, which refers to it weakly.
    shown: Any = function
    shown._numba_type_, shown._inside = _compiler().type_of(inside), inside
    return function


def _compile(function: Function, **options: Any) -> Function:
    if native.covers(function):
        kernel: Any = native.Kernel(function, lambda: _compiled(function, **options))
        return cast(Function, kernel)
    return _compiled(function, **options)


@cache
def _compiler() -> ModuleType:
    """Import and return the module that compiles, with Numba."""
    with extra_named():
        from cutenv._engine import lowering, shortcuts  # noqa: F401 - the lowering of rows is registered
    return shortcuts


def _register_all() -> None:
    """Register with Numba all functions decorated before compiling."""
    waiting = _unregistered.copy()
    _unregistered.clear()
    for register in waiting:
        register()


def _compiled(function: Function, cache: bool = True, **options: Any) -> Function:
    shortcuts = _compiler()
    _register_all()
    # Numba reads the folder once, when it decorates; the caches of other packages stay where they are.
    settings: Any = shortcuts.numba.config
    njit: Any = shortcuts.numba.njit  # whose types lack the wrappers
    before = settings.CACHE_DIR
    folder = _folder_of(function)
    settings.CACHE_DIR = str(folder or "")
    if tested := shortcuts.are_tested():
        options |= {"no_cfunc_wrapper": True, "pipeline_class": shortcuts.KernelCompiler}
    else:
        options = {name: value for name, value in options.items() if name in _DOCUMENTED}
    try:
        decorate = njit(cache=cache and folder is not None, fastmath=False, error_model="numpy", **options)
        compiled = decorate(function)
    finally:
        settings.CACHE_DIR = before
    if tested and compiled is not function:  # as where NUMBA_DISABLE_JIT is set
        shortcuts.compile_alone(compiled, folder if cache else None)
    return cast(Function, compiled)
