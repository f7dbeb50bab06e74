"""Each mechanism that stops the blade does so alone, where another one would hide that it is gone."""

from __future__ import annotations

import json
import math
import os
import signal
import socket
import threading
import time
from collections.abc import Callable
from multiprocessing import Pipe
from types import SimpleNamespace
from typing import Any

import pytest
from made_ready import ready_rig, ready_to_descend
from stage_in_memory import Judge, settings
from waiting import until

from cutenv.emulation.fake_rig import FakeRig
from cutenv.rig.config.settings import Bus, SensorSettings, fake_settings
from cutenv.rig.devices.canopen.axis import UNDER_WAY
from cutenv.rig.devices.canopen.network import CanNetwork
from cutenv.rig.devices.loop import AT_ONCE, FakeClock, SystemClock
from cutenv.rig.devices.netft_sensor import NetftSensor
from cutenv.rig.devices.protocols import DriveState, ForceSample, Latch, MotionSample, Phase
from cutenv.rig.devices.serial.board import SerialBoard
from cutenv.rig.errors import RigError
from cutenv.rig.remote_spine import RemoteSpine
from cutenv.rig.safety.monitors import MotionMonitor
from cutenv.rig.safety.stop_causes import Cause, StopReport
from cutenv.rig.safety.supervisor import ASLEEP
from cutenv.rig.spine_process import COMMAND, GO, Link, SampleWriter, _Served, cut_to

UPRIGHT = math.pi / 2
SOON = 0.003  # [s]


def cutting(**limits: Any) -> FakeRig:
    rig = ready_rig(**limits)
    rig.plant.advance(0.01, UPRIGHT, 200)
    return rig


def refuse(*arguments: Any, **named: Any) -> None:
    raise OSError("the line is cut")


def report_of(rig: FakeRig) -> StopReport:
    report = rig.plant.supervisor.report
    assert report is not None, "nothing stops the blade"
    return report


# A watchdog that sleeps


@pytest.mark.promise("S8")
def test_a_reading_alone_notices_a_watchdog_that_sleeps():
    rig = cutting()
    slept = rig.clock.now()
    rig.plant.spine.timers[0].stop()
    rig.clock.sleep_until(slept + 0.2)
    report = report_of(rig)
    assert (report.cause, "watchdog" in report.detail) == (Cause.EXCEPTION, True)
    assert report.detected - slept < ASLEEP + SOON


@pytest.mark.promise("S8")
def test_a_command_alone_notices_a_watchdog_that_sleeps():
    rig = cutting()
    rig.plant.spine.timers[0].stop()
    rig.faults.force_silent = True
    rig.clock.sleep_until(rig.clock.now() + 0.2)
    assert rig.plant.supervisor.report is None
    rig.plant.supervisor.drive(0.01, UPRIGHT, 0.02)
    assert (report_of(rig).cause, "watchdog" in report_of(rig).detail) == (Cause.EXCEPTION, True)


# Its sign of life


@pytest.mark.promise("S8")
def test_one_axis_that_nobody_judges_ends_the_heartbeat_on_a_bus_of_two():
    clock, sent = FakeClock(), []
    network = CanNetwork(Bus(), clock)
    latches = [Latch(), Latch()]
    network._members = [SimpleNamespace(name=f"axis {n}", latch=latch) for n, latch in enumerate(latches)]
    network.send_message = lambda number, data: sent.append(number)
    for latch in latches:
        latch.judged = clock.now()
    network._beat()
    assert sent == [0x700 + Bus().node]
    clock.sleep_until(clock.now() + 0.025)
    latches[0].judged = clock.now()
    network._beat()
    assert len(sent) == 1


@pytest.mark.promise("S8")
def test_a_board_hears_no_sign_of_life_of_a_rig_that_nobody_judges():
    sent, watched = [], [True]
    board = SerialBoard("none", 9600, FakeClock())
    board._members = [
        SimpleNamespace(allows_heartbeat=lambda now: True),
        SimpleNamespace(allows_heartbeat=lambda now: watched[0]),
    ]
    board.send = sent.append
    board._live()
    watched[0] = False
    board._live()
    assert sent == ["H"]


