"""Solids: specimen, cuts with depth and the scalpel, each as thick and where the record has it."""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded_cut import recorded_cut
from view_pages import shown, told

from cutenv.display.viewer.scene_parts import BELOW, BLADE_LENGTH, CHORD, blade_edge
from cutenv.display.viewer.solid import ShownCut
from cutenv.display.viewer.solid.solids import (
    BLADE_THICKNESS,
    PLANE_ROWS,
    SHEET_HEIGHT,
    ScalpelPose,
    SlabSolid,
    blade,
    box,
    handle,
    plane_rows,
    pose,
)
from cutenv.display.viewer.solid.view_page import view_page
from cutenv.people.play.devices import simple_hand
from cutenv.people.play.played_cut import PlayedDepthCut
from cutenv.records.scoring.truth import FLOOR_AT_END
from cutenv.sim.tissue.grid import SPACING
from cutenv.sim.trace import Trace
from scripts.browsers.chromium import Browser

ANGLE = math.radians(60.0)


@pytest.fixture(scope="module")
def solid() -> SlabSolid:
    recorded = recorded_cut("liver", angle_deg=60.0, turns=(0.08,))
    return SlabSolid(ShownCut.of(recorded.trace, target=0.083, instants=60))


def layers(solid: SlabSolid, values: np.ndarray) -> np.ndarray:
    """Values of the points by (layer, side, across, along)."""
    return values[: 2 * solid.n_lattice].reshape(2, *solid.slab.rest.shape[:-1], values.shape[-1])


def test_it_is_as_thick_as_the_cut_was_deep_and_as_wide_and_long_as_the_specimen(solid: SlabSolid) -> None:
    upper, lower = layers(solid, solid.rest)
    reached = upper[..., 1] < 0.078
    depth = solid.cut.depth.at(upper[..., 1])
    np.testing.assert_allclose(upper[reached][:, 2], depth[reached], atol=2e-4)
    beyond = upper[..., 1] > 0.083
    np.testing.assert_allclose(upper[beyond][:, 2], solid.cut.depth.depth[-1], atol=1e-5)
    assert (lower[..., 2] == 0.0).all()
    assert np.ptp(upper[..., 0]) == pytest.approx(0.08)
    assert np.ptp(upper[..., 1]) == pytest.approx(0.15)


def test_before_the_cut_nothing_moves(solid: SlabSolid) -> None:
    assert np.abs(solid.displacement(0)).max() < 1e-4


@pytest.mark.parametrize("i", [25, 59])
def test_the_cut_is_open_behind_the_tip_only(solid: SlabSolid, i: int) -> None:
    """The faces part behind each layer's end of the cut, to both sides alike, and nowhere else."""
    displaced = layers(solid, solid.displacement(i))
    for layer, rest, tip in zip(displaced, layers(solid, solid.rest), solid.front(i), strict=True):
        left, right = layer[0, -1], layer[1, 0]
        apart = right[:, 0] - left[:, 0]
        along = rest[0, -1, :, 1]
        assert (apart[(along > 0.003) & (along < tip - 0.003)] > 1e-4).all()
        assert np.abs(apart[along >= tip]).max() < 1e-12
        np.testing.assert_allclose(left[:, 0], -right[:, 0], atol=1e-9)
        np.testing.assert_allclose(left[:, 1], right[:, 1], atol=1e-9)  # the modulus is the same on both sides


def test_a_leaning_blade_s_cut_ends_sooner_below(solid: SlabSolid) -> None:
    upper, lower = solid.front(40)
    depth = float(solid.cut.depth.at(upper))
    assert upper - lower == pytest.approx(depth / math.tan(ANGLE), abs=3e-4)


def test_the_illustration_moves_nothing_along_the_cut(solid: SlabSolid) -> None:
    i = 40
    shown = layers(solid, solid.displacement(i))[0]
    field = solid.slab.on_lattice(solid.cut.field(i)[:, :2])
    np.testing.assert_allclose(shown[..., 1], field[..., 1], atol=1e-15)
    assert np.abs(field).max() > 1e-3


