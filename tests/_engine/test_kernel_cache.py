"""Compiled kernels on disk never outlive the source that they were made from."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import cutenv._engine.jit
import cutenv.task.stepper
from cutenv._engine import shortcuts
from cutenv._engine.jit import kernel_folder, source_digest

LAW = """
from package._engine.jit import {door}

@{door}
def force(x: float) -> float:
    return {factor} * x
"""
CALLER = """
from package._engine.jit import njit
from package.law import force

@njit
def twice(x: float) -> float:
    return 2.0 * force(x)

@njit
def thrice(x: float) -> float:
    return 3.0 * force(x)
"""


def digest_now(module: str, package: Path) -> str:
    """Digest of a package that changed since this process began."""
    for remembered in (cutenv._engine.jit._imports, cutenv._engine.jit._content, kernel_folder):
        remembered.cache_clear()
    return source_digest(module, package)


DOORS = ("njit", "njit_internal", "njit_inline")


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package of two compiled modules with the door to Numba that cutenv has."""
    folder = tmp_path / "package"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "_engine").mkdir()
    (folder / "_engine" / "jit.py").write_text(Path(cutenv._engine.jit.__file__).read_text())
    (folder / "caller.py").write_text(CALLER)
    write_law(folder, 3.0)
    return folder


def write_law(package: Path, factor: float, door: str = "njit") -> None:
    """Write the law, a minute later than the last time: Python overlooks an edit of the same size and second."""
    path = package / "law.py"
    edited = path.stat().st_mtime + 60.0 if path.exists() else 1e9
    path.write_text(LAW.format(factor=factor, door=door))
    os.utime(path, (edited, edited))


def answer(package: Path, kernel: str = "caller.twice", **environment: str) -> float:
    """What a kernel answers in a new process."""
    module, name = kernel.split(".")
    inherited = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA")}
    done = subprocess.run(
        [sys.executable, "-c", f"from package.{module} import {name}; print({name}(1.0))"],
        capture_output=True,
        text=True,
        check=True,
        env=inherited | {"PYTHONPATH": str(package.parent)} | environment,
    )
    return float(done.stdout)


def check_edit_of_an_inlined_function_is_seen(package: Path, **environment: str) -> None:
    assert answer(package, **environment) == 6.0
    assert list(package.parent.rglob("*.nbi"))
    write_law(package, 5.0)
    assert answer(package, **environment) == 10.0


@pytest.mark.parametrize("door", DOORS)
def test_another_kernel_finds_on_disk_what_the_first_has_called_and_an_edit_of_it_reaches_the_first(package, door):
    """Python may call it too."""
    write_law(package, 3.0, door)
    assert answer(package) == 6.0
    (kept,) = package.rglob("law.force-*.nbc")
    written = kept.stat().st_mtime_ns
    assert answer(package, "caller.thrice") == 9.0
    assert answer(package, "law.force") == 3.0
    assert kept.stat().st_mtime_ns == written
    write_law(package, 5.0, door)
    assert answer(package) == 10.0


