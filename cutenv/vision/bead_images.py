"""Images of beads whose places are nearly known.

Each alone, behind each other, and groups that jump together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from cutenv._base.arrays import Array, Indices
from cutenv.vision.spots import fit_spots

_TOUCHING = 2.2  # diameters: beads nearer than that are fitted together, for each is in the window of the other
_REACH = 1.3  # diameters around a bead that are fitted
_SHIFT, _CONTRAST = 2.0, 0.15  # standard deviations before the image is seen: place [px], height [of the usual one]
_ROUGH = 1.5  # of the usual noise: what a fit leaves over beyond it does not average out
_MOST_NOISE = 3.0  # times the usual: more is left over by an edge, or by a bead that nobody expects
_VAGUE = 4.0  # times the least error that the noise allows
_ROUNDS = 12
_SETTLED = 1e-3  # px


@dataclass(frozen=True, kw_only=True)
class BeadLook:
    """Look of a bead in a view's attenuation image.

    Minus the logarithm of the grey value.
    """

    diameter: float  # diameter [px]
    sigma: float  # width of the Gaussian that fits it [px]
    height: float  # its height [1]
    noise: float  # standard deviation of what its fit leaves over in one pixel [1]


def attenuation(grey: Array) -> Array:
    """Return minus the logarithm of an image, with black as 0.5."""
    return np.asarray(-np.log(np.maximum(grey, 0.5)))


def measure_beads(image: Array, expected: Array, look: BeadLook) -> tuple[Array, Array]:
    """Measure the places of beads near where they are expected.

    In the `attenuation` image each is expected, (n, 2), within about two pixels [px]. Return places [px], NaN where a
    bead is not to be seen, hidden, out of view or too faint, and their covariances [px²].
    """
    place = np.full((len(expected), 2), np.nan)
    covariance = np.full((len(expected), 2, 2), np.nan)
    known = np.flatnonzero(np.isfinite(expected).all(axis=1))
    tree = cKDTree(expected[known])
    near = tree.query_pairs(_TOUCHING * look.diameter, output_type="ndarray")
    links = csr_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(known),) * 2)
    heap = connected_components(links, directed=False)[1]
    size = np.bincount(heap, minlength=1)
    alone = known[size[heap] == 1]
    spots, settled = fit_spots(image, expected[alone], look.diameter)
    seen = settled & _usual(spots.amplitude, spots.scatter, look) & (spots.scatter < _MOST_NOISE * look.noise)
    unlike = _unlike(spots.scatter[seen], look)
    place[alone[seen]], covariance[alone[seen]] = spots.place[seen], unlike[:, None, None] * spots.covariance[seen]
    for one in np.flatnonzero(size > 1):
        members = known[heap == one]
        found = _fit_heap(image, expected[members], look)
        if found is not None:
            place[members], covariance[members] = found
    # Of two that hide each other, or share one image, errors stay the same from frame to frame, and add up.
    least = np.sqrt(2.0 / np.pi) * look.noise / look.height
    with np.errstate(invalid="ignore"):
        vague = np.sqrt(np.trace(covariance, axis1=1, axis2=2) / 2.0) > _VAGUE * least
    place[vague], covariance[vague] = np.nan, np.nan
    return place, covariance


def _usual(height: Array, scatter: Array, look: BeadLook) -> NDArray[np.bool_]:
    """Return which heights fit a single bead."""
    room = 0.4 * look.height + 1.5 * scatter
    return np.asarray(np.abs(height - look.height) < room)


def _unlike(scatter: Any, look: BeadLook) -> Array:
    """Return the factor of a fit's uncertainty for residuals beyond noise."""
    return np.asarray(np.maximum(1.0, (scatter / (_ROUGH * look.noise)) ** 2))


def _fit_heap(image: Array, expected: Array, look: BeadLook) -> tuple[Array, Array] | None:
    """Fit overlapping beads together with the usual width, or return None.

    The covariance of each contains what the others and the background leave open; of two in one place it is large.
    """
    n, reach = len(expected), _REACH * look.diameter
    low = np.floor(expected.min(axis=0) - reach).astype(int)
    high = np.ceil(expected.max(axis=0) + reach).astype(int) + 1
    if (low < 0).any() or high[0] > image.shape[1] or high[1] > image.shape[0]:
        return None
    y, x = (axis.ravel().astype(float) for axis in np.mgrid[low[1] : high[1], low[0] : high[0]])
    used = (np.hypot(x[:, None] - expected[:, 0], y[:, None] - expected[:, 1]) <= reach).any(axis=1)
    x, y, values = x[used], y[used], image[low[1] : high[1], low[0] : high[0]].ravel()[used]
    background = np.stack([np.ones_like(x), (x - x.mean()) / reach, (y - y.mean()) / reach], axis=1)
    window = _Window(x, y, values, background)
    # Columns, rows, heights, then the background; the first three with what is known beforehand.
    p = np.concatenate([expected.T.ravel(), np.full(n, look.height), [np.quantile(values, 0.2), 0.0, 0.0]])
    usual = p.copy()
    noise = 0.2 * look.height  # first guess, replaced by what is left over
    prior = np.zeros(len(p))
    cost, damping = np.inf, 1e-3
    left, slope = _heap(p, window, look.sigma)
    for _ in range(_ROUNDS):
        prior[: 2 * n] = (noise / _SHIFT) ** 2
        prior[2 * n : 3 * n] = (noise / (_CONTRAST * look.height)) ** 2
        normal = slope.T @ slope
        side = slope.T @ left + prior * (usual - p)
        step = np.linalg.solve(normal + np.diag(prior + damping * np.diag(normal) + 1e-9), side)
        tried = p + step
        tried_left, tried_slope = _heap(tried, window, look.sigma)
        tried_cost = float(tried_left @ tried_left + prior @ (tried - usual) ** 2)
        if tried_cost <= cost:
            p, left, slope, cost, damping = tried, tried_left, tried_slope, tried_cost, damping / 5.0
            noise = float(np.sqrt(left @ left / max(len(x) - len(p), 1)))
            cost = float(left @ left + prior @ (p - usual) ** 2)
            if np.abs(step[: 2 * n]).max() < _SETTLED:
                break
        else:
            damping *= 10.0
    height = p[2 * n : 3 * n]
    if not _usual(height, np.full(n, noise), look).all() or noise > _MOST_NOISE * look.noise:
        return None
    normal = slope.T @ slope + np.diag(prior + 1e-9)
    whole = np.asarray(np.linalg.inv(normal) * noise**2, float)
    whole = whole * _unlike(noise, look)
    rows = np.stack([np.arange(n), np.arange(n, 2 * n)], axis=1)
    return p[: 2 * n].reshape(2, n).T, whole[rows[:, :, None], rows[:, None, :]]


