"""Cuts with depth in 3-D: the blade at its height, the floor of the cut, the wanted depth, and the layer below."""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from pathlib import Path

import chromium
import numpy as np
import pytest
from view_pages import shown, told

from cutenv.play.devices import simple_hand
from cutenv.play.played_depth_cut import PlayedDepthCut
from cutenv.scoring.truth import FLOOR_AT_END
from cutenv.tissue.grid import SPACING
from cutenv.trace import Trace
from cutenv.viewer.scene_parts import BELOW
from cutenv.viewer.solid import ShownCut
from cutenv.viewer.solid.cut_plane import PLANE_ROWS, plane_rows
from cutenv.viewer.solid.scalpel import blade
from cutenv.viewer.solid.slab_solid import SlabSolid
from cutenv.viewer.solid.view_page import view_page


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
def test_the_near_half_is_taken_off_and_put_back(tmp_path: Path) -> None:
    path = tmp_path / "view.html"
    path.write_text(page(), encoding="utf-8")
    drawn = (
        "['top', 'rim', 'lines'].map(name => { const g = cutView.node(`tissue/${name}/<object>`).geometry;"
        " return Math.min(g.drawRange.count, g.index.count) / g.index.count; })"
    )
    with chromium.browser(tmp_path / "profile", graphics=True) as browser:
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