def test_a_rig_that_is_closed_is_judged_by_nobody_and_may_be_opened_again():
    rig = cutting()
    rig.plant.close()
    assert rig.blade.latch.allows_heartbeat("blade", rig.clock.now() + 1.0)


# Faults of a driver, and of what the loop repeats


def test_what_fails_in_the_loop_is_a_fault():
    rig = cutting()
    rig.clock.failed("cutenv SYNC failed: OSError: the line is cut")
    assert (report_of(rig).cause, "SYNC failed" in report_of(rig).detail) == (Cause.EXCEPTION, True)


@pytest.mark.parametrize(
    ("error", "cause", "said"),
    [(OSError, Cause.EXCEPTION, "the angle axis: OSError: the line is cut"), (RigError, Cause.BUS, "the line is cut")],
)
@pytest.mark.promise("S7")
def test_a_command_that_raises_stops_at_once(error, cause, said):
    rig = cutting()

    def raises(speed: float) -> None:
        raise error("the line is cut")

    rig.angle.command = raises
    rig.plant.supervisor.drive(0.01, UPRIGHT, 0.02)
    assert rig.plant.supervisor.report is None  # the angle has no part in it
    rig.plant.supervisor.turn(0.1)
    assert (report_of(rig).cause, said in report_of(rig).detail) == (cause, True)
    assert rig.blade.state is DriveState.QUICK_STOP


def test_a_command_that_meets_a_stop_is_stopped_once_more():
    """The driver has looked before the stop, and its frame comes behind it: some drives start again."""
    rig = cutting()

    def late(speed: float) -> None:
        rig.plant.supervisor.trip(Cause.OPERATOR, "at this very moment")
        rig.blade.state, rig.blade.target = DriveState.ENABLED, speed

    rig.blade.command = late
    rig.plant.supervisor.drive(0.01, UPRIGHT, 0.02)
    assert rig.blade.state is DriveState.QUICK_STOP


def test_an_answer_to_another_master_that_fails_is_no_failure_of_the_reader():
    rig = cutting()
    rig.blade.quick_stop = refuse
    for _ in range(3):
        rig.plant.spine.foreign("blade", "RPDO1", rig.clock.now())
        rig.clock.sleep_until(rig.clock.now() + 0.001)
    assert report_of(rig).cause is Cause.FOREIGN


def another_frame(limit: float) -> SimpleNamespace:
    """Return one more frame, as often as it is asked for."""
    kinds = dict.fromkeys(("is_error_frame", "is_remote_frame", "is_extended_id"), False)
    return SimpleNamespace(arbitration_id=0x7FF, data=b"", **kinds)


def test_a_flood_of_frames_or_packets_holds_the_loop_up_for_no_longer_than_its_share():
    network = CanNetwork(Bus(), FakeClock())
    frames: list[int] = []
    network.listen(0x7FF, lambda data, time: frames.append(1))
    network._read(SimpleNamespace(recv=another_frame))
    assert len(frames) == AT_ONCE
    sensor = NetftSensor(SensorSettings(address="127.0.0.1"), FakeClock())
    sensor._receive(SimpleNamespace(recvfrom=lambda most: (b"", ("somewhere", 1))))
    assert sensor.counters.foreign == AT_ONCE


def test_a_bus_that_breaks_while_a_command_is_sent_is_reported_by_the_loop():
    """Whoever sends may hold the lock that a member needs to stop the blade."""
    network, lost = CanNetwork(Bus(), FakeClock()), []
    network._members.append(SimpleNamespace(name="blade", latch=Latch(), lost=lambda why, time: lost.append(why)))
    network._break("the cable is out")
    assert not lost
    network._read(SimpleNamespace(recv=lambda limit: None))
    assert lost == ["the cable is out"]


