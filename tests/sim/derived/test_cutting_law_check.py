"""The worked-out check of the cutting law: homogeneous tissue, 10 cm, four speeds, two angles; laws that fail."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from led_cut import LedCut, changed_law, constant_feed, homogeneous, lead, lead_by, liver, residual_of

from scripts.validation.thesis.worked_check import EXPECTED, MEASURES, Expected, LawCut, loading_slopes

FAST, INCLINED = EXPECTED[3], EXPECTED[-1]
UNITS, SHARE, PEAK, SLOPE, LAG, WORK, RESIDUAL = MEASURES


def found_of(led: LedCut) -> LawCut:
    return LawCut(led.readings, led.end, led.stored[-1], float(np.abs(residual_of(led)).max()))


@functools.cache
def cut_of(expected: Expected) -> LawCut:
    return found_of(lead(homogeneous(), constant_feed(expected.speed), expected.angle))


@pytest.mark.parametrize("expected", EXPECTED, ids=lambda expected: expected.name)
def test_a_cut_is_as_calculated(expected: Expected) -> None:
    rows = [row_of(of, expected, cut_of(expected)) for of, row_of in MEASURES.items()]
    assert [row for row in rows if not row.agrees] == []
    assert len(loading_slopes(cut_of(expected), expected)) >= expected.units - 2


def check(led: LedCut, of: str, expected: Expected = FAST) -> None:
    """The cut passes for the one that is expected."""
    row = MEASURES[of](of, expected, found_of(led))
    assert row.agrees, row


def by(*changes: tuple[str, str], expected: Expected = FAST) -> LedCut:
    return lead_by(changed_law(*changes), homogeneous(), constant_feed(expected.speed), expected.angle)


@pytest.mark.parametrize("of", [UNITS, SHARE, PEAK])
def test_doubled_eta90_fails(of: str) -> None:
    led = lead(homogeneous(tissue=liver(eta90=0.56)), constant_feed(FAST.speed), FAST.angle)
    with pytest.raises(AssertionError):
        check(led, of)


def test_tissue_of_twice_the_stiffness_fails_the_mean_lag() -> None:
    led = lead(homogeneous(modulus=2 * 48.36e3), constant_feed(FAST.speed))
    with pytest.raises(AssertionError):
        check(led, LAG)


@pytest.mark.parametrize(
    ("of", "expected", "old", "new"),
    [
        (PEAK, INCLINED, "law.eta90 * pushing", "law.eta90"),
        (SLOPE, FAST, "* K * loading.length / softening", "* loading.length"),
        (SHARE, FAST, "ratio: float = min(1.0, modulus / law.quasi_static_modulus)", "ratio = 1.0"),
        (SLOPE, FAST, "ratio: float = min(1.0, modulus / law.quasi_static_modulus)", "ratio = 1.0"),
        (RESIDUAL, FAST, "change = U - next_U - spent", "change = F * (tip - a) - spent"),
        (WORK, EXPECTED[2], "if ledger <= 0.0 and F < toughness:", "if F < toughness:"),
    ],
    ids=[
        "eta blind to the angle",
        "growth blind to the falling stiffness",
        "never cuts as it loads: share",
        "never cuts as it loads: slope",
        "force times growth, not the difference of stored energy",
        "a run stops at the resistance and wastes energy",
    ],
)
def test_a_law_broken_on_purpose_fails(of: str, expected: Expected, old: str, new: str) -> None:
    led = by((old, new), expected=expected)
    with pytest.raises(AssertionError):
        check(led, of, expected)
