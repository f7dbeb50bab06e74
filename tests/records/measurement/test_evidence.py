"""A calibrated tissue says what it rests on; what was not measured is pig liver's, and said so."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from virtual_session import MODEL, SPEEDS, cuts, silent, traces
from whole_cut import cut as play
from whole_cut import make, steady

from cutenv.records.measurement import MeasuredCut, calibrate, measure_cuts, tissue_of
from cutenv.records.measurement.calibration import RefusedRecord, with_findings
from cutenv.records.measurement.pooled_cuts import FEWEST_FOR_CORRELATION, FIELDS, NOT_RESAMPLED, PooledCuts, resampled
from cutenv.sim.tissue import CutModel, TissueDescription, load_description, measured_liver
from cutenv.sim.tissue.description import Evidence, TissueCalibration

LIVER = measured_liver()
UPRIGHT = math.radians(80.0)


def tissue_from(chosen: Callable[[MeasuredCut], bool] = lambda _: True, **options: Any) -> TissueDescription:
    options = {"resamples": 0} | options
    return tissue_of([cut for cut in cuts() if chosen(cut)], MODEL, **options)


@functools.cache
def whole_session() -> TissueDescription:
    return tissue_from(resamples=30)


def calibration_of(tissue: TissueDescription) -> TissueCalibration:
    assert tissue.calibration is not None
    return tissue.calibration


def check_assumed(tissue: TissueDescription, *names: str) -> None:
    """These and no others are pig liver's, said so, and without an interval that nobody measured."""
    facts = calibration_of(tissue)
    assert set(facts.not_measured) == set(names)
    for name in names:
        evidence = facts.of(name)
        assert evidence.provenance == "assumed"
        assert "pig liver's" in evidence.how
        assert evidence.how.endswith("stands in")
        assert (evidence.low, evidence.high) == (None, None)


def test_a_full_session_leaves_nothing_assumed() -> None:
    tissue = whole_session()
    check_assumed(tissue)
    facts = calibration_of(tissue)
    assert (facts.cuts, facts.specimens) == (18, 3)
    assert [each.name for each in facts.evidence] == ["modulus", *FIELDS]


def test_upright_cuts_alone_give_the_inclined_line_in_pig_livers_proportion() -> None:
    tissue = tissue_from(lambda cut: cut.angle > UPRIGHT, resamples=30)
    check_assumed(tissue, "intercept_45", "slope_45", "inclined_between_cut_cv")
    assert tissue.intercept_45 / tissue.intercept_90 == pytest.approx(LIVER.intercept_45 / LIVER.intercept_90, rel=1e-5)
    assert tissue.slope_45 / tissue.slope_90 == pytest.approx(LIVER.slope_45 / LIVER.slope_90, rel=1e-5)
    assert "no cut flatter than 67.5 degrees" in calibration_of(tissue).of("intercept_45").how


def test_inclined_cuts_alone_give_the_upright_line_in_pig_livers_proportion() -> None:
    tissue = tissue_from(lambda cut: cut.angle < UPRIGHT)
    check_assumed(tissue, "modulus", "intercept_90", "slope_90", "inclined_between_cut_cv")
    assert tissue.intercept_45 / tissue.intercept_90 == pytest.approx(LIVER.intercept_45 / LIVER.intercept_90, rel=1e-5)


def test_one_speed_gives_pig_livers_fall_with_speed() -> None:
    tissue = tissue_from(lambda cut: cut.speed < 0.01, resamples=30)
    check_assumed(tissue, "slope_90", "slope_45", "correlation_length", "inclined_between_cut_cv")
    for angle in (90, 45):
        of, liver = (getattr(t, f"slope_{angle}") / getattr(t, f"intercept_{angle}") for t in (tissue, LIVER))
        assert of == pytest.approx(liver, rel=1e-5)
    assert "do not differ in speed" in calibration_of(tissue).of("slope_90").how


def test_no_return_stroke_leaves_friction_assumed_and_is_said() -> None:
    short = [trace.select(slice(int(np.argmax(trace.position)) + 1)) for trace in traces()]
    measured, refused = measure_cuts(short, MODEL)
    tissue = with_findings(tissue_of(measured, MODEL, resamples=0), refused)
    check_assumed(tissue, "friction_share")
    assert tissue.friction_share == LIVER.friction_share
    assert any("no return stroke past the tip" in note for note in calibration_of(tissue).notes)
    assert refused == []
    assert tissue.fracture_resistance == pytest.approx(tissue_from().fracture_resistance, rel=0.05)


def test_one_cut_tells_values_and_no_spread_between_cuts() -> None:
    tissue = tissue_from(lambda cut: cut.name == "cut 1", resamples=30)
    check_assumed(
        tissue, "slope_90", "intercept_45", "slope_45", "modulus_between_liver_cv", "modulus_between_cut_cv",
        "correlation_length", "fracture_between_cut_cv", "inclined_between_cut_cv",
    )  # fmt: skip
    for name in ("fracture_between_cut_cv", "modulus_between_cut_cv"):
        assert getattr(tissue, name) == pytest.approx(getattr(LIVER, name), rel=1e-5)
    assert all(each.low is None for each in calibration_of(tissue).evidence), "one cut cannot be resampled"


