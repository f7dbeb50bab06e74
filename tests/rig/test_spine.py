"""A spine in a process of its own stops the blade whatever the program does, and tells what one within it tells."""

from __future__ import annotations

import dataclasses
import math
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from multiprocessing import Pipe
from pathlib import Path
from types import SimpleNamespace

import pytest
from stage_in_memory import HANGS, TOLD, Balance, Judge, settings, told
from waiting import until

from cutenv.rig.devices.loop import SystemClock
from cutenv.rig.devices.protocols import DriveState, ForceSample, MotionSample
from cutenv.rig.errors import RigError
from cutenv.rig.plant import RigPlant, rig_plant
from cutenv.rig.safety.stop_causes import ENDS_SESSION, Cause, RigStopped
from cutenv.rig.spine_process import (
    COMMAND,
    DONE,
    GO,
    LONGEST_HOLD,
    REPLY,
    TURN,
    Link,
    Ring,
    SampleWriter,
    _Served,
    deliver,
    ring_size,
)

UPRIGHT = math.pi / 2
HERE = Path(__file__).parent
PERIOD = 0.050
PROGRAM = """
import ctypes, os, sys, time
from stage_in_memory import settings
from cutenv.rig.remote_spine import RemoteSpine
class Nobody:
    force = motion = alive = garbled = lambda self, *what: None
spine = RemoteSpine(settings())
spine.open(Nobody())
spine.power()
spine.clock.sleep_until(spine.clock.now() + 0.1)
spine.supervisor.release()
for _ in range(10):
    spine.supervisor.drive(0.01, 1.5708, 0.05)
    spine.clock.sleep_until(spine.clock.now() + 0.05)
spine.supervisor.drive(0.01, 1.5708, 0.05)
os.write(1, f"{spine.pid} {time.monotonic()}\\n".encode())
"""
"""Program that makes ready, moves the blade, and tells the id of its spine, and when it sent its last command."""
ENDS = {
    "counts": "while True: pass",
    "holds the interpreter": "ctypes.PyDLL(None).usleep(30_000_000)",
    "raises": "raise ZeroDivisionError",
    "sleeps": "time.sleep(30)",
}
SIGNALS = {"killed": signal.SIGKILL, "paused": signal.SIGSTOP, "interrupted": signal.SIGINT}


@pytest.fixture
def record(tmp_path, monkeypatch) -> Path:
    """File in which the drivers write."""
    path = tmp_path / "told.jsonl"
    path.touch()
    monkeypatch.setenv(TOLD, str(path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), *sys.path]))
    return path


@pytest.mark.promise("S16")
@pytest.mark.parametrize("end", [*ENDS, *SIGNALS])
def test_whatever_the_program_does_the_blade_is_stopped_in_time(end, record):
    """The last kind is held in a library while Ctrl-C comes to all processes of the terminal."""
    then = ENDS.get(end, ENDS["holds the interpreter" if end == "interrupted" else "sleeps"])
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM + then],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        spine, last = program.stdout.readline().split()
        if end in SIGNALS:
            (os.killpg if end == "interrupted" else os.kill)(program.pid, SIGNALS[end])
        until(lambda: any(each["what"] == "quick stop" for each in told(record)))
        heard = told(record)
        stopped = next(each["time"] for each in heard if each["what"] == "quick stop")
        assert stopped - float(last) < PERIOD * (1.0 + settings().limits.overrun) + 0.030  # of a busy machine
        assert all(each["what"] != "command" for each in heard if each["time"] > stopped), "it moves on"
    finally:
        program.kill()
        program.wait()
    until(lambda: not Path(f"/proc/{spine}").exists() or "closed" in [each["what"] for each in told(record)])


def release(plant: RigPlant) -> None:
    plant.power()
    plant.clock.sleep_until(plant.clock.now() + 0.1)
    plant.supervisor.release()
    plant.begin()


def ready(clock: SystemClock | None = None, speed: float = 0.01) -> RigPlant:
    """Open, with power, released; it has moved for a moment."""
    plant = rig_plant(settings(), clock)
    plant.open()
    release(plant)
    for _ in range(5):
        plant.advance(speed, UPRIGHT, 20)
    return plant


@pytest.mark.promise("S16")
@pytest.mark.parametrize("deaf", [False, True])
def test_a_spine_that_is_killed_or_hears_no_stop_is_a_stop_that_ends_the_session(deaf, record):
    plant = ready()
    os.kill(plant.spine.pid, signal.SIGSTOP if deaf else signal.SIGKILL)
    if deaf:
        plant.supervisor.trip(Cause.OPERATOR, "the button")
    until(lambda: plant.spine.supervisor.phase == "stopped")
    why = ", because it did not hear a stop .operator: the button." if deaf else ""
    with pytest.raises(RigStopped, match=f"ended by SIGKILL{why}; without its heartbeat the drives stop") as stop:
        plant.advance(0.01, UPRIGHT, 20)
    assert stop.value.report.cause is Cause.SPINE
    assert stop.value.report.cause in ENDS_SESSION
    assert plant.supervisor.phase == "stopped"
    plant.halt()
    with pytest.raises(RigError, match="begin again"):
        plant.supervisor.reset(agreed=True)
    plant.close()


