"""The long checks go on where they were stopped, and end with the date and the commit."""

from __future__ import annotations

import datetime
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from scripts import long_checks

ROOT = Path(__file__).parents[2]
state_of_source = long_checks.state_of_source

PASSES, FAILS = ["-c", "print('fine')"], ["-c", "raise SystemExit('a reason')"]


@pytest.fixture(autouse=True)
def source(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(long_checks, "state_of_source", lambda: "abc")


def test_what_has_passed_is_not_repeated_until_the_source_changes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    count = tmp_path / "count"
    checks = {"one": ["-c", f"open({str(count)!r}, 'a').write('x')"], "two": FAILS}
    assert long_checks.main([], checks, tmp_path) == 1
    said = capsys.readouterr().out
    assert "a reason" in said
    assert said.splitlines()[-1] == f"long checks: 1 failed, 1 passed; {datetime.date.today()}, commit abc"
    assert long_checks.main([], checks | {"two": PASSES}, tmp_path) == 0
    assert count.read_text() == "x"
    assert capsys.readouterr().out.splitlines()[-1].startswith("long checks: 2 passed; ")
    monkeypatch.setattr(long_checks, "state_of_source", lambda: "def")
    assert long_checks.main(["--only", "one"], checks, tmp_path) == 0
    assert count.read_text() == "xx"


@pytest.mark.skipif(os.name == "nt", reason="sends a POSIX signal")
def test_ctrl_c_ends_in_one_line_and_ends_what_was_started(tmp_path: Path) -> None:
    checks = {"one": PASSES, "two": ["-c", "import time; print('begun', flush=True); time.sleep(100)"]}
    code = (
        "import sys; from pathlib import Path; from scripts import long_checks; "
        f"sys.exit(long_checks.main([], {checks!r}, Path({str(tmp_path)!r})))"
    )
    command = [sys.executable, "-u", "-c", code]
    running = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert running.stdout is not None
    while not (tmp_path / "two.txt").exists() or "begun" not in (tmp_path / "two.txt").read_text():
        assert running.poll() is None
    running.send_signal(signal.SIGINT)
    out, error = (text.decode() for text in running.communicate(timeout=60))
    assert running.returncode == 130
    assert out.splitlines()[-1] == "[2/2] two ... stopped; the same command goes on (1 done)"
    assert error == ""
    assert list(json.loads((tmp_path / "done.json").read_text())["done"]) == ["one"]


def test_the_state_of_the_source_begins_with_its_commit() -> None:
    commit = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True).stdout.strip()
    assert re.match(r"[0-9a-f]{12}( changed [0-9a-f]{8})?$", state_of_source())
    assert commit.startswith(state_of_source()[:12])