def test_one_specimen_leaves_the_spread_between_specimens_assumed() -> None:
    tissue = tissue_from(lambda cut: cut.specimen == "liver 1", resamples=30)
    check_assumed(tissue, "modulus_between_liver_cv", "correlation_length", "inclined_between_cut_cv")
    assert tissue.modulus_between_liver_cv == pytest.approx(LIVER.modulus_between_liver_cv, rel=1e-5)


@pytest.mark.parametrize("n", [FEWEST_FOR_CORRELATION - 1, FEWEST_FOR_CORRELATION])
def test_fewer_than_eight_cuts_leave_the_correlation_length_assumed(n: int) -> None:
    first = [f"cut {number}" for number in range(1, n + 1)]
    tissue = tissue_from(lambda cut: cut.name in first)
    assert ("correlation_length" in calibration_of(tissue).not_measured) is (n < FEWEST_FOR_CORRELATION)
    assert (tissue.correlation_length == LIVER.correlation_length) is (n < FEWEST_FOR_CORRELATION)


def test_records_that_name_no_specimen_count_as_one_and_are_told() -> None:
    tissue = tissue_of([dataclasses.replace(cut, specimen="") for cut in cuts()], MODEL, resamples=0)
    assert calibration_of(tissue).specimens == 1
    assert any("no record names its specimen" in note for note in calibration_of(tissue).notes)


def test_a_line_that_is_extrapolated_is_said() -> None:
    tissue = tissue_from(lambda cut: cut.angle > UPRIGHT or cut.speed < 0.02)
    (note,) = [note for note in calibration_of(tissue).notes if "extrapolated" in note]
    assert "near 45 degrees was measured from 0.64 to 1.3 cm/s only" in note
    assert not any("extrapolated" in note for note in calibration_of(tissue_from()).notes)


def test_a_speed_at_which_no_modulus_was_seen_is_outside_the_range() -> None:
    made = [silent(cut) if cut.speed > 0.02 else cut for cut in cuts()]
    tissue = tissue_of(made, MODEL, resamples=0)
    assert tissue.speed_max == pytest.approx(SPEEDS[1], rel=0.01)
    assert any("show no steady loading segment" in note for note in calibration_of(tissue).notes)


def test_intervals_shrink_with_the_number_of_cuts() -> None:
    """Three livers instead of one: by the root of three, and chance."""
    few, many = (
        calibration_of(tissue_from(lambda cut, livers=livers: cut.specimen in livers, resamples=200))
        for livers in ({"liver 1"}, {"liver 1", "liver 2", "liver 3"})
    )
    for name in ("fracture_resistance", "friction_share", "eta90"):
        narrow, wide = (facts.of(name).high - facts.of(name).low for facts in (many, few))
        assert narrow < (1.0 if name == "eta90" else 0.9) * wide, name


def test_an_interval_holds_its_value_and_only_estimates_have_one() -> None:
    tissue = tissue_from(resamples=100)
    for each in calibration_of(tissue).evidence:
        if each.name in NOT_RESAMPLED:
            assert each.low is each.high is None
        elif not each.name.endswith(("_cv", "_length")):  # a resample has fewer different cuts: spread reads low
            assert each.low <= getattr(tissue, each.name) <= each.high, each.name


@pytest.mark.parametrize("names", [(9, 11, 12, 17, 18), (4, 9, 11, 13, 15, 16, 17)])
def test_no_interval_leaves_what_is_possible(names: tuple[int, ...]) -> None:
    """The lines of some resamples of these fall below zero."""
    chosen = [cut for cut in cuts() if cut.name in {f"cut {number}" for number in names}]
    pool, rng = PooledCuts(chosen), np.random.default_rng(0)
    drawn = [pool.numbers(resampled(rng, len(chosen)))["intercept_45"] for _ in range(200)]
    assert np.quantile(drawn, 0.025) < 0.0
    tissue = tissue_of(chosen, MODEL, resamples=200)
    for each in calibration_of(tissue).evidence:
        if each.low is not None and not each.name.startswith("slope"):
            assert each.low >= 0.0, each.name
            assert each.high <= 1.0 or each.name not in ("friction_share", "eta90")
    assert calibration_of(tissue).of("intercept_45").low == 0.0


def test_a_line_through_every_cut_tells_no_spread() -> None:
    names = {"cut 1", "cut 3", "cut 10", "cut 12"}  # two at either angle, of two speeds
    check_assumed(
        tissue_from(lambda cut: cut.name in names), "modulus_between_liver_cv", "modulus_between_cut_cv",
        "correlation_length", "inclined_between_cut_cv",
    )  # fmt: skip


def test_one_cut_of_each_liver_is_told_as_the_reason_for_the_assumed_spread_between_them() -> None:
    how = (
        calibration_of(tissue_from(lambda cut: cut.name in {"cut 1", "cut 8", "cut 15"}))
        .of("modulus_between_liver_cv")
        .how
    )
    assert "one such cut of each" in how


