"""Geometry of X-ray views.

Projection matrices, points in space from their images, and the size of a pixel there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range, one_of

_LEAST_POINTS = 8  # for the eleven numbers of a projection, with something left over
_ROUNDS = 8  # of the triangulation


def cone_beam_projection(
    source: ArrayLike, detector: ArrayLike, across: ArrayLike, down: ArrayLike, pixel: float
) -> Array:
    """Return an X-ray projection matrix (3, 4), metres to square pixels.

    ``source`` and ``detector``, its first pixel, are places [m]; ``across`` and ``down`` directions of the image's
    columns and rows in space, of any length; ``pixel`` is the size of one on the detector [m].

    Raises ValueError if directions are parallel, or the source lies in the plane of the detector.
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
    """C-arm that turns about the direction of the cut."""

    isocentre: tuple[float, float, float]  # point about which the arm turns, in the specimen's frame [m], shape (3,)
    source_to_isocentre: float  # distances from the source [m]
    source_to_detector: float
    pixel: float  # size of a square pixel on the detector [m]
    principal_point: tuple[float, float]  # where the ray through the isocentre meets the detector [square px]

    def projection(self, angle: float) -> Array:
        """Return a view's projection matrix (3, 4) at ``angle`` [rad].

        0: seen from above, the source below; π/2: seen from +x, the source at -x. The image's columns run along y.
        """
        ray = np.array([np.sin(angle), 0.0, np.cos(angle)])  # from source to detector
        across = np.array([0.0, 1.0, 0.0])
        down = np.cross(ray, across)
        source = np.asarray(self.isocentre, float) - self.source_to_isocentre * ray
        column, row = self.principal_point
        first = source + self.source_to_detector * ray - self.pixel * (column * across + row * down)
        return cone_beam_projection(source, first, across, down, self.pixel)


def project(projection: Array, points: ArrayLike) -> Array:
    """Project points in space to images, shape (n, 2) [square px]."""
    x = np.asarray(points, float).reshape(-1, 3)
    h = x @ projection[:, :3].T + projection[:, 3]
    return np.asarray(h[:, :2] / h[:, 2:])


def projection_slope(projection: Array, points: Array) -> Array:
    """Return the projection's derivative by place, (n, 2, 3) [px/m]."""
    h = points @ projection[:, :3].T + projection[:, 3]
    image = h[:, :2] / h[:, 2:]
    return np.asarray((projection[None, :2, :3] - image[:, :, None] * projection[None, 2:, :3]) / h[:, 2, None, None])


def fit_projection(points: ArrayLike, images: ArrayLike) -> tuple[Array, Array]:
    """Fit a view's projection matrix to known points of a phantom.

    They are (n, 3) [m], their undistorted images (n, 2) [square px]. Return the matrix, from metres to square pixels,
    and image minus projected point [px].

    Raises ValueError if there are fewer than 8 points, or they lie in one plane.
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

    def left(p: Array) -> Array:
        return np.asarray((y - project(p.reshape(3, 4) * scale, x)).ravel())

    solved = least_squares(left, (found / scale).ravel(), method="lm", max_nfev=400)
    projection = solved.x.reshape(3, 4) * scale
    return projection, y - project(projection, x)


def _homogeneous(points: Array) -> Array:
    return np.hstack([points, np.ones((len(points), 1))])


def _unit(points: Array) -> Array:
    """Return the matrix of Hartley's normalisation."""
    n = points.shape[1]
    scale = 1.0 / max(float(points.std()), 1e-12)
    matrix = np.eye(n + 1) * scale
    matrix[:n, n] = -scale * points.mean(axis=0)
    matrix[n, n] = 1.0
    return matrix


def triangulate(projections: Sequence[Array], images: ArrayLike, covariances: ArrayLike) -> tuple[Array, Array, Array]:
    """Triangulate points from several views by weighted least squares.

    ``images``, (views, n, 2) [square px], are undistorted, NaN where a view does not show a point; their covariances
    have shape (views, n, 2, 2) [px²].

    Return places [m], NaN for points that fewer than two views show, their covariances [m²], and misfits: squared
    distances of the images over their covariances, summed, over the degrees of freedom [1].
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


def epipolar_distance(first: Array, second: Array, in_first: ArrayLike, in_second: ArrayLike) -> Array:
    """Return Sampson's distance of image pairs from one point [px].

    Images in either view have shape (..., 2) [square px]; shapes broadcast.
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


