"""``cutenv view``: from a record to a page, and every refusal says what to give."""

from __future__ import annotations

import dataclasses
import webbrowser
from pathlib import Path

import numpy as np
import pytest
from recorded_cut import recorded_cut
from view_pages import told

pytest.importorskip("meshcat", reason="the 3-D viewer is an extra: pip install 'cutenv[view3d]'")
pytest.importorskip("tqdm", reason="an extra: pip install 'cutenv[data]'")

from cutenv.commands import cli
from cutenv.records import save
from cutenv.sim.trace import Trace


def trace(**metadata: object) -> Trace:
    every_tenth = recorded_cut("liver", turns=(0.06,)).trace.select(slice(None, None, 10))
    return dataclasses.replace(every_tenth, metadata=metadata)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(webbrowser, "open", lambda address: pytest.fail(f"opened {address}"))
    return tmp_path


def test_a_record_becomes_a_page_and_its_path_is_printed(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save([trace()], here / "my cut.csv")
    assert cli.main(["view", "my cut.csv"]) == 0
    assert capsys.readouterr().out.startswith("page: my_cut_view.html (")
    assert "my cut in 3-D" in (here / "my_cut_view.html").read_text(encoding="utf-8")


def test_options_arrive(here: Path) -> None:
    save([trace(name="first"), trace(name="second", target_length_m=0.05)], here / "two.csv")
    assert cli.main(["view", "two.csv", "--cut", "2", "--colour", "energy", "--out", "page.html"]) == 0
    page = (here / "page.html").read_text(encoding="utf-8")
    assert "second in 3-D" in page
    assert "strain energy density" in page
    assert told(page)["target_m"] == 0.05
    assert cli.main(["view", "two.csv", "--cut", "2", "--target-length", "62mm", "--out", "page.html"]) == 0
    assert told((here / "page.html").read_text(encoding="utf-8"))["target_m"] == pytest.approx(0.062)


def test_the_first_of_several_is_shown_and_the_others_are_told_of(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save([trace(name="first"), trace(name="second")], here / "two.csv")
    assert cli.main(["view", "two.csv"]) == 0
    assert (here / "first_view.html").exists()
    assert "cut 1 of 2 is taken" in capsys.readouterr().err


def test_open_opens_the_page_from_disk(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    save([trace(name="cut")], here / "cut.csv")
    assert cli.main(["view", "cut.csv", "--open"]) == 0
    assert opened == [(here / "cut_view.html").as_uri()]


def test_a_foreign_table_is_mapped(here: Path) -> None:
    own = trace()
    columns = np.column_stack([own.time, own.force, 1e3 * np.asarray(own.position)])
    np.savetxt(here / "rig.csv", columns, delimiter=",", header="t,Fx,x", comments="", fmt="%.6f")
    mapping = ["--map", "time=t", "force=Fx", "position=x[mm]", "angle=90deg", "depth=15mm", "--unit", "N"]
    assert cli.main(["view", "rig.csv", *mapping, "--out", "page.html"]) == 0
    assert max(told((here / "page.html").read_text(encoding="utf-8"))["surface_m"]) == pytest.approx(0.015)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["cut.csv", "--cut", "3"], "the file holds cuts 1;"),
        (["cut.csv", "--target-length", "80"], "no length with a unit"),
        (["cut.csv", "--out", "cut.csv/page.html"], "is a file; give a folder"),
        (["none.csv"], "no such file"),
        (["force.csv"], "depth=20mm"),
    ],
)
def test_a_refusal_names_the_cure_and_leaves_no_page(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    save([trace(name="cut")], here / "cut.csv")
    own = trace()
    save([Trace(time=own.time, force=own.force)], here / "force.csv")
    assert cli.main(["view", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert list(here.glob("*.html")) == []