@pytest.mark.promise("S7")
def test_a_driver_that_never_returns_does_not_hold_up_the_end(monkeypatch):
    """It hangs in the command of zero that locks a rig at rest."""
    monkeypatch.setattr("cutenv.rig.spine._LOCKED_WITHIN", 0.05)
    rig = ready_rig()
    held: list[float] = []
    over = threading.Event()

    def hang(speed: float) -> None:
        held.append(speed)
        over.wait(10.0)

    begun = time.monotonic()
    rig.blade.command = hang
    rig.plant.close()
    assert held == [0.0]
    assert rig._listeners["angle"] is None
    assert time.monotonic() - begun < 5.0
    over.set()


@pytest.mark.promise("S10")
def test_a_hinge_turns_for_as_long_as_a_command_is_valid_and_without_one_not_at_all():
    """A blade that rests, above which the hinge is told to turn before, or long after, any command."""
    for thinks in (None, 5.0):
        rig = ready_rig()
        if thinks is not None:
            rig.plant.supervisor.drive(0.0, UPRIGHT, 0.02)
            rig.clock.sleep_until(rig.clock.now() + thinks)
        assert rig.plant.supervisor.report is None
        told = rig.clock.now()
        rig.plant.supervisor.turn(-0.1)
        rig.clock.sleep_until(told + 0.1)
        assert (report_of(rig).cause, report_of(rig).detected - told < SOON) == (Cause.OVERRUN, True)


# Times and numbers


@pytest.mark.parametrize("told", [1.7e9, math.nan, -1.0])
@pytest.mark.parametrize("tell", ["foreign", "broken", "emergency"])
@pytest.mark.promise("S7")
def test_a_stop_is_dated_here_whatever_the_driver_says(tell, told):
    rig = cutting()
    what = (0x8611, "following error") if tell == "emergency" else ("as told",)
    getattr(rig.plant.spine, tell)("blade", *what, told)
    assert report_of(rig).detected == rig.clock.now()


@pytest.mark.parametrize("wrong", ["position", "speed", "torque"])
@pytest.mark.parametrize("axis", ["blade", "angle"])
def test_a_sample_that_is_no_number_is_a_breach_at_once(axis, wrong):
    watch = MotionMonitor(fake_settings(), follows=True)
    sample = MotionSample(0.0, UPRIGHT if axis == "angle" else 0.02, 0.0, 0.0, DriveState.ENABLED)
    watch.note(axis, sample)
    assert watch.check(axis, 0.0) is None
    watch.note(axis, sample._replace(time=0.005, **{wrong: math.nan}))
    breach = watch.check(axis, 0.0)
    assert breach is not None
    assert breach.cause is Cause.NOT_A_NUMBER


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("which", ["speed", "angle", "height"])
@pytest.mark.promise("S10")
def test_a_command_that_is_no_number_stops_and_none_of_it_is_sent(which, value):
    rig = ready_to_descend()
    heard: list[float] = []
    rig.heard = lambda time, axis, speed: heard.append(speed)
    command = {"speed": 0.01, "angle": UPRIGHT, "height": 0.0} | {which: value}
    rig.plant.supervisor.drive(command["speed"], command["angle"], 0.02, height=command["height"])
    assert report_of(rig).cause is Cause.NOT_A_NUMBER
    assert heard == []


# What a spine sees of its program


class Seen:
    """Spine without drivers that is served; ``signals`` and ``parent`` are what can be written to."""

    def __init__(self, program: int | None = None) -> None:
        self.judge, self.link = Judge(), Link()
        receiving, self.signals = socket.socketpair()
        receiving.setblocking(False)
        self.closed: list[bool] = []
        spine = SimpleNamespace(clock=SystemClock(), supervisor=self.judge)
        self.served = _Served(spine, Pipe()[0], self.link, program or os.getppid(), receiving, None)
        self.served._closed = lambda: self.closed.append(True)
        (self.ending, self.parent) = socket.socketpair()


def ask(seen: Seen) -> None:
    seen.link.stops.put(json.dumps({"cause": Cause.OPERATOR.value, "detail": "the button"}).encode())


def end_parent(seen: Seen) -> None:
    seen.served._parents_end = seen.ending.fileno()
    seen.parent.close()


