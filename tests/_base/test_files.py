"""Files: replaced whole or not at all, and found where the package has them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cutenv._base import resources
from cutenv._base.output import atomic_write


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
from cutenv._base.output import atomic_write
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


@pytest.fixture
def installation(tmp_path, monkeypatch):
    """An empty place with a package folder; tests add the data."""
    package = tmp_path / "site" / "cutenv"
    package.mkdir(parents=True)
    monkeypatch.setattr(resources, "_PACKAGED", package / "assets")
    monkeypatch.setattr(resources, "_CHECKOUT", package.parent / "assets")
    return package


def put(folder: Path, text: str) -> None:
    folder.mkdir(parents=True)
    (folder / "table.csv").write_text(text, encoding="utf-8")


def test_finds_the_tables_and_their_folder_as_an_absolute_path():
    found = resources.path("tables/table_5_6.csv")
    assert found.is_absolute()
    assert found.is_file()
    assert resources.path("tables").is_dir()


def test_finds_the_data_beside_the_package_in_a_checkout(installation):
    put(installation.parent / "assets", "checkout")
    assert resources.path("table.csv").read_text(encoding="utf-8") == "checkout"


def test_an_installed_package_never_reads_a_folder_that_happens_to_lie_beside_it(installation):
    put(installation / "assets", "ours")
    put(installation.parent / "assets", "somebody else's")
    (installation.parent / "assets" / "theirs.csv").touch()
    assert resources.path("table.csv").read_text(encoding="utf-8") == "ours"
    with pytest.raises(FileNotFoundError, match=r"theirs\.csv"):
        resources.path("theirs.csv")


def test_missing_data_name_both_places_and_the_cure(installation):
    with pytest.raises(FileNotFoundError, match="Reinstall") as refusal:
        resources.path("table.csv")
    assert str(installation / "assets") in str(refusal.value)
    assert str(installation.parent / "assets") in str(refusal.value)


def test_a_missing_file_names_what_was_looked_for_and_the_cure():
    with pytest.raises(FileNotFoundError, match=r"'tables/table_9_9\.csv': looked for .*table_9_9\.csv.*reinstall"):
        resources.path("tables/table_9_9.csv")


@pytest.mark.parametrize("name", ["../pyproject.toml", "tables/../../cutenv/__init__.py", "/etc/hostname", "", "."])
def test_names_that_leave_the_folder_are_refused(name):
    with pytest.raises(ValueError, match="must name something inside"):
        resources.path(name)


def test_a_link_out_of_the_folder_is_refused(installation):
    put(installation / "assets", "ours")
    (installation / "secret").touch()
    (installation / "assets" / "link").symlink_to(installation / "secret")
    with pytest.raises(ValueError, match="must name something inside"):
        resources.path("link")


@pytest.mark.parametrize("name", [None, 5.6, Path("tables")])
def test_only_strings_are_names(name):
    with pytest.raises(TypeError, match="must be a string"):
        resources.path(name)
