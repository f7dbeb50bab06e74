"""Where data files are found, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from cutenv._base import resources


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


def test_finds_the_tables_as_an_absolute_path():
    found = resources.path("tables/table_5_6.csv")
    assert found.is_absolute()
    assert found.is_file()


def test_finds_a_folder():
    assert resources.path("tables").is_dir()


def test_finds_the_data_inside_an_installed_package(installation):
    put(installation / "assets", "installed")
    assert resources.path("table.csv").read_text(encoding="utf-8") == "installed"


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
