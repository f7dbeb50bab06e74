"""A record as a plant: it gives back what was recorded, whatever it is told, and says what it lacks."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from recorded_cut import recorded_cut

from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.plant import ReplayPlant, to_trace
from cutenv.sim.tissue.specimen import SPACING
from cutenv.sim.trace import Trace

FIELDS = ("force", "position", "speed", "angle")


@pytest.fixture(scope="module")
def trace() -> Trace:
    return recorded_cut("liver", turns=(0.06, 0.05), angle_deg=60.0).trace


def test_a_record_of_1_khz_comes_back_bit_for_bit_whatever_is_commanded(trace: Trace) -> None:
    plant = ReplayPlant(trace)
    parts = [plant.advance(-1.0 * k, 0.5, 20).copy() for k in range(len(trace) // 20)]
    given = np.concatenate(parts)
    for name in FIELDS:
        assert (given[name] == getattr(trace, name)[: len(given)]).all()
    assert given["time"] == pytest.approx(TICK * np.arange(1, len(given) + 1))
    assert np.isnan(given["tip"]).all()
    assert plant.left == len(trace) - len(given)


def test_a_record_of_fewer_readings_is_interpolated_to_milliseconds(trace: Trace) -> None:
    plant = ReplayPlant(trace.select(slice(None, None, 10)))
    given = plant.advance(0.0, 0.0, 1001)
    assert given["position"] == pytest.approx(trace.position[:1001], abs=2e-6)
    assert given["force"][::10] == pytest.approx(trace.force[:1001:10])
    between = given["force"][::10][:-1], given["force"][5::10], given["force"][::10][1:]
    assert between[1] == pytest.approx((between[0] + between[2]) / 2.0)


def test_the_depth_is_the_one_that_was_recorded(trace: Trace) -> None:
    plant = ReplayPlant(trace)
    again = to_trace(plant, plant.advance(0.0, 0.0, len(trace)).copy())
    assert again.depth == pytest.approx(trace.depth, abs=1e-5)
    beyond = round(float(trace.position.max()) / SPACING) + 2
    assert (plant.depth[beyond:] == plant.depth[beyond]).all()


def test_a_speed_that_was_not_recorded_is_that_of_the_position(trace: Trace) -> None:
    plant = ReplayPlant(dataclasses.replace(trace, speed=None))
    steady = slice(500, 2000)
    assert plant.readings["speed"][steady] == pytest.approx(trace.speed[steady], abs=1e-4)


def test_the_end_of_the_record_is_an_error(trace: Trace) -> None:
    plant = ReplayPlant(trace)
    plant.advance(0.0, 0.0, len(trace) - 5)
    with pytest.raises(EOFError, match="5 more milliseconds, not 6"):
        plant.advance(0.0, 0.0, 6)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"angle": None}, "needs angle"),
        ({"depth": None, "position": None, "speed": None}, "needs position and depth"),
        ({"force_unit": "1"}, "needs force in newtons"),
    ],
)
def test_what_the_record_lacks_is_named(trace: Trace, changes: dict, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        ReplayPlant(dataclasses.replace(trace, **changes))


def test_a_record_that_begins_within_the_cut_or_is_too_coarse_is_refused(trace: Trace) -> None:
    with pytest.raises(ValueError, match=r"position at the start.*begins at the clamp"):
        ReplayPlant(trace.select(slice(3000, None)))
    with pytest.raises(ValueError, match=r"sample_rate = 10 Hz.*more often"):
        ReplayPlant(trace.select(slice(None, None, 100)))
