"""Ctrl-C ends an evaluation with its workers at once, in one line."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from program import command

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no process group to press Ctrl-C for")


@pytest.mark.parametrize("shown", [r" 0/", r" [1-9]\d*/"], ids=["workers import", "workers cut"])
def test_ctrl_c_ends_an_evaluation_and_its_workers_in_one_line(shown: str, tmp_path: Path) -> None:
    line = [*command("evaluate"), "probe and creep", "--specimens", "5000", "--processes", "2"]
    process = subprocess.Popen(
        line, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stderr is not None
    printed, deadline = "", time.monotonic() + 240.0
    try:
        while not re.search(shown, printed) and process.poll() is None and time.monotonic() < deadline:
            printed += process.stderr.read(1)
        time.sleep(1.0)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to all of them, once
        printed += process.communicate(timeout=20)[1]
        assert process.returncode == 130, printed
        assert "Traceback" not in printed
        assert printed.rstrip().splitlines()[-1] == "cutenv evaluate: interrupted; nothing was written"
        end = time.monotonic() + 5.0
        while _alive(process.pid) and time.monotonic() < end:
            time.sleep(0.1)
        assert not _alive(process.pid)
    finally:
        if _alive(process.pid):
            os.killpg(process.pid, signal.SIGKILL)


def _alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True
