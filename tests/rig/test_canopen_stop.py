"""Stops of the axis: a quick stop has the last word, a fault is told, and nothing moves before the operator's reset."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import pytest
from made_up_drive import FAULT, QUICK_STOP, SWITCHED_ON
from waiting import until

from cutenv.rig.devices.canopen.axis import CanopenAxis
from cutenv.rig.devices.protocols import DriveState, Event
from cutenv.rig.errors import RigError


def test_a_drive_in_fault_is_opened_told_and_not_enabled_before_it_is_cleared(benches):
    bench = benches(status=FAULT)
    bench.axis.open(bench.ear)
    assert bench.ear.samples[-1].state is DriveState.FAULT
    with pytest.raises(RigError, match='in "fault"; clear it first'):
        bench.axis.enable()
    assert 0x80 not in bench.drive.controlwords
    bench.clear()
    bench.axis.enable()


def test_a_fault_whose_cause_stays_is_told_by_its_emergency(bench, ready):
    bench.drive.fault_stays = True
    bench.drive.fail(0x8611)
    until(lambda: bench.ear.emergencies)
    assert bench.ear.emergencies == [("blade", 0x8611, "following error")]
    with pytest.raises(RigError, match="0x8611, following error"):
        bench.axis.command(0.01)
    until(lambda: bench.ear.samples[-1].state is DriveState.FAULT)
    with pytest.raises(RigError, match="does not leave its fault"):
        bench.clear()


def test_no_command_follows_an_emergency_even_before_the_statusword_tells(bench, ready):
    bench.drive.send(0x081, bytes.fromhex("20 32 04 00 00 00 00 00"))  # under-voltage; the status stays enabled
    until(lambda: bench.ear.emergencies)
    with pytest.raises(RigError, match="supply voltage too low"):
        bench.axis.command(0.01)


def test_the_end_of_an_error_is_no_emergency(bench, ready):
    bench.drive.send(0x081, bytes(8))
    bench.drive.send(0x081, bytes.fromhex("11 86 20 00 00 00 00 00"))
    until(lambda: bench.ear.emergencies)
    assert [code for _, code, _ in bench.ear.emergencies] == [0x8611]


def test_after_a_quick_stop_nothing_moves_it_before_it_is_cleared(bench, ready):
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
    bench.clear()
    assert bench.drive.status == 0x40
    bench.axis.enable()
    bench.axis.command(0.01)


def failing(call: Callable[[], None]) -> tuple[threading.Thread, list[RigError]]:
    """Begin a call in a thread of its own, and keep what it raises."""
    failed: list[RigError] = []

    def run() -> None:
        try:
            call()
        except RigError as error:
            failed.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    return thread, failed


def test_a_quick_stop_while_it_is_powered_on_wins(bench, opened):
    bench.drive.never = 0x27
    thread, failed = failing(bench.axis.enable)
    until(lambda: bench.drive.status == SWITCHED_ON and bench.drive.controlwords[-1] == 0x0F)
    bench.axis.quick_stop()
    thread.join()
    assert failed
    assert bench.drive.controlwords[bench.drive.controlwords.index(0x0B) :] == [0x0B]


def test_a_quick_stop_while_it_is_cleared_is_a_stop_of_its_own(bench, ready):
    bench.drive.fault_stays = True
    bench.drive.fail(0x8611)
    until(lambda: bench.ear.samples[-1].state is DriveState.FAULT)
    clearing, failed = failing(bench.clear)
    until(lambda: bench.drive.controlwords[-1] == 0x80)
    bench.axis.quick_stop()
    bench.drive.status = 0x40
    clearing.join()
    assert "stopped again" in str(failed[0])
    with pytest.raises(RigError, match="clear it first"):
        bench.axis.enable()
    bench.clear()
    bench.axis.enable()


def test_nothing_is_sent_to_an_axis_whose_latch_another_one_has_closed(bench, ready):
    sent = len(bench.drive.controlwords)
    bench.axis.latch.happens(Event.STOP)
    with pytest.raises(RigError, match="clear it first"):
        bench.axis.command(0.01)
    time.sleep(0.05)
    assert bench.drive.controlwords[sent:] == []


def hurry(axis: CanopenAxis, going: threading.Event) -> None:
    """Command for as long as it is allowed."""
    try:
        while True:
            axis.command(0.001)
            going.set()
    except RigError:
        return


def test_a_stop_against_a_hasty_commander_has_the_last_word(bench, ready):
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
        bench.clear()
        bench.axis.enable()


def test_a_quick_stop_does_not_wait_for_an_answer_to_an_sdo(bench, ready):
    bench.drive.silent_on.add((0x607D, 1))
    thread, failed = failing(bench.axis.limits)
    time.sleep(0.05)  # the request is out, its answer will never come
    bench.axis.quick_stop()
    until(lambda: 0x0B in bench.drive.controlwords)
    assert not failed, "the stop has waited for the SDO"
    thread.join()
    assert "0x607D:01" in str(failed[0])


@pytest.mark.parametrize("state", ["closed", "opened", "enabled", "fault"])
def test_a_quick_stop_is_sent_whatever_the_state(bench, state):
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


def test_a_drive_that_has_restarted_is_broken_for_its_set_up_is_lost(bench, ready):
    bench.drive.send(0x701, b"\x00")
    until(lambda: bench.ear.breaks)
    assert "restarted" in bench.ear.breaks[0][1]
    with pytest.raises(RigError, match="restarted"):
        bench.axis.command(0.01)
    bench.axis.close()
    bench.axis.open(bench.ear)
    bench.axis.enable()


def test_a_drive_that_is_sent_out_of_operation_is_broken(bench, ready):
    bench.drive.send(0x701, b"\x7f")
    bench.drive.send(0x701, b"\x7f")
    until(lambda: bench.ear.breaks)
    assert "not operational" in bench.ear.breaks[0][1]
    time.sleep(0.05)
    assert len(bench.ear.breaks) == 1


def test_a_moving_blade_is_not_left_without_power(bench, ready):
    bench.axis.command(0.02)
    until(lambda: bench.ear.samples[-1].speed != 0.0)
    with pytest.raises(RigError, match="does not come to rest"):
        bench.axis.disable()
    assert bench.drive.status == 0x27


def test_closing_stops_a_moving_blade_signs_off_and_may_be_repeated(bench, ready):
    bench.axis.command(0.02)
    until(lambda: bench.ear.samples[-1].speed != 0.0)
    bench.axis.close()
    assert (bench.drive.status, bench.drive.velocity) == (0x40, 0)
    assert bench.drive.value(0x1016, 1) == 0, "the drive still waits for a heartbeat"
    assert bench.drive.controlwords.index(0x0B) < len(bench.drive.controlwords) - 1
    bench.axis.close()
    with pytest.raises(RigError, match="not open"):
        bench.axis.limits()


def test_a_drive_in_quick_stop_by_itself_is_not_set_going_again(bench, ready):
    bench.drive.status = QUICK_STOP
    until(lambda: bench.ear.samples[-1].state is DriveState.QUICK_STOP)
    with pytest.raises(RigError, match="quick stop active"):
        bench.axis.command(0.01)
    assert bench.drive.controlwords[-1] == 0x0F  # the one that powered it on
    assert bench.drive.status == QUICK_STOP


def test_an_axis_that_is_abandoned_hears_no_heartbeat_until_it_is_cleared(bench, ready):
    until(lambda: {0x080, 0x77F} <= {number for number, _ in bench.drive.frames()})
    bench.axis.withhold_heartbeat("it ignores the quick stop")
    time.sleep(0.1)
    bench.drive.frames()
    time.sleep(0.3)
    heard = {number for number, _ in bench.drive.frames()}
    assert 0x77F not in heard
    assert {0x080, 0x181, 0x281} <= heard  # it is still seen whether it stops
    with pytest.raises(RigError, match="not enabled"):
        bench.axis.command(0.01)
    with pytest.raises(RigError, match="clear it first"):
        bench.axis.enable()
    bench.clear()
    until(lambda: 0x77F in {number for number, _ in bench.drive.frames()})
    bench.axis.enable()
