"""Cuts with depth tell what was put in: resistance by area and both works, layers; or the reason why they do not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cutenv.records.measurement.depth_sections import depth_sections, opened_resistance
from cutenv.records.measurement.layer_fit import fit_layers
from cutenv.records.measurement.measured_cut import find_layers
from cutenv.sim.tissue import CutModel, Layers, Specimen, measured_liver
from cutenv.sim.tissue.grid import SPACING
from scripts.validation.measurement.stepped_cuts import DEPTHS, stepped_cut

MODEL = CutModel()
PUT_IN = Layers(boundary=0.010, deep_toughness=3.0, deep_modulus=2.0)


def flat(modulus: float = 38e3, resistance: float = 211.0) -> Specimen:
    return Specimen.homogeneous(modulus=modulus, fracture_resistance=resistance, depth=0.02, tissue=measured_liver())


@pytest.fixture(scope="module")
def plain():
    """A cut through one tissue, without noise: record, and the cut with its truth."""
    return stepped_cut(flat(), Layers(), noisy=False)


@pytest.fixture(scope="module")
def layered():
    """Records and sections of four cuts through two layers, with noise, of livers that differ."""
    livers = [flat(), flat(30e3, 150.0), flat(45e3, 250.0), flat(38e3, 180.0)]
    orders = (DEPTHS, DEPTHS[::-1], (0.008, 0.013, 0.006, 0.011), (0.012, 0.007, 0.014, 0.009))
    traces = [
        stepped_cut(liver, PUT_IN, depths=depths, seed=n)[0]
        for n, (liver, depths) in enumerate(zip(livers, orders, strict=True))
    ]
    return traces, find_layers(traces, MODEL, boundary=0.010)[1]


def test_resistance_by_area_and_both_works_is_what_was_put_in(plain):
    trace, cut = plain
    sections = depth_sections(trace)
    assert len(sections) == len(DEPTHS)
    found = opened_resistance(sections)
    assert found["both works"] == pytest.approx(211.0, rel=0.03)
    assert sections[0].friction_per_depth == pytest.approx(cut.plant.specimen.friction_per_depth, rel=0.005)
    assert all(each.resistance == pytest.approx(211.0, rel=0.06) for each in sections)
    assert found["along"] < 0.97 * found["both works"]  # what the blade does downwards is missing
    assert found["norm ahead"] > found["component ahead"] > found["both works"]  # with what is stored at the end


def test_work_of_both_directions_is_the_account_s(plain):
    trace, cut = plain
    sections, energy = depth_sections(trace), cut.plant.energy()
    assert sum(each.work_along + each.work_down for each in sections) == pytest.approx(energy["work"], rel=0.01)
    assert sum(each.fracture_energy for each in sections) == pytest.approx(energy["fracture"], rel=0.02)


def test_area_is_that_of_the_floor_and_the_sum_of_its_layers(plain):
    trace, cut = plain
    sections = depth_sections(trace)
    cells = int(sections[-1].tip / SPACING + 0.5) + 1
    assert sum(each.area() for each in sections) == pytest.approx(SPACING * cut.plant.floor[:cells].sum(), rel=0.04)
    for each in sections:
        assert each.area(0.0, 0.01) + each.area(0.01) == pytest.approx(each.area(), rel=1e-12)


def test_with_length_times_one_depth_the_resistance_would_be_wrong(plain):
    trace, _ = plain
    sections = depth_sections(trace)
    energy = sum(each.fracture_energy for each in sections)
    assert abs(energy / (sections[-1].tip * sections[-1].depth) + sections[0].friction_per_depth - 211.0) > 30.0


def test_layers_are_found_with_intervals_that_hold_them(layered):
    fit, _ = find_layers(layered[0], MODEL, boundary=0.010)
    assert set(fit.found) == {"deep_toughness", "deep_modulus"}
    for name in fit.found:
        told = next(each for each in fit.evidence if each.name == f"layers.{name}")
        assert told.provenance == "measured"
        assert told.low <= getattr(PUT_IN, name) <= told.high
        assert getattr(fit.layers, name) == pytest.approx(getattr(PUT_IN, name), rel=0.2)
        assert 0.0 < fit.errors[name] < 0.2
    assert fit.modulus == pytest.approx([38e3, 30e3, 45e3, 38e3], rel=0.12)
    share = measured_liver().friction_share
    assert fit.resistance == pytest.approx((1.0 - share) * np.array([211.0, 150.0, 250.0, 180.0]), rel=0.12)


def test_the_depth_of_the_layer_is_found_where_it_is_not_given(layered):
    fit, _ = find_layers(layered[0], MODEL)
    assert fit.layers.boundary == pytest.approx(0.010, abs=0.0012)
    told = next(each for each in fit.evidence if each.name == "layers.boundary")
    assert told.low < fit.layers.boundary < told.high
    assert fit.layers.deep_toughness > 1.8


def test_a_layer_that_no_cut_touches_stays_assumed_with_the_reason(layered):
    fit = fit_layers(layered[1], MODEL, boundary=0.017)
    assert fit.found == ()
    assert fit.layers == Layers(boundary=0.017)
    told = next(each for each in fit.evidence if each.name == "layers.deep_toughness")
    assert told.provenance == "assumed"
    assert "0 of 1" in told.how
    assert "the deepest goes down to 14" in told.how


def test_no_layer_is_found_in_one_tissue():
    cuts = [depth_sections(stepped_cut(flat(), Layers(), seed=n)[0]) for n in range(3)]
    fit = fit_layers(cuts, MODEL)
    assert fit.found == ()
    assert fit.layers == Layers()
    assert "one tissue throughout fits as well" in next(e for e in fit.evidence if e.name == "layers.boundary").how


def test_too_few_sections_and_none_at_all_are_told(layered):
    fit = fit_layers([layered[1][0][:2]], MODEL, boundary=0.010)
    few = [each for each in fit.evidence if each.name == "layers.deep_toughness"]
    assert "too few" in few[0].how
    with pytest.raises(ValueError, match="no record has a way back"):
        fit_layers([[]], MODEL)


def test_a_capsule_of_which_nothing_is_given_stays_assumed(layered):
    told = {each.name: each for each in fit_layers(layered[1], MODEL, boundary=0.010).evidence}
    assert set(told) == {f"layers.{name}" for name in Layers.__dataclass_fields__}
    assert told["layers.capsule_toughness"].provenance == "assumed"
    assert "was not given" in told["layers.capsule_toughness"].how
    assert told["layers.boundary"].provenance == "choice"


def test_a_way_back_on_which_the_height_changes_ends_no_section(plain):
    trace, _ = plain
    back = np.concatenate(([False], np.diff(trace.position) < -1e-7))
    tilted = dataclasses.replace(trace, height=trace.height + np.where(back, 0.1 * (trace.position - 0.05), 0.0))
    reasons: list[str] = []
    assert depth_sections(tilted, reasons=reasons) == []
    assert len(reasons) == len(DEPTHS)
    assert "the height changes by" in reasons[0]


def test_a_record_that_lacks_a_force_is_refused(plain):
    trace, _ = plain
    with pytest.raises(ValueError, match="vertical_force"):
        depth_sections(dataclasses.replace(trace, vertical_force=None))
    with pytest.raises(ValueError, match="no section"):
        opened_resistance([])
