"""The sensor's zero: an offset and a drift cost nothing where the blade rested free, and are told where it did not."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from recorded_cut import RecordedCut, rested_cut

from cutenv.records.measurement import (
    DepthProfile,
    estimate_fracture_resistance,
    estimate_local_effective_moduli,
    fit_return_stroke,
    measure_cuts,
    zeroed,
)
from cutenv.records.measurement.calibration import zero_notes
from cutenv.records.measurement.zero import TAKEN_OFF, TARED
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.trace import Trace

MODEL = CutModel()
ERRORS = {"offset": (0.2, 0.0), "offset the other way": (-0.2, 0.0), "drift": (0.0, 0.3), "both": (1.5, -0.3)}
"""Offset [N], and drift [N] over the record."""


def shifted(trace: Trace, offset: float, drift: float = 0.0) -> Trace:
    along = (trace.time - trace.time[0]) / trace.duration
    return dataclasses.replace(trace, force=trace.force + offset + drift * along)


def let_go(cut: RecordedCut) -> Trace:
    """The same, as if the blade that rests after the cut had been lifted out of the tissue, where nothing holds it."""
    held = int(np.flatnonzero(cut.trace.position > 1e-6)[-1])
    force = cut.trace.force.copy()
    force[held:] = 0.02 * np.random.default_rng(2).standard_normal(len(force) - held)
    return dataclasses.replace(cut.trace, force=force)


def restless(trace: Trace) -> Trace:
    """The same without its rests: from the first motion to the last."""
    moved = np.flatnonzero(trace.position > 1.5e-3)
    return trace.select(slice(int(moved[0]), int(moved[-1])))


def found(trace: Trace) -> list[float]:
    fracture, moduli = estimate_fracture_resistance(trace), estimate_local_effective_moduli(trace, MODEL)
    return [fracture.corrected, fracture.apparent, fracture.friction_per_depth, moduli.mean]


def check_costs_nothing(trace: Trace, right: list[float], tolerance: float = 1e-3) -> None:
    assert found(trace) == pytest.approx(right, rel=tolerance)


@pytest.mark.parametrize("error", ERRORS)
@pytest.mark.parametrize("kind", ["2 cm", "liver"])
def test_offset_and_drift_cost_nothing_where_the_blade_rested_before_and_after(kind: str, error: str) -> None:
    trace = let_go(rested_cut(kind))
    check_costs_nothing(shifted(trace, *ERRORS[error]), found(trace))


def test_offset_and_drift_left_in_the_force_are_noticed() -> None:
    trace = rested_cut("liver").trace
    said = dataclasses.replace(trace, metadata={TAKEN_OFF: {"before": 0.0}})
    for error in ERRORS.values():
        with pytest.raises(AssertionError):
            check_costs_nothing(shifted(said, *error), found(trace), 0.02)


def test_one_rest_tells_a_constant() -> None:
    trace = rested_cut("liver").trace
    start, end = np.flatnonzero(trace.position > 1.5e-3)[[0, -1]]
    for part in (slice(end), slice(start, None)):
        check_costs_nothing(shifted(trace.select(part), 0.2), found(trace), 0.01)


@pytest.mark.parametrize("offset", [0.2, -0.2, 0.0])
def test_where_nobody_rested_free_the_way_back_tells_the_offset_if_depth_varies(offset: float) -> None:
    trace = restless(rested_cut("liver").trace)
    check_costs_nothing(shifted(trace, offset), found(trace), 0.01)
    _, zero = zeroed(shifted(trace, offset))
    assert zero.return_stroke == pytest.approx(offset, abs=0.01)
    assert (zero.before, zero.after) == (None, None)


def test_friction_of_an_even_depth_hides_the_offset_and_that_is_said() -> None:
    trace = shifted(restless(rested_cut("2 cm").trace), 0.2)
    plain, zero = zeroed(trace)
    assert not zero.is_known
    assert np.array_equal(plain.force, trace.force)
    for estimate in (estimate_fracture_resistance(trace), estimate_local_effective_moduli(trace, MODEL)):
        assert any("zero is not seen" in flag for flag in estimate.flags)
    assert fit_return_stroke(trace, DepthProfile.recorded(trace, by="the test"), with_offset=True) is None


def test_a_record_that_was_tared_needs_no_rest() -> None:
    trace = restless(rested_cut("2 cm").trace)
    tared = dataclasses.replace(trace, metadata={TARED: {"Fx": 0.2}})
    assert estimate_fracture_resistance(tared).flags == ()


def test_the_zero_is_taken_off_once_and_stands_in_the_record() -> None:
    trace = shifted(rested_cut("liver").trace, 0.2, 0.1)
    once, zero = zeroed(trace)
    twice, again = zeroed(once)
    assert once.metadata[TAKEN_OFF] == {"before": zero.before, "after": zero.after, "return_stroke": None}
    assert (zero.before, zero.after) == (pytest.approx(0.2, abs=0.01), pytest.approx(0.3, abs=0.01))
    assert twice == once
    assert again == zero
    assert estimate_fracture_resistance(once).flags == estimate_fracture_resistance(trace).flags
    assert "0.20 N before and 0.30 N after" in zero.flags[0]


def check_only_the_rest_before_counts(trace: Trace) -> None:
    _, zero = zeroed(trace)
    assert zero.before == pytest.approx(0.0, abs=0.01)
    assert zero.after is None


def test_a_blade_that_rests_in_the_cut_tells_no_zero() -> None:
    forward = rested_cut("liver").forward().trace
    n = len(forward)
    resting = np.minimum(np.arange(n + 500), n - 1)  # it stands where it stopped, under load
    columns: dict[str, Any] = {name: getattr(forward, name)[resting] for name in ("force", "position", "depth")}
    check_only_the_rest_before_counts(Trace(time=np.arange(n + 500) * 1e-3, **columns))


def test_friction_that_holds_a_resting_blade_is_no_zero() -> None:
    """In tissue 2 cm deep, as a spring between blade and tissue holds it; what lets go is one."""
    trace = let_go(rested_cut("2 cm"))
    held = np.flatnonzero(trace.position > 1e-6)[-1]
    sliding = float(trace.force[held - 300 : held - 50].mean())
    assert sliding < -0.5
    force = trace.force.copy()
    force[held:] = sliding
    check_only_the_rest_before_counts(dataclasses.replace(trace, force=force))
    with pytest.raises(AssertionError):
        check_only_the_rest_before_counts(trace)


def held_at_the_end(cut: RecordedCut) -> Trace:
    """The same, as if friction still held the blade that rests after the cut."""
    trace = let_go(cut)
    held = np.flatnonzero(trace.position > 1e-6)[-1]
    force = trace.force.copy()
    force[held:] -= cut.specimen.friction_per_depth * trace.depth[held:]
    return dataclasses.replace(trace, force=force)


@pytest.mark.parametrize("error", ERRORS)
def test_friction_that_holds_a_resting_blade_in_thin_tissue_is_found_and_left_out(error: str) -> None:
    cut = rested_cut("liver", turns=(0.06, 0.0))
    check_costs_nothing(shifted(held_at_the_end(cut), *ERRORS[error]), found(let_go(cut)), 0.02)


def test_friction_that_is_taken_for_the_zero_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    cut = rested_cut("liver", turns=(0.06, 0.0))
    monkeypatch.setattr("cutenv.records.measurement.zero._LET_GO", -1.0)  # every blade that rests counts as let go
    with pytest.raises(AssertionError):
        check_costs_nothing(held_at_the_end(cut), found(let_go(cut)), 0.02)


def test_a_force_that_changes_at_rest_tells_no_zero() -> None:
    trace = rested_cut("liver").trace
    rest = int(np.argmax(trace.position > 0.0))
    force = trace.force.copy()
    force[:rest] += np.linspace(0.0, 0.3, rest)
    assert zeroed(dataclasses.replace(trace, force=force))[1].before is None


def test_a_noisy_position_rests_too() -> None:
    trace = rested_cut("liver").trace
    noise = 2e-5 * np.random.default_rng(1).standard_normal(len(trace))
    noisy = shifted(dataclasses.replace(trace, position=trace.position + noise, speed=None), 0.2)
    _, zero = zeroed(noisy)
    assert (zero.before, zero.after) == (pytest.approx(0.2, abs=0.01), pytest.approx(0.2, abs=0.03))


# Calibration says when an offset cannot be told from friction and spread.


def notes_of(traces: list[Trace]) -> str:
    cuts, refused = measure_cuts(traces, MODEL)
    assert refused == []
    return "\n".join(zero_notes(cuts))


def check_warned(notes: str, *said: str) -> None:
    for words in said:
        assert words in notes


@pytest.mark.parametrize("offset", [0.0, 0.2])
def test_calibration_warns_where_friction_hides_an_offset(offset: float) -> None:
    even, varied = (restless(rested_cut(kind).trace) for kind in ("2 cm", "liver"))
    notes = notes_of([shifted(even, offset), shifted(varied, offset)])
    # 0.1 N over 2 cm and 211 J/m2
    check_warned(notes, "1 of 2 cuts do not show the sensor's zero", "cannot be told apart", "share by 0.02 or more")


def test_calibration_says_what_was_taken_off() -> None:
    cut, other = rested_cut("2 cm").trace, rested_cut("liver").trace
    assert notes_of([cut, other]) == ""
    notes = notes_of([cut, shifted(other, 0.2, 0.1)])
    assert notes == "the sensor's zero was taken off the force: 0.30 to 0.30 N in 1 of 2 cuts"


def test_calibration_warns_where_the_blade_was_not_free_at_rest() -> None:
    """It pressed on the tissue from the first reading on, or the record was tared so."""
    trace = shifted(rested_cut("liver").trace, -0.2)
    said = dataclasses.replace(trace, metadata={TARED: {"Fx": 0.2}})
    check_warned(notes_of([restless(said)]), "constant -0.20 N (median) beside friction")
    with pytest.raises(AssertionError):
        check_warned(notes_of([restless(rested_cut("liver").trace)]), "beside friction")