def test_the_cuts_of_one_specimen_say_how_far_another_may_be_off() -> None:
    first, *_ = calibration_of(tissue_from(lambda cut: cut.specimen == "liver 1", resamples=100)).notes
    assert first.startswith(
        "all 6 cuts are of one specimen, and the intervals hold for it alone. Pig livers differ by 13 %"
    )
    assert first.endswith("takes 7 specimens or more")


def test_without_resamples_there_are_values_and_no_intervals() -> None:
    without, with_some = tissue_from(resamples=0), tissue_from(resamples=30)
    assert without == with_some
    assert all(each.low is None and each.high is None for each in calibration_of(without).evidence)


def test_a_seed_gives_the_same_intervals_and_another_one_others() -> None:
    once, again, other = (calibration_of(tissue_from(resamples=30, seed=seed)) for seed in (1, 1, 2))
    assert once == again
    assert once != other


@pytest.mark.parametrize("resamples", [-1, 1_000_000, math.nan])
def test_a_number_of_resamples_that_is_none_is_refused(resamples: float) -> None:
    with pytest.raises(ValueError, match=r"resamples = .* Some hundreds give an interval"):
        tissue_from(resamples=resamples)


def test_moduli_belong_to_the_model_that_was_asked_for() -> None:
    strain = CutModel(formulation="plane_strain")
    few = traces()[:6]
    plain, other = (calibrate(few, model=model, resamples=0) for model in (MODEL, strain))
    assert other.formulation == "plane_strain"
    converted = MODEL.convert_modulus(plain.intercept_90, strain, 0.06)
    assert other.intercept_90 == pytest.approx(float(converted), rel=0.01)
    assert abs(other.intercept_90 / plain.intercept_90 - 1.0) > 0.03


# What is written and read.


def test_json_gives_back_every_number_and_what_it_rests_on(tmp_path: Any) -> None:
    tissue = with_findings(tissue_from(resamples=30), [RefusedRecord("bad <cut>", "no force")])
    path = tmp_path / "tissue.json"
    path.write_text(tissue.to_json())
    again = load_description(path)
    assert again == tissue
    assert again.calibration == tissue.calibration
    assert "left out: bad <cut>: no force" in calibration_of(again).notes


DAMAGES: dict[str, Callable[[dict[str, Any]], Any]] = {
    "no evidence": lambda facts: facts.pop("evidence"),
    "no number of cuts": lambda facts: facts.pop("cuts"),
    "cuts in words": lambda facts: facts.update(cuts="many"),
    "no cut": lambda facts: facts.update(cuts=0),
    "more specimens than cuts": lambda facts: facts.update(specimens=facts["cuts"] + 1),
    "one note that is no list": lambda facts: facts.update(notes="be careful"),
    "a note that is no text": lambda facts: facts.update(notes=[1]),
    "something unknown": lambda facts: facts.update(weather="fine"),
    "evidence that is none": lambda facts: facts["evidence"].append("measured"),
    "evidence of nothing known": lambda facts: facts["evidence"][0].update(name="intercept_60"),
    "evidence twice": lambda facts: facts["evidence"].append(facts["evidence"][0]),
    "a provenance that is none": lambda facts: facts["evidence"][0].update(provenance="guessed"),
    "half an interval": lambda facts: facts["evidence"][0].update(low=None),
    "an interval upside down": lambda facts: facts["evidence"][0].update(low=2.0, high=1.0),
    "an interval in words": lambda facts: facts["evidence"][0].update(low="1", high="2"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_calibration_is_refused(damage: str) -> None:
    content = json.loads(whole_session().to_json())
    TissueDescription.from_json(json.dumps(content))
    DAMAGES[damage](content["calibration"])
    with pytest.raises(ValueError, match=r"calibration|evidence|provenance"):
        TissueDescription.from_json(json.dumps(content))


def test_a_tissue_without_calibration_is_read_as_before() -> None:
    assert TissueDescription.from_json(LIVER.to_json()).calibration is None


def test_evidence_of_something_that_was_not_asked_for_is_refused_by_name() -> None:
    facts = TissueCalibration(cuts=1, specimens=1, evidence=(Evidence(name="eta90", provenance="measured", how="so"),))
    with pytest.raises(ValueError, match=r"field must be one of 'eta90', got 'eta'. Did you mean 'eta90'"):
        facts.of("eta")


def test_an_environment_takes_the_tissue_and_flags_speeds_outside_of_the_calibrated_range(tmp_path: Any) -> None:
    path = tmp_path / "my_tissue.json"
    path.write_text(calibrate(traces()[:6], resamples=0).to_json())
    env = make(tissue=str(path))
    inside, outside = (play(env, steady(speed), seed=3) for speed in (0.01, 0.005))  # calibrated from 0.0064 on
    assert inside.end
    assert not inside.infos[40]["speed_out_of_range"]
    assert outside.infos[40]["speed_out_of_range"]
    assert not play(make(), steady(0.005), seed=3).infos[40]["speed_out_of_range"], "pig liver was cut so slowly"