SLOW = """
import sys, time
import numba.core.dispatcher as dispatcher

compile_it = dispatcher._FunctionCompiler.compile

def told(self, args, return_type):
    print(self.py_func.__name__, flush=True)
    time.sleep(0.5)
    return compile_it(self, args, return_type)

dispatcher._FunctionCompiler.compile = told
from package.caller import twice
assert twice(1.0) == 6.0
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such lock")
def test_of_processes_that_want_a_kernel_at_once_one_compiles_it(package):
    environment = os.environ | {"PYTHONPATH": str(package.parent)}
    line = [sys.executable, "-c", SLOW]
    both = [subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env=environment) for _ in range(2)]
    printed = [each.communicate()[0].split() for each in both]
    assert [each.returncode for each in both] == [0, 0]
    assert sorted([*printed[0], *printed[1]]) == ["force", "twice"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such lock")
def test_a_process_that_was_stopped_while_it_compiled_is_not_waited_for_without_end(package, monkeypatch):
    import fcntl

    (folder,) = {kernel_folder("package.law", package)}
    with (folder / "compiling.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        monkeypatch.setattr(shortcuts, "_PATIENCE", 0.1)
        with shortcuts._alone_in(folder):
            pass
    with shortcuts._alone_in(folder), shortcuts._alone_in(folder):  # a kernel that another of its file calls
        assert shortcuts._held == {folder}
    assert not shortcuts._held


@pytest.mark.parametrize("door", DOORS[1:])
def test_what_is_for_kernels_is_plain_python_elsewhere(package, door):
    write_law(package, 3.0, door)
    plain = [sys.executable, "-c", "from package.law import force; print(type(force).__name__, force(2))"]
    environment = os.environ | {"PYTHONPATH": str(package.parent)}
    done = subprocess.run(plain, capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.split() == ["function", "6.0"]
    assert not list(package.rglob("*.nbi"))


def test_the_same_holds_where_the_user_chose_the_cache(package, tmp_path):
    check_edit_of_an_inlined_function_is_seen(package, NUMBA_CACHE_DIR=str(tmp_path / "chosen"))
    assert not list(package.rglob("*.nbi"))


@pytest.mark.parametrize(
    "line",
    [
        "from package.more import SPACING",
        "import package.more",
        "from package import (\n    law,\n    more,\n)",
        "def spacing() -> float:\n    from package.more import SPACING\n    return SPACING",
        'LATER = {"SPACING": "package.more"}',
    ],
)
def test_every_change_of_what_a_module_imports_changes_its_digest(package, line):
    seen = {digest_now("package.caller", package)}
    for change in (
        lambda: (package / "law.py").write_text(line),
        lambda: (package / "more.py").write_text("SPACING = 1.0"),
        lambda: (package / "more.py").write_text("SPACING = 2.0"),
        lambda: (package / "__init__.py").write_text("UNIT = 1.0"),
    ):
        change()
        seen.add(digest_now("package.caller", package))
    assert len(seen) == 5


def test_a_module_that_a_kernel_does_not_import_leaves_it_compiled(package):
    before = digest_now("package.caller", package)
    (package / "page.py").write_text("from package.caller import twice")
    assert digest_now("package.caller", package) == before
    assert digest_now("package.page", package) != before


@pytest.mark.parametrize("task", ["depth", "path"])
def test_a_loop_that_is_made_for_a_task_is_compiled_anew_when_the_task_changes(task):
    module = importlib.import_module(f"cutenv.task.{task}")
    step = cutenv.task.stepper.step_some(getattr(module, f"{task.upper()}_CUT"))
    kept = str(step._cache.cache_path)
    for name in (module.__name__, cutenv.task.stepper.__name__):
        assert source_digest(name) in kept


def test_folders_of_earlier_sources_are_removed_and_nothing_else(package, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    kernel_folder.cache_clear()
    first, other = (kernel_folder(f"package.{name}", package) for name in ("law", "_engine.jit"))
    kept = package / "__pycache__" / "law.cpython-311.pyc"
    kept.touch()
    write_law(package, 7.0)
    digest_now("package.law", package)
    second = kernel_folder("package.law", package)
    assert second != first
    assert second.is_dir()
    assert not first.exists()
    assert kept.exists()
    assert other.exists()


def test_the_first_use_says_that_it_compiles_and_the_second_says_nothing(tmp_path):
    use = (
        "import gymnasium, cutenv; env = gymnasium.make('cutenv/GentleCut-v1'); "
        "env.reset(seed=0); env.step(env.action_space.sample())"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    first = subprocess.Popen([sys.executable, "-c", use], stderr=subprocess.PIPE, text=True, env=environment)
    assert first.stderr is not None
    with first.stderr:
        assert first.stderr.readline().startswith("cutenv: compiling what this needs")
    first.kill()  # to compile all of it takes half a minute
    first.wait()
    for _ in range(2):  # with the kernels that the other tests use, too
        again = subprocess.run([sys.executable, "-c", use], capture_output=True, text=True, check=True)
    assert "compiling" not in again.stderr


def test_the_notice_of_compiling_stands_on_a_line_of_its_own_beside_a_progress_bar(tmp_path):
    pytest.importorskip("tqdm", reason="progress bars are an extra: pip install 'cutenv[view]'")
    use = (
        "from tqdm import tqdm; from cutenv._engine.jit import warn_before_first_compile; from "
        "cutenv.sim.cutting.simulate import hold\n"
        "with tqdm(total=5, desc='cutting') as bar: warn_before_first_compile(hold)"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    ran = subprocess.run([sys.executable, "-c", use], capture_output=True, check=True, env=environment)
    lines = re.split(r"[\r\n]+", ran.stderr.decode())
    assert any(line.startswith("cutenv: compiling what this needs for this machine") for line in lines)


def test_importing_compiles_nothing(tmp_path):
    command = [sys.executable, "-c", "import cutenv, cutenv.envs.vector, cutenv.agents.policy"]
    subprocess.run(command, check=True, env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)})
    assert not list(tmp_path.rglob("*.nbi"))


@pytest.fixture
def blocked(tmp_path: Path) -> str:
    """A folder that nobody can write to, the superuser included: a file is in its place."""
    (tmp_path / "blocked").touch()
    return str(tmp_path / "blocked")


def test_where_nothing_can_be_written_nothing_is_kept(package, tmp_path, blocked):
    assert answer(package, NUMBA_CACHE_DIR=blocked) == 6.0
    assert not list(tmp_path.rglob("*.nbi"))


def printed(program: str, **environment: str) -> list[str]:
    """Lines on stderr of a program in a new process."""
    inherited = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA")}
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, env=inherited | environment
    )
    return done.stderr.splitlines()


def test_where_nothing_can_be_written_one_line_says_what_to_set(blocked):
    use = (
        "from cutenv._engine.jit import warn_before_first_compile\n"
        "from cutenv.sim.cutting.motion import STRAIGHT\n"
        "from cutenv.sim.cutting.simulate import follow, hold\n"
        "for kernel in (hold, follow): warn_before_first_compile(kernel(STRAIGHT))"
    )
    (line,) = printed(use, NUMBA_CACHE_DIR=blocked)
    assert "at every start" in line
    assert "NUMBA_CACHE_DIR" in line


def test_a_user_without_a_home_can_import(package, blocked, monkeypatch):
    """A container may run as a number without a home; here the package's folder cannot be written to either."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    (package / "__pycache__").touch()
    kernel_folder.cache_clear()
    assert kernel_folder("package.law", package) is None