def test_colours_are_of_the_field_and_not_of_the_illustration(solid: SlabSolid) -> None:
    i = int(np.argmax(solid.cut.shift))
    amount = solid.amount(i, "displacement")
    assert amount.max() == pytest.approx(solid.cut.shift[i], rel=0.15)
    clamped = solid.rest[: solid.n_lattice, 1] == 0.0
    assert np.abs(amount[clamped]).max() == 0.0


def test_energy_is_greatest_at_the_tip_and_the_same_on_both_sides(solid: SlabSolid) -> None:
    i = int(np.argmax(solid.cut.shift))
    energy = solid.amount(i, "energy").reshape(solid.slab.rest.shape[:-1])
    np.testing.assert_allclose(energy[0], energy[1, ::-1], rtol=1e-6)
    place = solid.rest[np.argmax(energy)]
    assert abs(place[0]) < 1e-9
    assert place[1] == pytest.approx(solid.cut.tip[i], abs=0.01)
    assert (energy >= 0.0).all()


def test_an_unknown_colour_is_refused(solid: SlabSolid) -> None:
    with pytest.raises(ValueError, match="colour"):
        solid.amount(0, "stress")


def test_the_target_s_sheet_goes_with_the_tissue(solid: SlabSolid) -> None:
    assert solid.sheet is not None
    i = int(np.argmax(solid.cut.shift))
    rest, moved = solid.rest[solid.sheet.points], solid.displacement(i)[solid.sheet.points]
    np.testing.assert_allclose(rest[:, 1], 0.083, atol=1e-12)
    assert np.ptp(rest[:, 2]) == pytest.approx(float(solid.cut.depth.at(0.083)) + SHEET_HEIGHT, abs=1e-4)
    middle, rim = np.abs(rest[:, 0]) < 1e-9, np.abs(rest[:, 0]) > 0.039
    assert moved[middle, 1].min() > moved[rim, 1].max() > 0.0


def test_without_a_target_there_is_no_sheet(solid: SlabSolid) -> None:
    bare = SlabSolid(dataclasses.replace(solid.cut, target=None))
    assert bare.sheet is None
    assert len(bare.rest) == 2 * bare.n_lattice == len(bare.displacement(3))


def test_faces_are_seen_as_far_as_the_cut_and_no_farther(solid: SlabSolid) -> None:
    faces = solid.cut_faces
    assert np.abs(solid.rest[faces.points, 0]).max() == 0.0
    along = solid.rest[faces.points[faces.parts], 1]
    for i in (0, 25, 59):
        seen = solid.cut_parts(i)
        assert along[:seen].max(initial=0.0) <= solid.cut.tip[i] + 1.3e-3  # one cell
        assert along[seen:].min() >= solid.cut.tip[i] - 1e-9


def test_skins_use_every_point_and_lines_are_the_elements_edges(solid: SlabSolid) -> None:
    used = np.unique(np.concatenate([skin.points for skin in solid.lattices.values()]))
    np.testing.assert_array_equal(used, np.arange(2 * solid.n_lattice))
    ends = solid.rest[solid.lines.points[solid.lines.parts]]
    steps = np.abs(np.diff(ends[..., :2], axis=1)).squeeze()
    assert ((steps[:, 0] < 1e-9) ^ (steps[:, 1] < 1e-9)).all()
    on_grid = np.isclose(ends[..., :2] % 0.01, 0.0, atol=1e-9) | np.isclose(ends[..., :2] % 0.01, 0.01, atol=1e-9)
    assert on_grid.any(axis=-1).all()


@cache
def record() -> Trace:
    """A cut of a drawn liver by a hand that follows the wanted depth."""
    cut = PlayedDepthCut(seed=3, target_length=0.06)
    hand = simple_hand(0.06, level=cut.wanted_level)
    while not cut.end:
        cut.tick(hand.read())
    return cut.trace(name="deep")


@cache
def deep() -> ShownCut:
    return ShownCut.of(record(), instants=40)


@cache
def page() -> str:
    return view_page(deep())


