"""Disturbed records: the results stay within stated bounds, or the record is refused.

The disturbances, their ranges and the bounds stand in ``scripts/record_robustness.py``, which prints the table.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import record_robustness as robust
from hypothesis import given, settings
from hypothesis import strategies as st

from cutenv.trace import Trace

some = settings(max_examples=12)
few = settings(max_examples=6)  # for what takes most of a second
cuts = st.sampled_from(robust.CONDITIONS)
seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def check_within(kind: str, condition: tuple[Any, ...], disturbed: Trace) -> None:
    """A record that is measured tells what it told undisturbed."""
    known = robust.record(*condition)
    found = known.measured(disturbed)
    if not isinstance(found, robust.Refused):
        moved = found.moved(robust.undisturbed(known))
        assert moved.within(robust.BOUNDS[kind]), (kind, moved)


def check_measured(condition: tuple[Any, ...], disturbed: Trace) -> None:
    found = robust.record(*condition).measured(disturbed)
    assert not isinstance(found, robust.Refused), found


def of(condition: tuple[Any, ...]) -> Trace:
    trace: Trace = robust.record(*condition).trace
    return trace


@some
@given(cuts, seeds, st.floats(0.0, robust.NOISE))
def test_noise_moves_results_within_their_bounds(condition, rng, sd):
    check_within("noise", condition, robust.noisier(of(condition), rng, sd))


@few
@given(cuts, st.floats(math.log(robust.RATES[0]), math.log(robust.RATES[1])).map(math.exp))
def test_any_sample_rate_from_100_hz_to_10_khz_gives_the_same_results(condition, rate):
    check_within("sample rate", condition, robust.resampled(of(condition), rate))


@few
@given(cuts)
def test_a_file_in_other_units_gives_the_same_results(condition):
    disturbed = robust.through_other_units(of(condition))
    check_measured(condition, disturbed)
    check_within("other units", condition, disturbed)


@some
@given(cuts, st.floats(-1e5, 1e6))
def test_where_the_clock_starts_does_not_matter(condition, start):
    disturbed = robust.shifted_in_time(of(condition), start)
    check_measured(condition, disturbed)
    check_within("other clock", condition, disturbed)


@some
@given(cuts, st.floats(-robust.OFFSET, robust.OFFSET))
def test_a_zero_that_is_off_does_no_harm_where_the_blade_rested_and_else_what_it_is_mistaken_for(condition, zero):
    check_within("offset", condition, robust.offset(of(condition), zero))
    check_within("offset left in", condition, robust.offset_left_in(of(condition), zero))


@some
@given(cuts, st.floats(0.02, 0.9), st.floats(0.002, 2.0))
def test_a_gap_is_refused_or_does_no_harm(condition, at, seconds):
    disturbed = robust.with_gap(of(condition), at, seconds)
    check_within("gap", condition, disturbed)
    lost = float(np.diff(disturbed.time).max())
    (travel,) = np.abs(np.diff(disturbed.position))[[int(np.argmax(np.diff(disturbed.time)))]]
    if lost > 0.02 and travel > 2e-3:
        assert isinstance(robust.record(*condition).measured(disturbed), robust.Refused)


@some
@given(cuts, seeds, st.floats(0.0, robust.JITTER))
def test_a_jittered_clock_hardly_matters(condition, rng, steps):
    check_within("jitter", condition, robust.jittered(of(condition), rng, steps))


@some
@given(cuts, st.floats(1e-6, robust.ENCODER))
def test_an_encoder_hardly_matters(condition, step):
    check_within("encoder", condition, robust.by_encoder(of(condition), step))


@few
@given(cuts, st.sampled_from(sorted(robust.PROTOCOLS)))
def test_more_return_strokes_tell_the_same(condition, protocol):
    found = robust.record(*condition, robust.PROTOCOLS[protocol])
    check_measured(condition, found.trace)
    check_within("strokes", condition, found.trace)


@pytest.mark.parametrize("condition", robust.CONDITIONS)
def test_a_reversed_force_is_refused(condition):
    found = robust.record(*condition).measured(robust.reversed_sign(of(condition)))
    assert isinstance(found, robust.Refused)
    assert "Reverse its sign" in found.reason


@pytest.mark.parametrize(
    ("kind", "disturb"),
    [
        ("noise", lambda trace: dataclasses.replace(trace, force=1.2 * trace.force)),
        ("sample rate", lambda trace: dataclasses.replace(trace, depth=0.9 * trace.depth)),
        ("offset", lambda trace: robust.offset_left_in(trace, 0.1)),
        ("strokes", lambda trace: robust.offset_left_in(trace, -0.2)),
    ],
    ids=["another gain", "another depth", "a zero left in", "a zero far off"],
)
def test_what_moves_results_further_is_noticed(kind, disturb):
    condition = robust.CONDITIONS[1]
    with pytest.raises(AssertionError, match=kind):
        check_within(kind, condition, disturb(of(condition)))


def test_at_least_95_percent_of_valid_records_with_mild_noise_are_accepted():
    """Forty here; the script counts a thousand."""
    reasons = robust.refusals(40)
    assert 1.0 - len(reasons) / 40 >= robust.ACCEPTED, reasons
