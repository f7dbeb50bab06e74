"""Loading segments: found where there are ramps, with the slope that was put in, and nowhere else."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded_cut import recorded_cut

from cutenv.records.measurement import loading_segments
from cutenv.records.measurement.strokes import strokes, turning_points
from cutenv.sim.trace import Trace, blade_speed

SPEEDS = (0.001, 0.0127, 0.0254)
UNIT, SLOPE, DROP = 4e-3, 500.0, 1.6  # [m], [N/m], [N] of the saw


def saw(*, speed: float, noise: float = 0.02, resolution: float = 0.05, delay: float = 0.01) -> Trace:
    """A force that rises by SLOPE and drops by DROP after each UNIT, as a sensor would show it."""
    time = np.arange(round(0.1 / speed / 1e-3)) * 1e-3
    position = speed * time
    felt = np.maximum(speed * (time - delay), 0.0)
    units = np.floor(felt / UNIT)
    force = 1.0 + SLOPE * felt - DROP * units
    if noise:
        force = force + noise * np.random.default_rng(1).standard_normal(len(time))
    if resolution:
        force = resolution * np.round(force / resolution)
    return Trace(time=time, force=force, position=position)


@pytest.mark.parametrize("speed", SPEEDS)
def test_a_saw_is_found_through_noise_resolution_and_delay(speed: float) -> None:
    trace = saw(speed=speed)
    segments = loading_segments(trace)
    assert abs(len(segments) - 25) <= 1
    inner = segments[1:-1]
    assert np.allclose([s.slope for s in inner], SLOPE, rtol=0.03)
    smoothed = SLOPE * 2 * 10 * inner[0].speed * 1e-3  # what the drop loses to the means of two bins at the most
    assert all(DROP - smoothed - 0.03 < s.drop < DROP + 0.03 for s in inner)
    assert all(0.7 * UNIT < s.displacement <= UNIT for s in inner)
    assert np.allclose(np.diff([s.position for s in inner]), UNIT, rtol=0.05)


@pytest.mark.parametrize("angle_deg", [90.0, 45.0])
@pytest.mark.parametrize("speed", SPEEDS)
def test_ramps_are_found_at_every_speed_and_angle(speed: float, angle_deg: float) -> None:
    """Nine in ten of the units are found, and their slopes are LEM kappa B at the true tip, five in six to 5 %."""
    cut = recorded_cut(speed=speed, angle_deg=angle_deg)
    segments = [s for s in loading_segments(cut.trace) if s.is_steady]
    units = np.count_nonzero(np.diff(cut.tip) > 20e-6 + 1.01 * 0.0254 * 1e-3)
    assert 0.9 * units - 2 <= len(segments) <= units + 1
    tips = np.array([cut.tip[s.samples].mean() for s in segments])
    kappa = cut.specimen.cut_model().stiffness(tips)
    ratio = [s.slope for s in segments] / (cut.true_moduli(segments) * kappa * 0.02)
    assert abs(np.median(ratio) - 1.0) < 0.01
    assert np.quantile(np.abs(ratio - 1.0), 0.85) < 0.05
    assert np.abs(ratio - 1.0).max() < 0.15


def test_the_first_ramp_of_a_stroke_is_marked_and_steeper() -> None:
    first, *others = loading_segments(recorded_cut(angle_deg=45.0).forward().trace)
    assert first.after_standstill
    assert not any(s.after_standstill for s in others)
    assert first.slope > 1.3 * np.median([s.slope for s in others])


def test_a_way_back_and_a_rest_give_no_ramp() -> None:
    cut = recorded_cut(speed=0.0127)
    turn = int(np.argmax(cut.trace.position))
    assert all(s.stop <= turn for s in loading_segments(cut.trace))
    assert loading_segments(cut.trace.select(slice(turn, None))) == []


def test_friction_at_a_constant_depth_leaves_slopes() -> None:
    trace = recorded_cut().forward().trace
    shifted = dataclasses.replace(trace, force=trace.force + 0.85)
    for mine, theirs in zip(loading_segments(trace), loading_segments(shifted), strict=True):
        assert mine.slope == pytest.approx(theirs.slope, rel=1e-9)
        assert theirs.force - mine.force == pytest.approx(0.85)


def test_a_segment_is_what_its_readings_are() -> None:
    trace = recorded_cut().trace
    for s in loading_segments(trace):
        x, F = trace.position[s.samples], trace.force[s.samples]
        assert s.slope == pytest.approx(np.polyfit(x, F, 1)[0])
        assert s.r_squared == pytest.approx(np.corrcoef(x, F)[0, 1] ** 2)
        assert s.force_rise == pytest.approx(s.slope * (x[-1] - x[0]))
        assert (s.position, s.force) == pytest.approx((x.mean(), F.mean()))


def test_more_units_are_cut_slowly_than_fast() -> None:
    counts = [sum(s.is_steady for s in loading_segments(recorded_cut(speed=v).trace)) for v in SPEEDS]
    assert counts == sorted(counts, reverse=True)


@given(st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=60), st.floats(0.01, 5.0))
def test_valleys_and_hilltops_alternate_and_swing_enough(values: list[float], swing: float) -> None:
    series = np.array(values)
    turns = turning_points(series, swing)
    flat = [i for pair in turns for i in pair]
    assert flat == sorted(flat)
    assert all(abs(series[j] - series[i]) >= swing for i, j in itertools.pairwise(flat))
    for valley, hilltop in turns:
        assert series[valley] == series[valley : hilltop + 1].min()
        assert series[hilltop] == series[valley : hilltop + 1].max()


def test_strokes_part_where_the_blade_turns_or_rests() -> None:
    trace = recorded_cut(turns=(0.03, 0.0, 0.05, 0.0)).trace
    found = strokes(trace)
    assert [s.forward for s in found] == [True, False, True, False]
    ends = [trace.position[s.stop - 1] for s in found]
    assert ends == pytest.approx([0.03, 0.0, 0.05, 0.0], abs=2e-4)


def test_speed_is_that_of_the_drive_through_encoder_steps() -> None:
    time = np.arange(4000) * 1e-3
    position = 5e-6 * np.round(0.0127 * time / 5e-6)
    assert blade_speed(time, position)[100:-100] == pytest.approx(0.0127, rel=0.02)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"smallest_drop": 0.0}, "smallest_drop = 0 N is outside"),
        ({"smallest_drop": float("nan")}, "smallest_drop"),
        ({"smoothing_readings": 0}, "smoothing_readings = 0 is outside"),
    ],
)
def test_nonsense_is_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        loading_segments(saw(speed=0.0254), **changes)  # type: ignore[arg-type]


def in_time_only(trace: Trace, *, scale: float | None = None) -> Trace:
    """The record of a force alone, in newtons, or normalised by ``scale`` [N]."""
    force = trace.force if scale is None else trace.force / scale
    return Trace(time=trace.time, force=force, force_unit="N" if scale is None else "1")


def check_the_saw_is_found_in_time(trace: Trace, speed: float, unit: float, **changes: float) -> None:
    """Without position the ramps are those found with it, their rates dF/dU times the speed."""
    segments = loading_segments(trace, **changes)  # type: ignore[arg-type]
    assert abs(len(segments) - 25) <= 1
    inner = segments[1:-1]
    assert np.allclose([s.rate for s in inner], SLOPE * speed / unit, rtol=0.03)
    assert all(0.7 * UNIT / speed < s.duration <= UNIT / speed for s in inner)
    assert np.allclose(np.diff([s.time for s in inner]), UNIT / speed, rtol=0.05)
    assert np.allclose([s.drop for s in inner], DROP / unit, rtol=0.25)


@pytest.mark.parametrize("speed", SPEEDS)
def test_a_saw_is_found_without_position(speed: float) -> None:
    with_position = saw(speed=speed)
    check_the_saw_is_found_in_time(in_time_only(with_position), speed, 1.0)
    assert len(loading_segments(in_time_only(with_position))) == len(loading_segments(with_position))


@pytest.mark.parametrize("speed", SPEEDS)
def test_a_normalised_saw_is_found_by_its_own_range(speed: float) -> None:
    check_the_saw_is_found_in_time(in_time_only(saw(speed=speed), scale=40.0), speed, 40.0)


def test_a_force_alone_has_rates_and_no_slopes() -> None:
    for s in loading_segments(in_time_only(saw(speed=0.0127))):
        along = (s.position, s.displacement, s.slope, s.speed, s.speed_change)
        assert (*along, s.angle, s.depth) == (None,) * 7
        assert not s.is_steady
        with pytest.raises(ValueError, match="fit needs slope and speed of a loading segment, which only a trace with"):
            s.require("slope", "speed", by="fit")


def test_the_rate_is_that_of_the_readings_with_position_or_without() -> None:
    trace = recorded_cut().forward().trace
    found = loading_segments(trace)
    for s in [*found, *loading_segments(in_time_only(trace))]:
        t, F = trace.time[s.samples], trace.force[s.samples]
        assert s.rate == pytest.approx(np.polyfit(t, F, 1)[0])
        assert (s.time, s.duration) == pytest.approx((t.mean(), t[-1] - t[0]))
    assert [s.rate for s in found if s.is_steady] == pytest.approx(
        [s.slope * s.speed for s in found if s.is_steady], rel=0.02
    )


def test_a_slow_record_is_not_smoothed_away() -> None:
    time = np.arange(120) / 30.0
    found = loading_segments(Trace(time=time, force=(time % 0.5), force_unit="1"))
    assert len(found) == 8
    assert all(s.rate == pytest.approx(1.0) for s in found)
    assert loading_segments(Trace(time=time, force=time % 0.5, force_unit="1"), smoothing_readings=10) == []


def test_a_constant_force_has_no_segments() -> None:
    assert loading_segments(Trace(time=np.arange(50) / 30.0, force=np.full(50, 0.3), force_unit="1")) == []


def test_a_drop_that_is_none_is_refused_in_the_unit_of_the_record() -> None:
    bare = Trace(time=np.arange(101) * 0.01, force=np.linspace(0.0, 1.0, 101), force_unit="1")
    with pytest.raises(ValueError, match=r"smallest_drop = 0 is outside .* without one it is 0.09 here"):
        loading_segments(bare, smallest_drop=0.0)
    with pytest.raises(ValueError, match=r"smallest_drop = 0 N is outside"):
        loading_segments(dataclasses.replace(bare, force_unit="N"), smallest_drop=0.0)


@given(st.lists(st.floats(-1.0, 1.0, width=32), min_size=12, max_size=80), st.floats(1e-3, 1e3))
def test_segments_of_a_normalised_force_do_not_depend_on_what_it_was_normalised_with(
    steps: list[float], scale: float
) -> None:
    force = np.cumsum(steps)
    time = np.arange(len(force)) / 30.0
    one, other = (Trace(time=time, force=factor * force, force_unit="1") for factor in (1.0, scale))
    drop = 0.3712  # no whole number of any step: rounding does not decide
    mine, theirs = loading_segments(one, smallest_drop=drop), loading_segments(other, smallest_drop=drop * scale)
    assert [(s.start, s.stop) for s in mine] == [(s.start, s.stop) for s in theirs]
    assert [scale * s.rate for s in mine] == pytest.approx([s.rate for s in theirs], rel=1e-6, abs=1e-9 * scale)


def test_a_smallest_drop_in_the_wrong_unit_is_noticed() -> None:
    with pytest.raises(AssertionError):
        check_the_saw_is_found_in_time(in_time_only(saw(speed=0.0127), scale=40.0), 0.0127, 40.0, smallest_drop=0.1)
