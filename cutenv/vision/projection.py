"""Two-view geometry: projection matrices of X-ray views at any angle, and points in space from their images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from cutenv._base.validation import in_range

_LEAST_POINTS = 8  # for the eleven numbers of a projection, with something left over
_ROUNDS = 8  # of the triangulation


def cone_beam_projection(
    source: ArrayLike, detector: ArrayLike, across: ArrayLike, down: ArrayLike, pixel: float
) -> NDArray[np.float64]:
    """Return the projection matrix of an X-ray view, shape (3, 4): from metres to square pixels.

    Parameters
    ----------
    source : array_like, shape (3,)
        Place of the X-ray source [m].
    detector : array_like, shape (3,)
        Place of the detector's first pixel [m].
    across, down : array_like, shape (3,)
        Directions of the image's columns and rows in space; made unit vectors here.
    pixel : float
        Size of a square pixel on the detector [m].

    Raises
    ------
    ValueError
        If directions are parallel, or the source lies in the plane of the detector.
    """
    s, first, u, v = (np.asarray(each, float).reshape(3) for each in (source, detector, across, down))
    pixel = in_range("pixel", pixel, 1e-7, 0.1, "m", "It is the size of one pixel on the detector.")
    u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
    normal = np.cross(u, v)
    distance = float(normal @ (first - s))
    if np.linalg.norm(normal) < 1e-6 or abs(distance) < 1e-9:
        raise ValueError("columns and rows of the detector need two directions, and the source lies off its plane.")
    # A ray from the source through X meets the detector at s + (X - s) distance / (normal (X - s)).
    rows = [(distance * axis + normal * float(axis @ (s - first))) / pixel for axis in (u, v)]
    turn = np.stack([*rows, normal])
    return np.hstack([turn, -(turn @ s)[:, None]])


@dataclass(frozen=True, kw_only=True)
class CArm:
    """C-arm that turns about the direction of the cut.

    Parameters
    ----------
    isocentre : array_like, shape (3,)
        Point about which the arm turns, in the specimen's frame [m].
    source_to_isocentre, source_to_detector : float
        Distances from the source [m].
    pixel : float
        Size of a square pixel on the detector [m].
    principal_point : tuple of float
        Where the ray through the isocentre meets the detector [square px].
    """

    isocentre: tuple[float, float, float]
    source_to_isocentre: float
    source_to_detector: float
    pixel: float
    principal_point: tuple[float, float]

    def projection(self, angle: float) -> NDArray[np.float64]:
        """Return the projection matrix of the view at an angle [rad], shape (3, 4).

        0: seen from above, the source below; π/2: seen from +x, the source at -x. The image's columns run along y.
        """
        ray = np.array([np.sin(angle), 0.0, np.cos(angle)])  # from source to detector
        across = np.array([0.0, 1.0, 0.0])
        down = np.cross(ray, across)
        source = np.asarray(self.isocentre, float) - self.source_to_isocentre * ray
        column, row = self.principal_point
        first = source + self.source_to_detector * ray - self.pixel * (column * across + row * down)
        return cone_beam_projection(source, first, across, down, self.pixel)


def project(projection: NDArray[np.float64], points: ArrayLike) -> NDArray[np.float64]:
    """Return the images of points in space, shape (n, 2) [square px]."""
    x = np.asarray(points, float).reshape(-1, 3)
    h = x @ projection[:, :3].T + projection[:, 3]
    return np.asarray(h[:, :2] / h[:, 2:])


def projection_slope(projection: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the derivative of images by places, shape (n, 2, 3) [px/m]."""
    h = points @ projection[:, :3].T + projection[:, 3]
    image = h[:, :2] / h[:, 2:]
    return np.asarray((projection[None, :2, :3] - image[:, :, None] * projection[None, 2:, :3]) / h[:, 2, None, None])


