"""Calibration end to end: tissue that is known comes out of the records alone; and under real conditions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from recorded_cut import recorded_cut
from virtual_session import EVEN, MODEL, SPEEDS, measured, rig, tissue_with, traces

from cutenv.records.measurement import (
    MeasuredCut,
    estimate_initiation,
    initiation_excess,
    measure_cut,
    measure_cuts,
    segments,
    tissue_of,
)
from cutenv.records.measurement.zero import TAKEN_OFF
from cutenv.sim.tissue import Specimen, TissueDescription
from scripts.validation.measurement import recovery as script
from scripts.validation.measurement.calibration_studies import slow_and_noisy
from scripts.validation.thesis.virtual_cuts import true_moduli, true_resistance

RESISTANCE = 0.05
"""Largest error of the resistance, as a share of what was put in, with a return stroke."""
MODULUS = 0.05
"""Of the modulus, median over a cut's segments; measured: 0.002 at low speeds, 0.037 at 2.54 cm/s."""
FRICTION = 0.03
"""Difference of friction's shares of the resistance; measured: 0.009."""
ETA = 0.03
"""Difference of eta90."""
ETA_HOMOGENEOUS = 0.02
"""The same of one cut in homogeneous tissue; measured: 0.007 at a depth of 2 cm, 0.018 with the bulge."""
ETA_TOLD = 0.015
"""Bias that the evidence of eta90 tells of; measured: 0.006 with noise, 0.026 where drops of noise count."""
FEWEST = 3  # segments, of which a median is taken
SIBLINGS: dict[str, dict[str, Any]] = {
    "pig liver": {},
    "little initiation, much friction": {"eta90": 0.22, "friction_share": 0.35},
    "stiff, weak, no friction": {
        "modulus": 60e3, "intercept_90": 80e3, "slope_90": -1e6, "intercept_45": 60e3, "slope_45": -1.5e6,
        "fracture_resistance": 120.0, "friction_share": 0.0, "eta90": 0.4,
    },
}  # fmt: skip


def calibrated(**changes: Any) -> TissueDescription:
    """What a small session in tissue without spread tells: one liver, both angles, three speeds."""
    return tissue_of([cut for cut, _ in measured(livers=1, **EVEN, **changes)], MODEL, resamples=0)


def check_recovers(found: TissueDescription, put_in: TissueDescription) -> None:
    """Every number that an even tissue has, within what this project promises."""
    assert found.modulus == pytest.approx(put_in.modulus, rel=MODULUS)
    for speed in SPEEDS:
        for angle in (90, 45):
            modulus, truth = (
                level * tissue.local_effective_modulus(speed, math.radians(angle))
                for tissue, level in ((found, 1.0), (put_in, put_in.modulus / put_in.intercept_90))
            )
            assert modulus == pytest.approx(truth, rel=MODULUS), (speed, angle)
    assert found.fracture_resistance == pytest.approx(put_in.fracture_resistance, rel=RESISTANCE)
    assert found.friction_share == pytest.approx(put_in.friction_share, abs=FRICTION)
    assert found.eta90 == pytest.approx(put_in.eta90, abs=ETA)
    for name in ("edge_depth", "crown_depth", "rise_length"):
        assert getattr(found, name) == pytest.approx(getattr(put_in, name), rel=0.01)


@pytest.mark.parametrize("name", SIBLINGS)
def test_every_number_of_a_tissue_comes_out_as_it_was_put_in(name: str) -> None:
    check_recovers(calibrated(**SIBLINGS[name]), tissue_with(**SIBLINGS[name]))


@pytest.mark.parametrize(
    "other",
    [{"eta90": 0.22}, {"friction_share": 0.3}, {"fracture_resistance": 180.0}, {"intercept_90": 60e3},
     {"slope_45": -0.9e6}, {"rise_length": 0.03}],
    ids=lambda other: next(iter(other)),
)  # fmt: skip
def test_another_tissue_than_was_cut_is_noticed(other: dict[str, float]) -> None:
    with pytest.raises(AssertionError):
        check_recovers(calibrated(), tissue_with(**other))


def test_the_range_of_speeds_is_that_of_the_cuts() -> None:
    found = calibrated()
    assert found.speed_min == pytest.approx(min(SPEEDS), rel=0.01)
    assert found.speed_max == pytest.approx(max(SPEEDS), rel=0.01)


