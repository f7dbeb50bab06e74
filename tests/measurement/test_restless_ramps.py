"""Ramps that bend or hide a drop tell a wrong slope: they are known by their scatter, however few there are."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.measurement import Segment, loading_segments
from cutenv.measurement.modulus import telling
from cutenv.trace import Trace

NOISE = 0.025  # [N]
SPEED = 0.0127  # [m/s]


def saw(kink: float = 0.0, *, rate: float = 1000.0, noise: float = NOISE, repeated: int = 1) -> list[Segment]:
    """Three ramps of 0.4 s from 1 N to 3 N; from the middle on the last one rises by ``kink`` less [N/s].

    ``repeated`` readings share their noise, as an interpolated record's do.
    """
    time = np.arange(round(1.3 * rate)) / rate
    force = 1.0 + 5.0 * (time % 0.4)
    force -= np.where((time > 1.0) & (time < 1.2), kink * (time - 1.0), 0.0)
    rng = np.random.default_rng(1)
    disturbed = np.repeat(rng.normal(0.0, noise, len(time) // repeated + 1), repeated)[: len(time)]
    return loading_segments(Trace(time=time, force=force + disturbed, position=SPEED * time, angle=None))


def test_straight_ramps_are_restless_by_one_at_any_noise() -> None:
    for noise in (0.01, 0.025, 0.05):
        assert [ramp.restlessness for ramp in saw(noise=noise)[:3]] == pytest.approx([1.0] * 3, abs=0.2)


def test_a_bent_ramp_is_restless_and_tells_nothing() -> None:
    straight, bent = (saw(kink)[:3] for kink in (0.0, 4.0))
    assert [ramp.start for ramp in bent] == [ramp.start for ramp in straight]
    assert [ramp.is_steady for ramp in bent] == [ramp.is_steady for ramp in straight] == [False, True, True]
    assert [ramp.restlessness > 1.3 for ramp in bent] == [False, False, True]
    assert telling(straight) == straight[1:]
    assert telling(bent) == bent[1:2]


def test_a_bent_ramp_tells_nothing_though_it_is_the_only_one() -> None:
    """Beside itself it is as restless as usual."""
    assert telling(saw(4.0)[2:3]) == []
    assert telling(saw()[2:3]) == saw()[2:3]


def test_noise_that_lasts_is_no_bend() -> None:
    assert max(ramp.restlessness for ramp in saw(rate=10_000.0, repeated=10)[:3]) < 1.3


def test_a_ramp_without_noise_may_bend_with_the_depth() -> None:
    time = np.arange(1300) / 1000.0
    part = time % 0.4
    trace = Trace(time=time, force=1.0 + 4.0 * part + 3.0 * part**2, position=SPEED * time)
    ramps = [ramp for ramp in loading_segments(trace) if ramp.is_steady]
    assert all(ramp.restlessness > 1.3 for ramp in ramps)
    assert telling(ramps) == ramps != []
