"""Which image belongs to which bead.

It is found by a rotation of the C-arm, or by epipolar lines and motion; poses are adjusted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares, linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from cutenv._base.arrays import Array, Indices
from cutenv.vision.projection import epipolar_distance, project, triangulate

_DEPTH_STEP = 0.15  # px: how far the image of a place on a ray moves from one tried depth to the next, at most
_LEAST_SHARE = 0.6  # of the views that must show a bead
_TURN, _MOVE = 0.01, 0.003  # standard deviations of a pose before the adjustment [rad], [m]


def places_from_sweep(
    projections: Sequence[Array], images: Sequence[Array], region: ArrayLike, *, tolerance: float = 1.0
) -> tuple[Array, Array]:
    """Find places of resting beads from views of a rotating C-arm.

    The thesis rotated it by 90 degrees. Each image in the first view, which shows every bead apart from the others, is
    a ray. Of all places on it within the region, the lowest and highest coordinates [m], the one is taken that most
    views show; its images there are then triangulated. No bead has to be followed from view to view. ``images``,
    (n_view, 2), are undistorted [square px]; their distance from where a place shows them is taken for noise and errors
    of the pose up to ``tolerance`` [px].

    Return places [m], (n_first, 3), NaN where less than 60 % of the views agree on one, and their covariances with what
    the views disagree [m²].

    Raises ValueError if views are fewer than five, one shows no spot, or less than half of the beads are found: a view
    that is turned or mirrored, or of another calibration.
    """
    low, high = np.asarray(region, float)
    if len(projections) != len(images) or len(projections) < 5:
        raise ValueError(f"{len(images)} views and {len(projections)} projections: a sweep has five or more of both.")
    empty = [number for number, spots in enumerate(images) if len(spots) == 0]
    if empty:
        raise ValueError(f"views {empty} of the sweep show no bead.")
    starts, ends = _rays(projections[0], np.asarray(images[0], float), low, high)
    reach = max(
        float(np.hypot(*(project(p, starts) - project(p, ends))[np.isfinite(starts).all(axis=1)].T).max(initial=0.0))
        for p in projections
    )
    share = np.linspace(0.0, 1.0, int(np.clip(reach / (_DEPTH_STEP * 2.0), 20, 2000)))
    tried = starts[:, None] + share[:, None] * (ends - starts)[:, None]
    inside = np.nan_to_num(starts, nan=0.0)
    tried = np.where(np.isfinite(tried), tried, inside[:, None])
    trees = [cKDTree(spots) for spots in images]
    votes = np.zeros(tried.shape[:2])
    for projection, tree in zip(projections, trees, strict=True):
        away = np.asarray(tree.query(project(projection, tried.reshape(-1, 3)))[0]).reshape(votes.shape)
        votes += np.exp(-0.5 * (away / tolerance) ** 2)
    best = np.take_along_axis(tried, votes.argmax(axis=1)[:, None, None], axis=1)[:, 0]
    place, covariance = np.full_like(best, np.nan), np.full((len(best), 3, 3), np.nan)
    shown = np.full((len(images), len(best), 2), np.nan)
    for one, (projection, tree) in enumerate(zip(projections, trees, strict=True)):
        nearest, which = tree.query(project(projection, best))
        close = np.asarray(nearest) < 3.0 * tolerance
        shown[one, close] = images[one][np.asarray(which)[close]]
    error = np.broadcast_to((0.5 * tolerance) ** 2 * np.eye(2), (*shown.shape, 2))
    found, spread, misfit = triangulate(projections, shown, error)
    agreed = np.isfinite(shown[:, :, 0]).mean(axis=0)
    sure = np.isfinite(found).all(axis=1) & (agreed >= _LEAST_SHARE) & np.isfinite(starts).all(axis=1)
    place[sure] = found[sure]
    covariance[sure] = spread[sure] * np.maximum(misfit[sure], 0.1)[:, None, None]
    if sure.mean() < 0.5:
        raise ValueError(
            f"the sweep shows {sure.sum()} of {len(sure)} beads in one place. Is a view turned or mirrored, the "
            "calibration another one, or the region wrong?"
        )
    return place, covariance


def _rays(projection: Array, pixels: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return entry and exit of pixels' rays through the region, NaN outside."""
    source = -np.linalg.solve(projection[:, :3], projection[:, 3])
    way = np.linalg.solve(projection[:, :3], np.hstack([pixels, np.ones((len(pixels), 1))]).T).T
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    with np.errstate(divide="ignore"):
        one, two = (low - source) / way, (high - source) / way
    enter, leave = np.minimum(one, two).max(axis=1), np.maximum(one, two).min(axis=1)
    missed = ~(enter < leave)
    starts, ends = source + enter[:, None] * way, source + leave[:, None] * way
    starts[missed], ends[missed] = np.nan, np.nan
    return starts, ends