class _Window(NamedTuple):
    """Pixels that are fitted.

    Columns, rows, values, each of shape (m,), and the background's shapes (m, 3).
    """

    x: Array
    y: Array
    values: Array
    background: Array


def _heap(p: Array, window: _Window, sigma: float) -> tuple[Array, Array]:
    """Return residuals and Jacobian of n overlapping beads."""
    x, y, values, background = window
    n = (len(p) - background.shape[1]) // 3
    u, v = x[:, None] - p[:n], y[:, None] - p[n : 2 * n]
    bell = np.exp(-0.5 * (u**2 + v**2) / sigma**2)
    high = bell * p[2 * n : 3 * n]
    left = values - high.sum(axis=1) - background @ p[3 * n :]
    return left, np.hstack([high * u / sigma**2, high * v / sigma**2, bell, background])


_GROUP = 8  # beads that look for a shift together: one image of a bead is like another, a group of them is not
_MAX_SHIFT = 5.0  # diameters: largest shift that is looked for
_MIN_SHIFT = 1.0  # px: less is for each bead's own fit
_BETTER = 0.1  # of the usual answer of a bead: by how much a shift must be better than none, for each of the group
_MIN_GROUP = 5  # beads of a group: fewer may all be taken for others
_MAX_SHIFT_DIFFERENCE = 0.8  # diameters: by how much shifts of neighbouring groups may differ
_STIFF = 5e-3  # m: spread of places that tells as much of a slope as there is known of it before
_NEIGHBOURS = 3  # of a lost bead that must be seen
_LOOKS = 3  # at lost beads: those found are neighbours of others
_WORTH = 0.3  # px: a look nearer than that to the first shows the same


def groups_of(rest: Array) -> Indices:
    """Return each bead's group of neighbours at rest, (n, at most 8)."""
    near = cKDTree(rest).query(rest, k=min(_GROUP, len(rest)))[1]
    return np.asarray(near, np.int64).reshape(len(rest), -1)


def shared_shifts(image: Array, expected: Array, rest: Array, groups: Indices, look: BeadLook) -> Array:
    """Find the common shift of each group of beads in an attenuation image.

    They are ``expected``, (n, 2) [px], and lie at ``rest``, (n, 3) [m]. Return shifts, (n, 2) [px], zero where the
    group is where it is expected, or nowhere, or of fewer than 5.
    """
    if groups.shape[1] < _MIN_GROUP:
        return np.zeros_like(expected)
    most = int(np.ceil(_MAX_SHIFT * look.diameter))
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
    least = together[:, np.hypot(*shift.T) <= _MIN_SHIFT].max(axis=1) + _BETTER
    rows = np.arange(len(expected))
    best = together.argmax(axis=1)
    moved = together[rows, best] > least
    found = np.where(moved[:, None], shift[best], 0.0).astype(float)
    # The tissue moves smoothly: a group that alone has moved saw the blade, or beads that are not its own.
    near = np.hypot(*np.moveaxis(found[groups] - found[:, None], -1, 0)) < _MAX_SHIFT_DIFFERENCE * look.diameter
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


def _linear(places: Array, values: Array, wanted: Array) -> Array:
    """Interpolate over the first two axes; undetermined slopes are 0."""
    mean, middle = values.mean(axis=0), places[:, :2].mean(axis=0)
    x = places[:, :2] - middle
    slope = np.linalg.solve(x.T @ x + _STIFF**2 * np.eye(2), x.T @ (values - mean))
    return np.asarray(mean + (wanted[:, :2] - middle) @ slope)


def roundness(image: Array, look: BeadLook) -> Array:
    """Return how much each pixel looks like a bead's centre.

    It is 1 for a usual bead, and about 0 on a blade's edge: the lesser of the two curvatures of the smoothed image;
    along an edge there is none.
    """
    usual = look.height / (4.0 * look.sigma**2)  # curvature of a bead, smoothed by its own width
    xx, yy, xy = (
        -ndimage.gaussian_filter(image, look.sigma, order=order, truncate=3.0) for order in ((0, 2), (2, 0), (1, 1))
    )
    return np.asarray((0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)) / usual)


def measure_with_neighbours(image: Array, expected: Array, groups: Indices, look: BeadLook) -> tuple[Array, Array]:
    """Measure beads, and unseen ones again at their neighbours' shift.

    See `measure_beads`, and `groups_of` for the beads that move like each.
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
