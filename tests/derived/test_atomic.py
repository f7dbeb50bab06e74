"""A file that is replaced is the old one or the new one, whatever happens while it is written."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cutenv._base.atomic_file import atomic_write


def test_the_new_content_takes_the_old_one_s_place(tmp_path):
    target = tmp_path / "cut.csv"
    target.write_text("old")
    with atomic_write(target) as part:
        part.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


def test_the_unfinished_file_stands_beside_it_with_the_same_suffix(tmp_path):
    with atomic_write(tmp_path / "cut.h5") as part:
        part.write_text("new")
        assert (part.parent, part.suffix) == (tmp_path, ".h5")
        assert ".part" in part.suffixes


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
@pytest.mark.parametrize("existed", [True, False])
def test_an_error_in_mid_write_leaves_what_was_there_and_nothing_else(tmp_path, error, existed):
    target = tmp_path / "cut.csv"
    if existed:
        target.write_text("old")

    def write_half() -> None:
        with atomic_write(target) as part:
            part.write_text("half of the n")
            raise error

    with pytest.raises(error):
        write_half()
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == ({"cut.csv": "old"} if existed else {})


@pytest.mark.skipif(os.name == "nt", reason="a process kills itself by a signal")
def test_a_process_killed_in_mid_write_leaves_what_was_there(tmp_path):
    target = tmp_path / "cut.csv"
    target.write_text("old")
    code = f"""
import os, signal
from cutenv._base.atomic_file import atomic_write
with atomic_write({str(target)!r}) as part:
    with part.open("w") as file:
        file.write("half of the n")
        file.flush()
        os.kill(os.getpid(), signal.SIGKILL)
"""
    done = subprocess.run([sys.executable, "-c", code], check=False)
    assert done.returncode == -signal.SIGKILL
    assert target.read_text() == "old"
    (left,) = set(tmp_path.iterdir()) - {target}
    assert ".part" in left.name


def test_two_writers_do_not_mix(tmp_path):
    target = tmp_path / "cut.csv"
    with atomic_write(target) as first:
        first.write_text("first")
        with atomic_write(target) as second:
            second.write_text("second")
        assert target.read_text() == "second"
    assert target.read_text() == "first"


def test_a_link_stays_and_what_it_points_to_is_replaced(tmp_path):
    (tmp_path / "kept").mkdir()
    target, link = tmp_path / "kept" / "cut.csv", tmp_path / "latest.csv"
    target.write_text("old")
    link.symlink_to(target)
    with atomic_write(link) as part:
        part.write_text("new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_a_file_has_the_rights_that_any_new_file_has(tmp_path):
    (tmp_path / "plain.csv").write_text("")
    with atomic_write(tmp_path / "cut.csv") as part:
        part.write_text("")
    assert (tmp_path / "cut.csv").stat().st_mode == (tmp_path / "plain.csv").stat().st_mode


def test_a_long_name_has_room(tmp_path):
    target = tmp_path / f"{'c' * 250}.csv"
    with atomic_write(target) as part:
        part.write_text("new")
    assert target.read_text() == "new"


def test_a_missing_folder_is_named(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match="nowhere"), atomic_write(tmp_path / "nowhere" / "cut.csv") as part:
        part.write_text("new")
