"""Beads against the model: a cut filmed on a finer mesh gives back its field, its modulus twice, and its zones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cutenv.sim.tissue import CutModel, Specimen
from cutenv.vision import BeadTracks
from cutenv.vision.field_comparison import (
    FilmedMeasurement,
    MeanModulus,
    compare_displacements,
    compare_field,
    estimate_zone_moduli,
    even_borders,
    measure_filmed_cut,
    zones_as_measured,
)
from scripts.validation.measurement import filmed_cuts
from scripts.validation.measurement.filmed_cuts import FilmedCut, slice_of_zones

BORDERS, MODULI = [0.03, 0.06], [60e3, 30e3, 45e3]
MARK = 0.15e-3  # RMS of the field [m]


def filmed(moduli: list[float], borders: list[float], **changes: Any) -> FilmedCut:
    specimen = slice_of_zones(borders, moduli, depth=0.02)
    return filmed_cuts.filmed_cut(specimen, divisions=(16, 30), frames=6.0, length=0.08, **changes)


@pytest.fixture(scope="module")
def uniform() -> FilmedCut:
    return filmed([40e3], [])


@pytest.fixture(scope="module")
def zoned() -> FilmedCut:
    return filmed(MODULI, BORDERS)


@pytest.fixture(scope="module")
def measured_uniform(uniform: FilmedCut) -> FilmedMeasurement:
    return measure_filmed_cut(uniform.tracks, uniform.trace, CutModel())


@pytest.fixture(scope="module")
def measured(zoned: FilmedCut) -> FilmedMeasurement:
    return measure_filmed_cut(zoned.tracks, zoned.trace, CutModel())


def moved(tracks: BeadTracks, place: Any) -> BeadTracks:
    return replace(tracks, place=place)


def test_the_field_of_a_uniform_slice_is_the_model_s(uniform: FilmedCut) -> None:
    found = compare_displacements(uniform.tracks, uniform.trace, CutModel())
    assert found.rms() < MARK
    assert found.rms() < 1.5 * found.noise
    assert found.slope == pytest.approx(1.0, abs=0.02)
    assert found.correlation > 0.99
    assert found.flags == ()
    assert (found.near ^ found.far).all()
    assert found.near.any()


def test_the_table_lists_every_bead_with_the_mean_of_its_displacement(uniform, measured_uniform):
    found = compare_field(measured_uniform)
    rows = found.table()
    assert [row.bead for row in rows] == list(range(1, 99))
    bead = rows[30]
    own = found.rises.bead == bead.bead
    assert bead.measured == pytest.approx(np.linalg.norm(found.measured[own], axis=1).mean())
    assert (bead.across, bead.along) == pytest.approx(uniform.places[30, :2], abs=1e-4)
    of_one_ramp = found.table(ramp=5)
    assert {row.ramps for row in of_one_ramp} == {1}
    near, far = (np.mean([row.measured for row in rows if (abs(row.across) < 0.015) is side]) for side in (True, False))
    assert near > far, "beads closest to the cut move most (section 7.3.2)"


def test_one_cut_measured_twice_has_the_modulus_that_was_put_in(measured_uniform: FilmedMeasurement) -> None:
    image = measured_uniform.by_image()
    for found in (MeanModulus.of(measured_uniform.by_force), MeanModulus.of(image.modulus)):
        assert found.mean == pytest.approx(40e3, rel=0.02)
        assert found.low < found.mean < found.high
    assert (np.abs(image.modulus - 40e3) < 5 * image.standard_error + 0.02 * 40e3).all()


def test_the_image_does_not_use_the_motion_of_the_blade(measured_uniform: FilmedMeasurement) -> None:
    """A blade that bends moves less than its drive: the modulus by force falls, and that by image stays."""
    loads = [replace(load, stiffness=0.5 * load.stiffness) for load in measured_uniform.rises.ramps]
    bent = replace(measured_uniform, rises=replace(measured_uniform.rises, ramps=loads))
    assert bent.by_force == pytest.approx(0.5 * measured_uniform.by_force)
    assert (bent.by_image().modulus == measured_uniform.by_image().modulus).all()


def check_zones(measured: FilmedMeasurement, data: str = "both") -> None:
    found = estimate_zone_moduli(measured, BORDERS, data=data)
    assert found.modulus == pytest.approx(MODULI, rel=0.1)
    assert ((found.low < MODULI) & (MODULI < found.high)).all()
    assert found.unknown == ()
    assert (found.learned > 0.95).all()


@pytest.mark.parametrize("data", ["both", "beads", "force"])
def test_moduli_of_zones_come_back(measured: FilmedMeasurement, data: str) -> None:
    check_zones(measured, data)


def test_zones_that_the_cut_never_reached_are_told_to_be_unknown(measured: FilmedMeasurement) -> None:
    found = estimate_zone_moduli(measured, [*BORDERS, 0.14], prior=50e3)
    assert (found.learned[:3] > 0.95).all()
    assert found.learned[3] < 0.6
    assert found.low[3] < MODULI[2] < found.high[3]
    assert found.high[3] / found.low[3] > 2.0
    (said,) = found.unknown
    assert said.startswith("zone 4 (14.0 to 15.0 cm)")


def test_zones_make_the_field_agree(measured: FilmedMeasurement) -> None:
    uniform, as_measured, estimated = (
        compare_field(measured, *zones).rms()
        for zones in (([], [1.0]), zones_as_measured(measured.moduli), (BORDERS, MODULI))
    )
    assert estimated < MARK
    assert estimated < as_measured < uniform


def test_a_third_dimension_is_measured_by_bricks() -> None:
    cut = filmed_cuts.filmed_cut(
        slice_of_zones([], [40e3], depth=0.01), frames=5.0, length=0.06, element="hex20", formulation="solid",
        divisions=(8, 15, 2), thickness=0.01,
    )  # fmt: skip
    bricks = CutModel("hex20", "solid", divisions=(4, 10, 1), thickness=0.01)
    for model in (bricks, CutModel()):
        measured = measure_filmed_cut(cut.tracks, cut.trace, model)
        assert MeanModulus.of(measured.by_image().modulus).mean == pytest.approx(40e3, rel=0.1)
        assert compare_field(measured).measured.shape[1] == model.dim


def test_a_cut_beside_the_middle_needs_its_offset() -> None:
    slice_ = slice_of_zones([], [40e3], depth=0.02)
    cut = filmed_cuts.filmed_cut(slice_, divisions=(16, 30), frames=6.0, length=0.06, offset=0.02)
    beside, middle = (measure_filmed_cut(cut.tracks, cut.trace, CutModel(offset=x)).by_image() for x in (0.02, 0.0))
    assert MeanModulus.of(beside.modulus).mean == pytest.approx(40e3, rel=0.05)
    assert MeanModulus.of(middle.modulus).mean < 0.85 * 40e3, "a lopsided slab is softer"


def test_a_slab_that_is_not_cut_through_needs_its_thickness() -> None:
    slab = Specimen.homogeneous(modulus=40e3, fracture_resistance=211.0, depth=0.015, thickness=0.025)
    cut = filmed_cuts.filmed_cut(slab, divisions=(16, 30), frames=6.0, length=0.06)
    told, untold = (measure_filmed_cut(cut.tracks, cut.trace, CutModel(), thickness=t) for t in (0.025, None))
    for found in (told.by_force, told.by_image().modulus):
        assert MeanModulus.of(found).mean == pytest.approx(40e3, rel=0.03)
    assert MeanModulus.of(untold.by_image().modulus).mean == pytest.approx(40e3 * 25 / 15, rel=0.03)


# --------------------------------------------------------------------------------------------------- bad input


def some(tracks: BeadTracks, rows: Any) -> BeadTracks:
    return replace(tracks, **{name: getattr(tracks, name)[rows] for name in ("bead", "time", "place", "covariance")})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda tracks: replace(tracks, time=tracks.time + 1e4),
            r"tracks run from 1e\+04 .* the record from 0\.001 .*clocks are not in step",
        ),
        (lambda tracks: some(tracks, tracks.bead == 0), "hold no bead"),
        (lambda tracks: moved(tracks, 1e3 * tracks.place), r"all 98 beads lie outside the model, 0\.08 m wide"),
        (
            lambda tracks: replace(tracks, covariance=-tracks.covariance),
            r"the covariance of bead 1 at 0\.001 s is no covariance",
        ),
        (lambda tracks: replace(tracks, covariance=1e12 * tracks.covariance), "the covariance of bead 1 at"),
        (
            lambda tracks: some(tracks, np.isin(tracks.time, np.unique(tracks.time)[::30])),
            r"no bead was seen in 5 frames .* Film faster",
        ),
    ],
)
def test_tracks_that_do_not_belong_or_are_none_are_refused(uniform, change, said):
    with pytest.raises(ValueError, match=said):
        measure_filmed_cut(change(uniform.tracks), uniform.trace, CutModel())


def test_beads_beside_the_slab_are_left_out_and_told(uniform: FilmedCut) -> None:
    found = compare_displacements(uniform.tracks, uniform.trace, CutModel(width=0.04, divisions=(4, 15)))
    assert np.abs(found.rises.place[:, 0]).max() <= 0.02
    assert any("beads lie outside the model and are left out" in flag for flag in found.flags)


def test_a_mirrored_camera_is_told(uniform: FilmedCut) -> None:
    beads = uniform.places[uniform.tracks.bead - 1]
    place = beads + (uniform.tracks.place - beads) * [1, -1, 1]
    found = compare_displacements(moved(uniform.tracks, place), uniform.trace, CutModel())
    assert any("do not move as the model does (correlation -" in flag for flag in found.flags)


def test_beads_that_never_move_tell_no_modulus(uniform: FilmedCut) -> None:
    still = uniform.places[uniform.tracks.bead - 1]
    measured = measure_filmed_cut(moved(uniform.tracks, still), uniform.trace, CutModel())
    with pytest.raises(ValueError, match="no ramp tells a modulus by its beads"):
        measured.by_image()
    assert compare_field(measured).flags[-1].startswith("beads do not move as the model does")


@pytest.mark.parametrize("missing", ["position", "depth"])
def test_a_record_without_what_is_needed_is_refused(uniform: FilmedCut, missing: str) -> None:
    changes: dict[str, Any] = {missing: None} | ({"speed": None, "depth": None} if missing == "position" else {})
    with pytest.raises(ValueError, match=f"needs {missing}"):
        measure_filmed_cut(uniform.tracks, replace(uniform.trace, **changes), CutModel())


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"borders": [0.05], "data": "none"}, "data must be one of 'both', 'beads', 'force', got 'none'"),
        ({"borders": [0.2]}, "must increase between 0 and the length"),
        ({"borders": [], "prior": -1.0}, "prior = -1 Pa"),
        ({"borders": [], "prior_sd": 0.0}, "prior_sd = 0 "),
    ],
)
def test_bad_zones_are_refused(measured: FilmedMeasurement, arguments: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        estimate_zone_moduli(measured, **arguments)


def test_zones_end_on_elements(measured: FilmedMeasurement) -> None:
    assert even_borders(measured, 3) == pytest.approx([0.02, 0.04])
    with pytest.raises(ValueError, match=r"zones = 40: a cut of 6\.\d cm on elements of 1 cm has 1 to 6"):
        even_borders(measured, 40)