MAGNIFICATION_MODELS = {"linear": 1, "quadratic": 2, "cone_beam": 1}
"""Models, with the degree of the polynomial in the distance that each one is."""


@dataclass(frozen=True, kw_only=True)
class Magnification:
    """Object length per image pixel at distance d from the detector.

    The thesis's for its top view (7.3) is linear and for its side view (7.4) quadratic; the cone beam is what a point
    source gives, p (1 - d/D), with the pixel p on the detector and the source's distance D from it: the linear one with
    a meaning.

    Erratum: the thesis prints no units for m and d. (7.3) is a cone beam with p = 0.3411 and D = 426 in the unit of
    d. With m in mm/px that is a pixel of 0.34 mm; d in mm would put the source 43 cm from the detector, less than any
    C-arm has. (7.4) is no cone beam: it is smallest at d = 69.7 and grows beyond.

    >>> round(THESIS_MAGNIFICATION["top"].at(100.0), 4)
    0.2611
    >>> THESIS_MAGNIFICATION["top"].source_distance
    426.375
    """

    model: str
    coefficients: tuple[float, ...]  # highest power first, [length per pixel / distance^n]

    def __post_init__(self) -> None:
        one_of("model of the magnification", self.model, MAGNIFICATION_MODELS)
        needed = MAGNIFICATION_MODELS[self.model] + 1
        if len(self.coefficients) != needed or not np.isfinite(self.coefficients).all():
            raise ValueError(f"the magnification {self.model!r} has {needed} finite coefficients.")

    def at(self, distance: float) -> float:
        """Return the length per pixel at a distance from the detector."""
        return float(np.polyval(self.coefficients, distance))

    @property
    def source_distance(self) -> float:
        """Source's distance D from the detector, in d's unit.

        Raises ValueError for the quadratic model, which belongs to no point source.
        """
        if self.model == "quadratic":
            raise ValueError("a quadratic magnification belongs to no point source; fit the cone beam.")
        slope, pixel = self.coefficients
        return -pixel / slope


THESIS_MAGNIFICATION = {
    "top": Magnification(model="linear", coefficients=(-0.0008, 0.3411)),
    "side": Magnification(model="quadratic", coefficients=(0.000784, -0.1093, 5.1358)),
}
"""The thesis's equations (7.3) and (7.4), units not printed."""


def fit_magnification(
    distance: ArrayLike, length_per_pixel: ArrayLike, model: str = "cone_beam"
) -> tuple[Magnification, Array]:
    """Fit a magnification to images of rulers at several distances.

    Distances are from the detector, in any unit of length; the length of one pixel is the spacing of the grid over its
    spacing in pixels. Return the fit and its relative error at each distance [1].

    Raises ValueError if distances are too few, or a cone beam would have its source on the wrong side.
    """
    one_of("model of the magnification", model, MAGNIFICATION_MODELS)
    d, m = np.asarray(distance, float).ravel(), np.asarray(length_per_pixel, float).ravel()
    degree = MAGNIFICATION_MODELS[model]
    if len(d) != len(m) or len(np.unique(d)) < degree + 1 or not (np.isfinite(d).all() and np.isfinite(m).all()):
        raise ValueError(f"the magnification {model!r} needs finite lengths at {degree + 1} or more distances.")
    if (m <= 0.0).any():
        raise ValueError("lengths of a pixel are positive.")
    # Each image errs by a share of its length.
    found = Magnification(model=model, coefficients=tuple(np.polyfit(d, m, degree, w=1.0 / m).tolist()))
    if model == "cone_beam" and (found.coefficients[0] >= 0.0 or found.source_distance <= d.max()):
        raise ValueError(
            f"a pixel covers {m[np.argmin(d)]:g} at the least distance and {m[np.argmax(d)]:g} at the largest; in a "
            "cone beam it covers less away from the detector. Are the distances those from the source?"
        )
    return found, np.asarray(np.polyval(found.coefficients, d) / m - 1.0)