def test_tissue_without_spread_is_given_none() -> None:
    found = calibrated()
    for name in (
        "modulus_between_cut_cv",
        "modulus_within_cut_cv",
        "fracture_between_cut_cv",
        "fracture_within_cut_cv",
    ):
        assert getattr(found, name) <= 0.03, name


def test_the_modulus_of_unloading_is_that_of_slow_upright_loading() -> None:
    """So the fall with speed is growth of the cut while loading: with it switched off the two would be apart."""
    unloading = [cut.unloading_modulus(MODEL) for cut, _ in measured(livers=1, **EVEN)]
    assert np.median([each for each in unloading if each is not None]) == pytest.approx(
        tissue_with().modulus, rel=MODULUS
    )


def check_resistance(cuts: Sequence[tuple[MeasuredCut, Specimen]], by: str = "corrected") -> None:
    for cut, specimen in cuts:
        truth = true_resistance(specimen, cut.fracture.cut_length)
        assert getattr(cut.fracture, by) == pytest.approx(truth, rel=RESISTANCE), cut.name


def check_friction(cuts: Sequence[tuple[MeasuredCut, Specimen]]) -> None:
    for cut, specimen in cuts:
        truth = specimen.friction_per_depth / true_resistance(specimen, cut.fracture.cut_length)
        assert cut.fracture.friction_per_depth / cut.fracture.corrected == pytest.approx(truth, abs=FRICTION), cut.name


def test_resistance_comes_out_of_every_cut() -> None:
    check_resistance(measured())


def test_friction_comes_out_of_every_cut() -> None:
    check_friction(measured())


def test_the_formula_that_takes_the_blade_for_the_tip_is_noticed() -> None:
    with pytest.raises(AssertionError):
        check_resistance(measured(), by="apparent")


def test_moduli_come_out_of_every_cut_that_has_some() -> None:
    known = [(cut, specimen) for cut, specimen in measured() if len(cut.moduli) >= FEWEST]
    assert len(known) >= 15
    for cut, specimen in known:
        truth = true_moduli(specimen, cut.moduli.position, cut.moduli.segments)
        assert np.median(cut.moduli.modulus / truth) == pytest.approx(1.0, abs=MODULUS), cut.name


EVERY_SPEED = pytest.mark.parametrize("speed", [float(v) for v in rig.SPEEDS])
BOTH_ANGLES = pytest.mark.parametrize("angle_deg", [90.0, 45.0])
ETA_PUT_IN = 0.28


def check_initiation(cut: MeasuredCut) -> None:
    assert len(cut.initiation.unit_area) >= 4
    assert initiation_excess([cut.initiation]) == pytest.approx(ETA_PUT_IN, abs=ETA_HOMOGENEOUS)


@EVERY_SPEED
@BOTH_ANGLES
@pytest.mark.parametrize("kind", ["2 cm", "bulge"])
def test_initiation_comes_out_at_every_speed_and_both_angles(kind: str, speed: float, angle_deg: float) -> None:
    check_initiation(measure_cut(recorded_cut(kind, speed=speed, angle_deg=angle_deg).trace, MODEL))


@BOTH_ANGLES
def test_friction_left_in_the_force_is_noticed_in_initiation(angle_deg: float) -> None:
    cut = recorded_cut("2 cm", angle_deg=angle_deg, friction_share=0.4)
    check_initiation(measure_cut(cut.trace, MODEL))
    with_it = estimate_initiation(cut.trace, MODEL, friction_per_depth=0.0)
    assert initiation_excess([with_it]) < ETA_PUT_IN - ETA


def check_noise_adds_no_bias() -> None:
    """Every tenth reading with 0.1 N of noise, three times, within the bias that is told."""
    rng = np.random.default_rng(0)
    records = [slow_and_noisy(trace, rng) for _ in range(3) for trace in traces(livers=2)]
    found, refused = measure_cuts(records, MODEL)
    assert refused == []
    assert initiation_excess([cut.initiation for cut in found]) == pytest.approx(tissue_with().eta90, abs=ETA_TOLD)


def test_noise_of_a_slow_sensor_is_no_initiation() -> None:
    check_noise_adds_no_bias()


def test_a_drop_that_is_noise_would_be_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(segments, "SMALLEST_DROP_NOISE", 0.0)
    with pytest.raises(AssertionError):
        check_noise_adds_no_bias()


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