def pairs_by_epipolar(
    first: Array, second: Array, in_first: ArrayLike, in_second: ArrayLike, *, tolerance: float = 0.5
) -> tuple[Indices, Indices]:
    """Pair tracks of two views by epipolar lines.

    The images of a bead lie on each other's epipolar lines in every frame, at rest and on the way: beads that lie on
    one line by chance part when they move. A pair is taken if it is the best for both of its tracks together, and for
    each of them twice as good as any other. Tracks, (frames, n, 2) and (frames, m, 2), are undistorted [square px], NaN
    where a bead was not seen; the root of their mean squared distance from the line is at most ``tolerance`` [px].

    Return the numbers of paired tracks, (k, 2), and tracks of the first view that several of the second would fit, or
    none.
    """
    a, b = np.asarray(in_first, float), np.asarray(in_second, float)
    if a.ndim != 3 or b.ndim != 3 or len(a) != len(b):
        raise ValueError(f"tracks have shapes {a.shape} and {b.shape}: give (frames, beads, 2) with the same frames.")
    squares, count = np.zeros((a.shape[1], b.shape[1])), np.zeros((a.shape[1], b.shape[1]))
    for one, two in zip(a, b, strict=True):
        away = epipolar_distance(first, second, one[:, None], two[None])
        seen = np.isfinite(away)
        squares += np.where(seen, away, 0.0) ** 2
        count += seen
    cost = np.where(count > 0.3 * len(a), np.sqrt(squares / np.maximum(count, 1)), 1e3)
    rows, columns = linear_sum_assignment(np.minimum(cost, 3.0 * tolerance))
    chosen = cost[rows, columns]
    others = cost.copy()
    others[rows, columns] = np.inf
    rival = np.minimum(others[rows].min(axis=1, initial=np.inf), others[:, columns].min(axis=0, initial=np.inf))
    sure = (chosen < tolerance) & (rival > 2.0 * chosen)
    pairs = np.stack([rows[sure], columns[sure]], axis=1).astype(np.int64)
    return pairs, np.setdiff1d(np.arange(a.shape[1]), pairs[:, 0])


def bundle_adjusted(
    projections: Sequence[Array], images: ArrayLike, covariances: ArrayLike
) -> tuple[list[Array], Array]:
    """Adjust camera poses by bundle adjustment, keeping the first view.

    The places of the beads are eliminated: for each trial of the poses they are triangulated anew. Arms come back to a
    pose within about 10 mrad and 3 mm. Images of resting beads are those for `triangulate`.

    Return adjusted projections, and turn [rad] and shift [m] of each view after the first about the middle of the
    beads, (views - 1, 6).

    Raises ValueError if fewer than 12 beads are seen in two views.
    """
    y, c = np.asarray(images, float), np.asarray(covariances, float)
    start, _, _ = triangulate(projections, y, c)
    known = np.isfinite(start).all(axis=1)
    if known.sum() < 12:
        raise ValueError(f"{known.sum()} beads are seen in two views; the poses need 12.")
    y, c, middle = y[:, known], c[:, known], start[known].mean(axis=0)
    seen = np.isfinite(y).all(axis=2)
    root = np.zeros_like(c)
    # Poses in units of their own uncertainty: of that a thousandth is a good step for the derivative.
    units = np.tile([_TURN] * 3 + [_MOVE] * 3, len(projections) - 1)
    root[seen] = np.linalg.cholesky(np.linalg.inv(c[seen])).transpose(0, 2, 1)

    def moved(p: Array) -> list[Array]:
        views = [projections[0]]
        for old, change in zip(projections[1:], p.reshape(-1, 6), strict=True):
            motion = np.eye(4)
            motion[:3, :3] = Rotation.from_rotvec(change[:3]).as_matrix()
            motion[:3, 3] = middle + change[3:] - motion[:3, :3] @ middle
            views.append(old @ motion)
        return views

    def left(p: Array) -> Array:
        views = moved(p)
        x, _, _ = triangulate(views, y, c)
        off = np.stack([np.where(s[:, None], i - project(v, x), 0.0) for v, i, s in zip(views, y, seen, strict=True)])
        whitened = np.einsum("vnij,vnj->vni", root, off).ravel()
        return np.concatenate([whitened, p / units])

    def shifted(q: Array) -> Array:
        return left(units * (q - 1.0))  # steps are shares of q, so it must not begin at 0

    solved = least_squares(shifted, np.ones(len(units)), diff_step=[1e-3], loss="soft_l1", f_scale=3.0)
    changes = units * (solved.x - 1.0)
    return moved(changes), changes.reshape(-1, 6)


def linked(images: Sequence[Array], largest_step: float, *, memory: int = 3) -> Array:
    """Link spots of one view from frame to frame.

    Links have the least total distance. ``images`` of each frame, (n_frame, 2), are undistorted [square px]; the
    largest step from one to the next [px] is less than half the distance between beads; a spot may be hidden for
    ``memory`` frames.

    Return tracks, (frames, n, 2), that are seen in 30 % of the frames or more; NaN where they are not.

    Raises ValueError if no frame shows a spot.
    """
    if not any(len(spots) for spots in images):
        raise ValueError("no frame shows a spot.")
    last, seen_in = np.zeros((0, 2)), np.zeros(0, int)  # of each track: its last place, and the frame of it
    numbers = []  # of the track that each spot belongs to, by frame
    for k, spots in enumerate(images):
        number = np.full(len(spots), -1)
        open_tracks = np.flatnonzero(k - seen_in <= memory + 1)
        way = cdist(last[open_tracks], spots)
        track, spot = linear_sum_assignment(np.minimum(way, 1e3 * largest_step))
        near = way[track, spot] <= largest_step
        number[spot[near]] = open_tracks[track[near]]
        new = np.flatnonzero(number < 0)
        number[new] = len(last) + np.arange(len(new))
        last, seen_in = np.concatenate([last, spots[new]]), np.concatenate([seen_in, np.full(len(new), k)])
        last[number], seen_in[number] = spots, k
        numbers.append(number)
    tracks = np.full((len(images), len(last), 2), np.nan)
    for k, (number, spots) in enumerate(zip(numbers, images, strict=True)):
        tracks[k, number] = spots
    kept = np.isfinite(tracks[:, :, 0]).mean(axis=0) >= 0.3
    return np.asarray(tracks[:, kept])
