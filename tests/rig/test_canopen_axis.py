"""The axis against a slave of others' making: what it promises when all is well, and when it is not."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator

import pytest
from made_up_drive import FAULT, QUICK_STOP, SWITCHED_ON, Ear, MadeUpDrive, until

from cutenv.rig.canopen import CanNetwork, CanopenAxis
from cutenv.rig.clock import SystemClock
from cutenv.rig.drivers import RigError
from cutenv.rig.samples import DriveState
from cutenv.rig.settings import Axis, Bus


class Bench:
    """One drive, its axis, and what the axis has told."""

    def __init__(self, settings: Axis | None = None, **drive) -> None:
        self.drive = MadeUpDrive(**drive)
        clock = SystemClock()
        self.network = CanNetwork(Bus(interface="virtual", channel=self.drive.channel), clock)
        self.axis = CanopenAxis(self.network, settings or Axis(), clock)
        self.ear = Ear()

    def ready(self) -> Bench:
        self.axis.open(self.ear)
        self.axis.enable()
        return self

    def close(self) -> None:
        self.axis.close()
        self.drive.close()


@pytest.fixture
def benches() -> Iterator[type[Bench]]:
    made: list[Bench] = []

    class Kept(Bench):
        def __init__(self, *arguments, **drive) -> None:
            super().__init__(*arguments, **drive)
            made.append(self)

    yield Kept
    for bench in made:
        bench.close()
    assert not [thread.name for thread in threading.enumerate() if thread.name.startswith("cutenv ")]


def test_samples_come_in_si_units_as_soon_as_it_is_open(benches):
    bench = benches()
    bench.axis.open(bench.ear)
    bench.drive.position = 4096 * 22  # 22 turns of the motor are 5 of the screw, 10 mm
    until(lambda: bench.ear.samples and bench.ear.samples[-1].position > 0)
    sample = bench.ear.samples[-1]
    assert sample.position == pytest.approx(0.010, rel=1e-12)
    assert sample.torque == 0.125
    assert sample.state is DriveState.DISABLED
    assert bench.axis.units.steps == 1000


def test_a_command_turns_the_motor_and_the_speed_comes_back(benches):
    bench = benches().ready()
    bench.axis.command(0.010)
    assert bench.drive.frames()
    until(lambda: bench.ear.samples[-1].speed != 0.0)
    assert bench.ear.samples[-1].speed == pytest.approx(0.010, abs=bench.axis.units.speed_step)
    assert bench.drive.velocity == 1_320_000  # 5 turns of the screw a second, 22 of the motor, in milli-rpm


def test_an_axis_mounted_the_other_way_round_turns_its_motor_backwards(benches):
    bench = benches(Axis(direction=-1)).ready()
    bench.axis.command(0.010)
    until(lambda: bench.ear.samples[-1].position > 0.0)
    assert bench.ear.samples[-1].speed > 0.0
    assert bench.drive.velocity == -1_320_000
    assert bench.axis.limits()["low"] == pytest.approx(0.0)
    assert bench.axis.limits()["high"] == pytest.approx(0.149, rel=1e-6)


def test_what_the_drive_keeps_is_told_as_limits(benches):
    bench = benches().ready()
    bench.drive.node.set_data(0x6085, 0, (264_000).to_bytes(4, "little"))
    limits = bench.axis.limits()
    assert limits["quick_stop"] == pytest.approx(2.0)
    assert limits["speed"] == pytest.approx(0.0381, rel=1e-6)
    assert limits["acceleration"] == pytest.approx(0.1, rel=1e-4)


@pytest.mark.parametrize(
    ("drive", "found"),
    [
        ({"values": {(0x1018, 1): 0x9A}}, r"0x1018:01 \(vendor\) is 0x0000009A, expected 0x000000FB"),
        ({"values": {(0x1000, 0): 0x00040192}}, r"0x1000:00 \(device type\) is 0x00040192, expected 0x00020192"),
        ({"values": {(0x3003, 1): 3}}, r"gear of 3/5 .* gear = 4.4"),
        ({"values": {(0x3003, 2): 0}}, r"gear of 22/0 "),
        ({"values": {(0x3010, 1): 500}}, r"500 pulses .* pulses = 1024"),
    ],
)
def test_another_drive_than_the_settings_describe_is_refused_by_what_was_found(benches, drive, found):
    bench = benches(**drive)
    with pytest.raises(RigError, match=found):
        bench.axis.open(bench.ear)
    assert set(bench.drive.controlwords) <= {0}


def test_a_node_that_does_not_answer_is_named_with_what_to_look_at(benches):
    bench = benches()
    bench.drive.mute = True
    with pytest.raises(RigError, match=r"node 1 does not answer on virtual .* terminated"):
        bench.axis.open(bench.ear)
    bench.drive.mute = False
    bench.axis.open(bench.ear)  # once it is there


def test_an_object_that_the_drive_refuses_is_named_with_the_reason(benches):
    bench = benches()
    bench.drive.refused[0x6085, 0] = 0x06090031
    with pytest.raises(RigError, match=r"0x6085:00 \(quick stop deceleration\).*Value of parameter written too high"):
        bench.axis.open(bench.ear)


def test_an_object_that_the_drive_does_not_keep_is_named(benches):
    bench = benches()
    bench.drive.kept[0x605A, 0] = 2
    with pytest.raises(RigError, match=r"keeps 2 .*0x605A:00 \(quick stop option\), where 6"):
        bench.axis.open(bench.ear)


@pytest.mark.parametrize(("code", "steps"), [(0x00B44700, 1), (0xFFB44700, 10)])
def test_a_drive_without_milli_rpm_is_told_speeds_in_what_it_counts(benches, code, steps):
    bench = benches()
    bench.drive.refused[0x60A9, 0], bench.drive.kept[0x60A9, 0] = 0x06090030, code
    bench.ready().axis.command(0.010)
    until(lambda: bench.drive.velocity != 0)
    assert bench.axis.units.steps == steps
    assert bench.drive.velocity == 1320 * steps


def test_a_drive_that_counts_in_another_unit_than_revolutions_is_refused(benches):
    bench = benches()
    bench.drive.kept[0x60A9, 0] = 0x00010300  # metres a second
    with pytest.raises(RigError, match="no revolution a minute"):
        bench.axis.open(bench.ear)


def test_a_drive_in_fault_is_opened_told_and_not_enabled_before_it_is_cleared(benches):
    bench = benches(status=FAULT)
    bench.axis.open(bench.ear)
    assert bench.ear.samples[-1].state is DriveState.FAULT
    with pytest.raises(RigError, match='in "fault"; clear it first'):
        bench.axis.enable()
    assert 0x80 not in bench.drive.controlwords
    bench.axis.clear()
    bench.axis.enable()


def test_a_fault_whose_cause_stays_is_told_by_its_emergency(benches):
    bench = benches().ready()
    bench.drive.fault_stays = True
    bench.drive.fail(0x8611)
    until(lambda: bench.ear.emergencies)
    assert bench.ear.emergencies == [("blade", 0x8611, "following error")]
    with pytest.raises(RigError, match="0x8611, following error"):
        bench.axis.command(0.01)
    until(lambda: bench.ear.samples[-1].state is DriveState.FAULT)
    with pytest.raises(RigError, match="does not leave its fault"):
        bench.axis.clear()


def test_no_command_follows_an_emergency_even_before_the_statusword_tells(benches):
    bench = benches().ready()
    bench.drive.send(0x081, bytes.fromhex("20 32 04 00 00 00 00 00"))  # under-voltage; the status stays enabled
    until(lambda: bench.ear.emergencies)
    with pytest.raises(RigError, match="supply voltage too low"):
        bench.axis.command(0.01)


def test_the_end_of_an_error_is_no_emergency(benches):
    bench = benches().ready()
    bench.drive.send(0x081, bytes(8))
    bench.drive.send(0x081, bytes.fromhex("11 86 20 00 00 00 00 00"))
    until(lambda: bench.ear.emergencies)
    assert [code for _, code, _ in bench.ear.emergencies] == [0x8611]


def test_after_a_quick_stop_nothing_moves_it_before_it_is_cleared(benches):
    bench = benches().ready()
    bench.axis.command(0.02)
    until(lambda: bench.drive.velocity != 0)
    bench.axis.quick_stop()
    with pytest.raises(RigError):
        bench.axis.command(0.02)
    with pytest.raises(RigError):
        bench.axis.enable()
    until(lambda: bench.ear.samples[-1].speed == 0.0)
    assert bench.drive.status == QUICK_STOP
    assert bench.drive.controlwords[-1] == 0x0B
    bench.axis.clear()
    assert bench.drive.status == 0x40
    bench.axis.enable()
    bench.axis.command(0.01)


def test_a_quick_stop_while_it_is_powered_on_wins(benches):
    bench = benches()
    bench.axis.open(bench.ear)
    bench.drive.never = 0x27
    failed: list[RigError] = []

    def enable() -> None:
        try:
            bench.axis.enable()
        except RigError as error:
            failed.append(error)

    thread = threading.Thread(target=enable)
    thread.start()
    until(lambda: bench.drive.status == SWITCHED_ON and bench.drive.controlwords[-1] == 0x0F)
    bench.axis.quick_stop()
    thread.join()
    assert failed
    assert bench.drive.controlwords[bench.drive.controlwords.index(0x0B) :] == [0x0B]


def hurry(axis: CanopenAxis, going: threading.Event) -> None:
    """Command for as long as it is allowed."""
    try:
        while True:
            axis.command(0.001)
            going.set()
    except RigError:
        return


def test_a_stop_against_a_hasty_commander_has_the_last_word(benches):
    bench = benches().ready()
    for _ in range(20):
        going = threading.Event()

        thread = threading.Thread(target=hurry, args=(bench.axis, going))
        thread.start()
        going.wait(5.0)
        bench.axis.quick_stop()
        thread.join()
        words = [data[0] for number, data in bench.drive.frames() if number == 0x201]
        assert 0x0F in words
        assert words[-1] == 0x0B
        until(lambda: bench.drive.controlwords[-1:] == [0x0B])
        bench.axis.clear()
        bench.axis.enable()


def test_a_quick_stop_does_not_wait_for_an_answer_to_an_sdo(benches):
    bench = benches().ready()
    bench.drive.silent_on.add((0x607D, 1))
    failed = threading.Event()

    def ask() -> None:
        with pytest.raises(RigError, match="0x607D:01"):
            bench.axis.limits()
        failed.set()

    thread = threading.Thread(target=ask)
    thread.start()
    time.sleep(0.05)  # the request is out, its answer will never come
    bench.axis.quick_stop()
    until(lambda: 0x0B in bench.drive.controlwords)
    assert not failed.is_set(), "the stop has waited for the SDO"
    thread.join()
    assert failed.is_set()


@pytest.mark.parametrize("state", ["closed", "opened", "enabled", "fault"])
def test_a_quick_stop_is_sent_whatever_the_state(benches, state):
    bench = benches()
    if state == "closed":
        with pytest.raises(RigError, match="not open"):
            bench.axis.quick_stop()
        return
    bench.axis.open(bench.ear)
    if state == "enabled":
        bench.axis.enable()
    if state == "fault":
        bench.drive.fail(0x2310)
    bench.axis.quick_stop()
    until(lambda: bench.drive.controlwords[-1] == 0x0B)


def test_a_lost_drive_leaves_every_question_with_an_error_in_time(benches):
    bench = benches().ready()
    bench.drive.die()
    time.sleep(0.1)
    samples, beats = len(bench.ear.samples), len(bench.ear.heartbeats)
    before = time.monotonic()
    for question in (bench.axis.enable, bench.axis.disable, bench.axis.clear, bench.axis.limits):
        with pytest.raises(RigError):
            question()
    bench.axis.close()
    assert time.monotonic() - before < 15.0
    assert (samples, beats) == (len(bench.ear.samples), len(bench.ear.heartbeats))


def test_a_drive_that_has_restarted_is_broken_for_its_set_up_is_lost(benches):
    bench = benches().ready()
    bench.drive.send(0x701, b"\x00")
    until(lambda: bench.ear.breaks)
    assert "restarted" in bench.ear.breaks[0][1]
    with pytest.raises(RigError, match="restarted"):
        bench.axis.command(0.01)
    bench.axis.close()
    bench.axis.open(bench.ear)
    bench.axis.enable()


def test_a_drive_that_is_sent_out_of_operation_is_broken(benches):
    bench = benches().ready()
    bench.drive.send(0x701, b"\x7f")
    bench.drive.send(0x701, b"\x7f")
    until(lambda: bench.ear.breaks)
    assert "not operational" in bench.ear.breaks[0][1]
    time.sleep(0.05)
    assert len(bench.ear.breaks) == 1


def test_a_drive_that_does_not_power_on_is_told_by_its_state(benches):
    bench = benches()
    bench.axis.open(bench.ear)
    bench.drive.never = 0x27
    with pytest.raises(RigError, match=r'does not leave "switched on" within .*safe torque off'):
        bench.axis.enable()


def test_a_moving_blade_is_not_left_without_power(benches):
    bench = benches().ready()
    bench.axis.command(0.02)
    until(lambda: bench.ear.samples[-1].speed != 0.0)
    with pytest.raises(RigError, match="does not come to rest"):
        bench.axis.disable()
    assert bench.drive.status == 0x27


def test_closing_stops_a_moving_blade_signs_off_and_may_be_repeated(benches):
    bench = benches().ready()
    bench.axis.command(0.02)
    until(lambda: bench.ear.samples[-1].speed != 0.0)
    bench.axis.close()
    assert (bench.drive.status, bench.drive.velocity) == (0x40, 0)
    assert bench.drive.value(0x1016, 1) == 0, "the drive still waits for a heartbeat"
    assert bench.drive.controlwords.index(0x0B) < len(bench.drive.controlwords) - 1
    bench.axis.close()
    with pytest.raises(RigError, match="not open"):
        bench.axis.limits()


@pytest.mark.parametrize("speed", [math.nan, math.inf, 0.0382, -1.0, None, "fast"])
def test_a_speed_that_is_none_never_reaches_the_bus(benches, speed):
    bench = benches().ready()
    sent = len(bench.drive.controlwords)
    with pytest.raises((TypeError, ValueError), match="speed"):
        bench.axis.command(speed)
    assert len(bench.drive.controlwords) == sent


def test_it_is_not_commanded_before_it_is_enabled(benches):
    bench = benches()
    with pytest.raises(RigError, match="before it is open"):
        bench.axis.command(0.01)
    bench.axis.open(bench.ear)
    with pytest.raises(RigError, match="not enabled"):
        bench.axis.command(0.01)
    assert 0x0F not in bench.drive.controlwords


def test_opening_twice_is_refused(benches):
    bench = benches()
    bench.axis.open(bench.ear)
    with pytest.raises(RigError, match="open already"):
        bench.axis.open(bench.ear)


def test_a_drive_in_quick_stop_by_itself_is_not_set_going_again(benches):
    bench = benches().ready()
    bench.drive.status = QUICK_STOP
    until(lambda: bench.ear.samples[-1].state is DriveState.QUICK_STOP)
    with pytest.raises(RigError, match="quick stop active"):
        bench.axis.command(0.01)
    assert bench.drive.controlwords[-1] == 0x0F  # the one that powered it on
    assert bench.drive.status == QUICK_STOP
