"""Points in space from their images in two views, at any angle; and pixels against distance."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.vision.projection import (
    THESIS_MAGNIFICATION,
    CArm,
    epipolar_distance,
    fit_magnification,
    fit_projection,
    project,
    triangulate,
)

NOISE = 0.1


ARM = CArm(
    isocentre=(0, 0.07, 0.01), source_to_isocentre=0.6, source_to_detector=1.0, pixel=4e-4, principal_point=(330, 240)
)


def views(*degrees):
    return [ARM.projection(np.radians(angle)) for angle in degrees]


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(0).uniform([-0.03, 0.01, 0.0], [0.03, 0.13, 0.03], (200, 3))


@pytest.mark.parametrize("degrees", [90.0, 60.0, 35.0])
def test_points_are_found_within_their_covariance(points, degrees):
    rng = np.random.default_rng(1)
    pair = views(3.0, 3.0 + degrees)
    images = np.stack([project(view, points) for view in pair])
    error = np.broadcast_to(NOISE**2 * np.eye(2), (*images.shape, 2))
    place, covariance, misfit = triangulate(pair, images + NOISE * rng.normal(size=images.shape), error)
    off = place - points
    assert np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off).mean() == pytest.approx(3.0, rel=0.15)
    assert misfit.mean() == pytest.approx(1.0, rel=0.25)
    assert 1e3 * np.sqrt((off**2).sum(axis=1).mean()) < 0.15


def test_a_point_in_one_view_alone_has_no_place(points):
    pair = views(0.0, 90.0)
    images = np.stack([project(view, points[:3]) for view in pair])
    images[1, 1] = np.nan
    place, _, _ = triangulate(pair, images, np.broadcast_to(np.eye(2), (2, 3, 2, 2)))
    assert np.isfinite(place).all(axis=1).tolist() == [True, False, True]
    assert place[0] == pytest.approx(points[0], abs=1e-9)


def test_a_view_is_found_from_a_phantom(points):
    (view,) = views(77.0)
    rng = np.random.default_rng(2)
    found, residual = fit_projection(points[:40], project(view, points[:40]) + 0.05 * rng.normal(size=(40, 2)))
    assert np.abs(project(found, points) - project(view, points)).max() < 0.1
    assert np.sqrt((residual**2).mean()) < 0.06


def test_a_phantom_that_cannot_tell_is_refused(points):
    (view,) = views(10.0)
    with pytest.raises(ValueError, match="needs 8"):
        fit_projection(points[:6], project(view, points[:6]))
    flat = points * (1.0, 1.0, 0.0)
    with pytest.raises(ValueError, match="in one plane"):
        fit_projection(flat, project(view, flat))


def test_images_of_one_point_lie_on_each_others_epipolar_lines(points):
    first, second = views(0.0, 80.0)
    one, two = project(first, points), project(second, points)
    assert epipolar_distance(first, second, one, two).max() < 1e-6
    moved = epipolar_distance(first, second, one, two + np.array([3.0, 0.0]))
    assert 1.5 < moved.min() < moved.max() < 3.0  # along the cut the lines part, and both views share the error


def test_a_cone_beam_is_found_again():
    distance = np.array([0.0, 60.0, 150.0, 300.0])
    found, residual = fit_magnification(distance, 0.38 * (1.0 - distance / 980.0))
    assert found.source_distance == pytest.approx(980.0)
    assert np.abs(residual).max() < 1e-9
    with pytest.raises(ValueError, match="from the source"):
        fit_magnification(distance, 0.38 * (1.0 + distance / 980.0))
    with pytest.raises(ValueError, match="3 or more distances"):
        fit_magnification(distance[:2], [0.3, 0.2], "quadratic")


def test_the_thesiss_magnifications_are_as_printed():
    assert THESIS_MAGNIFICATION["top"].at(100.0) == pytest.approx(0.3411 - 0.08)
    assert THESIS_MAGNIFICATION["side"].at(10.0) == pytest.approx(0.0784 - 1.093 + 5.1358)
    with pytest.raises(ValueError, match="no point source"):
        _ = THESIS_MAGNIFICATION["side"].source_distance
