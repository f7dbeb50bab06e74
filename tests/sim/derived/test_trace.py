"""A trace holds what a rig measured, in SI, unchangeable; and says what it refuses and what it lacks."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cutenv.sim.trace import Reading, Trace, limits

TIME = np.arange(6) * 1e-3
FULL: dict[str, Any] = {
    "time": TIME,
    "force": np.array([0.0, 0.1, 0.2, 0.35, 0.2, 0.1]),
    "position": 0.0254 * TIME,
    "speed": np.full(6, 0.0254),
    "angle": np.full(6, np.pi / 2),
    "depth": np.full(6, 0.02),
    "metadata": {"trial": "T01", "cut": 3},
}


def full(**changes: Any) -> Trace:
    return Trace(**(FULL | changes))


def test_a_trace_gives_back_what_it_was_given() -> None:
    trace = full()
    for name, values in FULL.items():
        assert np.array_equal(getattr(trace, name), values)
    assert (len(trace), trace.duration, trace.sample_rate) == pytest.approx((6, 5e-3, 1000.0))
    assert trace.known == ("time", "force", "position", "speed", "angle", "depth")


def test_arrays_are_read_only_copies() -> None:
    force = FULL["force"].copy()
    trace = full(force=force)
    force[0] = 9.0
    assert trace.force[0] == 0.0
    for copied in (trace, copy.deepcopy(trace), pickle.loads(pickle.dumps(trace))):
        with pytest.raises(ValueError, match="read-only"):
            copied.force[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        trace.force_unit = "1"  # type: ignore[misc]


def test_metadata_do_not_follow_what_they_were_made_from() -> None:
    metadata = {"tags": ["a"]}
    trace = full(metadata=metadata)
    named = trace.with_metadata(metadata)
    metadata["tags"].append("b")
    assert trace.metadata == named.metadata == {"tags": ["a"]}


def test_other_metadata_leave_the_readings_as_they_are() -> None:
    trace = full()
    speed = trace.blade_speed
    named = trace.with_metadata({"name": "my cut"})
    assert named == full(metadata={"name": "my cut"})
    assert named.force is trace.force
    assert named.blade_speed is speed
    assert trace == full()
    with pytest.raises(TypeError, match=r"metadata\['gain'\]"):
        trace.with_metadata({"gain": float("nan")})
    with pytest.raises(ValueError, match="read-only"):
        speed[0] = 1.0
    with pytest.raises(ValueError, match="blade_speed needs position"):
        _ = full(position=None).blade_speed


@pytest.mark.parametrize("copying", [copy.copy, copy.deepcopy, lambda t: pickle.loads(pickle.dumps(t))])
def test_copies_are_equal(copying: Callable[[Trace], Trace]) -> None:
    assert copying(full()) == full()


@pytest.mark.parametrize(
    "changes",
    [{"force": FULL["force"] + 1e-12}, {"depth": None}, {"force_unit": "1"}, {"metadata": {}}, {"time": TIME + 1.0}],
)
def test_any_difference_makes_traces_unequal(changes: dict[str, Any]) -> None:
    assert full(**changes) != full()
    assert full() != "a trace"


def check_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises((ValueError, TypeError), match=message):
        full(**changes)


REFUSALS = [
    ({"position": 2.54 * np.arange(6)}, "position = .* m is outside .*metres from the clamp.*centimetres"),
    ({"speed": np.full(6, 2.54)}, "speed = 2.54 m/s is outside .*cm/s, which is 0.0254"),
    ({"angle": np.full(6, 90.0)}, "angle = 90 rad is outside .*degrees"),
    ({"depth": np.full(6, 2.0)}, "depth = 2 m is outside .*centimetres"),
    ({"depth": np.full(6, -0.001)}, "depth = -0.001 m is outside"),
    ({"force": np.full(6, 4200.0)}, "force = 4200 N is outside .*millinewtons"),
    ({"time": np.arange(6) * 1.0}, "time steps by 1 s.*milliseconds"),
    ({"time": TIME[::-1]}, "time must increase strictly, but goes from 0.005 s to 0.004 s"),
    ({"time": np.array([0, 1, 2, 2, 3, 4]) * 1e-3}, "0.002 s to 0.002 s at instant 3.*repeated"),
    ({"force": np.arange(5) * 0.1}, "force has 5 values and time has 6"),
    ({"force": np.zeros((6, 3))}, r"force has shape \(6, 3\)"),
    ({"force": ["a"] * 6}, "force must be real numbers in N"),
    ({"force_unit": "mN"}, "force_unit must be one of 'N', '1'"),
    ({"metadata": {"when": {1, 2}}}, r"metadata\['when'\].*not what JSON can hold"),
    ({"metadata": {"gain": float("nan")}}, r"metadata\['gain'\]"),
    ({"metadata": {1: "a"}}, "metadata names are strings"),
    ({"metadata": [1]}, "metadata must map names"),
]


@pytest.mark.parametrize(("changes", "message"), REFUSALS)
def test_what_looks_wrong_is_refused_with_the_cure(changes: dict[str, Any], message: str) -> None:
    check_refused(changes, message)


@pytest.mark.parametrize("name", ["force", "position", "speed", "angle", "depth"])
def test_limits_are_the_last_values_that_are_taken(name: str) -> None:
    alone = {"time": TIME, "force": np.zeros(6)}
    for limit, beyond in zip(limits(name), (-np.inf, np.inf), strict=True):
        assert getattr(Trace(**alone | {name: np.full(6, limit)}), name)[0] == limit
        with pytest.raises(ValueError, match=f"{name} = .* is outside"):
            Trace(**alone | {name: np.full(6, np.nextafter(limit, beyond))})
    assert limits("force", "1") == (-1e9, 1e9)


def test_limits_of_what_is_no_field_are_refused() -> None:
    with pytest.raises(ValueError, match="Did you mean 'position'"):
        limits("positon")
    with pytest.raises(ValueError, match="force_unit must be one of"):
        limits("force", "mN")


def there_and_back(speed_unit: float, position_unit: float) -> Trace:
    time = np.arange(4000) * 1e-3
    speed = 0.0038 * np.where(time < 2.0, 1.0, -1.0) + 1e-4 * np.random.default_rng(0).standard_normal(4000)
    position = 0.0038 * np.minimum(time, 4.0 - time)
    return Trace(time=time, force=np.zeros(4000), speed=speed_unit * speed, position=position_unit * position)


def test_a_speed_that_agrees_with_the_position_is_taken() -> None:
    assert len(there_and_back(1.0, 1.0)) == 4000
    standing = np.full(4000, 0.03)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(4000)
    Trace(time=np.arange(4000) * 1e-3, force=standing, position=standing, speed=noise)


@pytest.mark.parametrize(("speed_unit", "position_unit"), [(100.0, 1.0), (1.0, 30.0), (1e-3, 1.0)])
def test_a_speed_in_another_unit_than_the_position_is_refused(speed_unit: float, position_unit: float) -> None:
    with pytest.raises(ValueError, match=r"speed and position disagree.*1 cm/s is 0.01"):
        there_and_back(speed_unit, position_unit)


@pytest.mark.parametrize("name", ["time", "force", "position", "speed", "angle", "depth"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_no_field_may_hold_a_value_that_is_not_finite(name: str, value: float) -> None:
    values = FULL[name].copy()
    values[2] = value
    check_refused({name: values}, name)


def test_one_instant_is_no_trace() -> None:
    with pytest.raises(ValueError, match="2 instants or more, got 1"):
        Trace(time=[0.0], force=[0.0])


def test_a_normalised_force_has_no_newtons() -> None:
    trace = full(force_unit="1", force=FULL["force"] * 1e4)
    with pytest.raises(ValueError, match=r"score needs force in newtons \(force_unit \"N\"\)"):
        trace.require_newtons(by="score")
    assert np.array_equal(full().require_newtons(by="score"), FULL["force"])


def test_require_names_the_function_and_what_is_missing() -> None:
    trace = full(position=None, speed=None, depth=None)
    with pytest.raises(ValueError, match=r"score needs position and depth, .* it holds time, force, angle"):
        trace.require("position", "angle", "depth", by="score")
    with pytest.raises(ValueError, match="Did you mean 'position'"):
        trace.require("positon", by="score")
    angle, time = trace.require("angle", "time", by="score")
    assert np.array_equal(angle, FULL["angle"])
    assert np.array_equal(time, TIME)


@pytest.mark.parametrize("which", [slice(1, 4), [1, 2, 3], np.array([0, 1, 1, 1, 0, 0], dtype=bool)])
def test_a_part_is_a_trace(which: Any) -> None:
    part = full().select(which)
    assert np.array_equal(part.force, FULL["force"][1:4])
    assert np.array_equal(part.depth, FULL["depth"][1:4])
    assert part.metadata == FULL["metadata"]


def test_a_part_that_is_no_trace_is_refused() -> None:
    with pytest.raises(ValueError, match="2 instants or more"):
        full().select(slice(0, 1))
    with pytest.raises(ValueError, match="a mask of shape"):
        full().select(np.ones(5, dtype=bool))
    with pytest.raises(ValueError, match="time must increase"):
        full().select([3, 2, 1])


def test_a_pause_left_out_does_not_look_like_another_speed() -> None:
    time = np.concatenate((np.arange(1000) * 1e-3, 600.0 + np.arange(1000) * 1e-3))
    position = 0.0254 * np.concatenate((np.arange(1000), np.arange(1000, 2000))) * 1e-3
    known = {"time": time, "force": np.zeros(2000), "position": position}
    assert np.all(Trace(**known, speed=np.full(2000, 0.0254)).speed == 0.0254)
    with pytest.raises(ValueError, match="speed"):
        Trace(**known, speed=np.full(2000, 0.5))


@given(st.lists(st.tuples(st.floats(-10.0, 10.0), st.floats(0.0, 0.1), st.floats(0.1, 1.5)), min_size=2, max_size=20))
def test_readings_make_the_trace_that_gives_them(rows: list[tuple[float, float, float]]) -> None:
    readings = [Reading(time=0.1 * i, force=F, depth=B, angle=q) for i, (F, B, q) in enumerate(rows)]
    trace = Trace.from_readings(readings, metadata={"n": len(rows)})
    assert list(trace) == readings
    assert trace.known == ("time", "force", "angle", "depth")


def test_a_field_known_to_some_readings_only_is_refused() -> None:
    readings = [Reading(0.0, 0.0, position=0.0), Reading(0.1, 0.0)]
    with pytest.raises(ValueError, match="position is None in 1 readings, but not in all"):
        Trace.from_readings(readings)
    with pytest.raises(ValueError, match="2 instants or more, got 0"):
        Trace.from_readings([])


def test_a_trace_shows_what_it_holds() -> None:
    assert repr(full(speed=None)) == (
        "Trace(time, force, position, angle, depth; 6 instants in 0.005 s, force_unit='N')"
    )