@pytest.mark.promise("S16")
def test_a_driver_that_never_returns_holds_up_neither_stop_nor_program_nor_close(record, monkeypatch):
    monkeypatch.setenv(HANGS, "0.02")
    plant = ready()
    begun = time.monotonic()
    with pytest.raises(RigStopped, match="no new command"):
        plant.advance(0.02, UPRIGHT, 20)
    assert plant.supervisor.report.standstill is not None
    plant.close()
    assert time.monotonic() - begun < 3.0
    assert told(record)[-1]["what"] == "closed"


def test_a_stop_that_the_program_asks_for_is_under_way_when_it_goes_on(record):
    plant = ready()
    assert plant.spine.about()["blade"]["process"] == plant.spine.pid != os.getpid()
    plant.supervisor.trip(Cause.OPERATOR, "the button")
    assert plant.supervisor.phase == "stopped"
    assert str(plant.supervisor.report).startswith("operator: the button")
    with pytest.raises(RigStopped, match="the button"):
        plant.advance(0.01, UPRIGHT, 20)
    with pytest.raises(RigError, match="the operator has not agreed"):
        plant.supervisor.reset(agreed=False)
    plant.supervisor.reset(agreed=True)
    release(plant)
    assert len(plant.advance(0.01, UPRIGHT, 20)) == 20
    lower = dataclasses.replace(plant.settings.limits, force=1.0)
    with pytest.raises(RigError, match="between cuts"):
        plant.lower(lower)
    plant.halt()
    plant.lower(lower)
    assert plant.settings.limits.force == plant.supervisor.limits.force == 1.0
    plant.close()
    assert told(record)[-1]["what"] == "closed"


def test_a_rig_that_is_opened_again_is_watched_as_at_first(record):
    plant = ready()
    plant.close()
    plant.open()
    release(plant)
    assert len(plant.advance(0.01, UPRIGHT, 20)) == 20
    os.kill(plant.spine.pid, signal.SIGKILL)
    until(lambda: plant.spine.supervisor.phase == "stopped")
    with pytest.raises(RigStopped, match="ended by SIGKILL; without its heartbeat"):
        plant.advance(0.01, UPRIGHT, 20)
    plant.close()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("use", [lambda plant: plant.advance(0.01, UPRIGHT, 20), lambda plant: plant.supervisor.lock()])
def test_a_fork_is_refused_though_a_lock_was_held_when_it_was_made(record, use):
    """The fork's copy of a held lock is never released: waiting for it would never end."""
    plant = ready()
    with plant.spine._hearing, plant.spine._calling:
        child = os.fork()
        if not child:
            signal.alarm(5)
            try:
                use(plant)
            except RigError as error:
                os._exit(7 if "is a fork" in str(error) else 8)
            os._exit(9)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    plant.close()


def test_it_moves_and_measures_as_a_spine_in_this_process_does(record):
    """Both follow the same commands, each on the machine's clock: they differ by how late a command was."""
    readings = []
    for clock in (None, SystemClock()):
        plant = ready(clock)
        readings.append(plant.advance(0.01, UPRIGHT, 100))
        plant.halt()
        plant.close()
    for name in ("time", "angle"):
        assert readings[0][name] == pytest.approx(readings[1][name])
    assert readings[0]["position"] == pytest.approx(readings[1]["position"], abs=0.01 * 0.030)
    assert readings[0]["speed"] == pytest.approx(readings[1]["speed"], abs=1e-9)
    assert set(readings[0]["force"]) == set(readings[1]["force"]) == {0.0, 0.01}


def test_a_driver_that_refuses_its_settings_is_told_as_it_is_here(record):
    wrong = dataclasses.replace(settings(), blade=dataclasses.replace(settings().blade, driver="no_such:Stage"))
    with pytest.raises(ValueError, match=r"no_such:Stage.*cannot be imported"):
        rig_plant(wrong).open()
    slow = dataclasses.replace(settings().sensor, rate=2.0 * Balance.rate)
    with pytest.raises(RigError, match="250 readings a second, but the rig's file has 500"):
        rig_plant(dataclasses.replace(settings(), sensor=slow)).open()


def command(number: int = 6, ahead: float = 0.0, hold: float = 0.02, mark: bytes = GO) -> bytes:
    given = time.monotonic() + ahead
    return COMMAND.pack(mark, number, os.getppid(), given, 0.01, UPRIGHT, hold, 0.0, 0.0)


