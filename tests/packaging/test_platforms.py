"""The package can be imported, and the simulator runs, where Python lacks what only POSIX systems have."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cutenv.emulation import process
from cutenv.rig.errors import RigError

ROOT = Path(__file__).parents[2]
PORTABLE = ROOT / "tests" / "portable.txt"
POSIX_MODULES = ("curses", "fcntl", "grp", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty")
POSIX_NAMES = {
    "os": (
        "fork", "getuid", "geteuid", "killpg", "mkfifo", "nice", "sched_getaffinity", "sched_getparam",
        "sched_getscheduler", "sched_param", "sched_setaffinity", "sched_setscheduler", "setsid", "SCHED_RR",
    ),
    "signal": (
        "SIGALRM", "SIGCHLD", "SIGCONT", "SIGHUP", "SIGKILL", "SIGPIPE", "SIGQUIT", "SIGSTOP", "SIGUSR1", "alarm",
        "pthread_kill", "setitimer",
    ),
}  # fmt: skip
WITHOUT_POSIX = f"""
import os, signal, sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name in {POSIX_MODULES!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())
for name in {POSIX_MODULES!r}:
    sys.modules.pop(name, None)
for module, names in {POSIX_NAMES!r}.items():
    for name in names:
        if hasattr(sys.modules[module], name):
            delattr(sys.modules[module], name)
"""
IMPORT_ALL = """
import importlib, pkgutil
import cutenv
from cutenv._base.imports import EXTRAS_OF_MODULE
modules = [module.name for module in pkgutil.walk_packages(cutenv.__path__, "cutenv.")]
for name in modules:
    if name != "cutenv.__main__":
        try:
            importlib.import_module(name)
        except ModuleNotFoundError as error:  # of an extra that is not installed here
            if error.name.partition(".")[0] not in EXTRAS_OF_MODULE:
                raise
print(len(modules))
"""
STEP = """
import gymnasium
import cutenv
env = gymnasium.make("cutenv/GentleCut-v1")
env.reset(seed=1)
print(env.step(env.action_space.sample())[1] <= 1.0)
env.close()
"""


def run_without_posix(code: str) -> str:
    command = [sys.executable, "-c", WITHOUT_POSIX + code]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_module_of_the_package_can_be_imported_and_the_simulator_makes_a_step() -> None:
    count, stepped = run_without_posix(IMPORT_ALL + STEP).split()
    assert int(count) > 100
    assert stepped == "True"


@pytest.mark.parametrize(
    "code", ["import fcntl", "import signal; signal.SIGKILL", "import os; os.sched_getaffinity(0)"]
)
def test_what_only_posix_has_is_missing_there(code: str) -> None:
    with pytest.raises(AssertionError, match=r"(fcntl|SIGKILL|sched_getaffinity)"):
        run_without_posix(code)


def files_without_encoding(*folders: Path) -> list[str]:
    """Places that open a text file in the system's encoding, which is not UTF-8 on Windows."""
    command = [sys.executable, "-m", "ruff", "check", "--isolated", "--no-cache", "--preview", "--select", "PLW1514"]
    done = subprocess.run(
        [*command, "--output-format", "concise", *folders], capture_output=True, text=True, check=False
    )
    assert done.returncode in (0, 1), done.stderr
    return [line for line in done.stdout.splitlines() if "PLW1514" in line or "unspecified-encoding" in line]


def test_text_files_name_their_encoding() -> None:
    assert files_without_encoding(*(ROOT / name for name in ("cutenv", "agents", "scripts"))) == []


def test_a_text_file_without_encoding_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "reading.py").write_text("from pathlib import Path\nprint(Path('a').read_text())\n")
    assert len(files_without_encoding(tmp_path)) == 1


def portable_arguments() -> tuple[list[str], list[str]]:
    """Paths that the list runs, and those that it leaves out."""
    lines = PORTABLE.read_text(encoding="utf-8").splitlines()
    left_out = [line.partition("=")[2].partition("::")[0] for line in lines if line.startswith("--")]
    return [line for line in lines if not line.startswith("--")], left_out


def posix_uses(tree: ast.Module) -> set[str]:
    """Names in a module that only POSIX has."""
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    used = {
        f"{node.value.id}.{node.attr}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
    }
    names = {f"{module}.{name}" for module, names in POSIX_NAMES.items() for name in names}
    return imported & set(POSIX_MODULES) | used & names


def test_the_portable_list_names_what_exists() -> None:
    run, left_out = portable_arguments()
    assert [name for name in run + left_out if not (ROOT / name).exists()] == []


def test_portable_tests_use_nothing_of_posix_alone() -> None:
    run, left_out = portable_arguments()
    files = [file for name in run for file in ([ROOT / name] if name.endswith(".py") else (ROOT / name).glob("*.py"))]
    assert len(files) > 50
    for file in files:
        text = file.read_text(encoding="utf-8")
        if posix_uses(ast.parse(text)) and 'skipif(os.name == "nt"' not in text:
            assert file.relative_to(ROOT).as_posix() in left_out


def test_uses_of_posix_are_noticed() -> None:
    code = "import os, resource, signal\nos.fork()\nsignal.SIGKILL\nos.getpid()\n"
    assert posix_uses(ast.parse(code)) == {"resource", "os.fork", "signal.SIGKILL"}


def test_the_emulated_rig_is_refused_on_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as windows:
        windows.setattr(os, "name", "nt")
        try:
            process.start()
        except RigError as error:
            refusal = str(error)
    assert "Linux and macOS" in refusal
    assert 'rig="fake"' in refusal
