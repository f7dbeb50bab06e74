"""Kalman filter of beads: what each view shows is taken in, or refused where it belongs to another bead."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, Indices
from cutenv.vision.bead_images import groups_of
from cutenv.vision.fluoroscopy import CArmView
from cutenv.vision.projection import project, projection_slope

_JUMP = 12.0  # squared innovation over its variance, beyond which prediction or image is wrong
_OF_A_JUMP = 0.3  # of a shared jump, that a bead's own may differ from it
_AGREE = 1.5  # px: of the views on a shared jump
_PERSISTENCE = 60.0  # a doubtful image is believed when it has come about five times


@dataclass(kw_only=True, eq=False)
class BeadFilter:
    """Kalman filter of every bead: where it rested, moved as the model predicts, and an offset that wanders.

    Parameters
    ----------
    rest, variance : ndarray, shapes (n, 3) and (n, 3, 3)
        Places at rest [m] and covariance of the places [m²].

    Attributes
    ----------
    groups : ndarray of int, shape (n, k)
        Beads that move like each, see `groups_of`.
    predicted : ndarray, shape (n, 3)
        Places that the model predicts for this frame [m].
    offset : ndarray, shape (n, 3)
        Place less that predicted [m].
    refused : ndarray of bool, shape (n,)
        Beads of which a view has refused the image in this frame.
    """

    rest: Array
    variance: Array
    groups: Indices = field(init=False)
    predicted: Array = field(init=False)
    offset: Array = field(init=False)
    refused: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.groups = groups_of(self.rest)
        self.offset = np.zeros_like(self.rest)
        self.begin(self.rest)

    @property
    def place(self) -> Array:
        """Places as they are known now [m], shape (n, 3)."""
        return self.predicted + self.offset

    def begin(self, predicted: Array) -> None:
        """Begin a frame, for which the model predicts these places: no view has shown anything yet."""
        n = len(self.rest)
        self.predicted = predicted
        self._before = self.offset.copy(), self.variance.copy()
        self._ray = np.zeros((n, 3))  # of the view that has shown the bead in this frame
        self._shown = np.zeros(n, bool)
        self._jumped = np.zeros(n, bool)
        self.refused = np.zeros(n, bool)

    def jump(self, rows: NDArray[np.bool_], slope: Array, shift: Array) -> None:
        """Move some beads as their images have moved together.

        Slope, of shape (n, 2 views, 3) [px/m], and shift, (n, 2 views) [px], are those of ``rows``. Where the views
        contradict each other, nothing moves.
        """
        scale = np.linalg.norm(slope, axis=(1, 2))[:, None, None]
        turned = slope.transpose(0, 2, 1)
        moved = np.linalg.solve(turned @ slope + 1e-6 * scale**2 * np.eye(3), turned @ shift[:, :, None])[:, :, 0]
        agree = np.abs((slope @ moved[:, :, None])[:, :, 0] - shift).max(axis=1) < _AGREE
        rows, moved = np.flatnonzero(rows)[agree], moved[agree]
        self.offset[rows] += moved
        unsure = (_OF_A_JUMP * np.hypot.reduce(moved, axis=1)) ** 2
        self.variance[rows] += unsure[:, None, None] * np.eye(3)

    def update(self, view: CArmView, measured: Array, error: Array, crowded: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Take in what one view shows, in undistorted pixels; return which beads it showed.

        An image far from the prediction is a jump of the bead, or another bead. It is refused where another bead is
        near in this view (``crowded``), and where it contradicts the view that has shown the bead in this frame.
        """
        matrix = view.projection
        assert matrix is not None  # a calibration's views have one
        there = np.asarray(np.isfinite(measured).all(axis=1))
        rows = np.flatnonzero(there)
        place = self.place[rows]
        slope = projection_slope(matrix, place)
        left = measured[rows] - project(matrix, place)
        variance, error = self.variance[rows], error[rows]
        square = _square(left, slope, variance, error)
        metres = np.hypot(*left.T) / np.linalg.norm(slope, axis=(1, 2)) * np.sqrt(2.0)
        # The tissue springs back within a frame when the crack runs: then what was known before is worth little, but
        # across the rays of the view that has just shown the bead.
        ray, again = self._ray[rows], self._shown[rows]
        free = np.where(again[:, None, None], ray[:, :, None] * ray[:, None, :], np.eye(3))
        doubted = square > _JUMP
        wider = variance + np.where(doubted, metres**2, 0.0)[:, None, None] * free
        contrary = doubted & again & (_square(left, slope, wider, error) > _JUMP)
        refused = doubted & (crowded[rows] | contrary)
        taken = ~refused
        self.variance[rows[refused]] += (metres[refused] ** 2 / _PERSISTENCE)[:, None, None] * free[refused]
        both = contrary & self._jumped[rows]  # the view before may be wrong as well
        self.undo(rows[both])
        self.variance[rows[both]] += (metres[both] ** 2 / _PERSISTENCE)[:, None, None] * np.eye(3)
        there[rows[refused]] = False
        self.refused[rows[refused]] = True

        own, slope, left, error, variance = rows[taken], slope[taken], left[taken], error[taken], wider[taken]
        turned = slope.transpose(0, 2, 1)
        gain = variance @ turned @ np.linalg.inv(slope @ variance @ turned + error)
        self.offset[own] += np.einsum("nij,nj->ni", gain, left)
        kept = np.eye(3) - gain @ slope
        # Joseph's form stays symmetric and positive.
        self.variance[own] = kept @ variance @ kept.transpose(0, 2, 1) + gain @ error @ gain.transpose(0, 2, 1)
        self._shown[own] = True
        self._jumped[own] |= doubted[taken]
        across = np.cross(slope[:, 0], slope[:, 1])
        self._ray[own] = across / np.linalg.norm(across, axis=1, keepdims=True)
        return there

    def undo(self, rows: NDArray[np.bool_] | Indices) -> None:
        """Take back what this frame has shown of some beads."""
        self.offset[rows], self.variance[rows] = self._before[0][rows], self._before[1][rows]

    def follow(self, seen: NDArray[np.bool_]) -> None:
        """Move what views (``seen``, of shape (views, n)) did not show as the neighbours moved in this frame.

        A bead that one view shows is known across its rays; along them it goes as its neighbours do.
        """
        whole = np.asarray(seen.all(axis=0))
        step = self.offset - self._before[0]
        for one in np.flatnonzero(~whole):
            near = self.groups[one][whole[self.groups[one]]]
            if len(near) < 2:
                continue
            theirs = np.median(step[near], axis=0)
            scatter = float(np.mean((step[near] - theirs) ** 2))
            if seen[:, one].any():
                along = np.outer(self._ray[one], self._ray[one])
                self.offset[one] += along @ (theirs - step[one])
            else:
                along = np.eye(3)
                self.offset[one] += theirs - step[one]
            self.variance[one] += scatter * along


def _square(left: Array, slope: Array, variance: Array, error: Array) -> Array:
    spread = slope @ variance @ slope.transpose(0, 2, 1) + error
    return np.asarray(np.einsum("ni,nij,nj->n", left, np.linalg.inv(spread), left))
