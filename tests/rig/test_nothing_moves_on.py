"""What is to rest does rest: a quick stop that is lost, a hinge that was still turning, a locked axis that moves."""

from __future__ import annotations

import math

import pytest
from made_ready import ready_rig

from cutenv.emulation.fake_rig import FakeRig
from cutenv.rig.devices.protocols import DriveState
from cutenv.rig.safety.stop_causes import RESEND_STOP_AFTER, STOP_PERIOD, WITHHOLD_HEARTBEAT_AFTER, Cause, RigStopped

UPRIGHT, LEANING = math.pi / 2, math.radians(60.0)
PERIOD = 20  # [ms]
SYNC = 0.005  # [s]


def cut_for(rig: FakeRig, seconds: float, angle: float = UPRIGHT) -> None:
    for _ in range(round(seconds / (PERIOD * 1e-3))):
        rig.plant.advance(0.01, angle, PERIOD)


def pass_time(rig: FakeRig, seconds: float) -> None:
    rig.clock.sleep_until(rig.clock.now() + seconds)


@pytest.mark.parametrize("lost", [0, 1, 2, 5])
@pytest.mark.promise("S6")
def test_a_quick_stop_that_is_lost_is_sent_again_until_the_drive_obeys(rig, lost):
    cut_for(rig, 0.2)
    rig.faults.quick_stops_lost = lost
    rig.plant.supervisor.trip(Cause.OPERATOR, "as told")
    pass_time(rig, 0.1)
    report = rig.plant.supervisor.report
    sent = [time for time, what in rig.blade.sent if what == "quick stop"]
    assert len(sent) == lost + 1
    assert sent[0] == report.commanded
    assert sent[lost > 0] <= report.commanded + RESEND_STOP_AFTER + SYNC
    assert rig.blade.state is DriveState.QUICK_STOP
    assert report.standstill is not None
    assert rig.bench.motion[1] == 0.0


@pytest.mark.promise("S6")
def test_a_drive_that_never_obeys_is_left_by_the_heartbeat(rig):
    cut_for(rig, 0.2)
    rig.faults.quick_stops_lost = 10**6
    rig.plant.supervisor.trip(Cause.OPERATOR, "as told")
    pass_time(rig, 0.2)
    (abandoned,) = (time for time, what in rig.blade.sent if what == "abandoned")
    report = rig.plant.supervisor.report
    assert (
        RESEND_STOP_AFTER + WITHHOLD_HEARTBEAT_AFTER
        <= abandoned - report.commanded
        <= RESEND_STOP_AFTER + WITHHOLD_HEARTBEAT_AFTER + 2 * SYNC + 1e-9
    )
    assert "our heartbeat ends" in report.detail
    assert report.standstill is not None


def test_a_drive_that_nobody_sees_is_told_again_and_not_left_by_the_heartbeat(rig):
    cut_for(rig, 0.2)
    rig.faults.quick_stops_lost, rig.faults.motion_silent = 5, True
    rig.plant.supervisor.trip(Cause.OPERATOR, "as told")
    pass_time(rig, 0.090)
    report = rig.plant.supervisor.report
    sent = [time for time, _ in rig.blade.sent]
    assert sent[1] <= report.commanded + rig.settings.limits.stale_motion + STOP_PERIOD + 1e-9
    assert rig.blade.state is DriveState.QUICK_STOP
    assert rig.bench.motion[1] == 0.0
    rig.faults.motion_silent = False
    pass_time(rig, 0.1)
    assert {what for _, what in rig.blade.sent} == {"quick stop"}
    assert report.standstill is not None


def test_quick_stops_go_on_while_nothing_is_seen_and_end_once_it_is(rig):
    cut_for(rig, 0.2)
    rig.faults.motion_silent = True
    rig.plant.supervisor.trip(Cause.OPERATOR, "as told")
    for _ in range(5):
        before = len(rig.blade.sent)
        pass_time(rig, 1.0)
        assert len(rig.blade.sent) - before >= 0.9 / STOP_PERIOD
    rig.faults.motion_silent = False
    pass_time(rig, 0.1)
    told = len(rig.blade.sent)
    pass_time(rig, 1.0)
    assert len(rig.blade.sent) == told


def test_a_drive_that_has_obeyed_and_is_no_longer_seen_is_told_again(rig):
    """Whoever gives it power then is not seen either."""
    cut_for(rig, 0.2)
    rig.plant.supervisor.trip(Cause.OPERATOR, "as told")
    pass_time(rig, 0.2)
    assert len(rig.blade.sent) == 1
    rig.faults.motion_silent = True
    pass_time(rig, 0.2)
    rig.blade.state, rig.blade.target = DriveState.ENABLED, 0.01
    pass_time(rig, 0.02)
    assert rig.blade.state is DriveState.QUICK_STOP
    assert {what for _, what in rig.blade.sent} == {"quick stop"}


