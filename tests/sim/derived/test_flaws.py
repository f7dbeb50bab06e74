"""Each flaw of a record is found where it is, and honest records of any sensor have none."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from pairs import every_pair
from recorded_cut import recorded_cut

from cutenv.records.measurement import quality_issues
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.trace import Trace
from scripts.validation.records.virtual_records import FLAWS, one_cut, valid_record

NOISES, RESOLUTIONS = (0.0, 0.005, 0.02, 0.05), (0.0, 0.01, 0.05)
SENSORS = [
    SensorParameters(force_noise=noise, force_resolution=resolution) for noise in NOISES for resolution in RESOLUTIONS
]
NOISY = [sensor for sensor in SENSORS if sensor.force_noise >= 0.3 * max(sensor.force_resolution, 1e-9)]
SEEDS = range(6)


def force_only(trace: Trace) -> Trace:
    return Trace(time=trace.time, force=trace.force, force_unit=trace.force_unit)


@pytest.mark.parametrize(
    ("kind", "noise", "resolution"), every_pair(("2 cm", "1 cm", "bulge", "liver"), NOISES, RESOLUTIONS)
)
def test_an_honest_cut_has_no_flaw(kind: str, noise: float, resolution: float) -> None:
    sensor = SensorParameters(force_noise=noise, force_resolution=resolution)
    for speed, angle in ((0.004, 90.0), (0.0254, 45.0)):
        cut = recorded_cut(kind, speed=speed, angle_deg=angle, turns=(0.06, 0.0), sensor=sensor)
        for trace in (cut.trace, cut.forward().trace):
            for stride in (1, 10):
                part = trace.select(slice(None, None, stride))
                assert quality_issues(part) == ()
                assert quality_issues(force_only(part)) == ()


def friction(*, noise: float, resolution: float, depth: np.ndarray | None = None) -> Trace:
    """A blade that goes to and fro in an open crack: rest, forward, rest, back, rest."""
    speed = np.repeat([0.0, 0.01, 0.0, -0.01, 0.0], [1000, 5000, 500, 5000, 1000])
    position = np.cumsum(speed) * 1e-3
    force = (
        42.0
        * np.sign(speed)
        * (0.02 if depth is None else np.interp(position, np.linspace(0, 0.05, len(depth)), depth))
    )
    force = force + noise * np.random.default_rng(1).standard_normal(len(force))
    if resolution:
        force = resolution * np.floor(force / resolution + 0.5)
    return Trace(time=np.arange(len(speed)) * 1e-3, force=force, position=position, speed=speed)


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.02])
@pytest.mark.parametrize("resolution", [0.0, 0.05])
@pytest.mark.parametrize("depth", [None, np.array([0.001, 0.015, 0.02, 0.02, 0.018])])
def test_friction_alone_is_no_stuck_sensor(noise: float, resolution: float, depth: np.ndarray | None) -> None:
    trace = friction(noise=noise, resolution=resolution, depth=depth)
    assert quality_issues(trace) == ()
    assert quality_issues(force_only(trace)) == ()


@pytest.mark.parametrize("kind", ["held reading", "dead zone", "filter", "unit 1"])
def test_what_electronics_do_is_no_flaw(kind: str) -> None:
    trace = recorded_cut("liver", speed=0.01, turns=(0.06, 0.0), sensor=SensorParameters(force_resolution=0.0)).trace
    force = trace.force
    if kind == "held reading":  # a sensor of 100 Hz, stored at 1 kHz
        force = np.repeat(force[::10], 10)[: len(force)]
    elif kind == "dead zone":
        force = np.where(np.abs(force) < 0.08, 0.0, force)
    elif kind == "filter":
        force = np.convolve(force, np.ones(50) / 50, mode="same")
    else:
        force = force / force.max()
    trace = dataclasses.replace(trace, force=force, force_unit="1" if kind == "unit 1" else "N")
    assert quality_issues(trace) == ()
    assert quality_issues(force_only(trace)) == ()


def check_found(trace: Trace, kind: str, rows: tuple[int, int], *, off: int, refuse: bool) -> None:
    """One flaw of this kind, at these rows, and none of another kind."""
    found = quality_issues(trace)
    assert [flaw.kind for flaw in found] == [kind]
    assert found[0].rows == pytest.approx(rows, abs=off)
    assert found[0].refuse == refuse
    assert found[0].message


@pytest.mark.parametrize("sensor", NOISY)
@pytest.mark.parametrize("known", ["all", "force"])
def test_a_stuck_sensor_is_found_with_its_rows(sensor: SensorParameters, known: str) -> None:
    cut = recorded_cut("liver", speed=0.01, turns=(0.06,), sensor=sensor).trace
    force = cut.force.copy()
    force[3000:4500] = force[3000]
    stuck = dataclasses.replace(cut, force=force)
    check_found(stuck if known == "all" else force_only(stuck), "stuck", (3000, 4499), off=3, refuse=True)
    with pytest.raises(AssertionError):
        check_found(cut, "stuck", (3000, 4499), off=3, refuse=True)


def test_a_sensor_without_noise_is_stuck_where_a_cut_would_show() -> None:
    cut = recorded_cut("2 cm", speed=0.01, sensor=SensorParameters(force_noise=0.0), turns=(0.06,)).trace
    force = cut.force.copy()
    force[3000:4500] = force[3000]
    check_found(dataclasses.replace(cut, force=force), "stuck", (3000, 4499), off=30, refuse=True)


def test_a_cable_that_falls_out_amid_the_cut_is_found() -> None:
    cut = recorded_cut("2 cm", speed=0.01, turns=(0.06, 0.0)).trace
    force = cut.force.copy()
    force[3000:4500] = 0.0
    check_found(dataclasses.replace(cut, force=force), "stuck", (3000, 4499), off=0, refuse=True)


@pytest.mark.parametrize("sensor", NOISY)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_clipping_is_found_from_the_first_flat_top_to_the_last(sensor: SensorParameters, sign: float) -> None:
    cut = recorded_cut("2 cm", speed=0.01, turns=(0.08,), sensor=sensor).trace
    limit = 0.8 * cut.force.max()  # between the least and the greatest force of the cut
    tops = np.flatnonzero(cut.force >= limit)
    clipped = Trace(time=cut.time, force=sign * np.minimum(cut.force, limit))
    found = [flaw for flaw in quality_issues(clipped) if flaw.kind == "clipping"]
    assert len(found) == 1
    assert found[0].refuse
    first, last = found[0].rows
    assert tops[0] - 3 <= first < tops[0] + 1500  # noise may break the first tops up
    assert tops[-1] - 1500 < last <= tops[-1] + 3
    assert (clipped.force[[first, last]] == sign * limit).all()


@pytest.mark.parametrize(("speed", "clips"), [(0.0, False), (0.01, True)])
def test_a_force_may_rest_at_its_largest_where_the_blade_stands(speed: float, clips: bool) -> None:
    cut = recorded_cut("2 cm", speed=0.01, turns=(0.06,), sensor=SensorParameters(force_resolution=0.05)).trace
    top, count = int(np.argmax(cut.force)), 60
    rests = np.zeros(count), speed * 1e-3 * np.arange(1, count + 1)
    force, moved = (np.insert(values, top + 1, values[top] + more) for values, more in zip(
        (cut.force, cut.position), rests, strict=True))  # fmt: skip
    moved[top + 1 + count :] += rests[1][-1]
    trace = Trace(time=1e-3 * np.arange(len(force)), force=force, position=moved)
    assert any(flaw.kind == "clipping" for flaw in quality_issues(trace)) is clips
    assert any(flaw.kind == "clipping" for flaw in quality_issues(force_only(trace)))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_gap_is_found_at_its_rows(seed: int) -> None:
    trace, rows = FLAWS["gap"](one_cut(seed), np.random.default_rng(seed))
    check_found(trace, "gap", rows, off=0, refuse=abs(np.diff(trace.position[list(rows)])[0]) > 1e-3)
    check_found(force_only(trace), "gap", rows, off=0, refuse=True)


def test_a_gap_in_which_the_blade_stood_is_worth_a_look() -> None:
    cut = recorded_cut("2 cm", speed=0.01, turns=(0.02,)).trace
    kept = np.ones(len(cut), bool)
    kept[-150:-20] = False
    check_found(cut.select(kept), "gap", (len(cut) - 151, len(cut) - 150), off=0, refuse=False)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_reversed_force_is_refused_where_the_motion_is_known(seed: int) -> None:
    trace, _ = FLAWS["reversed"](one_cut(seed), np.random.default_rng(seed))
    found = [flaw for flaw in quality_issues(trace) if flaw.kind == "reversed"]
    assert [flaw.refuse for flaw in found] == [True]
    assert "force=-column" in found[0].message
    assert [flaw.refuse for flaw in quality_issues(force_only(trace)) if flaw.kind == "reversed"] == [False]


def test_a_constant_force_is_refused() -> None:
    cut = recorded_cut("2 cm", speed=0.01, turns=(0.02,)).trace
    check_found(
        dataclasses.replace(cut, force=np.full(len(cut), 1.2)), "constant", (0, len(cut) - 1), off=0, refuse=True
    )


def test_a_short_record_is_refused() -> None:
    cut = recorded_cut("2 cm", speed=0.01, turns=(0.02,)).trace
    check_found(cut.select(slice(1000, 1049)), "short", (0, 48), off=0, refuse=True)
    assert quality_issues(cut.select(slice(1000, 1050))) == ()


@pytest.mark.parametrize("seed", SEEDS)
def test_an_irregular_clock_is_worth_a_look(seed: int) -> None:
    cut = one_cut(seed)
    trace, rows = FLAWS["clock"](force_only(cut), np.random.default_rng(seed))
    check_found(trace, "clock", rows, off=20, refuse=False)
    jitter = 1e-4 * np.random.default_rng(seed).standard_normal(len(cut)).clip(-3, 3)
    assert quality_issues(dataclasses.replace(force_only(cut), time=cut.time + jitter)) == ()


def test_readings_that_come_in_bursts_are_an_irregular_clock_and_no_gaps() -> None:
    cut = force_only(one_cut(0))
    steps = 1e-3 * np.where(np.arange(len(cut) - 1) % 8 == 0, 6.6, 0.2)
    found = quality_issues(dataclasses.replace(cut, time=np.concatenate(([0.0], np.cumsum(steps)))))
    assert [flaw.kind for flaw in found] == ["clock"]


@pytest.mark.parametrize("factor", [0.5, 2.0, -1.0])
def test_a_speed_that_disagrees_with_the_position_is_worth_a_look(factor: float) -> None:
    cut = recorded_cut("2 cm", speed=0.01, turns=(0.02, 0.0)).trace
    found = quality_issues(dataclasses.replace(cut, speed=factor * cut.speed))
    assert [(flaw.kind, flaw.refuse) for flaw in found] == [("speed", False)]
    assert f"{1 / factor:.2g} times as fast" in found[0].message
    unsigned = quality_issues(dataclasses.replace(cut, speed=np.abs(cut.speed)))
    assert [flaw.kind for flaw in unsigned] == ["speed"]


def test_flaws_come_in_order_of_time() -> None:
    cut = recorded_cut("liver", speed=0.01, turns=(0.06,)).trace
    force = cut.force.copy()
    force[4000:5000] = force[4000]
    kept = np.ones(len(cut), bool)
    kept[2000:2200] = False
    found = quality_issues(dataclasses.replace(cut, force=force).select(kept))
    assert [flaw.kind for flaw in found] == ["gap", "stuck"]
    assert found[0].rows[1] < found[1].rows[0]


@pytest.mark.parametrize("seed", range(20))
def test_valid_records_with_mild_noise_are_accepted(seed: int) -> None:
    record = valid_record(seed)
    assert quality_issues(dataclasses.replace(record.trace, force=record.trace.force - record.offset)) == ()


@pytest.mark.parametrize("n", [2, 3, 60])
@pytest.mark.parametrize("force", [0.0, 1.0, math.pi])
def test_any_trace_can_be_judged(n: int, force: float) -> None:
    time = np.arange(n) * 0.01
    for values in (np.full(n, force), force * np.arange(n), np.where(np.arange(n) == 1, force, 0.0)):
        for unit in ("N", "1"):
            trace = Trace(time=time, force=values, position=0.001 * time, speed=np.zeros(n), force_unit=unit)
            assert all(0 <= flaw.rows[0] <= flaw.rows[1] < n for flaw in quality_issues(trace))
