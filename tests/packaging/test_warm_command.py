"""``cutenv warm`` compiles ahead what the first cut would compile, and says where nothing can be kept."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cutenv._engine import jit
from cutenv.commands import cli, warm


def test_a_part_is_compiled_in_a_process_of_its_own(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran: list[list[str]] = []

    def run(command: list[str], **options: object) -> subprocess.CompletedProcess[str]:
        ran.append(command)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(warm.subprocess, "run", run)
    assert cli.main(["warm", "--task", "depth", "--task", "gentle"]) == 0
    assert sorted(command[-1].rpartition("(")[2] for command in ran) == ["'depth')", "'gentle')"]
    assert "ready after" in capsys.readouterr().out


def test_a_part_that_fails_is_named_with_its_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failed = subprocess.CompletedProcess([], 1, "", "Traceback\nMemoryError: no memory")
    monkeypatch.setattr(warm.subprocess, "run", lambda *command, **options: failed)
    assert cli.main(["warm", "--task", "gentle"]) == 1
    assert "cutenv warm: gentle: MemoryError: no memory" in capsys.readouterr().err


def test_after_ctrl_c_no_further_part_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[str] = []

    def run(command: list[str], **options: object) -> subprocess.CompletedProcess[str]:
        ran.append(command[-1])
        if len(ran) == 1:
            raise KeyboardInterrupt
        time.sleep(0.5)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(warm.subprocess, "run", run)
    monkeypatch.setattr(warm.os, "cpu_count", lambda: 1)
    assert cli.main(["warm"]) == 130
    assert len(ran) <= 2 < len(warm.parts())  # one may have begun in the meantime


def test_where_nothing_can_be_kept_nothing_is_compiled(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(jit, "kernel_folder", lambda module: None)
    assert cli.main(["warm"]) == 1
    assert "NUMBA_CACHE_DIR" in capsys.readouterr().err


def test_what_was_compiled_can_be_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "given"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    package = tmp_path / "cutenv"
    kept = [tmp_path / "given" / "cutenv", package / "__pycache__", tmp_path / "cache" / "cutenv"]
    for place in kept:
        (place / "kernels-cutenv.law-0123").mkdir(parents=True)
    (package / "__pycache__" / "cli.pyc").touch()
    assert jit.remove_kernels(package) == kept
    assert not list(tmp_path.rglob("kernels-*"))
    assert [place.exists() for place in kept] == [False, True, False]  # Python's own files are pip's
    assert jit.remove_kernels(package) == []


@pytest.mark.slow
@pytest.mark.parametrize("task", warm.TASKS)
def test_after_it_nothing_is_left_to_compile(task: str, tmp_path: Path) -> None:
    """Single cuts and batches; the first use would print a line, and leave further files."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    assert subprocess.run([sys.executable, "-m", "cutenv", "warm", "--task", task], env=environment).returncode == 0
    kept = sorted(tmp_path.rglob("*.nbc"))
    use = f"from cutenv.commands.warm import compile_part; compile_part({task!r})"
    done = subprocess.run([sys.executable, "-c", use], env=environment, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert sorted(tmp_path.rglob("*.nbc")) == kept
