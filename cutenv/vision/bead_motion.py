"""Motion that neighbouring beads share: a jump of the tissue between two frames, and where lost beads are found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from cutenv.vision.bead_images import BeadLook, measure_beads

_GROUP = 8  # beads that look for a shift together: one image of a bead is like another, a group of them is not
_FARTHEST = 5.0  # diameters: largest shift that is looked for
_LEAST = 1.0  # px: less is for each bead's own fit
_BETTER = 0.1  # of the usual answer of a bead: by how much a shift must be better than none, for each of the group
_SMALLEST = 5  # beads of a group: fewer may all be taken for others
_ALIKE = 0.8  # diameters: by how much shifts of neighbouring groups may differ
_STIFF = 5e-3  # m: spread of places that tells as much of a slope as there is known of it before
_NEIGHBOURS = 3  # of a lost bead that must be seen
_LOOKS = 3  # at lost beads: those found are neighbours of others
_WORTH = 0.3  # px: a look nearer than that to the first shows the same


def groups_of(rest: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return for each bead its group: itself and those nearest to it at rest, shape (n, at most 8)."""
    near = cKDTree(rest).query(rest, k=min(_GROUP, len(rest)))[1]
    return np.asarray(near, np.int64).reshape(len(rest), -1)


def shared_shifts(
    image: NDArray[np.float64],
    expected: NDArray[np.float64],
    rest: NDArray[np.float64],
    groups: NDArray[np.int64],
    look: BeadLook,
) -> NDArray[np.float64]:
    """Find by how much groups of beads are away together from where they are expected.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Attenuation image.
    expected : ndarray, shape (n, 2)
        Where each bead is expected [px].
    rest : ndarray, shape (n, 3)
        Places at rest [m].
    groups : ndarray of int, shape (n, k)
        Beads that move like each (see `groups_of`).
    look : BeadLook
        How a bead looks.

    Returns
    -------
    ndarray, shape (n, 2)
        Shifts [px], zero where the group is where it is expected, or nowhere, or of fewer than 5.
    """
    if groups.shape[1] < _SMALLEST:
        return np.zeros_like(expected)
    most = int(np.ceil(_FARTHEST * look.diameter))
    room = most + int(np.ceil(4.0 * look.sigma)) + 1
    size = np.array(image.shape[::-1])
    low = np.clip(np.floor(expected.min(axis=0)).astype(int) - room, 0, size - 1)
    high = np.clip(np.ceil(expected.max(axis=0)).astype(int) + room + 1, low + 1, size)
    answer = np.clip(roundness(image[low[1] : high[1], low[0] : high[0]], look), 0.0, 1.2)
    step = np.arange(-most, most + 1)
    shift = np.stack(np.meshgrid(step, step, indexing="ij"), axis=-1).reshape(-1, 2)
    shift = shift[np.hypot(*shift.T) <= most]
    places = (expected - low)[:, None] + shift
    own = ndimage.map_coordinates(answer, (places[..., 1], places[..., 0]), order=1, cval=0.0)
    together = own[groups].mean(axis=1)
    least = together[:, np.hypot(*shift.T) <= _LEAST].max(axis=1) + _BETTER
    rows = np.arange(len(expected))
    best = together.argmax(axis=1)
    moved = together[rows, best] > least
    found = np.where(moved[:, None], shift[best], 0.0).astype(float)
    # The tissue moves smoothly: a group that alone has moved saw the blade, or beads that are not its own.
    near = np.hypot(*np.moveaxis(found[groups] - found[:, None], -1, 0)) < _ALIKE * look.diameter
    moved &= (near & moved[groups]).mean(axis=1) > 0.5
    # The others are looked for where the motion of those around, made linear, would have them.
    for _ in range(_LOOKS):
        if moved.all() or moved.sum() < _NEIGHBOURS:
            break
        tree = cKDTree(rest[moved])
        for one in np.flatnonzero(~moved):
            around = np.flatnonzero(moved)[tree.query(rest[one], k=min(_GROUP, int(moved.sum())))[1]]
            theirs = _linear(rest[around] - rest[one], found[around], rest[groups[one]] - rest[one])
            there = expected[groups[one]] - low + theirs
            score = ndimage.map_coordinates(answer, there.T[::-1], order=1, cval=0.0).mean()
            if score > least[one]:
                found[one], moved[one] = theirs[0], True
    return np.where(moved[:, None], found, 0.0)


def _linear(
    places: NDArray[np.float64], values: NDArray[np.float64], wanted: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return values at wanted places along the first two axes by a linear fit; slopes that nothing tells are 0."""
    mean, middle = values.mean(axis=0), places[:, :2].mean(axis=0)
    x = places[:, :2] - middle
    slope = np.linalg.solve(x.T @ x + _STIFF**2 * np.eye(2), x.T @ (values - mean))
    return np.asarray(mean + (wanted[:, :2] - middle) @ slope)


def roundness(image: NDArray[np.float64], look: BeadLook) -> NDArray[np.float64]:
    """Return how much each pixel looks like the centre of a bead: 1 for a usual one, about 0 on a blade's edge.

    It is the lesser of the two curvatures of the smoothed image; along an edge there is none.
    """
    usual = look.height / (4.0 * look.sigma**2)  # curvature of a bead, smoothed by its own width
    xx, yy, xy = (
        -ndimage.gaussian_filter(image, look.sigma, order=order, truncate=3.0) for order in ((0, 2), (2, 0), (1, 1))
    )
    return np.asarray((0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)) / usual)


def measure_with_neighbours(
    image: NDArray[np.float64], expected: NDArray[np.float64], groups: NDArray[np.int64], look: BeadLook
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Measure beads, and those not seen once more where they are as far off as their neighbours.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Attenuation image.
    expected : ndarray, shape (n, 2)
        Where each bead is expected [px].
    groups : ndarray of int, shape (n, k)
        Beads that move like each.
    look : BeadLook
        How a bead looks.

    Returns
    -------
    place, covariance : ndarray, shapes (n, 2) and (n, 2, 2)
        As from `measure_beads`.
    """
    place, covariance = measure_beads(image, expected, look)
    for _ in range(_LOOKS):
        seen = np.asarray(np.isfinite(place).all(axis=1))
        again = np.where(seen[:, None], place, expected)
        for one in np.flatnonzero(~seen):
            near = groups[one][seen[groups[one]]]
            if len(near) >= _NEIGHBOURS:
                again[one] = expected[one] + np.median((place - expected)[near], axis=0)
        tried = ~seen & (np.hypot(*(again - expected).T) > _WORTH)
        if not tried.any():
            break
        second, error = measure_beads(image, again, look)
        found = np.asarray(tried & np.isfinite(second).all(axis=1))
        place[found], covariance[found] = second[found], error[found]
        if not found.any():
            break
    return place, covariance
