"""A record that grows on disk: what was appended is there, whatever becomes of the process or the disk."""

from __future__ import annotations

import errno
import math
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import FULL, JSON, some, traces

from cutenv.records import AppendingRecord, RecordError, RecordingFailed, load, load_one, read_record, save
from cutenv.sim.trace import CHANNELS, Reading, Trace

READINGS = [FULL[i] for i in range(len(FULL))]
BARE = ("time", "force")
CHILD = """
import resource, sys, time
sys.path.insert(0, sys.argv[2])
from made_up import some
from cutenv.records import AppendingRecord, RecordingFailed
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "cut.csv"


def test_a_finished_record_is_an_ordinary_one(file: Path) -> None:
    record = AppendingRecord(file, {"rig": "bench 2", "trial": 3})
    record.append(READINGS[:7])
    record.append([])
    record.append(READINGS[7:])
    record.close()
    other = file.with_name("saved.csv")
    save(FULL, other)
    assert file.read_bytes() == other.read_bytes()


@given(trace=traces(), extra=st.dictionaries(st.just("end"), JSON))
def test_a_record_gives_back_what_was_appended_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, trace: Trace, extra: dict
) -> None:
    file = tmp_path_factory.mktemp("record") / "cut.csv"
    channels = [name for name in trace.known if name in CHANNELS]
    fields = [name for name in trace.known if name not in channels]
    record = AppendingRecord(file, trace.metadata, fields=fields, channels=channels, force_unit=trace.force_unit)
    for i in range(len(trace)):
        more = [tuple(float(getattr(trace, name)[i]) for name in channels)]
        record.append([trace[i]], more if channels else None)
    so_far = load_one(file)
    record.close(extra)
    whole = load_one(file)
    for name in trace.known:
        assert np.array_equal(getattr(whole, name), getattr(trace, name))
    assert whole == Trace(
        **{name: getattr(trace, name) for name in trace.known},
        force_unit=trace.force_unit,
        metadata={**trace.metadata, **extra},
    )
    assert so_far.metadata == {**trace.metadata, "truncated": True}
    assert np.array_equal(so_far.force, trace.force)


def test_what_was_appended_can_be_loaded_at_once(file: Path) -> None:
    with AppendingRecord(file) as record:
        for first in range(0, 100, 20):
            record.append(some(first))
            assert len(load_one(file)) == first + 20


def test_a_record_left_by_an_error_stays_truncated(file: Path) -> None:
    record = AppendingRecord(file, {"rig": "bench 2"})
    record.append(some(0))
    with pytest.raises(RuntimeError, match="lost"), record:
        raise RuntimeError("lost")
    assert load_one(file).metadata == {"rig": "bench 2", "truncated": True}
    record.close({"end": "finished"})  # too late
    assert "end" not in load_one(file).metadata


def command(code: str, file: Path) -> list[str]:
    return [sys.executable, "-c", CHILD + code, str(file), str(Path(__file__).parent)]


KILLED = """
record = AppendingRecord(sys.argv[1], {"rig": "bench 2"})
first = 0
while True:
    record.append(some(first))
    first += 20
    print(first, flush=True)
    time.sleep(0.001)
"""


def test_a_killed_process_loses_nothing_that_it_had_appended(file: Path) -> None:
    child = subprocess.Popen(command(KILLED, file), stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    appended = 0
    while appended < 400:
        appended = int(child.stdout.readline())
    child.send_signal(signal.SIGKILL)
    rest, _ = child.communicate()
    appended = int((rest.split() or [appended])[-1])
    cut = load_one(file)
    assert appended <= len(cut) <= appended + 20  # killed after writing, before saying so
    assert np.array_equal(cut.force, np.arange(len(cut)) * 1e-2)
    assert cut.metadata == {"rig": "bench 2", "truncated": True}
    assert [path.name for path in file.parent.iterdir()] == ["cut.csv"]


FULL_DISK = """
record = AppendingRecord(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000))
for first in range(0, 10_000, 20):
    try:
        record.append(some(first))
    except RecordingFailed as error:
        print(record.rows, record.failed == str(error), error, sep="|")
        break
for attempt in (lambda: record.append(some(first)), lambda: record.close({"end": "finished"})):
    try:
        attempt()
    except RecordingFailed as error:
        print(error)
