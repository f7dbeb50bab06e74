"""Under real conditions: what ``scripts/measure_recovery.py`` prints, on a few livers."""

from __future__ import annotations

from typing import Any

import measure_recovery as script
import pytest

from cutenv.measurement.zero import TAKEN_OFF


@pytest.fixture(scope="module")
def cuts() -> Any:
    """At the higher speeds: the slow cuts have most of the readings."""
    return script.cut_specimens(0.11, 8, seed=1, speeds=script.SPEEDS[3:])


def found(cuts: Any, condition: str) -> Any:
    return script.recovery(cuts, script.CONDITIONS[condition])


def check_promise(
    cuts: Any, condition: str, *, resistance: float, modulus: float, friction: float, refused: int = 0
) -> None:
    """95th percentiles of the errors of single cuts of 11 cm."""
    errors = found(cuts, condition)
    assert errors.refused == refused
    assert errors.resistance[1] < resistance
    assert errors.modulus[1] < modulus
    assert errors.friction[1] < friction


def test_a_long_cut_gives_back_what_was_cut(cuts: Any) -> None:
    check_promise(cuts, "exact depth", resistance=0.05, modulus=0.05, friction=0.02)
    # One, of tissue that an inclined blade cuts almost without a run, shows two ramps and no way back.
    check_promise(cuts, "exact depth, no return stroke", resistance=0.10, modulus=0.06, friction=0.10, refused=1)
    check_promise(cuts, "depth known to 0.5 mm", resistance=0.10, modulus=0.15, friction=0.03)


def check_costs_nothing(cuts: Any, condition: str, than: str, tolerance: float = 1e-4) -> None:
    errors, right = (found(cuts, name) for name in (condition, than))
    for name in ("resistance", "modulus", "friction"):
        assert getattr(errors, name) == pytest.approx(getattr(right, name), abs=tolerance), name


def test_offset_and_drift_cost_nothing_where_the_blade_rested(cuts: Any) -> None:
    check_costs_nothing(cuts, "  offset 0.2 N", "depth known to 0.5 mm")
    check_costs_nothing(cuts, "  drift 0.3 N", "depth known to 0.5 mm", 0.01)  # friction may hold the blade at the end
    check_costs_nothing(cuts, "  no return stroke, offset 0.2 N", "  no return stroke")


def test_an_offset_that_stays_in_the_force_is_noticed(cuts: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def left_in(cut: Any) -> Any:
        trace = script.with_offset(cut)
        return script.dataclasses.replace(trace, metadata={TAKEN_OFF: {"before": 0.0}})

    monkeypatch.setitem(script.CONDITIONS, "left in", left_in)
    with pytest.raises(AssertionError):
        check_costs_nothing(cuts, "left in", "depth known to 0.5 mm")
