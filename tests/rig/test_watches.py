"""What each packet and each sample is checked for, one rule at a time, at its limit and just below it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cutenv.rig.config.settings import MOST_BLIND, Identified, SafetyLimits, fake_settings
from cutenv.rig.devices.protocols import DriveState, ForceSample, MotionSample
from cutenv.rig.safety.monitors import FollowingMonitor, ForceMonitor, ForceReadings, MotionMonitor
from cutenv.rig.safety.stop_causes import STILL, SURPLUS, Cause, SampleRateMonitor

SYNC = 0.005
LIMITS = SafetyLimits()


def reading(n: int, force=(0.0, 0.0, 0.0), *, time=None, status=0, lost=0, counts=None, sequence=None) -> ForceSample:
    counts = (n, 2 * n, 3 * n, 0, 0, 0) if counts is None else counts
    return ForceSample(
        1e-3 * n if time is None else time, force, counts, status, n if sequence is None else sequence, lost
    )


def causes(samples: list[ForceSample]) -> list[Cause | None]:
    watch = ForceMonitor(LIMITS, ForceReadings(1000.0))
    return [breach and breach.cause for breach in map(watch.check, samples)]


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_force_beyond_the_limit_of_an_axis_is_found_in_its_own_packet(axis, sign):
    force = [0.0, 0.0, 0.0]
    force[axis] = sign * (LIMITS.force - 0.01)
    below = reading(1, tuple(force))
    force[axis] = sign * (LIMITS.force + 0.01)
    assert causes([below, reading(2, tuple(force))]) == [None, Cause.FORCE]


def test_the_norm_counts_where_no_axis_does():
    share = LIMITS.force_norm / math.sqrt(3.0)
    assert share < LIMITS.force
    assert causes([reading(1, (share - 0.01,) * 3), reading(2, (share + 0.01,) * 3)]) == [None, Cause.FORCE]


def test_a_rise_is_a_breach_and_a_fall_is_a_crack_that_runs():
    step = LIMITS.force_rise * 0.010 + 0.01
    low, high = [reading(n) for n in range(1, 20)], [reading(n, (step, 0.0, 0.0)) for n in range(20, 40)]
    assert Cause.FORCE_RISE in causes(low + high)
    falling = [reading(n, (step, 0.0, 0.0)) for n in range(1, 20)] + [reading(n) for n in range(20, 40)]
    assert set(causes(falling)) == {None}


def test_a_force_that_turns_round_has_risen_by_all_that_it_passed():
    there = [reading(n, (0.0, 5.0, 0.0)) for n in range(1, 20)]
    for other in ((0.0, -5.0, 0.0), (5.0, 0.0, 0.0), (0.0, 5.0, 2.1)):
        assert Cause.FORCE_RISE in causes([*there, reading(20, other)]), other
    for fallen in ((0.0, 0.0, 0.0), (0.0, 2.0, 0.0), (1.9, 2.0, 0.0)):  # and a little to the side, by noise
        assert set(causes([*there, reading(20, fallen)])) == {None}, fallen


@pytest.mark.parametrize(
    ("torque", "cause"),
    [((0.0, 2.9, 0.0), None), ((2.0, -2.0, 2.0), Cause.TORQUE), ((math.nan, 0.0, 0.0), Cause.NOT_A_NUMBER)],
)
def test_the_torque_has_a_limit_of_its_own(torque, cause):
    assert causes([reading(1), reading(2)._replace(torque=torque)]) == [None, cause]


@given(st.floats(0.0, 13.0))
def test_tissue_as_stiff_as_any_that_was_measured_never_rises_too_fast(slope):
    samples = [reading(n, (min(slope * 1e-3 * n, 14.0), 0.0, 0.0)) for n in range(1, 400)]
    assert set(causes(samples)) == {None}


def test_status_not_a_number_and_restart():
    assert causes([reading(1), reading(2, status=0x80000000)])[-1] is Cause.FORCE_STATUS
    assert causes([reading(1), reading(2, (math.nan, 0.0, 0.0))])[-1] is Cause.NOT_A_NUMBER
    assert causes([reading(5000), reading(5001), reading(5002, sequence=3)])[-1] is Cause.FORCE_STATUS
    assert causes([reading(2**32 - 1, time=0.0), reading(1, time=0.001, sequence=0)])[-1] is None  # it wraps round


def test_frozen_readings_are_found_after_20_ms_and_two_equal_ones_are_none():
    frozen = [reading(n, counts=(7, 7, 7, 7, 7, 7)) for n in range(1, 40)]
    found = causes(frozen)
    assert found[:20] == [None] * 20
    assert found[20] is Cause.FORCE_FROZEN
    pairs = [reading(n, counts=(n // 2,) * 6) for n in range(1, 200)]
    assert set(causes(pairs)) == {None}


@pytest.mark.parametrize(("every", "found"), [(3, True), (10, False)])
def test_lost_readings_count_by_their_share(every, found):
    """Of three, two are lost; of ten, one."""
    if every == 3:
        samples = [reading(n, lost=2) for n in range(3, 600, 3)]
    else:
        samples = [reading(n, lost=1 if n % 10 == 1 else 0) for n in range(11, 600) if n % 10]
    assert (Cause.FORCE_LOST in causes(samples)) is found


def test_readings_that_come_later_than_they_did():
    on_time = [reading(n) for n in range(1, 100)]
    late = [reading(n, time=1e-3 * n + 0.025) for n in range(100, 120)]
    assert causes(on_time + late)[99] is Cause.FORCE_LATE
    bearable = [reading(n, time=1e-3 * n + 0.015) for n in range(100, 120)]
    assert set(causes(on_time + bearable)) == {None}


def moving(commands: list[float], speeds: list[float], *, positions=None, settings=None, state=DriveState.ENABLED):
    """Causes for a blade that has those speeds at every SYNC."""
    settings = settings or fake_settings()
    watch = MotionMonitor(settings, follows=True)
    x, found = 0.02, []
    for n, (command, speed) in enumerate(zip(commands, speeds, strict=True)):
        x += speed * SYNC
        position = x if positions is None else positions[n]
        watch.note("blade", MotionSample(SYNC * n, position, speed, 0.0, state))
        breach = watch.check("blade", command)
        found.append(breach and breach.cause)
    return found


def as_told(command: float, count: int, lag: float = 0.040) -> list[float]:
    """Speeds of an axis with that lag and 0.1 m/s2."""
    speed, speeds = 0.0, []
    for _ in range(count):
        change = (command - speed) * (1.0 - math.exp(-SYNC / lag))
        speed += min(max(change, -0.1 * SYNC), 0.1 * SYNC)
        speeds.append(speed)
    return speeds


@given(st.floats(-0.0254, 0.0254), st.floats(0.030, 0.055))
def test_an_axis_that_does_as_it_is_told_is_left_alone(command, lag):
    """Also if its lag is not quite the one it is expected to have."""
    count = 150
    start = 0.09 if command < 0.0 else 0.01
    speeds = as_told(command, count, lag)
    positions = [start + SYNC * sum(speeds[: n + 1]) for n in range(count)]
    assert set(moving([command] * count, speeds, positions=positions)) == {None}


def test_speed_is_watched_as_told_and_as_travelled():
    assert Cause.SPEED in moving([0.0254] * 20, [0.0270] * 20)
    hidden = [0.02 + 0.04 * SYNC * n for n in range(40)]  # the drive tells 1 cm/s and goes 4
    assert set(moving([0.01] * 40, [0.01] * 40, positions=hidden)) & {Cause.SPEED, Cause.FOLLOWING}


def test_acceleration_travel_state_and_not_a_number():
    assert Cause.ACCELERATION in moving([0.02] * 6, [0.0, 0.0, 0.0, 0.013, 0.02, 0.02])
    assert moving([0.0], [0.0], positions=[0.1481]) == [Cause.TRAVEL]
    assert moving([0.0], [0.0], positions=[-0.0011]) == [Cause.TRAVEL]
    assert moving([0.0], [0.0], state=DriveState.QUICK_STOP) == [Cause.DRIVE]
    assert moving([0.0], [0.0], positions=[math.nan]) == [Cause.NOT_A_NUMBER]


def test_a_standing_encoder_is_stuck_after_60_ms_of_expected_motion():
    found = moving([0.0127] * 60, [0.0] * 60, positions=[0.02] * 60)
    first = found.index(Cause.STUCK)
    assert 0.060 <= SYNC * first <= 0.090  # it was to start, too
    assert set(moving([0.0005] * 200, [0.0] * 200, positions=[0.02] * 200)) == {None}  # too slow to tell


def test_a_stalled_computer_gets_many_samples_at_once_and_none_is_doubled():
    random = np.random.default_rng(1)
    for stall in (0.02, 0.1, 0.24):
        cadence = SampleRateMonitor(SYNC)
        most, due = -math.inf, 0.0
        for n in range(2000):
            due = SYNC * n + random.uniform(0.0, 0.9 * SYNC)
            stalled = 3.0 <= due % 4.0 < 3.0 + stall
            cadence.count(due - due % 4.0 + 3.0 + stall if stalled else due)
            most = max(most, cadence.surplus)
        assert most < SURPLUS - 1.0, stall
        for n in range(6):
            cadence.count(due + SYNC * (n + 1))
            cadence.count(due + SYNC * (n + 1) + 2e-4)
        assert cadence.surplus > SURPLUS


def test_following_forgets_small_differences_and_finds_lasting_ones():
    following = FollowingMonitor(lag=0.04, acceleration=0.1, sync=SYNC, slow=0.001, unmoved=5e-6)
    off = 0.0
    for n in range(400):
        off = following.watch(MotionSample(SYNC * n, 0.01 * 1.02 * SYNC * n, 0.0102, 0.0, DriveState.ENABLED), 0.01)[1]
    assert abs(off) < 0.0003  # two per cent of a speed is no slip
    slipping = moving([0.02] * 300, [speed * 0.6 for speed in as_told(0.02, 300)])
    assert Cause.FOLLOWING in slipping


def test_the_angle_has_its_own_limits():
    watch = MotionMonitor(fake_settings(), follows=True)
    for degrees, breached in ((90.0, False), (91.5, True), (45.0, False), (43.0, True)):
        watch.note("angle", MotionSample(0.0, math.radians(degrees), 0.0, 0.0, DriveState.ENABLED))
        breach = watch.check("angle", 0.0)
        assert (breach is not None and breach.cause is Cause.ANGLE) is breached


@pytest.mark.promise("S10")
def test_limits_on_the_command_line_may_only_be_lower():
    assert SafetyLimits().lowered(force=5.0).force == 5.0
    assert SafetyLimits().lowered(force=None) == SafetyLimits()
    with pytest.raises(ValueError, match=r"force = 16 is above 15.*only be lower"):
        SafetyLimits().lowered(force=16.0)
    with pytest.raises(ValueError, match="force_norm"):
        SafetyLimits().lowered(forse_norm=1.0)
    with pytest.raises(ValueError, match="stale_force"):  # what protects by being short is not the command line's
        SafetyLimits().lowered(stale_force=0.01)
    assert dataclasses.replace(SafetyLimits(), force=20.0).force == 20.0


def noisy(count: int, *, frozen: int | None, at: int = 0, moving=lambda n: True, identified=None) -> int | None:
    """Reading after ``at`` in which a force that stands from there on is found; torques and other forces flicker."""
    watch = ForceMonitor(LIMITS, ForceReadings(1000.0), identified)
    for n in range(1, count):
        counts = [3 * n % 7, 5 * n % 11, 2 * n % 5, n, n, n]
        if frozen is not None and n >= at:
            counts[frozen] = 4
        breach = watch.check(reading(n, counts=tuple(counts)), moving=moving(n))
        if breach is not None:
            assert breach.cause is Cause.FORCE_AXIS, breach
            assert f"the {'xyz'[frozen]} force stays" in breach.detail
            assert ("rig identify" in breach.detail) == (identified is None)
            return n - at
    return None


@pytest.mark.parametrize("axis", range(3))
def test_one_frozen_force_is_found_although_everything_else_lives(axis):
    assert noisy(2000, frozen=axis, at=500) == round(1000 * STILL)
    known = Identified(force_still_x=0.030, force_still_y=0.050, force_still_z=0.090)
    assert noisy(2000, frozen=axis, at=500, identified=known) == (30, 50, 90)[axis]
    assert noisy(2000, frozen=None) is None


def test_a_force_may_stand_while_the_blade_does():
    assert noisy(2000, frozen=0, moving=lambda n: False) is None
    assert noisy(2000, frozen=0, moving=lambda n: n >= 1000) == 1000 + round(1000 * STILL) - 1


def test_a_policy_that_rests_now_and_then_hides_no_frozen_force():
    assert noisy(5000, frozen=0, moving=lambda n: n // 20 % 2 == 0) < 2.2 * round(1000 * STILL)


@pytest.mark.parametrize(
    "wide", [{"stale_force": 0.5}, {"stale_motion": 0.5}, {"heartbeat": 1.0}, {"overrun": 10.0}, {"frozen_force": 0.3}]
)
@pytest.mark.promise("S11")
def test_limits_let_no_blade_go_far_unseen(wide):
    with pytest.raises(ValueError, match=rf"with {next(iter(wide))} the blade may go .* 5 mm allowed"):
        SafetyLimits(**wide)
    assert SafetyLimits(**wide, speed=0.005).blind_way <= MOST_BLIND  # a slow blade may be seen later


def test_a_record_can_tell_whether_limits_were_the_same():
    assert SafetyLimits().fingerprint == SafetyLimits(force=15.0).fingerprint
    assert SafetyLimits().fingerprint != SafetyLimits(force=14.999).fingerprint


def test_of_two_sets_of_limits_the_stricter_of_each_counts():
    strict = SafetyLimits(force=5.0, high=0.15).strictest(SafetyLimits(low=0.0, high=0.1, angle_high=1.5))
    assert strict == SafetyLimits(force=5.0, low=0.0, high=0.1, angle_high=1.5)