def test_at_the_end_of_a_cut_a_turning_hinge_rests_at_once(rig):
    cut_for(rig, 0.5)
    cut_for(rig, 0.1, LEANING)
    begun = rig.bench.motion[2]
    rig.plant.halt()
    assert rig.plant.supervisor.phase == "unready"
    assert abs(rig.bench.motion[2] - begun) < math.radians(0.2)


def test_a_lock_bids_every_axis_rest(rig):
    cut_for(rig, 0.1, LEANING)
    rig.plant.supervisor.drive(0.00004, LEANING, 0.02)  # so slow that it counts as standing
    assert rig.angle.target != 0.0
    assert rig.blade.target != 0.0
    rig.plant.supervisor.lock()
    assert (rig.blade.target, rig.angle.target) == (0.0, 0.0)
    assert rig.plant.supervisor.phase == "unready"


@pytest.mark.parametrize(("axis", "speed", "moves"), [("blade", 0.01, "mm"), ("angle", -0.5, "degrees")])
def test_a_locked_axis_that_moves_by_itself_is_stopped(rig, axis, speed, moves):
    rig.plant.halt()
    pass_time(rig, 0.5)
    assert rig.plant.supervisor.phase == "unready"
    drive = rig.blade if axis == "blade" else rig.angle
    drive.target = speed
    pass_time(rig, 0.5)
    report = rig.plant.supervisor.report
    assert (report.cause, rig.plant.supervisor.phase) == (Cause.FOLLOWING, "stopped")
    assert f"locked, the {axis} axis moves" in report.detail
    assert moves in report.detail
    assert drive.state is DriveState.QUICK_STOP


def test_an_axis_without_power_may_be_pushed_by_hand(rig):
    rig.plant.halt()
    rig.plant.switch_off()
    for _ in range(100):
        rig.bench.step(0.02, 0.0, False)  # 20 ms, but for the bench alone
        pass_time(rig, 0.01)
    assert rig.plant.supervisor.phase == "unready"


def test_a_policy_that_is_late_stops_a_hinge_that_turns_above_a_resting_blade(rig):
    for _ in range(5):
        rig.plant.advance(0.0, UPRIGHT, PERIOD)
    rig.plant.advance(0.0, LEANING, PERIOD)
    assert rig.angle.target != 0.0
    pass_time(rig, 0.1)
    assert rig.plant.supervisor.report.cause is Cause.OVERRUN
    assert rig.angle.state is DriveState.QUICK_STOP


def test_a_policy_may_think_while_nothing_moves(rig):
    for _ in range(100):
        rig.plant.advance(0.0, UPRIGHT, PERIOD)
    pass_time(rig, 5.0)
    assert rig.plant.supervisor.phase == "ready"


def test_a_hinge_whose_encoder_is_stuck_is_stopped(rig):
    cut_for(rig, 0.1)
    rig.faults.turn_stuck = True
    begun = rig.clock.now()
    with pytest.raises(RigStopped) as stopped:
        cut_for(rig, 1.0, LEANING)
    assert stopped.value.report.cause is Cause.STUCK
    assert "hinge" in stopped.value.report.detail
    assert stopped.value.report.detected - begun < 0.1
    assert rig.angle.state is DriveState.QUICK_STOP


def test_a_hinge_that_turns_as_told_is_let_turn(rig):
    for _ in range(4):
        cut_for(rig, 0.7, LEANING)
        cut_for(rig, 0.7, UPRIGHT)
    assert rig.plant.supervisor.phase == "ready"


def test_a_hinge_beyond_its_limit_is_stopped():
    rig = ready_rig(angle_low=math.radians(70.0))
    cut_for(rig, 1.0, LEANING)  # commands keep within the limit
    assert rig.plant.supervisor.phase == "ready"
    rig.bench._angle = math.radians(69.0)
    with pytest.raises(RigStopped) as stopped:
        cut_for(rig, 0.1)
    assert stopped.value.report.cause is Cause.ANGLE


def test_a_second_release_does_not_end_the_watch_on_the_last_command(rig):
    cut_for(rig, 0.2)
    rig.plant.supervisor.release()
    pass_time(rig, 0.2)
    assert rig.plant.supervisor.report.cause is Cause.OVERRUN
