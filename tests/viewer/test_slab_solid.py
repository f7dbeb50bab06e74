"""The specimen as a solid: as thick as recorded, displaced by the field, opened where it is cut and nowhere else."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from recorded_cut import recorded_cut

from cutenv.viewer.solid import ShownCut
from cutenv.viewer.solid.slab_solid import SHEET_HEIGHT, SlabSolid

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


def check_opens_behind_the_tip_only(solid: SlabSolid, displacement: np.ndarray, front: tuple[float, float]) -> None:
    """The faces part behind each layer's end of the cut, to both sides alike, and nowhere else."""
    for layer, rest, tip in zip(layers(solid, displacement), layers(solid, solid.rest), front, strict=True):
        left, right = layer[0, -1], layer[1, 0]
        apart = right[:, 0] - left[:, 0]
        along = rest[0, -1, :, 1]
        assert (apart[(along > 0.003) & (along < tip - 0.003)] > 1e-4).all()
        assert np.abs(apart[along >= tip]).max() < 1e-12
        np.testing.assert_allclose(left[:, 0], -right[:, 0], atol=1e-9)
        np.testing.assert_allclose(left[:, 1], right[:, 1], atol=1e-9)  # the modulus is the same on both sides


def test_the_cut_is_open_behind_the_tip_only(solid: SlabSolid) -> None:
    for i in (25, 59):
        check_opens_behind_the_tip_only(solid, solid.displacement(i), solid.front(i))


def test_a_cut_that_opens_ahead_is_noticed(solid: SlabSolid) -> None:
    with pytest.raises(AssertionError):
        check_opens_behind_the_tip_only(solid, solid.displacement(27), solid.front(25))


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
