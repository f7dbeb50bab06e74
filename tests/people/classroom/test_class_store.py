"""A class's database: the same on SQLite and on a real PostgreSQL, for several servers at once, and with bad input."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from scripts import test_programs

pytest.importorskip("sqlalchemy", reason="the server is an extra: pip install 'cutenv[serve]'")

from sqlalchemy import text

from cutenv.commands.cli import main
from cutenv.people.classroom import ClassStore
from cutenv.people.classroom.class_backup import restore_backup, write_backup
from cutenv.people.classroom.class_store import CutEnd, HandedOutCut, NewCut, SeenMovements, teacher_of


@pytest.fixture(scope="module")
def postgresql() -> Iterator[str]:
    """Address of a PostgreSQL of our own."""
    pytest.importorskip("psycopg", reason="speaks to PostgreSQL in the tests: pip install 'cutenv[dev]'")
    with test_programs.own_postgresql() as address:
        yield address


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.needs("postgresql"))])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'class.db'}" if request.param == "sqlite" else request.getfixturevalue("postgresql")


@pytest.fixture
def store(url: str) -> Iterator[ClassStore]:
    opened = ClassStore(url)
    yield opened
    for code, _ in opened.codes():
        opened.delete(code)
    opened.close()


def handed_out(store: ClassStore, code: str, new: NewCut) -> HandedOutCut:
    cut = store.hand_out(code, lambda _: new)
    assert cut is not None
    return cut


def test_what_is_stored_comes_back(store: ClassStore) -> None:
    (code,) = store.add_codes(1)
    store.consent(code)
    assert store.codes() == [(code, True)]
    cut = handed_out(store, code, NewCut("liver", 2**31 - 1, 0.0805, "a course", "a task", "terms"))
    assert (cut.seed, cut.target_length, cut.task, cut.state) == (2**31 - 1, 0.0805, "a task", "prepared")
    assert store.begun(cut.id, code)
    assert not store.begun(cut.id, code)
    end = CutEnd(
        state="saved", record="x.csv", outcome="success", score=87.4, numbers={"peak_force": 0.1}, stalled=4.75
    )
    store.finish(cut.id, end)
    (found,) = store.cuts(code)
    assert (found.state, found.record, found.outcome, found.score) == ("saved", "x.csv", "success", 87)
    assert (found.course, found.numbers, found.stalled) == ("a course", {"peak_force": 0.1}, 4.75)
    with pytest.raises(LookupError, match="no cut"):
        store.cut(cut.id, "somebody else")


def test_sessions_end_with_their_person(store: ClassStore) -> None:
    (code,) = store.add_codes(1)
    token, teachers = store.sign_in(code), store.sign_in(teacher_of("secret"))
    assert store.signed_in(token) == code
    assert store.signed_in(teachers) == teacher_of("secret")
    assert store.signed_in("made up") is None
    assert store.delete(code)
    assert store.signed_in(token) is None
    assert not store.delete(code)


def test_a_name_is_no_code(store: ClassStore) -> None:
    with pytest.raises(ValueError, match="may identify a person"):
        store.add_code("Anna Schmidt")
    assert store.codes() == []


def test_a_cut_is_handed_out_once_whatever_the_number_of_servers(store: ClassStore, url: str) -> None:
    servers = (store, ClassStore(url))
    codes, rounds, together = store.add_codes(4), 5, 3

    def begins(code: str, server: ClassStore) -> str:
        cut = server.hand_out(code, lambda ended: NewCut("liver", len(ended), task=f"task {len(ended)}", terms=code))
        assert cut is not None
        assert cut.nth == cut.seed + 1, "it is the next of what had ended"
        return cut.id

    with ThreadPoolExecutor(len(codes) * together) as pool:
        for number in range(rounds):
            asked = [(code, servers[each % 2]) for code in codes for each in range(together)]
            given = list(pool.map(begins, *zip(*asked, strict=True)))
            assert len(set(given)) == len(codes), "everybody has one, from whichever server"
            ends = [CutEnd(state="saved", record=f"{number}.csv")] * len(given)
            ended = list(pool.map(lambda cut, end: servers[0].finish(cut, end), given, ends))
            assert sum(ended) == len(codes)
    for code in codes:
        assert [(cut.nth, cut.state) for cut in servers[1].cuts(code)] == [(n, "saved") for n in range(1, rounds + 1)]
    servers[1].close()


def test_a_cut_is_handed_out_again_on_the_same_terms_alone(store: ClassStore) -> None:
    (code,) = store.add_codes(1)
    first = handed_out(store, code, NewCut("liver", 1, terms="easy"))
    assert handed_out(store, code, NewCut("liver", 2, terms="easy")) == first
    other = handed_out(store, code, NewCut("vascular", 3, terms="hard"))
    assert (other.id == first.id, other.seed) == (False, 3)
    store.begun(other.id, code)
    handed_out(store, code, NewCut("vascular", 4, terms="hard"))
    assert [cut.state for cut in store.cuts(code)] == ["taken back", "left", "prepared"]
    assert not store.finish(other.id, CutEnd(state="saved", record="a.csv"))


def test_no_movements_are_saved_twice(store: ClassStore) -> None:
    end = CutEnd(state="saved", record="a.csv", movements="0" * 64)
    first, again = (handed_out(store, code, NewCut("liver", 1)) for code in store.add_codes(2))
    assert store.finish(first.id, end)
    with pytest.raises(SeenMovements, match="bit for bit"):
        store.finish(again.id, end)
    assert store.cut(again.id, again.code).state == "prepared"


def test_a_database_of_an_earlier_version_is_brought_up(url: str) -> None:
    store = ClassStore(url)
    (code,) = store.add_codes(1)
    with store.engine.begin() as connection:
        for name in ("cuts_in_order", "one_open_cut", "movements_once"):
            connection.execute(text(f"DROP INDEX {name}"))
        for name in ("nth", "course", "terms", "begun", "ended", "numbers", "movements", "stalled_ms"):
            connection.execute(text(f"ALTER TABLE cuts DROP COLUMN {name}"))
        connection.execute(text("ALTER TABLE sessions DROP COLUMN seen"))
        for number, state in enumerate(("saved", "prepared", "prepared")):
            row = f"'{number}', '{code}', 'liver', 1, '2026-01-0{number + 1}', '{state}'"
            columns = "id, code, specimen_class, seed, handed_out, state"
            connection.execute(text(f"INSERT INTO cuts ({columns}) VALUES ({row})"))
    store.close()
    later = ClassStore(url)
    assert [(cut.nth, cut.state) for cut in later.cuts(code)] == [(1, "saved"), (2, "unfinished"), (3, "unfinished")]
    assert handed_out(later, code, NewCut("liver", 5)).nth == 4
    assert later.signed_in(later.sign_in(code)) == code
    later.delete(code)
    later.close()


def test_a_backup_of_one_database_fills_another(store: ClassStore, tmp_path: Path) -> None:
    (code,) = store.add_codes(1)
    cut = handed_out(store, code, NewCut("uniform", 3))
    store.finish(cut.id, CutEnd(state="saved", record="a.csv"))
    (tmp_path / "records" / code).mkdir(parents=True)
    (tmp_path / "records" / code / "a.csv").write_text("numbers")
    assert write_backup(store, tmp_path / "records", tmp_path / "class.zip") == 1
    fresh = ClassStore(f"sqlite:///{tmp_path / 'fresh.db'}")
    assert restore_backup(fresh, tmp_path / "fresh" / "records", tmp_path / "class.zip") == 1
    assert fresh.cuts() == store.cuts()
    assert (tmp_path / "fresh" / "records" / code / "a.csv").read_text() == "numbers"
    with pytest.raises(ValueError, match="holds records already"):
        restore_backup(fresh, tmp_path / "fresh" / "records", tmp_path / "class.zip")
    fresh.close()


def rows(**tables: Any) -> dict[str, str]:
    return {"class.json": json.dumps({"schema": "cutenv-class/1", "people": [], "cuts": []} | tables)}


@pytest.mark.parametrize(
    "content",
    [
        {},
        {"class.json": "{}"},
        {"class.json": "no json"},
        {"../out.csv": "x"},
        {"records/../../out.csv": "x"},
        rows(cuts=[{"id": "1", "code": "P01", "record": "../../etc/hostname"}]),
        rows(people=[{"code": "../P01"}]),
        rows(people=[{"code": "P01", "unknown": 1}]),
        rows(people=[{"code": "P01"}, {"code": "P01", "created": "2026"}]),
        rows(people=3),
    ],
    ids=["empty", "no schema", "no json", "a path out", "a path out below records", "a record's path out",
         "a person's path out", "a column too many", "a column too few", "no rows"],
)  # fmt: skip
def test_what_is_no_backup_is_refused_and_nothing_written(tmp_path: Path, content: dict[str, str]) -> None:
    with zipfile.ZipFile(tmp_path / "bad.zip", "w") as archive:
        for name, written in (rows() | content if content else {}).items():
            archive.writestr(name, written)
    store = ClassStore(f"sqlite:///{tmp_path / 'class.db'}")
    with pytest.raises(ValueError, match=r"backup|schema|no record") as told:
        restore_backup(store, tmp_path / "new" / "records", tmp_path / "bad.zip")
    assert "\n" not in str(told.value)
    assert (store.codes(), store.cuts()) == ([], [])
    assert not (tmp_path / "new").exists()
    assert not (tmp_path / "out.csv").exists()
    store.close()


def test_a_refused_backup_leaves_no_database(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with zipfile.ZipFile(tmp_path / "bad.zip", "w") as archive:
        archive.writestr("class.json", rows(people=[{"code": "P01", "unknown": 1}])["class.json"])
    folder = tmp_path / "class"
    assert main(["serve", str(folder), "--restore", str(tmp_path / "bad.zip")]) == 2
    assert not list(folder.iterdir())
    assert capsys.readouterr().err.count("\n") == 1
