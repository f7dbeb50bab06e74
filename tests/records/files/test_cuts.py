"""The sensor's zero, and start and end of every cut, are found in long records; where there is none, none is found."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from recorded_cut import recorded_cut

from cutenv.records.foreign.cut_detection import CutSearch, find_cuts, find_tare
from cutenv.records.scoring.validity import is_truncated
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.trace import Trace

MILD = SensorParameters(force_noise=0.02, force_resolution=0.0)
NOISY = SensorParameters(force_noise=0.05, force_resolution=0.0)
COARSE = SensorParameters(force_noise=0.02, force_resolution=0.05)


def resting(seconds: float, position: float, sensor: SensorParameters, seed: int) -> dict[str, Any]:
    n = round(1000 * seconds)
    force = sensor.force_noise * np.random.default_rng(seed).standard_normal(n)
    if sensor.force_resolution:
        force = sensor.force_resolution * np.round(force / sensor.force_resolution)
    return {"force": force, "position": np.full(n, position)}


def long_record(
    *,
    sensor: SensorParameters = MILD,
    pauses: tuple[float, ...] = (2.0, 3.0, 2.0, 1.5),
    offset: float = 0.0,
    **cut: Any,
) -> tuple[Trace, list[float], list[float]]:
    """Cuts parted by pauses, with a pause before the first and after the last; and where they start and end [s]."""
    one = recorded_cut(sensor=sensor, **cut).trace
    parts, starts, ends = [resting(pauses[0], 0.0, sensor, 0)], [], []
    for k, pause in enumerate(pauses[1:], 1):
        starts.append(sum(len(part["force"]) for part in parts) / 1000)
        parts.append({"force": one.force, "position": one.position})
        ends.append(starts[-1] + one.duration)
        parts.append(resting(pause, float(one.position[-1]), sensor, k))
    columns = {name: np.concatenate([part[name] for part in parts]) for name in ("force", "position")}
    columns["force"] = columns["force"] + offset
    return Trace(time=np.arange(len(columns["force"])) / 1000, **columns), starts, ends


def force_only(trace: Trace) -> Trace:
    return dataclasses.replace(trace, position=None)


def check_tare(trace: Trace, offset: float, sensor: SensorParameters) -> None:
    """Within four standard errors of the offset; a coarse sensor's zero may lie between its levels."""
    tare = find_tare(trace)
    assert tare is not None
    assert tare.standard_error < 1.2 * max(sensor.force_noise, sensor.force_resolution) / np.sqrt(tare.stop)
    assert abs(tare.offset - offset) <= 4.0 * tare.standard_error + 0.1 * sensor.force_resolution
    assert 0.8 < trace.time[tare.stop - 1] < 2.0


@pytest.mark.parametrize("sensor", [MILD, NOISY, COARSE])
@pytest.mark.parametrize("offset", [-1.3, 0.0, 0.37])
def test_the_zero_is_found_within_the_noise(sensor: SensorParameters, offset: float) -> None:
    trace, *_ = long_record(sensor=sensor, offset=offset)
    check_tare(trace, offset, sensor)
    check_tare(force_only(trace), offset, sensor)


def test_a_spike_does_not_move_the_zero() -> None:
    trace, *_ = long_record(offset=0.3)
    force = trace.force.copy()
    force[700] += 0.9  # too short to be contact, once it is averaged
    check_tare(dataclasses.replace(trace, force=force), 0.3, MILD)


@pytest.mark.parametrize("speed", [0.001, 0.0127, 0.0254])
@pytest.mark.parametrize("first", [0, 1000, 2500])
def test_a_record_that_starts_amid_a_cut_has_no_zero(speed: float, first: int) -> None:
    cut = recorded_cut(speed=speed, sensor=NOISY, turns=(0.02,)).trace
    some = cut.select(slice(first, None)) if len(cut) > first + 1000 else cut
    assert find_tare(some) is None
    assert find_tare(force_only(some)) is None


def test_too_few_readings_tell_no_zero() -> None:
    assert find_tare(Trace(time=np.arange(15) * 0.01, force=np.zeros(15))) is None


def check_cuts(trace: Trace, starts: list[float], ends: list[float], *, late: float) -> None:
    found = find_cuts(trace)
    assert len(found) == len(starts)
    assert np.allclose([trace.time[cut.start] for cut in found], starts, atol=0.03)
    assert np.allclose([trace.time[cut.stop - 1] for cut in found], ends, atol=late)


