"""The project's Numba decorators: typed, and with an on-disk cache that never outlives the source.

Numba's cache watches only the file of the function that it stores.  A kernel that inlines the cutting law from
another file would keep running yesterday's law after an edit or an upgrade, so the kernels of a module are kept in a
folder that is named after the source of all that it imports.
"""

from __future__ import annotations

import gc
import hashlib
import os
import re
import shutil
import signal
import sys
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import compiler, event, targetconfig, types

Function = TypeVar("Function", bound=Callable[..., Any])


def _compare_flags_fast() -> None:
    """Let Numba compare its compiler flags by what was set, not by reading each of 30 options: a fifth of compiling.

    Equal flags stay equal; the hash was that of the options' names, the same for all flags.
    """
    flags: Any = targetconfig.TargetConfig
    by_options, name_hash = flags.__eq__, hash("flags")
    flags.__eq__ = lambda own, other: own._values == getattr(other, "_values", None) or by_options(own, other)
    flags.__hash__ = lambda own: name_hash


_compare_flags_fast()


def _remember_operators() -> None:
    """Let Numba remember what an operator of given types is: at each ``a[n]`` it tries up to 16 templates."""
    function: Any = types.functions.BaseFunction
    resolve = function.get_call_type

    def remembered(own: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws or getattr(own.typing_key, "__module__", "") != "_operator":
            return resolve(own, context, args, kws)
        known = own.__dict__.setdefault("_cutenv_known", {})
        if (found := known.get((context, args))) is None:
            found = known[context, args] = resolve(own, context, args, kws)
        return found

    function.get_call_type = remembered


_remember_operators()


class _Lean(compiler.CompilerBase):
    """Numba's pipeline without the passes for what kernels do not contain, a tenth of the time.

    Kernels have no closures, no ``with``, no loops over tuples of different types, and nobody reads type annotations.
    """

    _UNUSED = (
        "WithLifting",
        "InlineClosureLikes",
        "FindLiterallyCalls",
        "LiteralUnroll",
        "LiteralPropagationSubPipelinePass",
        "MakeFunctionToJitFunction",
        "InlineInlinables",
        "AnnotateTypes",
    )

    def define_pipelines(self) -> list[Any]:
        builder: Any = compiler.DefaultPassBuilder  # has no types
        passes = builder.define_nopython_pipeline(self.state)
        passes.passes[:] = [step for step in passes.passes if step[0].__name__ not in self._UNUSED]
        return [passes]


_PACKAGE = Path(__file__).parents[1]
_events: Any = event  # has no types
_PREFIX = "kernels-"


def sources(module: str, package: Path = _PACKAGE) -> set[Path]:
    """Return the files of a module and of all that it imports from the package: constants of any may be compiled in."""
    found: set[Path] = set()
    waiting = set(_files(module, package))
    while waiting:
        found |= waiting
        waiting = set().union(*(_imports(path, package) for path in waiting)) - found
    return found


def _files(name: str, package: Path) -> list[Path]:
    """Return the file of a module, or of something in it, and those of the packages that hold it: they are run, too."""
    root, *parts = name.split(".")
    if root != package.name:  # a task that somebody declares elsewhere
        file = getattr(sys.modules.get(name), "__file__", None)
        return [] if file is None else [Path(file)]
    places = [package.joinpath(*parts[:depth]) for depth in range(len(parts) + 1)]
    files = [place / "__init__.py" for place in places] + [place.with_suffix(".py") for place in places[-2:]]
    return [path for path in files if path.is_file()]


@cache
def _imports(path: Path, package: Path) -> set[Path]:
    """Return the files that a file imports, anywhere in it, or names in quotes, to be imported when they are used."""
    text, root = path.read_text(encoding="utf-8"), package.name
    modules = set(re.findall(rf'"({root}\.[\w.]+)"', text))
    for line in re.finditer(rf"^ *(?:from|import) ({root}\b[\w.]*)(?: import (\([^)]*\)|.*))?", text, re.MULTILINE):
        modules |= {line[1], *(f"{line[1]}.{name}" for name in re.findall(r"\b[a-z]\w*", line[2] or ""))}
    return {file for name in modules for file in _files(name, package)}


def source_digest(module: str, package: Path = _PACKAGE) -> str:
    """Return a digest of the present source of a module and of all that it imports from the package."""
    content = hashlib.sha256()
    for path in sorted(sources(module, package)):
        content.update(_content(path))
    return content.hexdigest()[:16]


@cache
def _content(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).digest()


@cache
def kernel_folder(module: str, package: Path = _PACKAGE, maker: str | None = None) -> Path | None:
    """Return the folder of the compiled kernels of a module as it is; None where nothing can be written.

    ``maker`` is the module that makes kernels for declarations of the other one: their code depends on both.

    Below ``NUMBA_CACHE_DIR`` if that is set, else beside the source, else in the user's cache.  Its folders for earlier
    versions of the source are removed.
    """
    if not sources(module, package):  # typed into a shell: nothing says when it changes
        return None
    name = module if maker is None else f"{module}-{maker.rpartition('.')[2]}"
    digest = "".join(source_digest(each, package) for each in (module, maker) if each is not None)
    given = os.environ.get("NUMBA_CACHE_DIR")
    places = [Path(given) / package.name] if given else [package / "__pycache__", _user_cache() / package.name]
    for place in places:
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


def _user_cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


_announced = bool(os.environ.get("NUMBA_DISABLE_JIT"))


def njit(function: Function) -> Function:
    """Compile ``function`` with Numba: float64, no fast-math (bit-for-bit repeatable), cached on disk.

    With the environment variable ``NUMBA_DISABLE_JIT=1`` it stays plain Python, against which the tests compare.
    """
    return _compile(function)


def njit_nogil(function: Function) -> Function:
    """Compile like :func:`njit`, but release the GIL while it runs: for kernels of :mod:`cutenv._engine.parallel`."""
    return _compile(function, nogil=True)


def njit_internal(function: Function) -> Function:
    """Compile ``function`` for callers inside kernels only; from Python it stays plain Python, also for arrays.

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
    """Compile like :func:`njit_inline` a function without a file, from :func:`cutenv._engine.fuse.fuse`."""
    return _compile_internal(function, forceinline=True, cache=False)


class WithoutCollection(event.Listener):
    """Listener that keeps garbage collection away while functions of this package compile: 5 % less time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._going_on = 0
        self._collects = False

    def on_start(self, event: Any) -> None:
        if not self._concerns(event):
            return
        with self._lock:
            if self._going_on == 0:
                self._collects = gc.isenabled()
                gc.disable()
            self._going_on += 1

    def on_end(self, event: Any) -> None:
        if not self._concerns(event):
            return
        with self._lock:
            self._going_on -= 1
            if self._going_on == 0 and self._collects:
                gc.enable()

    def _concerns(self, event: Any) -> bool:
        function = event.data["dispatcher"].py_func
        return bool(function.__module__.split(".")[0] == _PACKAGE.name)


class Uninterrupted(event.Listener):
    """Listener that lets a Ctrl-C wait until the function at hand is compiled or loaded, mostly under a second.

    In a callback from LLVM the KeyboardInterrupt would be lost, or Numba would end in an error of its own.
    """

    COMPILING, WORKING = "numba:compile", "numba:compiler_lock"
    """Events of one function, and of all that Numba does, loading among it."""

    def __init__(self) -> None:
        self._going_on = 0
        self._interrupted = False
        self._handler: Any = None

    def on_start(self, event: Any) -> None:
        if event.kind != self.WORKING or not _in_main_thread():
            return
        if self._going_on == 0:
            self._handler = signal.signal(signal.SIGINT, self._remember)
        self._going_on += 1

    def on_end(self, event: Any) -> None:
        if self._going_on == 0 or not _in_main_thread():
            return
        if event.kind == self.WORKING:
            self._going_on -= 1
            if self._going_on > 0:
                return
            if self._handler is not None:  # None: not set from Python
                signal.signal(signal.SIGINT, self._handler)
        if self._interrupted:
            self._interrupted = False
            if callable(self._handler):  # not SIG_IGN
                self._handler(signal.SIGINT, None)

    def _remember(self, number: int, frame: Any) -> None:
        self._interrupted = True


def _in_main_thread() -> bool:
    """Return True in the thread that receives the signals."""
    return threading.current_thread() is threading.main_thread()


_events.register("numba:compile", WithoutCollection())
_uninterrupted = Uninterrupted()
for _kind in (Uninterrupted.COMPILING, Uninterrupted.WORKING):
    _events.register(_kind, _uninterrupted)


def warn_before_first_compile(*kernels: Callable[..., Any]) -> None:
    """Print on stderr, once, that the first use compiles for some seconds, if one of ``kernels`` is not on disk."""
    global _announced
    if _announced or all(_is_compiled(kernel) for kernel in kernels):
        return
    _announced = True
    notice = f"{_PACKAGE.name}: compiling for this machine; takes about half a minute, once."
    if (progress := sys.modules.get("tqdm")) is not None:  # a bar of it may stand on the line
        progress.tqdm.write(notice, file=sys.stderr)
    else:
        print(notice, file=sys.stderr, flush=True)


def _is_compiled(kernel: Any) -> bool:
    """Return True if a kernel is on disk, or cannot be kept there."""
    folder = kernel_folder(kernel.__module__, maker=getattr(kernel, "made_in", None))
    return folder is None or (hasattr(kernel, "py_func") and any(folder.rglob(f"*.{kernel.__name__}-*.nbi")))


def _compile_internal(function: Function, **options: bool) -> Function:
    inside: Any = _compile(function, no_cpython_wrapper=True, **options)
    if inside is not function:  # Python must not call what lacks the wrapper; Numba looks for the type
        shown: Any = function
        shown._numba_type_, shown._inside = numba.types.Dispatcher(inside), inside  # the type refers to it weakly
    return function


def _compile(function: Function, cache: bool = True, **options: bool) -> Function:
    # Numba reads the folder once, when it decorates; the caches of other packages stay where they are.
    settings: Any = numba.config
    njit: Any = numba.njit  # whose types lack the wrappers
    before = settings.CACHE_DIR
    folder = kernel_folder(function.__module__, maker=getattr(function, "made_in", None))
    settings.CACHE_DIR = str(folder or "")
    try:
        decorate = njit(
            cache=cache and folder is not None,
            fastmath=False,
            error_model="numpy",
            no_cfunc_wrapper=True,
            pipeline_class=_Lean,
            **options,
        )
        return cast(Function, decorate(function))
    finally:
        settings.CACHE_DIR = before