def homeless() -> Path:
    raise RuntimeError("Could not determine home directory.")


def test_nothing_is_said_of_a_kernel_that_was_typed_into_a_shell():
    use = (
        "from cutenv._engine.jit import njit, warn_before_first_compile\n"
        "@njit\n"
        "def twice(x): return 2.0 * x\n"
        "warn_before_first_compile(twice)"
    )
    assert printed(use) == []


NEWER = "import numba; numba.__version__ = '9.0'; numba.version_info = numba.version_info._replace(short=(9, 0))\n"


A_DRAW = (
    "from cutenv._engine.jit import warn_before_first_compile; from cutenv._engine.randomness import normal_at\n"
    "warn_before_first_compile(normal_at)\n"
    "print([normal_at(3, 5, 1, k).hex() for k in range(50)])"
)
A_CUT = (
    "from cutenv._engine.jit import warn_before_first_compile\n"
    "from cutenv.sim.cutting.motion import STRAIGHT\n"
    "from cutenv.sim.cutting.simulate import follow\n"
    "from cutenv.sim.plant import SimulatedPlant\n"
    "from cutenv.sim.tissue import Specimen\n"
    "warn_before_first_compile(follow(STRAIGHT))\n"
    "for _ in range(2):\n"
    "    plant = SimulatedPlant(Specimen.drawn(3), seed=3)\n"
    "    for angle in (1.5, 0.9): seen = plant.advance(0.02, angle, 300)\n"
    "print(seen.tobytes().hex())"
)


@pytest.mark.parametrize("use", [A_DRAW, pytest.param(A_CUT, marks=pytest.mark.slow)], ids=["draw", "cut"])
def test_a_newer_numba_computes_the_same_numbers_with_one_line_that_tells_of_it(tmp_path, use):
    kept = kernel_folder("cutenv._engine.shortcuts") or tmp_path  # compiles for some seconds, once
    seen, told = [], []
    for program, environment in ((use, {}), (NEWER + use, {"NUMBA_CACHE_DIR": str(kept / "newer")})):
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, check=True, env=os.environ | environment
        )
        seen.append(done.stdout)
        told.append([line for line in done.stderr.splitlines() if "compiling what this needs" not in line])
    assert seen[0] == seen[1]
    assert told[0] == []
    (line,) = told[1]
    assert line.startswith("cutenv: Numba 9.0 is newer than")


def test_a_newer_numba_gets_none_of_the_shortcuts():
    """Nor options that its documentation does not name."""
    plain = (
        "from cutenv._engine.jit import njit, njit_inline, njit_internal, njit_nogil\n"
        "for door in (njit, njit_inline, njit_internal, njit_nogil):\n"
        "    kernel = door(lambda x: 2.0 * x)\n"
        "    assert kernel(1.0) == 2.0\n"
        "    assert 'compile' not in vars(kernel)\n"
        "    assert kernel._compiler.pipeline_class is numba.core.compiler.Compiler\n"
        "    assert not {'forceinline', 'no_cpython_wrapper', 'no_cfunc_wrapper'} & kernel.targetoptions.keys()\n"
    )
    assert printed(NEWER + plain) == []


def test_the_shortcuts_were_tested_with_the_numba_of_the_constraints():
    pins = (Path(__file__).parents[2] / "constraints.txt").read_text(encoding="utf-8")
    pinned = re.search(r"^numba==(\d+)\.(\d+)", pins, re.MULTILINE)
    assert pinned is not None
    assert tuple(map(int, pinned.groups())) == shortcuts.TESTED
