"""A measured depth profile is told every half millimetre, and covers the whole cut or is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted_operator import ScriptedOperator

from cutenv.rig.config.depth_profile import measured_depth
from cutenv.rig.config.settings import RigSettings, SafetyLimits
from cutenv.rig.errors import RigError
from cutenv.rig.operation.specimen_source import SpecimenKey, SpecimensByHand


def of(*points: tuple[float, float]) -> RigSettings:
    return RigSettings(depth_profile=points)


def test_depth_is_linear_between_points_and_constant_beyond() -> None:
    depth = measured_depth(of((0.001, 0.010), (0.061, 0.016), (0.101, 0.012)))
    place = np.arange(301) * 0.0005
    assert depth.shape == (301,)
    assert depth[2] == pytest.approx(0.010, rel=1e-12)
    assert np.array_equal(depth[:2], [0.010, 0.010])
    assert depth[62] == pytest.approx(0.013, rel=1e-12)  # 31 mm
    assert np.array_equal(depth[place > 0.101], np.full(sum(place > 0.101), 0.012))


@given(depths=st.lists(st.floats(0.001, 0.06), min_size=2, max_size=6))
def test_no_depth_lies_beyond_those_measured(depths: list[float]) -> None:
    along = measured_depth(of(*zip(np.linspace(0.0, 0.15, len(depths)).tolist(), depths, strict=True)))
    assert min(depths) <= along.min() * (1 + 1e-12)
    assert along.max() <= max(depths) * (1 + 1e-12)


def test_a_profile_must_reach_the_target_that_is_cut_to() -> None:
    settings = of((0.0, 0.01), (0.08, 0.01))
    assert measured_depth(settings, 0.08)[-1] == 0.01
    with pytest.raises(ValueError, match="ends at 80 mm, and the blade goes to 90 mm"):
        measured_depth(settings, 0.09)


def test_a_short_travel_needs_a_short_profile() -> None:
    short = RigSettings(limits=SafetyLimits(high=0.03), depth_profile=((0.0, 0.01), (0.03, 0.01)))
    assert measured_depth(short).shape == (301,)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ((), "has 0 points, and needs 2 or more. Measure the specimen"),
        (((0.0, 0.01), (0.0, 0.01), (0.1, 0.01)), "goes from 0 to 0 mm; positions must rise"),
        (((0.0, 0.01), (0.1, 0.0009)), "depth = 0.9 mm is outside 1 to 60 mm"),
        (((0.0, 0.01), (0.1, float("nan"))), "depth = nan mm"),
        (((float("nan"), 0.01), (0.1, 0.01)), "position = nan mm"),
    ],
)
def test_a_bad_profile_is_refused_in_millimetres(points: tuple[tuple[float, float], ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        measured_depth(of(*points))


def test_every_specimen_has_the_profile_that_stands_in_the_file_when_it_is_laid() -> None:
    profiles = [of((0.0, 0.01), (0.15, 0.01)), of((0.0, 0.02), (0.15, 0.02)), of((0.0, 0.02), (0.07, 0.02))]
    operator = ScriptedOperator([("without power", True)] * 3)
    supply = SpecimensByHand(lambda: profiles.pop(0), operator)
    for episode, depth in enumerate((0.01, 0.02)):
        laid = supply.mount(SpecimenKey(seed=0, episode=episode, target=0.08))
        assert laid is not None
        assert laid[0] == depth
    with pytest.raises(RigError, match=r"depth of the specimen is not known.* ends at 70 mm"):
        supply.mount(SpecimenKey(seed=0, episode=2, target=0.08))
