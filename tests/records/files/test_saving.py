"""Saving is whole or not at all, in a format that the suffix names, by libraries that are there."""

from __future__ import annotations

import ast
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from made_up import FULL

import cutenv.records
from cutenv.records import RecordError, load, load_one, save
from cutenv.sim.trace import Trace

SUFFIXES = (".csv", ".parquet", ".h5")
BARE = Trace(time=FULL.time, force=FULL.force)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_error_in_mid_write_leaves_the_earlier_record(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"cut{suffix}"
    save(FULL, path)
    monkeypatch.setattr(os, "fsync", fail)  # all is written, but not yet on the disk
    with pytest.raises(OSError, match="disk is full"):
        save(BARE, path)
    assert load(path) == [FULL]
    assert list(tmp_path.iterdir()) == [path]


def fail(*arguments: object) -> None:
    raise OSError("disk is full")


def size(path: Path) -> int:
    """In bytes; none if it has just been renamed."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


KILLED = """
import os, signal, sys
import numpy as np
from cutenv.records import save
from cutenv.sim.trace import Trace
n = 200_000
cut = Trace(time=np.arange(n) * 1e-3, force=np.random.default_rng(0).uniform(size=n))
print("begins", flush=True)
for _ in range(1000):
    save(cut, sys.argv[1])
"""


@pytest.mark.skipif(os.name == "nt", reason="a process is killed by a signal")
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_process_killed_while_it_writes_leaves_a_whole_record(tmp_path, suffix):
    path = tmp_path / f"cut{suffix}"
    save(FULL, path)
    writer = subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE)
    assert writer.stdout
    assert writer.stdout.readline() == b"begins\n"
    while not any(".part" in other.name and size(other) for other in tmp_path.iterdir()):
        assert writer.poll() is None
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    writer.stdout.close()
    assert len(load_one(path)) in (len(FULL), 200_000)


@pytest.mark.parametrize(
    ("traces", "error", "message"),
    [
        ([], ValueError, "no trace to save"),
        ([FULL, "trace"], TypeError, r"traces\[1\] is a str; save takes a Trace or several"),
        (Trace(time=[0, 1e-3], force=[0, 1], metadata={"operator": "Jane Doe"}), ValueError, "operator 'Jane Doe' may"),
    ],
)
def test_what_cannot_be_saved_is_refused_before_anything_is_written(tmp_path, traces, error, message):
    with pytest.raises(error, match=message):
        save(traces, tmp_path / "cut.csv")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["cut.xlsx", "cut", "cut.csv.gz", "cut.h5.part"])
def test_another_suffix_is_refused_and_the_known_are_named(tmp_path, name):
    for action in (lambda path: save(FULL, path), load):
        with pytest.raises(RecordError, match=r"is no format of a record. Use one of .csv, .parquet, .h5, .hdf5"):
            action(tmp_path / name)


def test_several_cuts_are_not_taken_for_one(tmp_path):
    save([FULL, FULL], tmp_path / "cuts.csv")
    with pytest.raises(RecordError, match=r"it holds 2 cuts. Read them with load\(\)"):
        load_one(tmp_path / "cuts.csv")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_no_file_is_no_record_error(tmp_path, suffix):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        load(tmp_path / f"nowhere{suffix}")
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(IsADirectoryError, match="folder"):
        load(tmp_path / f"folder{suffix}")


@pytest.mark.parametrize("name", ["a\0b.csv", "x" * 5000 + ".csv"])
def test_a_name_that_no_file_can_have_is_a_record_error(name):
    with pytest.raises(RecordError):
        load(name)


@pytest.mark.parametrize(("suffix", "package"), [(".parquet", "pyarrow"), (".h5", "h5py")])
def test_a_missing_library_is_answered_with_the_pip_command(tmp_path, suffix, package, monkeypatch):
    path = tmp_path / f"cut{suffix}"
    save(FULL, path)
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    for action in (lambda: load(path), lambda: save(FULL, path)):
        with pytest.raises(ModuleNotFoundError, match=rf"{package}.*pip install 'cutenv\[data\]'") as caught:
            action()
        assert caught.value.name == package
    save(FULL, tmp_path / "cut.csv")
    assert load_one(tmp_path / "cut.csv") == FULL


def test_csv_needs_neither_h5py_nor_pyarrow_nor_the_simulator(tmp_path):
    save(FULL, tmp_path / "cut.csv")
    code = (
        "import sys; from cutenv.records import load, save; save(load('cut.csv'), 'again.csv'); "
        "print(*{name.partition('.')[0] for name in sys.modules} & {'h5py', 'pyarrow', 'numba', 'skfem', 'scipy'})"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


SOURCES = sorted(Path(cutenv.records.__file__).parent.glob("*.py"))


def imported(source: str) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
    return names


def test_no_module_imports_pickle_or_what_uses_it():
    pickling = {"pickle", "shelve", "marshal", "dill", "joblib", "cloudpickle"}
    assert len(SOURCES) > 5
    assert imported("import pickle") & pickling
    for source in SOURCES:
        text = source.read_text(encoding="utf-8")
        assert not imported(text) & pickling, source
        assert "allow_pickle" not in text, source


class Trap:
    """Runs a command when it is unpickled."""

    def __init__(self, sprung: Path) -> None:
        self.sprung = sprung

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, (str(self.sprung),)


def test_a_pickle_in_a_file_is_not_opened(tmp_path):
    sprung = tmp_path / "sprung"
    trap = pickle.dumps(Trap(sprung))
    pickle.loads(trap)
    assert sprung.exists()
    sprung.rmdir()
    for suffix in SUFFIXES:
        (tmp_path / f"trap{suffix}").write_bytes(trap)
    with h5py.File(tmp_path / "inside.h5", "w") as file:
        file["time_s"] = [0.0, 0.1]
        file["force_N"] = np.array([trap, trap], dtype=np.void(trap).dtype)
        file.attrs["metadata"] = np.void(trap)
    for path in [*tmp_path.glob("trap.*"), tmp_path / "inside.h5"]:
        with pytest.raises(RecordError):
            load(path)
    assert not sprung.exists()
