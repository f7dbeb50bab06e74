"""The Lab Streaming Layer: a client of others reads a cut while it goes on, and any force stream becomes a record."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pylsl
import pytest

from cutenv.commands import cli
from cutenv.records import ColumnMap, RecordError, load_one
from cutenv.records.foreign.lsl import LslInlet, LslOutlet, lsl, record_stream
from cutenv.sim.cutting.dtypes import READING

pytestmark = pytest.mark.real_time
MAP = ColumnMap.parse(["time=stamp", "force=norm(Fx,Fz)", "position=way", "depth=20mm"])


class Sensor:
    """Another program's force stream: two components in newtons, a way in millimetres, a sample each 5 ms."""

    def __init__(self, name: str, *, spoilt: int = -1, stalls: int = -1, last: int = 10**9) -> None:
        lsl()
        info = pylsl.StreamInfo(name, "Force", 3, 200, "float32", name)
        channels = info.desc().append_child("channels")
        for label, unit in (("Fx", "newtons"), ("Fz", "N"), ("way", "mm")):
            channel = channels.append_child("channel")
            channel.append_child_value("label", label)
            channel.append_child_value("unit", unit)
        self._outlet = pylsl.StreamOutlet(info)
        self._stop = threading.Event()
        self._spoilt, self._stalls, self._last = spoilt, stalls, last
        self._thread = threading.Thread(target=self._send, daemon=True)
        self._thread.start()

    def _send(self) -> None:
        self._outlet.wait_for_consumers(5.0)
        for k in range(self._last):
            force = float("nan") if k == self._spoilt else 3.0
            self._outlet.push_sample([force, 4.0, 0.05 * k])
            if self._stop.wait(1.0 if k == self._stalls else 0.005):
                return

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        del self._outlet


@pytest.fixture
def inlet() -> Iterator[LslInlet]:
    sensor = Sensor("bench force")
    found = LslInlet("bench force")
    yield found
    found.close()
    sensor.close()


def test_any_force_stream_becomes_a_record_in_si(inlet: LslInlet, tmp_path: Path) -> None:
    newest: list[Any] = []
    count = record_stream(inlet, MAP, tmp_path / "cut.csv", seconds=0.6, on_reading=newest.append)
    trace = load_one(tmp_path / "cut.csv")
    assert len(trace) == count
    assert 20 <= count <= 121  # 120; a sender on a busy machine is late
    assert np.allclose(trace.force, 5.0)
    assert trace.depth is not None
    assert trace.position is not None
    assert np.allclose(np.diff(trace.position), 5e-5, atol=1e-6)
    assert trace.time[0] == 0.0
    assert 0.5 < trace.time[-1] < 0.6
    assert trace.metadata["stream_end"] == "asked"
    assert newest[-1].time == trace.time[-1]


def test_a_spoilt_sample_ends_the_record_which_keeps_what_came_before(tmp_path: Path) -> None:
    sensor = Sensor("spoilt", spoilt=150)
    try:
        with pytest.raises(RecordError, match=r"reading 1\d\d of spoilt: 'Fx \[N\]' is nan, no finite number"):
            record_stream(LslInlet("spoilt"), MAP, tmp_path / "cut.csv", seconds=5.0)
    finally:
        sensor.close()
    assert 20 < len(load_one(tmp_path / "cut.csv")) <= 150


def test_a_stream_that_falls_silent_is_a_whole_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.records.foreign.lsl.SILENCE", 0.5)
    sensor = Sensor("silent", last=40)
    record_stream(LslInlet("silent"), MAP, tmp_path / "cut.csv")
    sensor.close()
    assert load_one(tmp_path / "cut.csv").metadata["stream_end"] == "silent"