def test_the_blades_lowest_point_is_at_its_recorded_height() -> None:
    facts, cut = told(page()), deep()
    assert cut.height is not None
    assert np.ptp(cut.height) > 0.005
    _, y, z = blade().vertices.T
    for i in range(len(cut)):
        angle = facts["angle_rad"][i]
        lowest = (facts["scalpel_height_m"][i] - y * math.cos(angle) + z * math.sin(angle)).min()
        assert lowest == pytest.approx(cut.height[i], abs=5e-5)
    np.testing.assert_allclose(facts["below_m"], cut.depth.at(cut.position) - cut.height, atol=1e-6)


def test_floor_wanted_depth_and_layer_are_where_the_record_says() -> None:
    cut = deep()
    assert cut.wanted is not None
    assert cut.layer is not None
    noted = np.array(record().metadata[FLOOR_AT_END])
    along = np.arange(len(noted)) * SPACING
    surface = cut.depth.at(along)
    rows = dict(zip(PLANE_ROWS, plane_rows(cut, along, surface), strict=True))
    heights = {name: row[:, 2] for name, row in rows.items()}
    np.testing.assert_allclose(heights["floor"], np.maximum(surface - noted, -BELOW), atol=1e-9)
    np.testing.assert_allclose(heights["layer"], np.maximum(surface - record().metadata["layer_depth_m"], -BELOW))
    middle = 0.5 * (heights["wanted"] + heights["below wanted"])
    seen = surface - cut.wanted.at(along) > -BELOW + 0.001
    assert seen.sum() > 50
    np.testing.assert_allclose(middle[seen], (surface - cut.wanted.at(along))[seen], atol=1e-9)
    assert min(row.min() for row in heights.values()) >= -BELOW - 1e-12


def test_a_record_that_notes_no_floor_gets_the_one_that_liver_would_have() -> None:
    facts = {key: value for key, value in record().metadata.items() if key != FLOOR_AT_END}
    expected = ShownCut.of(dataclasses.replace(record(), metadata=facts), instants=5).floor
    noted = deep().floor
    assert expected is not None
    assert noted is not None
    along = np.arange(0.0, 0.05, 0.001)
    assert 0.0 < np.abs(expected.at(along) - noted.at(along)).mean() < 0.001


def test_the_open_cut_closes_toward_its_floor_and_the_tissue_below_is_whole() -> None:
    solid, i = SlabSolid(deep()), 20
    moved = solid.rest[:, :2] + solid.displacement(i)
    n = 2 * solid.n_lattice
    upper, lower = moved[:n].reshape(2, *solid.slab.rest.shape)
    along = solid.slab.rest[0, -1, :, 1]
    cut = (along > 0.003) & (along < solid.cut.tip[i] - 0.003)
    assert cut.sum() > 5
    assert (upper[1, 0, cut, 0] - upper[0, -1, cut, 0] > 1e-3).all()
    np.testing.assert_allclose(lower[1, 0, :, 0], lower[0, -1, :, 0], atol=1e-12)
    floor = moved[solid.plane["below"].points[: len(along)]]
    np.testing.assert_allclose(floor, lower[0, -1], atol=1e-12)


def test_what_is_cut_and_what_is_not_share_their_parts() -> None:
    solid = SlabSolid(deep())
    begins = [
        solid.rest[skin.points[skin.parts], 1].min(axis=1)
        for skin in (solid.cut_faces, *(solid.plane[name] for name in ("near", "below", "ahead")))
    ]
    for each in begins[1:]:
        np.testing.assert_array_equal(begins[0], each)


def test_layer_and_wanted_depth_are_drawn_only_where_the_record_has_them() -> None:
    bare = dataclasses.replace(deep(), wanted=None, layer=None)
    assert set(SlabSolid(bare).plane) == {"near", "below", "ahead"}
    assert told(view_page(bare))["wanted_m"] is None


def test_a_record_without_height_is_shown_as_before() -> None:
    solid = SlabSolid(shown())
    assert (solid.bottom, solid.plane, solid.cut.height) == (0.0, {}, None)
    assert 'id="half"' not in view_page(shown())


