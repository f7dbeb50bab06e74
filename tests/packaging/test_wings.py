"""The shape of the package: few wings, few loose modules, no import cycle, and a rig that loads only when asked for."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from scripts.documentation import measure_codebase

ROOT = Path(__file__).parents[2]


REAL = ("cutenv.rig.hardware", "cutenv.rig.devices.canopen.axis", "cutenv.rig.devices.netft_sensor")

WRITE_A_RIG = """
import pathlib, tempfile
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.toml_file import to_toml
path = pathlib.Path(tempfile.mkdtemp()) / "rig.toml"
depth = ((0.0, 0.02), (0.15, 0.02))
path.write_text(to_toml(RigSettings(name="a rig", armed_by="nobody", angle_mode="fixed", depth_profile=depth)))
print(path)
"""


def run(code: str) -> list[str]:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def loaded_after(statements: str) -> set[str]:
    """Modules of the package that a fresh process has loaded after some statements."""
    return set(run(f"import sys\n{statements}\nprint(*(name for name in sys.modules if name.startswith('cutenv')))"))


def modules_of_the_rig(loaded: set[str]) -> set[str]:
    return {name for name in loaded if name == "cutenv.rig" or name.startswith("cutenv.rig.")}


def test_the_contract_has_seven_to_nine_wings() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (wings,) = (
        each["layers"] for each in settings["tool"]["importlinter"]["contracts"] if each["name"].startswith("a layer")
    )
    assert 7 <= len(wings) <= 9


def test_few_modules_lie_loose() -> None:
    loose = {path.stem for path in (ROOT / "cutenv").glob("*.py")} - {"__init__", "__main__"}
    assert len(loose) <= 4, loose


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert measure_codebase.import_cycles(ROOT, *measure_codebase.CODE) == []


@pytest.mark.parametrize("make", ["make", "make_vec"])
def test_the_simulator_loads_no_module_of_the_rig(make: str) -> None:
    loaded = loaded_after(f"import gymnasium, cutenv\ngymnasium.{make}('cutenv/GentleCut-v1').reset(seed=0)")
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
    assert "cutenv.imitated.fake_rig" in loaded
    assert not loaded & set(REAL)
    assert not any(name.startswith("cutenv.imitated.emulator") for name in loaded)


def test_a_real_rig_loads_neither_fake_nor_emulator() -> None:
    (path,) = run(WRITE_A_RIG)
    loaded = loaded_after(f"import gymnasium, cutenv\ngymnasium.make('cutenv/RigCut-v1', rig={path!r})")
    assert "cutenv.rig.plant" in loaded
    assert not any(name.startswith(("cutenv.imitated.fake", "cutenv.imitated.emulator")) for name in loaded)


def test_an_emulated_rig_loads_no_fake() -> None:
    loaded = loaded_after(
        "import cutenv.imitated.emulator.process, cutenv.imitated.connection, cutenv.rig.hardware\n"
        "from cutenv.rig.devices.host import SystemClock\nfrom cutenv.rig.spine import mounted_spine\n"
        "from cutenv.rig.config.settings import RigSettings\nmounted_spine(RigSettings(), SystemClock())"
    )
    assert set(REAL) <= loaded
    assert not any(name.startswith("cutenv.imitated.fake") for name in loaded)


def test_dir_shows_what_a_user_can_import() -> None:
    import cutenv

    shown = dir(cutenv)
    assert {"__version__", "make", "envs", "policy", "tissue", "scoring", "rig", "trace"} <= set(shown)
    for name in shown:
        assert getattr(cutenv, name) is not None
    with pytest.raises(AttributeError, match=r"it has .*policy"):
        _ = cutenv.polices
