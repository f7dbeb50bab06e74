"""A class's database: the same on SQLite and on a real PostgreSQL, for several servers at once, and with bad input."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
import test_programs

pytest.importorskip("sqlalchemy", reason="the server is an extra: pip install 'cutenv[serve]'")

from cutenv.classroom import ClassStore
from cutenv.classroom.class_backup import restore_backup, write_backup
from cutenv.classroom.class_store import TEACHER, CutEnd

PROGRAMS = test_programs.postgresql()


@pytest.fixture(scope="module")
def postgresql() -> Iterator[str]:
    """Address of a PostgreSQL of our own, which listens on a socket in a folder alone."""
    pytest.importorskip("psycopg", reason="speaks to PostgreSQL in the tests: pip install 'cutenv[dev]'")
    folder = Path(tempfile.mkdtemp(prefix="pg"))  # the path of a socket is at most 107 characters long
    somebody: dict[str, Any] = {}
    if os.geteuid() == 0:  # PostgreSQL refuses to run as root
        shutil.chown(folder, "postgres", "postgres")
        somebody = {"user": "postgres", "group": "postgres", "extra_groups": []}
    data = folder / "data"
    start = [f"{PROGRAMS}/initdb", "-D", data, "-A", "trust", "-U", "postgres", "--no-sync"]
    subprocess.run(start, check=True, capture_output=True, cwd=folder, **somebody)
    run = [f"{PROGRAMS}/postgres", "-D", data, "-k", folder, "-c", "listen_addresses=", "-c", "fsync=off"]
    server = subprocess.Popen(run, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=folder, **somebody)
    try:
        until = time.monotonic() + 60.0
        while subprocess.run([f"{PROGRAMS}/pg_isready", "-h", folder], capture_output=True).returncode:
            assert time.monotonic() < until, "PostgreSQL does not begin"
            time.sleep(0.1)
        yield f"postgresql+psycopg://postgres@/postgres?host={folder}"
    finally:
        server.terminate()
        server.wait(60.0)
        shutil.rmtree(folder, ignore_errors=True)


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


def test_what_is_stored_comes_back(store: ClassStore) -> None:
    (code,) = store.add_codes(1)
    store.consent(code)
    assert store.codes() == [(code, True)]
    cut = store.hand_out(code, "liver", 2**31 - 1, 0.0805, "a task")
    assert store.prepared(code) == cut
    assert (cut.seed, cut.target_length, cut.task, cut.state) == (2**31 - 1, 0.0805, "a task", "prepared")
    store.begun(cut.id, code)
    store.finish(cut.id, CutEnd(state="saved", record="x.csv", outcome="success", score=87.4))
    (found,) = store.cuts(code)
    assert (found.state, found.record, found.outcome, found.score) == ("saved", "x.csv", "success", 87)
    with pytest.raises(LookupError, match="no cut"):
        store.cut(cut.id, "somebody else")


def test_sessions_end_with_their_person(store: ClassStore) -> None:
    (code,) = store.add_codes(1)
    token, teachers = store.sign_in(code), store.sign_in(TEACHER)
    assert store.signed_in(token) == code
    assert store.signed_in(teachers) == TEACHER
    assert store.signed_in("made up") is None
    assert store.delete(code)
    assert store.signed_in(token) is None
    assert not store.delete(code)


def test_a_name_is_no_code(store: ClassStore) -> None:
    with pytest.raises(ValueError, match="may identify a person"):
        store.add_code("Anna Schmidt")
    assert store.codes() == []


def test_two_servers_share_one_database(store: ClassStore, url: str) -> None:
    other = ClassStore(url)
    codes = store.add_codes(8)

    def cuts(number: int) -> None:
        opened = (store, other)[number % 2]
        for _ in range(5):
            cut = opened.hand_out(codes[number], "liver", number)
            opened.finish(cut.id, CutEnd(state="saved", record=f"{cut.id}.csv"))

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(cuts, range(8)))
    assert [len(other.cuts(code)) for code in codes] == [5] * 8
    other.close()


def test_a_backup_of_one_database_fills_another(store: ClassStore, tmp_path: Path) -> None:
    (code,) = store.add_codes(1)
    cut = store.hand_out(code, "uniform", 3)
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


@pytest.mark.parametrize(
    "content",
    [{}, {"class.json": "{}"}, {"class.json": "no json"}, {"../out.csv": "x"}, {"records/../../out.csv": "x"}],
    ids=["empty", "no schema", "no json", "a path out", "a path out below records"],
)
def test_what_is_no_backup_is_refused_and_nothing_written(tmp_path: Path, content: dict[str, str]) -> None:
    with zipfile.ZipFile(tmp_path / "bad.zip", "w") as archive:
        rows = '{"schema": "cutenv-class/1", "people": [], "cuts": []}'
        for name, text in ({"class.json": rows} | content if content else {}).items():
            archive.writestr(name, text)
    store = ClassStore(f"sqlite:///{tmp_path / 'class.db'}")
    with pytest.raises(ValueError, match=r"backup|schema|no record"):
        restore_backup(store, tmp_path / "new" / "records", tmp_path / "bad.zip")
    assert not (tmp_path / "new").exists()
    assert not (tmp_path / "out.csv").exists()
    store.close()