@pytest.mark.parametrize("sensor", [MILD, NOISY, COARSE])
@pytest.mark.parametrize("speed", [0.0127, 0.0254])
@pytest.mark.parametrize("turns", [(0.05, 0.0), (0.02, 0.0, 0.04, 0.0)])
def test_a_long_record_is_split_at_the_pauses(sensor: SensorParameters, speed: float, turns: tuple[float, ...]) -> None:
    trace, starts, ends = long_record(sensor=sensor, speed=speed, turns=turns)
    check_cuts(trace, starts, ends, late=0.3)  # the blade comes to rest, then dwells for 0.2 s
    check_cuts(force_only(trace), starts, ends, late=0.3)


def test_a_blade_that_stays_loaded_is_one_cut() -> None:
    there = recorded_cut(sensor=MILD, turns=(0.04,)).trace
    loaded = float(there.force[-100:].mean())
    n = 4000
    force = np.concatenate([np.zeros(1000), there.force, np.full(n, loaded), there.force])
    position = np.concatenate([np.zeros(1000), there.position, np.full(n, 0.04), 0.04 + there.position])
    trace = Trace(time=np.arange(len(force)) / 1000, force=force, position=position)
    assert len(find_cuts(trace)) == 1
    assert len(find_cuts(force_only(trace))) == 1


def test_what_counts_as_a_pause_is_said() -> None:
    trace, *_ = long_record(pauses=(2.0, 0.5, 2.0, 1.5))
    assert len(find_cuts(trace)) == 2
    assert len(find_cuts(trace, CutSearch(pause=0.4))) == 3
    assert len(find_cuts(trace, CutSearch(pause=10.0))) == 1


def test_the_way_back_after_a_long_pause_belongs_to_the_cut() -> None:
    whole = recorded_cut(sensor=MILD, turns=(0.05, 0.045)).trace  # unloads
    back = np.linspace(0.045, 0.0, 4000)
    friction = -0.5 + 0.02 * np.random.default_rng(1).standard_normal(4000)
    force = np.concatenate([np.zeros(1000), whole.force, np.zeros(2000), friction, np.zeros(1500)])
    position = np.concatenate([np.zeros(1000), whole.position, np.full(2000, 0.045), back, np.zeros(1500)])
    trace = Trace(time=np.arange(len(force)) / 1000, force=force, position=position)
    (cut,) = find_cuts(trace)
    assert trace.time[cut.start] == pytest.approx(1.0, abs=0.03)
    assert trace.time[cut.stop - 1] == pytest.approx((1000 + len(whole) + 6000) / 1000, abs=0.12)


def test_motion_in_the_air_and_knocks_are_no_cuts() -> None:
    n = 8000
    rng = np.random.default_rng(1)
    force = 0.02 * rng.standard_normal(n)
    force[3000:3020] += 2.0
    position = np.clip(np.arange(n) / 1000 * 0.01, 0.0, 0.05)
    assert find_cuts(Trace(time=np.arange(n) / 1000, force=force, position=position)) == []
    assert find_cuts(Trace(time=np.arange(n) / 1000, force=force)) == []


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_is_no_cut(seed: int) -> None:
    force = 0.05 * np.random.default_rng(seed).standard_normal(20_000)
    assert find_cuts(Trace(time=np.arange(20_000) / 1000, force=force)) == []


@pytest.mark.parametrize("changes", [{"contact": 0.0}, {"pause": -1.0}, {"quiet": float("nan")}])
def test_parameters_out_of_range_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(changes))} = "):
        CutSearch(**changes)


@pytest.mark.parametrize("rate", [30, 100, 1000])
@pytest.mark.parametrize("speed", [0.004, 0.05])
def test_a_cut_that_stops_at_once_keeps_the_rest_that_shows_it(rate: int, speed: float) -> None:
    time = np.arange(round(rate * (2.0 + 0.04 / speed + 2.0))) / rate
    position = np.clip(speed * (time - 2.0), 0.0, 0.04)
    force = np.where((time > 2.0) & (position < 0.04), 2.0, 0.0) + 0.01 * np.sin(50.0 * time)
    trace = Trace(time=time, force=force, position=position)
    (cut,) = find_cuts(trace)
    assert trace.time[cut.stop - 1] < 2.0 + 0.04 / speed + 0.4
    assert is_truncated(trace.select(cut.samples)) == ""
    short = trace.select(slice(round(rate * (2.0 + 0.03 / speed))))
    (cut,) = find_cuts(short)
    assert "ends while the blade moves" in is_truncated(short.select(cut.samples))
