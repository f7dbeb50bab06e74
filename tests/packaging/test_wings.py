"""The shape of the package: few wings, few loose modules, no import cycle, and a rig that loads only when asked for."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import cutenv
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.toml_file import to_toml
from scripts.documentation import measure_codebase

ROOT = Path(__file__).parents[2]


REAL = ("cutenv.rig.devices.canopen.axis", "cutenv.rig.devices.netft_sensor")


def run(code: str) -> list[str]:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def loaded_after(statements: str) -> set[str]:
    """Modules of the package that a fresh process has loaded after some statements."""
    return set(run(f"import sys\n{statements}\nprint(*(name for name in sys.modules if name.startswith('cutenv')))"))


FAKES = {"cutenv.emulation.fake_benches", "cutenv.emulation.fake_rig"}
ANY_RIG = {"cutenv.emulation", "cutenv.emulation.tissue_in_plane"}
"""Modules of the emulation that are no part of the emulator, besides the fakes."""


def imitations(loaded: set[str]) -> set[str]:
    """Modules of the fakes and of the emulator."""
    return {name for name in loaded if name.startswith("cutenv.emulation")} - ANY_RIG


def modules_of_the_rig(loaded: set[str]) -> set[str]:
    return {name for name in loaded if name == "cutenv.rig" or name.startswith("cutenv.rig.")}


def layers() -> list[list[str]]:
    """Rows of the contract from above to below, each with the packages that it names."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (rows,) = (
        each["layers"] for each in settings["tool"]["importlinter"]["contracts"] if each["name"].startswith("a layer")
    )
    return [re.findall(r"\w+", row) for row in rows]


def test_the_first_level_of_the_package_is_the_layers_of_the_contract() -> None:
    """Eleven layers of packages that anybody imports; helpers and engine below them are private."""
    assert sum(not row[0].startswith("_") for row in layers()) == 11
    names = {name for row in layers() for name in row}
    assert names == {path.parent.name for path in (ROOT / "cutenv").glob("*/__init__.py")}
    assert sorted(cutenv.WINGS) == sorted(name for name in names if not name.startswith("_"))
    assert {path.stem for path in (ROOT / "cutenv").glob("*.py")} == {"__init__", "__main__"}


@pytest.mark.parametrize("wing", cutenv.WINGS)
def test_a_wing_says_what_it_may_import_and_has_its_packages_as_attributes(wing: str) -> None:
    rows = layers()
    (place,) = (number for number, row in enumerate(rows) if wing in row)
    below = [name for row in rows[place + 1 :] for name in row if not name.startswith("_")]
    (said,) = re.findall(r"May import: ([^.]*)\.", getattr(cutenv, wing).__doc__)
    assert set(re.findall(r"\w+", said)) == set(below) or (wing == "sim" and said.startswith("nothing"))
    for path in (ROOT / "cutenv" / wing).glob("*/__init__.py"):
        if wing not in ("commands", "task", "vision"):
            assert getattr(getattr(cutenv, wing), path.parent.name).__name__ == f"cutenv.{wing}.{path.parent.name}"


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert measure_codebase.import_cycles(ROOT, *measure_codebase.CODE) == []


def test_the_simulator_loads_no_module_of_the_rig() -> None:
    loaded = loaded_after(
        "import gymnasium, cutenv\n"
        "for make in (gymnasium.make, gymnasium.make_vec): make('cutenv/GentleCut-v1').reset(seed=0)"
    )
    assert "cutenv.envs.gentle_cut" in loaded
    assert modules_of_the_rig(loaded) == set()


def test_identified_constants_are_read_when_they_are_asked_for() -> None:
    loaded = loaded_after(
        "import cutenv.envs.constants as constants\n"
        "try:\n    constants.rig_constants('missing.toml')\nexcept FileNotFoundError:\n    pass"
    )
    assert "cutenv.rig.toml_file" in loaded


def test_a_fake_rig_loads_neither_drivers_nor_emulator() -> None:
    loaded = loaded_after("import gymnasium, cutenv\ngymnasium.make('cutenv/RigCut-v1', rig='fake').reset(seed=0)")
    assert not loaded & set(REAL)
    assert imitations(loaded) == FAKES


def test_a_real_rig_loads_neither_fake_nor_emulator(tmp_path: Path) -> None:
    settings = RigSettings(
        name="a rig", armed_by="nobody", angle_mode="fixed", depth_profile=((0.0, 0.02), (0.15, 0.02))
    )
    path = tmp_path / "rig.toml"
    path.write_text(to_toml(settings), encoding="utf-8")
    loaded = loaded_after(f"import gymnasium, cutenv\ngymnasium.make('cutenv/RigCut-v1', rig={str(path)!r})")
    assert "cutenv.rig.plant" in loaded
    assert imitations(loaded) == set()


def test_an_emulated_rig_loads_no_fake() -> None:
    loaded = loaded_after(
        "import cutenv.emulation.process, cutenv.rig.plant\n"
        "from cutenv.rig.devices.loop import SystemClock\nfrom cutenv.rig.spine import mounted_spine\n"
        "from cutenv.rig.config.settings import RigSettings\nmounted_spine(RigSettings(), SystemClock())"
    )
    assert set(REAL) <= loaded
    assert "cutenv.emulation.process" in loaded
    assert not loaded & FAKES


def test_the_spine_loads_no_plant_no_compiler_and_no_policy() -> None:
    """The rig and its configuration alone have to be believed where a blade moves."""
    loaded = set(run(
        "import sys\nfrom cutenv.rig.spine_process import serve_spine\nfrom cutenv.rig.spine import mounted_spine\n"
        "from cutenv.rig.devices.loop import SystemClock\nfrom cutenv.rig.config.settings import RigSettings\n"
        "mounted_spine(RigSettings(), SystemClock())\nprint(*sys.modules)"
    ))  # fmt: skip
    assert set(REAL) <= loaded
    assert not {"numba", "llvmlite", "torch", "cutenv.rig.plant"} & loaded
    unwanted = tuple(f"cutenv.{each}" for each in ("agents", "envs", "sim.plant", "drivers", "emulation"))
    assert [name for name in loaded if name.startswith(unwanted)] == []


def test_dir_shows_what_a_user_can_import() -> None:
    shown = dir(cutenv)
    assert {"__version__", "make", "agents", "envs", "records", "rig", "sim", "task"} <= set(shown)
    for name in shown:
        assert getattr(cutenv, name) is not None
    with pytest.raises(AttributeError, match=r"it has .*agents"):
        _ = cutenv.polices
