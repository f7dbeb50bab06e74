"""Loading segments: found where there are ramps, with the slope that was put in, and nowhere else."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded_cut import recorded_cut

from cutenv.measurement import Segment, loading_segments
from cutenv.measurement.strokes import blade_speed, strokes, turning_points
from cutenv.trace import Trace

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


def check_the_saw_is_found(trace: Trace) -> None:
    segments = loading_segments(trace)
    assert abs(len(segments) - 25) <= 1
    inner = segments[1:-1]
    assert np.allclose([s.slope for s in inner], SLOPE, rtol=0.03)
    smoothed = SLOPE * 2 * 10 * inner[0].speed * 1e-3  # what the drop loses to the means of two bins at the most
    assert all(DROP - smoothed - 0.03 < s.drop < DROP + 0.03 for s in inner)
    assert all(0.7 * UNIT < s.displacement <= UNIT for s in inner)
    assert np.allclose(np.diff([s.position for s in inner]), UNIT, rtol=0.05)


@pytest.mark.parametrize("speed", SPEEDS)
def test_a_saw_is_found_through_noise_resolution_and_delay(speed: float) -> None:
    check_the_saw_is_found(saw(speed=speed))


def test_noise_beyond_the_smallest_drop_is_noticed() -> None:
    with pytest.raises(AssertionError):
        check_the_saw_is_found(saw(speed=0.0254, noise=0.3))


def test_a_fine_saw_that_smoothing_hides_is_noticed() -> None:
    with pytest.raises(AssertionError):
        check_the_saw_is_found(saw(speed=0.0254).select(slice(None, None, 40)))


def check_ramps_are_those_of_the_law(speed: float, angle_deg: float, pick: Callable[[Segment], bool]) -> None:
    """Nine in ten of the law's units are found, and their slopes are LEM kappa B at the true tip."""
    cut = recorded_cut(speed=speed, angle_deg=angle_deg)
    segments = [s for s in loading_segments(cut.trace) if pick(s)]
    units = np.count_nonzero(np.diff(cut.tip) > 20e-6 + 1.01 * 0.0254 * 1e-3)
    assert 0.9 * units - 2 <= len(segments) <= units + 1
    tips = np.array([cut.tip[s.samples].mean() for s in segments])
    kappa = cut.specimen.cut_model().stiffness(tips)
    ratio = [s.slope for s in segments] / (cut.true_moduli(segments) * kappa * 0.02)
    assert abs(np.median(ratio) - 1.0) < 0.01
    assert np.quantile(np.abs(ratio - 1.0), 0.9) < 0.05
    assert np.abs(ratio - 1.0).max() < 0.15


@pytest.mark.parametrize("angle_deg", [90.0, 45.0])
@pytest.mark.parametrize("speed", SPEEDS)
def test_ramps_are_found_at_every_speed_and_angle(speed: float, angle_deg: float) -> None:
    check_ramps_are_those_of_the_law(speed, angle_deg, lambda s: s.is_steady)


def test_a_first_ramp_taken_for_steady_is_noticed() -> None:
    with pytest.raises(AssertionError):
        check_ramps_are_those_of_the_law(0.0127, 45.0, lambda s: s.is_steady or s.after_standstill)


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
    found = strokes(trace.time, trace.position)
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


def test_a_trace_without_position_or_newtons_is_refused_by_name() -> None:
    bare = Trace(time=[0.0, 0.1], force=[0.0, 1.0])
    with pytest.raises(ValueError, match="loading_segments needs position"):
        loading_segments(bare)
    with pytest.raises(ValueError, match="loading_segments needs force in newtons"):
        loading_segments(dataclasses.replace(bare, force_unit="1"))
