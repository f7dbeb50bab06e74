"""A wheel's library of kernels: built, linked for every system, and used without Numba, to the same bits."""

from __future__ import annotations

import platform
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest

from scripts import build_kernels

ROOT = Path(__file__).parents[2]
SYSTEMS = {
    ("x86_64", "linux"): "x86_64-linux", ("aarch64", "linux"): "aarch64-linux", ("arm64", "darwin"): "arm64-macos",
    ("AMD64", "win32"): "x86_64-windows",
}  # fmt: skip
HERE = SYSTEMS[platform.machine(), sys.platform]
MAGIC = {
    "x86_64-linux": b"\x7fELF\x02", "aarch64-linux": b"\x7fELF\x02", "arm64-macos": b"\xcf\xfa\xed\xfe",
    "x86_64-windows": b"MZ",
}  # fmt: skip
USES = """
import numpy as np
from cutenv._engine.randomness import normal_at
from cutenv._engine.parallel import make_queue, wait_done
from cutenv.sim.cutting.drive import lag_gain
from cutenv.sim.cutting.dtypes import DRIVE
from cutenv.sim.cutting.motion import STRAIGHT
from cutenv.sim.cutting.simulate import account_one
from cutenv.sim.tissue.specimen_kernels import add_vessels, is_vascular, lognormal


def results():
    '''Numbers, tuples, arrays, a record; a kernel that releases the lock, one that returns a named tuple.'''
    keys = [(np.uint64(seed), np.uint64(2)) for seed in range(50)]
    resistance, drive, cut = np.ones(301), np.zeros(1, DRIVE), np.zeros(1, STRAIGHT.cut)
    for key in keys:
        add_vessels(key, resistance)
    normal = [normal_at(*key, np.uint64(3), k) for k, key in enumerate(keys)]
    drive["lag"], cut["states"]["work"] = 0.05, 0.25
    numbers = lognormal(0.3, 0.1), lag_gain(drive[0], 0.001), wait_done(make_queue(0), 3), wait_done(make_queue(9), 3)
    return [is_vascular(*key) for key in keys], resistance.tolist(), normal, numbers, account_one(STRAIGHT)(cut)
"""


def built(folder: Path, *systems: str) -> Path:
    """Build libraries with the kernels that a small program calls."""
    (folder / "some_uses.py").write_text(USES, encoding="utf-8")
    command = [sys.executable, ROOT / "scripts" / "build_kernels.py", "--out", folder, "--part", "some_uses:results"]
    wanted = [f"--target={system}" for system in systems]
    done = subprocess.run([*command, *wanted], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("kernels"), HERE)


def run_with(libraries: Path, program: str, *, digest: str = "library.digest") -> str:
    """Run a program that finds the library as that of its package, and no Numba."""
    file = libraries / HERE / build_kernels.TARGETS[HERE].file
    before = f"""
        import sys
        from importlib.machinery import ExtensionFileLoader
        from importlib.util import module_from_spec, spec_from_loader

        loader = ExtensionFileLoader("_kernels", {str(file)!r})
        library = module_from_spec(spec_from_loader("_kernels", loader))
        library.digest = {digest}
        sys.modules["cutenv._engine._kernels"] = library
        sys.modules["numba"] = None
        sys.path.insert(0, {str(libraries)!r})
    """
    command = [sys.executable, "-c", textwrap.dedent(before) + textwrap.dedent(program)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    return done.stdout + done.stderr


@pytest.mark.slow
def test_every_system_has_its_library(tmp_path: Path) -> None:
    """The linker finds every symbol; none but that of this system can be loaded here."""
    built(tmp_path)
    for name, target in build_kernels.TARGETS.items():
        assert (tmp_path / name / target.file).read_bytes().startswith(MAGIC[name]), name


def test_without_numba_it_computes_the_same_bits(libraries: Path) -> None:
    compiled: dict[str, Any] = {}
    exec(USES, compiled)
    expected = str(compiled["results"]())
    assert "EnergyAccount(work=0.25" in expected
    assert run_with(libraries, "import some_uses; print(some_uses.results())").strip() == expected


def test_what_it_lacks_names_the_extra_with_the_compiler(libraries: Path) -> None:
    printed = run_with(libraries, "from cutenv.task.beginning import drawn_length; drawn_length(1, 2)")
    assert printed.strip().endswith("numba is not installed: pip install 'cutenv[compile]'")


def test_a_call_with_other_types_is_no_call_of_it(libraries: Path) -> None:
    """Read-only arrays, other dtypes and layouts: the library must not write where it may not."""
    program = """
        import numpy as np
        from cutenv.sim.tissue.specimen_kernels import add_vessels
        key, fixed = (np.uint64(1), np.uint64(2)), np.ones(301)
        fixed.flags.writeable = False
        for wrong in (fixed, np.ones(301, np.float32), np.ones(602)[::2], np.ones((301, 1)), [1.0] * 301):
            try:
                add_vessels(key, wrong)
            except ModuleNotFoundError:
                print("compiles")
        print(fixed.sum())
    """
    assert run_with(libraries, program).split() == ["compiles"] * 5 + ["301.0"]


def test_of_another_source_it_is_not_used(libraries: Path) -> None:
    """Its source is that of declarations, and of the modules that make kernels of them."""
    printed = run_with(libraries, "import cutenv._engine.native as n; print(n.LIBRARY)", digest="'another'")
    assert printed.strip() == "None"
    sources = run_with(libraries, "print(*library.sources)").split()
    assert {"sim/cutting/motion.py", "sim/cutting/simulate.py", "sim/tissue/specimen_kernels.py"} <= set(sources)
