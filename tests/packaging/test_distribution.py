"""The wheel holds cutenv and its data alone, and works like the checkout; so does one that an sdist makes."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DATA = [
    ROOT / "assets" / folder
    for folder in ("browser", "courses", "derived", "firmware", "policies", "reference", "sensors", "tables")
]  # pictures are for the README
ASSETS = {path.relative_to(ROOT).as_posix() for folder in DATA for path in folder.rglob("*") if path.is_file()}
CODE = (".py", ".js", ".json", ".css", ".html", ".xml")
MODULES = {path.relative_to(ROOT).as_posix() for path in (ROOT / "cutenv").rglob("*") if path.suffix in CODE}

SITE = "cutenv/assets/site/"
HOOK = "scripts/kernels/wheel_hook.py"

READ_A_TABLE = """
import cutenv, cutenv._base.resources
table = cutenv._base.resources.path("tables/table_6_1.csv")
print(cutenv.__version__, cutenv.__file__, table, len(table.read_text()), sep="\\n")
"""


def run(*command: str | Path, cwd: Path) -> str:
    done = subprocess.run([sys.executable, *map(str, command)], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def only(folder: Path, pattern: str) -> Path:
    (found,) = folder.glob(pattern)
    return found


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a wheel from the checkout, without the network."""
    out = tmp_path_factory.mktemp("wheel")
    run("-m", "build", "--no-isolation", "--wheel", "--outdir", out, ROOT, cwd=out)
    return only(out, "*.whl")


@pytest.fixture(scope="module")
def site(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel beside this environment's packages."""
    folder = tmp_path_factory.mktemp("site")
    run("-m", "pip", "install", "--no-deps", "--no-index", "--quiet", "--target", folder, wheel, cwd=folder)
    return folder


def run_installed(site: Path, code: str, folder: Path) -> str:
    return run("-c", f"import sys; sys.path.insert(0, {str(site)!r})\n{code}", cwd=folder)


def check_holds_only_the_package(names: set[str]) -> None:
    built = ("cutenv-", SITE)  # and the documentation, where it is built
    package = {name for name in names if not name.startswith(built)}
    assert package == MODULES | {"cutenv/py.typed"} | {f"cutenv/{name}" for name in ASSETS}


def test_a_wheel_made_by_an_sdist_is_that_of_the_checkout_with_the_documentation_that_was_built(
    wheel: Path, tmp_path: Path
) -> None:
    checkout, out = tmp_path / "checkout", tmp_path / "out"
    for folder in ("cutenv", *(path.relative_to(ROOT) for path in DATA)):
        shutil.copytree(ROOT / folder, checkout / folder, ignore=shutil.ignore_patterns("__pycache__"))
    (checkout / "scripts" / "kernels").mkdir(parents=True)
    for file in ("pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", ".gitignore", HOOK):
        shutil.copy(ROOT / file, checkout / file)
    page = checkout / "assets" / "site" / "how-to" / "index.html"
    page.parent.mkdir(parents=True)
    page.write_text("<h1>How-to</h1>", encoding="utf-8")
    run("-m", "build", "--no-isolation", "--outdir", out, checkout, cwd=tmp_path)  # the wheel from the sdist
    with zipfile.ZipFile(only(out, "*.whl")) as archive:
        assert archive.read(f"{SITE}how-to/index.html") == b"<h1>How-to</h1>"
    made, expected = (contents(path) for path in (only(out, "*.whl"), wheel))
    assert made == expected


def contents(wheel: Path) -> dict[str, int]:
    """Checksums of all that a wheel holds but for the documentation, and the list of files, which has it."""
    with zipfile.ZipFile(wheel) as archive:
        entries = {entry.filename: entry.CRC for entry in archive.infolist()}
    return {name: crc for name, crc in entries.items() if not name.startswith(SITE) and not name.endswith("/RECORD")}


def test_wheel_holds_the_package_and_its_data_alone(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    check_holds_only_the_package(names)
    with pytest.raises(AssertionError):
        check_holds_only_the_package(names | {"tests/conftest.py"})
    with pytest.raises(AssertionError):
        check_holds_only_the_package(names - {"cutenv/assets/tables/table_6_1.csv"})


def test_wheel_reads_its_own_tables_from_anywhere(site: Path, tmp_path: Path) -> None:
    _, module, table, length = run_installed(site, READ_A_TABLE, tmp_path).split()
    assert Path(module) == site / "cutenv" / "__init__.py"
    assert Path(table) == site / "cutenv" / "assets" / "tables" / "table_6_1.csv"
    assert int(length) == len((ROOT / "assets" / "tables" / "table_6_1.csv").read_text())


TEN_LINES = """
from stable_baselines3 import PPO
from cutenv.agents.sb3 import FeatureVecEnv, NativeVecEnv
for kind in (NativeVecEnv, FeatureVecEnv):
    environments = kind(2, control_hz=50)
    model = PPO("MlpPolicy", environments, n_steps=4, batch_size=8, n_epochs=1, gamma=1.0, device="cpu")
    model.learn(8)
    print(kind.__name__, model.num_timesteps)
import cutenv.agents.learning.on_policy, cutenv.agents.policy
name = cutenv.agents.policy.SHIPPED[0]
print(name, cutenv.agents.policy.shipped(name).card.sha256)
print(cutenv.__file__)
"""


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_wheel_trains_with_stable_baselines3_and_loads_the_policies_that_it_ships(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compiled: bool
) -> None:
    """In plain Python, for a wheel has no kernels yet, and to compile them takes most of the time."""
    pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")
    if not compiled:
        monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    native, features, policy, module = run_installed(site, TEN_LINES, tmp_path).splitlines()
    assert (native, features) == ("NativeVecEnv 8", "FeatureVecEnv 8")
    name, digest = policy.split()
    shipped = ROOT / "assets" / "policies" / name / "policy.safetensors"
    assert hashlib.sha256(shipped.read_bytes()).hexdigest() == digest
    assert Path(module) == site / "cutenv" / "__init__.py"


def test_wheel_has_the_commands_of_training(site: Path, tmp_path: Path) -> None:
    code = """
import contextlib, cutenv.commands.cli
print(cutenv.__file__)
for command in ("train", "evaluate", "datasets"):
    with contextlib.suppress(SystemExit):
        cutenv.commands.cli.main([command, "--help"])
"""
    module, *shown = run_installed(site, code, tmp_path).splitlines()
    assert Path(module) == site / "cutenv" / "__init__.py"
    for command in ("train", "evaluate", "datasets"):
        assert any(line.startswith(f"usage: cutenv {command}") for line in shown)


def test_wheel_declares_version_licence_and_command(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = [name for name in archive.namelist() if ".dist-info/" in name]
        info = {Path(name).name: archive.read(name).decode() for name in names}
    version = run("-c", "import cutenv; print(cutenv.__version__)", cwd=ROOT).strip()
    assert f"\nVersion: {version}\n" in info["METADATA"]
    assert "\nLicense-Expression: MIT\n" in info["METADATA"]
    assert "cutenv = cutenv.commands.cli:main" in info["entry_points.txt"]
    assert "The cutenv developers" in info["LICENSE"]


def test_editable_install_reads_the_checkout(tmp_path: Path) -> None:
    _, module, table, _ = run("-c", READ_A_TABLE, cwd=ROOT).split()
    assert Path(module) == ROOT / "cutenv" / "__init__.py"
    assert Path(table) == ROOT / "assets" / "tables" / "table_6_1.csv"
