"""The record reduced to its hilltops and valleys."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.measurement import filtered, loading_segments
from cutenv.trace import Trace


@pytest.fixture
def sawtooth():
    time = np.arange(6000) / 1000.0
    position = 0.02 + 0.01 * time
    clean = 2.0 + 0.8 * (time % 1.0)
    noisy = clean + np.random.default_rng(0).normal(0.0, 0.02, len(time))
    return clean, Trace(time=time, position=position, force=noisy)


def test_noise_goes_and_hilltops_and_valleys_stay(sawtooth):
    clean, trace = sawtooth
    found = filtered(trace)
    away_from_drops = np.abs((trace.time % 1.0) - 0.5) < 0.45
    inside = away_from_drops & (trace.time > 0.1) & (trace.time < 5.9)
    assert np.abs(found.force - clean)[inside].max() < 0.03
    assert np.abs(trace.force - clean)[inside].max() > 0.06
    falling = found.time[1:][np.diff(found.force) < -0.005]
    assert np.unique(np.round(falling[falling > 0.1])).tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_the_filtered_record_has_the_same_segments(sawtooth):
    _, trace = sawtooth
    before, after = loading_segments(trace), loading_segments(filtered(trace))
    assert len(before) == len(after) == 6
    assert [s.slope for s in after] == pytest.approx([s.slope for s in before], rel=0.05)


def test_a_stroke_back_stays_as_recorded(sawtooth):
    _, trace = sawtooth
    back = Trace(time=trace.time, position=trace.position[::-1], force=trace.force)
    assert np.array_equal(filtered(back).force, back.force)


def test_a_drop_below_the_noise_is_refused(sawtooth):
    with pytest.raises(ValueError, match="smallest_drop"):
        filtered(sawtooth[1], smallest_drop=-1.0)