@pytest.mark.parametrize(
    ("happens", "cause"),
    [
        (lambda seen: None, None),
        (lambda seen: seen.signals.send(bytes([signal.SIGTERM])), Cause.INTERRUPTED),
        (lambda seen: seen.signals.send(bytes([signal.SIGINT])), Cause.INTERRUPTED),
        (ask, Cause.OPERATOR),
        (end_parent, Cause.ORPHANED),
    ],
    ids=["nothing", "SIGTERM", "SIGINT", "asked", "parent"],
)
@pytest.mark.promise("S16")
def test_the_loop_alone_sees_what_ends_a_program(happens: Callable[[Seen], Any], cause: Cause | None) -> None:
    seen = Seen()
    happens(seen)
    seen.served.look(0.0)
    assert seen.judge.tripped == [cause] * (cause is not None)
    assert seen.closed == []


@pytest.mark.promise("S16")
def test_the_loop_alone_sees_the_death_of_the_program_and_closes_the_rig_once():
    seen = Seen(program=os.getpid())  # whose child this process is not
    for _ in range(3):
        seen.served.look(0.0)
    assert set(seen.judge.tripped) == {Cause.ORPHANED}
    until(lambda: seen.closed)
    assert seen.closed == [True]


@pytest.mark.promise("S16")
def test_a_command_of_a_program_whose_parent_has_changed_stops_the_blade():
    seen = Seen()
    for number, parent in enumerate((os.getppid(), os.getppid(), 1), start=1):
        assert seen.judge.tripped == []
        given = seen.served.spine.clock.now()
        seen.served._commanded(COMMAND.pack(GO, number, parent, given, 0.01, UPRIGHT, 0.5, 0.0, 0.0))
    assert seen.judge.tripped == [Cause.ORPHANED]


# What a program sees of its spine


def deaf_spine() -> tuple[RemoteSpine, list[str], list[float]]:
    """Spine of a program without its process, with what was asked of it, and when the program killed it."""
    spine, asked, killed = RemoteSpine(settings()), [], []
    spine._link = Link()
    spine._process = SimpleNamespace(poll=lambda: -9 if killed else None, kill=lambda: killed.append(1.0), wait=None)
    spine.supervisor.last_phase = Phase.READY
    return spine, asked, killed


@pytest.mark.promise("S16")
@pytest.mark.parametrize("lost", [True, False])
def test_readings_that_are_lost_or_do_not_come_are_a_stop(lost):
    spine, asked, _ = deaf_spine()
    spine.ask_for_stop = lambda cause, detail: asked.append(detail)
    samples = spine._link.samples
    write = SampleWriter(samples, ["blade"])
    for number in range(200):
        write.force(ForceSample(0.0, (0.0, 0.0, 0.0), (number,) * 6, 0, number, 0))
    if lost:
        samples._memory[samples._start + 3 * samples._record] ^= 0xFF
    spine.hear()
    assert [why.partition(":")[0] for why in asked] == ["1 readings of the spine are lost"] * lost
    if not lost:
        spine._heard_at -= 0.25  # seconds ago
        spine.hear()
        spine.hear()
        assert [why.partition(":")[0] for why in asked] == ["nothing comes from the spine any more"]
    spine._link.close()


@pytest.mark.promise("S16")
def test_a_spine_that_does_not_hear_a_stop_loses_its_line_before_it_is_killed():
    spine, _, killed = deaf_spine()
    spine._line, other = Pipe()
    ended: list[bool] = []

    def kill() -> None:
        ended.append(other.poll(0.0))  # its end can be read
        killed.append(1.0)

    spine._process.kill = kill
    begun = time.monotonic()
    spine.ask_for_stop(Cause.OPERATOR, "the button")
    assert 0.4 < time.monotonic() - begun < 5.0  # half a second, on a busy machine some more
    assert ended == [True]
    assert spine.gone
    with pytest.raises(EOFError):
        other.recv_bytes()