def test_a_layer_that_is_no_depth_is_refused_by_name() -> None:
    wrong = dataclasses.replace(record(), metadata=record().metadata | {"layer_depth_m": 12.0})
    with pytest.raises(ValueError, match=r"metadata layer_depth_m = 12 m is outside .* 12 mm is 0\.012"):
        ShownCut.of(wrong)


@pytest.mark.needs("chromium")
def test_the_near_half_is_taken_off_and_put_back(browser: Browser, tmp_path: Path) -> None:
    path = tmp_path / "view.html"
    path.write_text(page(), encoding="utf-8")
    drawn = (
        "['top', 'rim', 'lines'].map(name => { const g = cutView.node(`tissue/${name}/<object>`).geometry;"
        " return Math.min(g.drawRange.count, g.index.count) / g.index.count; })"
    )
    browser.open(path, 900)
    assert browser.value(drawn) == [0.5, 0.5, 0.5]
    assert browser.value("cutView.node('tissue/ahead').visible && !cutView.node('tissue/near').visible")
    assert browser.value("document.getElementById('shown-below').textContent").endswith(" mm")
    browser.value("document.getElementById('half').click()")
    assert browser.value(drawn) == [1.0, 1.0, 1.0]
    assert browser.value("cutView.node('tissue/near').visible && !cutView.node('tissue/ahead').visible")
    browser.value("cutView.show(20)")
    parts = "cutView.node('tissue/near/<object>').geometry.drawRange.count"
    assert browser.value(parts) == 3 * told(page())["cut_parts"][20] > 0
    assert browser.errors() == []


def standing(vertices: np.ndarray, at: ScalpelPose) -> np.ndarray:
    """Places (across, along, height) of the scalpel's own: turned about its thickness, then moved, as the page does."""
    phi = at.angle - math.pi / 2
    x, y, z = vertices.T
    return np.stack(
        [x, at.along + math.cos(phi) * y - math.sin(phi) * z, at.height + math.sin(phi) * y + math.cos(phi) * z],
        axis=-1,
    )


@given(st.floats(0.0, 0.15), st.floats(math.radians(45), math.radians(135)), st.floats(0.001, 0.02))
def test_the_edge_meets_the_surface_where_the_record_has_the_blade(position: float, angle: float, depth: float) -> None:
    at = pose(position, angle, depth)
    y, z = np.vstack([blade_edge(400), [0.0, 0.05]]).T  # prolonged beyond where the blade narrows
    edge = standing(np.stack([np.zeros_like(y), y, z], axis=-1), at)
    assert edge[:, 2].min() == pytest.approx(0.0, abs=2e-6)
    lowest = int(edge[:, 2].argmin())
    assert np.interp(depth, edge[lowest:, 2], edge[lowest:, 1]) == pytest.approx(position, abs=2e-5)


def test_a_blade_that_leans_forward_reaches_back_below() -> None:
    upper = pose(0.05, math.radians(50.0), 0.02)
    assert upper.along < pose(0.05, math.radians(90.0), 0.02).along


@pytest.mark.parametrize("made", [blade, handle, lambda: box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))])
def test_solids_are_closed(made) -> None:
    """Every side of a triangle belongs to an even number of them, where vertices are the same place."""
    surface = made()
    places, number = np.unique(surface.vertices.round(9), axis=0, return_inverse=True)
    faces = number.ravel()[surface.faces]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, count = np.unique(sides, axis=0, return_counts=True)
    assert len(places) > 7
    assert (count % 2 == 0).all()


def test_the_blade_has_the_measures_of_a_number_10() -> None:
    size = np.ptp(blade().vertices, axis=0)
    assert size == pytest.approx([BLADE_THICKNESS, CHORD, BLADE_LENGTH], rel=1e-9)
    edge = blade_edge()
    slope = np.diff(edge[:, 0]) / np.maximum(np.diff(edge[:, 1]), 1e-12)
    assert (np.diff(slope) <= 1e-9).all()  # the belly is convex, and straight at the end
    assert slope[-1] == pytest.approx(0.0, abs=1e-9)


def test_handle_and_blade_hold_together() -> None:
    assert handle().vertices[:, 2].min() < BLADE_LENGTH < handle().vertices[:, 2].max()