def test_a_stall_of_the_sender_is_a_gap_in_the_record_and_spoils_no_other_time(tmp_path: Path) -> None:
    sensor = Sensor("stalling", stalls=60)
    record_stream(LslInlet("stalling"), MAP, tmp_path / "cut.csv", seconds=1.6)
    sensor.close()
    steps = np.diff(load_one(tmp_path / "cut.csv").time)
    assert (steps > 0.9).sum() == 1
    assert np.median(np.abs(steps - 0.005)) < 0.002
    assert np.sort(steps)[-2] < 0.3


def test_an_lsl_client_reads_every_reading_and_the_markers_to_the_last_bit() -> None:
    outlet = LslOutlet("test", about={"rig": "bench"})
    info = pylsl.resolve_byprop("name", "test readings", 1, 3.0)[0]
    readings = pylsl.StreamInlet(info)
    markers = pylsl.StreamInlet(pylsl.resolve_byprop("name", "test markers", 1, 3.0)[0])
    readings.open_stream(3.0)
    markers.open_stream(3.0)
    given = np.zeros(500, READING)
    rng = np.random.default_rng(0)
    for name in given.dtype.names:
        given[name] = rng.normal(size=500)
    given["time"] = 1e-3 * np.arange(1, 501)
    origin = time.monotonic()
    outlet.began("liver 3")
    for part in np.array_split(given, 7):
        outlet.readings(part, np.full(len(part), 0.02), origin)
    outlet.ended("finished")
    samples: list[list[float]] = []
    stamps: list[float] = []
    deadline = time.monotonic() + 5.0
    while len(samples) < 500 and time.monotonic() < deadline:
        more, when = readings.pull_chunk(timeout=0.2)
        samples, stamps = samples + list(more), stamps + list(when)
    told = [markers.pull_sample(timeout=2.0)[0][0] for _ in range(2)]
    described = readings.info()  # whose memory a description points into
    outlet.close()
    assert told == ["begin liver 3", "end finished"]
    assert np.array_equal(np.array(samples)[:, 0], given["force"])
    assert np.array_equal(np.array(samples)[:, 1], given["position"])
    assert np.allclose(np.array(stamps) - pylsl.local_clock() + time.monotonic() - origin, given["time"], atol=1e-3)
    assert described.desc().child_value("rig") == "bench"
    first = described.desc().child("channels").child("channel")
    assert (first.child_value("label"), first.child_value("unit")) == ("force", "N")


def test_the_outlet_does_not_wait_for_anybody() -> None:
    outlet = LslOutlet("busy")
    part, depth = np.zeros(100, READING), np.zeros(100)
    start = time.perf_counter()
    for _ in range(100):
        outlet.readings(part, depth, 0.0)
    assert (time.perf_counter() - start) / 100 < 1e-3
    outlet.close()
    outlet.close()


def test_a_scope_beyond_this_machine_must_be_chosen_first() -> None:
    lsl()
    with pytest.raises(ValueError, match=r"this program's streams are kept to 'machine'"):
        lsl("site")
    with pytest.raises(ValueError, match=r"scope must be one of 'machine', 'link', 'site'"):
        lsl("world")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--map", "force=Fx", "time=t"], "a stream has a time of its own"),
        (["--map", "position=x"], "force is not mapped"),
        (["--map", "force=Fx", "--seconds", "-1"], "--seconds = -1"),
        (["--map", "force=Fx", "--out", "a.h5"], "give a .csv"),
        (["--map", "force=Fx"], "there is no stream called 'nothing'; found here: "),
    ],
)
def test_record_refuses_before_it_writes(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("cutenv.records.foreign.lsl.FIND_WITHIN", 0.3)
    given = ["record", "--stream", "nothing", *([] if "--out" in arguments else ["--out", "a.csv"]), *arguments]
    assert cli.main(given) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_command_records_a_stream(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sensor = Sensor("command")
    out = tmp_path / "new" / "cut.csv"
    try:
        given = ["record", "--stream", "command", "--map", "force=Fz", "--seconds", "0.3", "--out", str(out)]
        assert cli.main(given) == 0
    finally:
        sensor.close()
    assert np.allclose(load_one(out).force, 4.0)
    assert "readings" in capsys.readouterr().out