record.close()
"""


def test_a_full_disk_is_said_and_keeps_what_it_took(file: Path) -> None:
    ran = subprocess.run(command(FULL_DISK, file), capture_output=True, text=True, check=True)
    first, *again = ran.stdout.splitlines()
    rows, said, message = first.split("|")
    assert said == "True"
    assert message.startswith(f"{file}: the disk takes no more of the record (File too large); the {rows} readings")
    assert again == [message, message]  # of the next append, and of the end
    cut = load_one(file)
    assert file.stat().st_size == 5000
    assert int(rows) <= len(cut) < int(rows) + 20
    assert np.array_equal(cut.force, np.arange(len(cut)) * 1e-2)
    assert cut.metadata == {"truncated": True}


def failure(record: AppendingRecord) -> str:
    """What the thread finds wrong, once it does."""
    deadline = time.monotonic() + 20.0
    first = 0
    while record.failed is None:
        assert time.monotonic() < deadline, "nothing was found wrong"
        record.append(some(first))
        first += 20
        time.sleep(0.02)
    return record.failed


def test_a_disk_that_fails_behind_the_back_is_said_at_the_next_append(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(descriptor: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr("cutenv.records.appending.os.fsync", broken)
    record = AppendingRecord(file)
    assert "Input/output error" in failure(record)
    with pytest.raises(RecordingFailed, match="Input/output error"):
        record.append(some(1_000_000))
    with pytest.raises(RecordingFailed, match="Input/output error"):
        record.close()
    assert load_one(file).metadata == {"truncated": True}


def test_a_file_that_was_taken_away_is_noticed(file: Path) -> None:
    record = AppendingRecord(file)
    file.unlink()
    assert "the file was deleted" in failure(record)
    assert "it is not there any more" in str(record.failed)
    assert "can be loaded" not in str(record.failed)
    record.abandon()


def test_a_file_that_was_moved_is_not_promised_under_its_old_name(file: Path) -> None:
    record = AppendingRecord(file)
    record.append(some(0))
    moved = file.rename(file.with_name("moved.csv"))
    with pytest.raises(RecordingFailed, match="unless somebody moved it"):
        record.close()
    assert len(load_one(moved).time) == 20


def test_the_disk_is_flushed_within_a_second_by_a_thread_that_ends(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flushed = []
    synced = threading.Event()

    def fsync(descriptor: int) -> None:
        flushed.append(threading.current_thread().name)
        synced.set()

    monkeypatch.setattr("cutenv.records.appending.os.fsync", fsync)
    record = AppendingRecord(file)
    for _ in range(2):
        record.append(some(20 * len(flushed)))
        assert synced.wait(20.0)
        synced.clear()
    record.close()
    assert flushed[:2] == ["record cut.csv"] * 2
    assert "record cut.csv" not in [thread.name for thread in threading.enumerate()]


def test_a_silent_disk_does_not_hold_up_the_end(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entered, answered = threading.Event(), threading.Event()

    def hangs(descriptor: int) -> None:
        entered.set()
        answered.wait(60.0)

    monkeypatch.setattr("cutenv.records.appending.os.fsync", hangs)
    monkeypatch.setattr("cutenv.records.appending._PATIENCE", 0.2)
    record = AppendingRecord(file)
    record.append(some(0))
    assert entered.wait(20.0)
    record.append(some(20))  # does not wait for it either
    with pytest.raises(RecordingFailed, match=r"no answer within 0\.2 s"):
        record.close()
    answered.set()
    assert len(load_one(file)) == 40


BAD = {
    "NaN": (READINGS[5]._replace(force=math.nan), ValueError, "force_N = nan"),
    "infinite": (READINGS[5]._replace(position=math.inf), ValueError, "position_m = inf"),
    "out of range": (READINGS[5]._replace(depth=2.0), ValueError, "depth_m = 2 is outside 0 to 0.1"),
    "missing": (READINGS[5]._replace(speed=None), TypeError, "speed_m_s must be one real number"),
    "text": (READINGS[5]._replace(angle="1.5"), TypeError, "angle_rad must be one real number"),
    "again": (READINGS[4], ValueError, "time goes from 0.004 s to 0.004 s"),
    "NaN time": (READINGS[5]._replace(time=math.nan), ValueError, "time_s = nan"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_reading_is_refused_with_its_block_and_the_record_goes_on(file: Path, name: str) -> None:
    reading, kind, message = BAD[name]
    record = AppendingRecord(file)
    record.append(READINGS[:5])
    with pytest.raises(kind, match=message):
        record.append([reading, *READINGS[6:8]])
    with pytest.raises(kind, match=message):
        record.append([reading])
    assert record.rows == 5
    record.append(READINGS[5:])
    record.close(FULL.metadata)
    assert load_one(file) == FULL


def test_whole_numbers_and_numpy_numbers_are_numbers(file: Path) -> None:
    with AppendingRecord(file, fields=BARE) as record:
        record.append([Reading(0, 1), Reading(np.float64(0.1), np.float32(0.5))])
    assert load_one(file) == Trace(time=[0.0, 0.1], force=[1.0, 0.5])


def cut_off(file: Path, *, left: int) -> None:
    file.write_bytes(file.read_bytes()[:-left])


@pytest.fixture
def growing(file: Path) -> Path:
    record = AppendingRecord(file)
    record.append(some(0))
    record.abandon()
    return file


def test_the_last_line_counts_only_if_it_is_whole(growing: Path) -> None:
    whole = growing.read_bytes()
    last = len(whole.splitlines()[-1])
    for left in (1, 2, last, last + 1, last + 2):  # the end of its line counts too
        growing.write_bytes(whole[:-left])
        assert len(load_one(growing)) == (19 if left <= last + 1 else 18)


def test_zeros_that_a_power_cut_left_are_no_readings(growing: Path) -> None:
    with growing.open("ab") as file:
        file.write(b"0.02,0." + bytes(500) + b".2,2e-05,0.001,1.5,0.02\n")
    assert len(load_one(growing)) == 20


def test_damage_before_the_end_is_an_error_all_the_same(growing: Path) -> None:
    growing.write_text(growing.read_text().replace("\n0.01,", "\n0.01;"))
    with pytest.raises(RecordError, match="line 15: "):
        load(growing)


def test_a_finished_record_that_lost_its_end_is_refused(file: Path) -> None:
    with AppendingRecord(file) as record:
        record.append(some(0))
    cut_off(file, left=3)
    with pytest.raises(RecordError, match="announces 20 rows and holds 20, and its last line is not whole"):
        load(file)


def test_a_truncated_record_that_is_saved_again_stays_known_as_one(growing: Path) -> None:
    cut = load_one(growing)
    save(cut, growing)
    assert "# rows: 20" in growing.read_text()
    assert load_one(growing) == cut
    assert cut.metadata["truncated"] is True


def test_every_reader_takes_a_truncated_record(growing: Path) -> None:
    (trace,) = read_record(growing).traces
    assert trace == load_one(growing)


def test_there_is_nothing_to_load_before_the_first_reading(file: Path) -> None:
    record = AppendingRecord(file)
    with pytest.raises(RecordError, match="holds no readings"):
        load(file)
    record.abandon()


def test_a_file_that_is_there_is_never_written_over(file: Path) -> None:
    file.write_text("mine")
    with pytest.raises(FileExistsError):
        AppendingRecord(file)
    assert file.read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "kind", "message"),
    [
        ({"fields": ("time", "position")}, ValueError, "must hold time and force; force is missing"),
        ({"fields": ("time", "force", "sped")}, ValueError, "Did you mean 'speed'"),
        ({"force_unit": "mN"}, ValueError, "force_unit must be one of"),
        ({"metadata": {"gain": math.nan}}, ValueError, "metadata are not what JSON can hold"),
        ({"metadata": {"rig": {1}}}, TypeError, "metadata are not what JSON can hold"),
        ({"metadata": {"operator": "Jane Doe"}}, ValueError, "operator"),
    ],
)
def test_what_could_not_be_recorded_is_refused_before_there_is_a_file(
    file: Path, arguments: dict, kind: type[Exception], message: str
) -> None:
    with pytest.raises(kind, match=message):
        AppendingRecord(file, **arguments)
    assert not file.exists()


def test_a_record_that_grows_is_a_csv_file(file: Path) -> None:
    with pytest.raises(RecordError, match=r"Give it the suffix \.csv"):
        AppendingRecord(file.with_suffix(".parquet"))


def test_bad_last_metadata_leave_the_record_open(file: Path) -> None:
    record = AppendingRecord(file)
    record.append(some(0))
    with pytest.raises(ValueError, match="operator"):
        record.close({"operator": "Jane Doe"})
    record.append(some(20))
    record.close({"operator": "P07"})
    record.close({"operator": "P08"})
    assert (len(load_one(file)), load_one(file).metadata) == (40, {"operator": "P07"})
    with pytest.raises(ValueError, match="is closed"):
        record.append(some(40))
