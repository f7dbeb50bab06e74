"""The habits that a program can check: lint, form, types and the direction of imports."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPTS = Path(sys.executable).parent


def check(*command: str, cwd: Path = ROOT) -> None:
    """Run one of the environment's programs; what it says is the failure's message."""
    done = subprocess.run([str(SCRIPTS / command[0]), *command[1:]], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout[-40000:]}{done.stderr[-2000:]}"


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Copy the package and its configuration to where a habit can be broken."""
    shutil.copytree(ROOT / "cutenv", tmp_path / "cutenv", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def test_lint_is_clean() -> None:
    check("ruff", "check", "--no-cache", ".")


def test_form_is_that_of_ruff_format() -> None:
    check("ruff", "format", "--check", "--no-cache", ".")


def test_types_are_strict_and_hold() -> None:
    """Types hold in the strict mode of mypy, whose cache in the environment serves the next checkout."""
    check("mypy", "--cache-dir", str(Path(sys.prefix) / "mypy-cache"))


def test_layers_import_downwards() -> None:
    check("lint-imports", "--no-cache")


BROKEN = [
    ("_base/validation", "import cutenv.sim.tissue.tables", "a layer imports downwards only"),
    ("sim/tissue/elasticity", "import gymnasium", "gymnasium is imported by environments and learners alone"),
    ("_base/validation", "import torch", "learning libraries are imported by"),
    ("commands/train", "import stable_baselines3", "learning libraries are imported by"),
    ("envs/vector", "import cutenv.agents.sb3", "a layer imports downwards only"),
    ("people/play/hand_model", "import pymunk", "the drawn handle alone is moved by pymunk"),
    ("_base/validation", "import matplotlib.pyplot", "drawing is done by the viewer and the report"),
    ("records/measurement/simulating", "import cutenv.sim.cutting.law", "records are measured and scored without"),
    ("records/scoring/card_reader", "import cutenv._engine.jit", "the compiled engine is private"),
    ("sim/trace", "import cutenv.sim.tissue.tables", "inside the simulator imports go one way"),
    ("rig/config/settings", "import cutenv.rig.plant", "inside the rig imports go one way"),
]


def test_every_broken_layer_is_noticed(copy: Path) -> None:
    """All of them at once, for to read every import takes seconds: each is named, and its contract is broken."""
    for module, line, _ in BROKEN:
        path = copy / "cutenv" / f"{module}.py"
        path.write_text(f"{path.read_text() if path.exists() else ''}\n{line}\n")
    with pytest.raises(AssertionError) as broken:
        check("lint-imports", "--no-cache", cwd=copy)
    told = str(broken.value)
    for module, line, contract in BROKEN:
        assert re.search(rf"{contract}.* BROKEN", told), contract
        name, imported = f"cutenv.{module.replace('/', '.')}", line.split()[1]
        assert re.search(rf"{name} ->\s+{imported.removesuffix('.pyplot')}\b", told), line


def test_a_module_outside_the_layers_is_noticed(copy: Path) -> None:
    (copy / "cutenv" / "utils.py").write_text("import math\n")
    with pytest.raises(AssertionError, match="not listed as layers"):
        check("lint-imports", "--no-cache", cwd=copy)


def test_an_untyped_function_is_noticed(tmp_path: Path) -> None:
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "untyped.py").write_text("def double(x):\n    return 2 * x\n")
    with pytest.raises(AssertionError, match="Function is missing a type annotation"):
        check("mypy", "untyped.py", cwd=tmp_path)