@pytest.mark.promise("S16")
@pytest.mark.parametrize("letter", ["x", "ы", "\x00", "😀"])
def test_a_stop_with_a_long_text_in_any_letters_is_asked_for_and_told(letter):
    spine, _, _ = deaf_spine()
    spine._ask({"cause": Cause.EXCEPTION.value, "detail": cut_to(letter * 5000, 800)})
    asked = spine._link.stops.take()
    assert asked is not None
    assert json.loads(asked)["detail"].startswith(letter * 40)
    report = StopReport(cause=Cause.EXCEPTION, detail=letter * 5000, detected=1.0)
    served = SimpleNamespace(
        supervisor=SimpleNamespace(report=report, phase=Phase.STOPPED, limited=0), _heard=1, _told=(), _link=spine._link
    )
    _Served._tell(served)
    spine.hear()
    assert spine.supervisor.last_phase is Phase.STOPPED
    assert spine.supervisor._report.detail.startswith(letter * 40)
    spine._link.close()


@pytest.mark.promise("S16")
def test_a_signal_while_readings_are_taken_in_waits_for_nothing():
    """Its handler asks for the phase in the thread that it has interrupted: with the lock held, or amid a reading."""
    spine, asked, _ = deaf_spine()
    spine.ask_for_stop = lambda cause, detail: asked.append(detail)
    heard: list[Any] = []

    class Interrupted:
        def force(self, sample: ForceSample) -> None:
            heard.append(spine.supervisor.phase)

    spine._receiver = Interrupted()
    SampleWriter(spine._link.samples, ["blade"]).force(ForceSample(0.0, (0.0, 0.0, 0.0), (0,) * 6, 0, 1, 0))
    hearing = threading.Thread(target=lambda: [spine._hearing.acquire(), spine.hear()], daemon=True)
    hearing.start()
    hearing.join(10.0)
    assert heard == [Phase.READY]
    assert asked == []
    spine._link.close()


@pytest.mark.promise("S5")
def test_a_locked_axis_whose_place_is_no_number_is_stopped():
    rig = cutting()
    supervisor = rig.plant.supervisor
    supervisor.lock()
    supervisor.motion("blade", MotionSample(rig.clock.now(), math.nan, 0.0, 0.0, DriveState.ENABLED))
    assert (supervisor.phase, report_of(rig).cause) == (Phase.STOPPED, Cause.FOLLOWING)


@pytest.mark.promise("S7")
@pytest.mark.parametrize("report", [
    lambda spine: spine.emergency("blade", "8611", "a text for a number", 0.0),
    lambda spine: spine.alive(["no name"], 0.0),
    lambda spine: spine.motion("blade", None),
    lambda spine: spine.force(None),
])  # fmt: skip
def test_a_report_that_cannot_be_judged_is_a_fault_whatever_it_is_of(report):
    rig = cutting()
    report(rig.plant.spine)
    assert report_of(rig).cause is Cause.EXCEPTION
    assert "cannot be judged: " in report_of(rig).detail


def counted(seconds: float, unanswered_every: float) -> list[int]:
    """Answers of a node that are under way, at every SYNC; one more does not come every so many seconds."""
    network, under_way, period = CanNetwork(Bus(), FakeClock()), [], Bus().sync
    for number in range(round(seconds / period)):
        network._syncs += 1
        if number % round(unanswered_every / period) or number == 0:
            network.answered(1)
        under_way.append(network.unanswered(1))
    return under_way


def test_a_bus_that_is_slowly_later_and_later_is_found():
    """A second of growth by one SYNC a second is 5 ms: the quick stop would be as late as the answers."""
    assert max(counted(60.0, 10.0)) <= UNDER_WAY  # answers that are lost now and then
    under_way = counted(60.0, 1.0)
    late = next(number for number, each in enumerate(under_way) if each > UNDER_WAY)
    assert late * Bus().sync < 20.0


def test_a_bus_that_is_opened_again_begins_to_count_anew():
    network = CanNetwork(Bus(), FakeClock())
    network._syncs = 50
    network.answered(1)
    network.answered(1)
    network.unanswered(1)
    network._use(SimpleNamespace(recv=lambda timeout: None), None)
    network._syncs += 1
    assert network.unanswered(1) == 0
