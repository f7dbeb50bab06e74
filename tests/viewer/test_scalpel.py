"""The scalpel: its measures, and that its edge stands where the record has the blade."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cutenv.viewer.scene_parts import BLADE_LENGTH, CHORD, blade_edge
from cutenv.viewer.solid import scalpel
from cutenv.viewer.solid.scalpel import ScalpelPose, blade, handle, pose
from cutenv.viewer.solid.solids import Surface, box


def standing(vertices: np.ndarray, at: ScalpelPose) -> np.ndarray:
    """Places (across, along, height) of the scalpel's own: turned about its thickness, then moved, as the page does."""
    phi = at.angle - math.pi / 2
    x, y, z = vertices.T
    return np.stack(
        [
            x,
            at.along + math.cos(phi) * y - math.sin(phi) * z,
            at.height + math.sin(phi) * y + math.cos(phi) * z,
        ],
        axis=-1,
    )


def check_stands(at: ScalpelPose, position: float, depth: float) -> None:
    """The edge meets the surface at the position, and the lowest point is the depth below it, at the lower face."""
    y, z = np.vstack([blade_edge(400), [0.0, 0.05]]).T  # prolonged beyond where the blade narrows
    edge = standing(np.stack([np.zeros_like(y), y, z], axis=-1), at)
    assert edge[:, 2].min() == pytest.approx(0.0, abs=2e-6)
    lowest = int(edge[:, 2].argmin())
    assert np.interp(depth, edge[lowest:, 2], edge[lowest:, 1]) == pytest.approx(position, abs=2e-5)


@given(st.floats(0.0, 0.15), st.floats(math.radians(45), math.radians(135)), st.floats(0.001, 0.02))
def test_the_edge_meets_the_surface_where_the_record_has_the_blade(position: float, angle: float, depth: float) -> None:
    check_stands(pose(position, angle, depth), position, depth)


@pytest.mark.parametrize("changed", [{"along": 0.051}, {"height": 0.001}, {"angle": 1.2}])
def test_a_blade_that_stands_elsewhere_is_noticed(changed: dict[str, float]) -> None:
    with pytest.raises(AssertionError):
        check_stands(pose(0.05, 1.3, 0.015)._replace(**changed), 0.05, 0.015)


def test_a_blade_that_leans_forward_reaches_back_below() -> None:
    upper = pose(0.05, math.radians(50.0), 0.02)
    assert upper.along < pose(0.05, math.radians(90.0), 0.02).along


def check_closed(surface: Surface) -> None:
    """Without a hole: every side of a triangle belongs to an even number of them, where vertices are the same place."""
    places, number = np.unique(surface.vertices.round(9), axis=0, return_inverse=True)
    faces = number.ravel()[surface.faces]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, count = np.unique(sides, axis=0, return_counts=True)
    assert len(places) > 7
    assert (count % 2 == 0).all()


@pytest.mark.parametrize("made", [blade, handle, lambda: box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))])
def test_solids_are_closed(made) -> None:
    check_closed(made())


def test_a_hole_is_noticed() -> None:
    whole = blade()
    with pytest.raises(AssertionError):
        check_closed(Surface(vertices=whole.vertices, faces=whole.faces[5:]))


def test_the_blade_has_the_measures_of_a_number_10() -> None:
    size = np.ptp(blade().vertices, axis=0)
    assert size == pytest.approx([scalpel.BLADE_THICKNESS, CHORD, BLADE_LENGTH], rel=1e-9)
    edge = blade_edge()
    slope = np.diff(edge[:, 0]) / np.maximum(np.diff(edge[:, 1]), 1e-12)
    assert (np.diff(slope) <= 1e-9).all()  # the belly is convex, and straight at the end
    assert slope[-1] == pytest.approx(0.0, abs=1e-9)


def test_handle_and_blade_hold_together() -> None:
    assert handle().vertices[:, 2].min() < BLADE_LENGTH < handle().vertices[:, 2].max()