@pytest.mark.promise("S16")
@pytest.mark.parametrize(
    ("message", "cause"),
    [
        (command, None),
        (lambda: command(number=4), Cause.FOREIGN),
        (lambda: command(number=5), Cause.FOREIGN),
        (lambda: command(ahead=3600.0), Cause.OVERRUN),
        (lambda: command(ahead=-0.1), Cause.OVERRUN),
        (lambda: command(ahead=math.nan), Cause.OVERRUN),
        (lambda: command(hold=math.inf), Cause.OVERRUN),
        (lambda: command(hold=LONGEST_HOLD + 0.1), Cause.OVERRUN),
        (lambda: command(hold=math.nan), Cause.OVERRUN),
        (lambda: command(hold=LONGEST_HOLD, mark=TURN), None),
        (lambda: command(hold=LONGEST_HOLD, mark=TURN, ahead=-1.5), Cause.OVERRUN),
        (lambda: command(hold=LONGEST_HOLD, mark=TURN, ahead=3600.0), Cause.OVERRUN),
        (lambda: command()[:-1], Cause.EXCEPTION),
        (lambda: b"\x80noise", Cause.EXCEPTION),
        (lambda: bytes(1 << 20), Cause.EXCEPTION),
    ],
)
def test_what_no_program_would_send_stops_the_blade(message, cause):
    """It is heard by a spine without drivers; the messages before it are good."""
    ours, theirs = Pipe()
    judge, link = Judge(), Link()
    rig = SimpleNamespace(clock=SystemClock(), supervisor=judge)
    served = _Served(rig, theirs, link, os.getpid(), socket.socketpair()[0], None)

    threading.Thread(target=served.run, daemon=True).start()
    ours.send_bytes(command(number=5))
    assert REPLY.unpack(ours.recv_bytes())[:2] == (DONE, 5)
    assert not judge.tripped
    # Apart: nobody reads to its end what is too long, and the process whose end would say so is this one.
    threading.Thread(target=ours.send_bytes, args=(message(),), daemon=True).start()
    if cause is not Cause.EXCEPTION:
        ours.recv_bytes()
    until(lambda: len(judge.tripped) == (cause is not None))
    assert judge.tripped == [cause] * (cause is not None)
    link.close()


# Memory


class Ear:
    """Receiver that keeps what it is given."""

    def __init__(self) -> None:
        self.heard: list[tuple] = []

    def force(self, *what) -> None:
        self.heard.append(("force", *what))

    def motion(self, *what) -> None:
        self.heard.append(("motion", *what))

    def alive(self, *what) -> None:
        self.heard.append(("alive", *what))

    def garbled(self, *what) -> None:
        self.heard.append(("garbled", *what))


def ring(record: int = 64, count: int = 4) -> Ring:
    return Ring(bytearray(ring_size(record, count)), 0, record, count)


def test_what_drivers_report_arrives_as_it_was():
    memory, ear, axes = ring(SampleWriter.RECORD, 8), Ear(), ["blade", "height"]
    writer = SampleWriter(memory, axes)
    force = ForceSample(
        1.5, (1.0, -2.0, math.inf), (1, -(2**31), 3, 4, 5, 6), 0x80000001, 2**32 - 1, 7, (0.1, 0.2, 0.3)
    )
    motion = MotionSample(1.6, 0.1, -0.2, 0.3, DriveState.QUICK_STOP)
    writer.force(force)
    writer.motion("height", motion)
    writer.alive("blade", 1.7)
    writer.garbled("why", 1.8)
    while (record := memory.take()) is not None:
        deliver(record, axes, ear)
    reported = [("force", force), ("motion", "height", motion), ("alive", "blade", 1.7)]
    assert ear.heard == [*reported, ("garbled", "not a reading", 1.8)]


@pytest.mark.promise("S16")
@pytest.mark.parametrize("backwards", [False, True])
def test_no_record_is_read_that_is_half_written(backwards):
    """Each byte of a record may be written or not, from either end, over an older record or over nothing."""
    for over in (0, 4):
        before, after = ring(), ring()
        for number in range(over + 1):
            after.put(bytes([number + 1]) * 40)
            if number < over:
                before.put(bytes([number + 1]) * 40)
        for _ in range(over):
            assert before.take() is not None
        old, new = bytes(before._memory), bytes(after._memory)
        differ = [at for at in range(len(old)) if old[at] != new[at]]
        assert len(differ) > 40
        order = differ[::-1] if backwards else differ
        for at in order:
            assert before.take() is None, f"read before byte {at} was written"
            before._memory[at] = new[at]
        assert before.take() == bytes([over + 1]) * 40


def test_a_reader_who_is_far_behind_goes_on_and_counts_what_it_missed():
    memory = ring(count=4)
    for number in range(11):
        memory.put(bytes([number]))
    seen = []
    while (record := memory.take()) is not None:
        seen.append(record[0])
    assert seen[-1] == 10
    assert seen == list(range(seen[0], 11))
    assert memory.lost == 11 - len(seen)
    with pytest.raises(ValueError, match="too long"):
        memory.put(bytes(65))


def test_a_record_that_was_destroyed_is_passed_over_once_later_ones_are_there():
    memory = ring(count=32)
    for number in range(8):
        memory.put(bytes([number]))
    memory._memory[memory._start + 3 * memory._record] ^= 0xFF  # the third one's number
    assert [memory.take(), memory.take(), memory.take()] == [b"\0", b"\1", None]
    for number in range(8, 12):
        memory.put(bytes([number]))
    assert [memory.take(), memory.lost] == [b"\3", 1]