def fit_projection(points: ArrayLike, images: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find the projection matrix of a view from known points, by linear and then least-squares fit.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Places of the points of a phantom [m], not all in one plane.
    images : array_like, shape (n, 2)
        Their images, undistorted [square px].

    Returns
    -------
    projection : ndarray, shape (3, 4)
        From metres to square pixels.
    residual : ndarray, shape (n, 2)
        Image minus projected point [px].

    Raises
    ------
    ValueError
        If there are fewer than 8 points, or they lie in one plane.
    """
    x, y = np.asarray(points, float).reshape(-1, 3), np.asarray(images, float).reshape(-1, 2)
    if len(x) != len(y) or len(x) < _LEAST_POINTS:
        raise ValueError(f"{len(x)} points and {len(y)} images are given: a projection needs {_LEAST_POINTS} of both.")
    spread = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    if spread[2] < 0.02 * spread[0]:
        raise ValueError("the points lie in one plane, nearly: a projection needs a phantom with depth.")
    to_space, to_image = _unit(x), _unit(y)
    a, b = _homogeneous(x) @ to_space.T, _homogeneous(y) @ to_image.T
    none = np.zeros_like(a)
    matrix = np.vstack([np.hstack([a, none, -b[:, :1] * a]), np.hstack([none, a, -b[:, 1:2] * a])])
    found = np.linalg.svd(matrix)[2][-1].reshape(3, 4)
    found = np.linalg.inv(to_image) @ found @ to_space
    found *= np.sign(found[2] @ _homogeneous(x)[0]) / np.linalg.norm(found[2, :3])
    scale = np.abs(found) + 1e-9 * np.abs(found).max()

    def left(p: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray((y - project(p.reshape(3, 4) * scale, x)).ravel())

    solved = least_squares(left, (found / scale).ravel(), method="lm", max_nfev=400)
    projection = solved.x.reshape(3, 4) * scale
    return projection, y - project(projection, x)


def _homogeneous(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.hstack([points, np.ones((len(points), 1))])


def _unit(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix that moves points to mean 0 and size 1 (Hartley's normalisation)."""
    n = points.shape[1]
    scale = 1.0 / max(float(points.std()), 1e-12)
    matrix = np.eye(n + 1) * scale
    matrix[:n, n] = -scale * points.mean(axis=0)
    matrix[n, n] = 1.0
    return matrix


def triangulate(
    projections: Sequence[NDArray[np.float64]], images: ArrayLike, covariances: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Find points in space from their images in several views, by weighted least squares.

    Parameters
    ----------
    projections : sequence of ndarray, shape (3, 4)
        One for each view.
    images : array_like, shape (views, n, 2)
        Undistorted images [square px]; NaN where a view does not show a point.
    covariances : array_like, shape (views, n, 2, 2)
        Their covariances [px²].

    Returns
    -------
    place : ndarray, shape (n, 3)
        Places [m]; NaN for points that fewer than two views show.
    covariance : ndarray, shape (n, 3, 3)
        Their covariances [m²].
    misfit : ndarray, shape (n,)
        Squared distances of the images over their covariances, summed, over the degrees of freedom [1].
    """
    y, c = np.asarray(images, float), np.asarray(covariances, float)
    seen = np.isfinite(y).all(axis=2)
    known = seen.sum(axis=0) >= 2
    place = np.full((y.shape[1], 3), np.nan)
    covariance = np.full((y.shape[1], 3, 3), np.nan)
    misfit = np.full(y.shape[1], np.nan)
    if not known.any():
        return place, covariance, misfit
    y, seen = y[:, known], seen[:, known]
    weight = np.zeros((*y.shape, 2))
    weight[seen] = np.linalg.inv(c[:, known][seen])
    y = np.where(seen[:, :, None], y, 0.0)
    normal, side = np.zeros((y.shape[1], 3, 3)), np.zeros((y.shape[1], 3))
    for one, projection in enumerate(projections):  # linear: the image times its depth
        rows = projection[None, :2] - y[one][:, :, None] * projection[None, 2:]
        rows = rows * seen[one][:, None, None] / np.linalg.norm(rows[:, :, :3], axis=2, keepdims=True)
        normal += np.einsum("nki,nkj->nij", rows[:, :, :3], rows[:, :, :3])
        side -= np.einsum("nki,nk->ni", rows[:, :, :3], rows[:, :, 3])
    x = np.linalg.solve(normal, side[:, :, None])[:, :, 0]
    for _ in range(_ROUNDS):
        normal, side, squares = np.zeros_like(normal), np.zeros_like(side), np.zeros(len(x))
        for one, projection in enumerate(projections):
            slope = projection_slope(projection, np.asarray(x))
            left = y[one] - project(projection, x)
            weighted = np.einsum("nki,nkl->nil", slope, weight[one])
            normal += weighted @ slope
            side += np.einsum("nil,nl->ni", weighted, left)
            squares += np.einsum("nk,nkl,nl->n", left, weight[one], left)
        step = np.linalg.solve(normal, side[:, :, None])[:, :, 0]
        x = x + step
        if np.abs(step).max() < 1e-9:
            break
    place[known], covariance[known] = x, np.linalg.inv(normal)
    misfit[known] = squares / (2.0 * seen.sum(axis=0) - 3.0)
    return place, covariance, misfit


def epipolar_distance(
    first: NDArray[np.float64], second: NDArray[np.float64], in_first: ArrayLike, in_second: ArrayLike
) -> NDArray[np.float64]:
    """Return how far pairs of images are from belonging to one point [px], shape of the pairs (Sampson's distance).

    Parameters
    ----------
    first, second : ndarray, shape (3, 4)
        Projection matrices.
    in_first, in_second : array_like, shape (..., 2)
        Images in either view [square px]; shapes broadcast.
    """
    source = np.linalg.svd(first)[2][-1]
    e = second @ source
    cross = np.array([[0.0, -e[2], e[1]], [e[2], 0.0, -e[0]], [-e[1], e[0], 0.0]])
    fundamental = cross @ second @ np.linalg.pinv(first)
    a, b = np.broadcast_arrays(np.asarray(in_first, float), np.asarray(in_second, float))
    a, b = (np.concatenate([each, np.ones((*each.shape[:-1], 1))], axis=-1) for each in (a, b))
    line_b, line_a = a @ fundamental.T, b @ fundamental
    slope = np.sqrt((line_b[..., :2] ** 2).sum(axis=-1) + (line_a[..., :2] ** 2).sum(axis=-1))
    return np.asarray(np.abs((b * line_b).sum(axis=-1)) / slope)
