"""A plate with a square grid of holes or dots in an X-ray image: every hole found, and given its row and column."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from cutenv._base.arrays import Array, Indices
from cutenv.vision.spots import Spots, checked_image, locate_spots

LEAST_HOLES = 60
"""Holes without which a distortion is not fitted."""
_NEAR = 0.3  # of the spacing: how far a hole may lie from where its neighbour expects it
_FORGET = 0.5  # how much of a step from hole to hole is taken on to the next


class CalibrationRefusedError(ValueError):
    """A calibration image cannot be used.

    Parameters
    ----------
    message : str
        What is wrong, and the cure.
    picture : ndarray of uint8, shape (rows, columns, 3)
        The image in colours: holes that were used green, those left out red, residuals as yellow lines, ten times
        their length.
    """

    def __init__(self, message: str, picture: NDArray[np.uint8]) -> None:
        super().__init__(message)
        self.picture = picture


@dataclass(frozen=True, kw_only=True, eq=False)
class GridHoles:
    """Holes of a calibration grid.

    Parameters
    ----------
    place : ndarray, shape (n, 2)
        Column and row of each hole in the image [px].
    index : ndarray of int64, shape (n, 2)
        Its column and row in the grid, counted from the hole nearest the middle.
    covariance : ndarray, shape (n, 2, 2)
        Covariance of the places [px²].
    left_out : ndarray, shape (m, 2)
        Places of spots that fit nowhere into the grid [px].
    """

    place: Array
    index: Indices
    covariance: Array
    left_out: Array

    def __len__(self) -> int:
        return len(self.place)


def locate_grid(image: ArrayLike, diameter: float, *, dark: bool | None = None) -> GridHoles:
    """Find the holes of a calibration grid.

    Parameters
    ----------
    image : array_like, shape (rows, columns)
        Image of the grid, its rows within 40 degrees of the image's.
    diameter : float
        Diameter of a hole in the image [px].
    dark : bool, optional
        Whether the spots are darker than the plate. By default what gives more holes.

    Raises
    ------
    CalibrationRefusedError
        If fewer than `LEAST_HOLES` lie on a grid, or they cover less than a quarter of the image.
    ValueError
        If the image is none.
    """
    grey = checked_image(image, "the image of the grid")
    found = [_indexed(locate_spots(grey, diameter, dark=one)) for one in ((True, False) if dark is None else (dark,))]
    holes = max(found, key=len)
    if len(holes) < LEAST_HOLES:
        seen = len(holes) + len(holes.left_out)
        raise CalibrationRefusedError(
            f"{seen} spots of about {diameter:g} px were found, and {len(holes)} of them lie on a square grid; "
            f"{LEAST_HOLES} are needed. Is the diameter that of a hole in this image, and is the plate all in view?",
            residual_picture(grey, holes),
        )
    covered = float(np.prod(np.ptp(holes.place, axis=0)) / (grey.shape[0] * grey.shape[1]))
    if covered < 0.25:
        raise CalibrationRefusedError(
            f"the grid covers {covered:.0%} of the image; beyond it the distortion would be guessed. "
            "Use a plate that fills the view.",
            residual_picture(grey, holes),
        )
    return holes


def _indexed(spots: Spots) -> GridHoles:
    """Give every spot its column and row, from hole to hole; each step is expected where the last one was."""
    place = spots.place
    index = np.zeros((len(place), 2), np.int64)
    reached = np.zeros(len(place), bool)
    if len(place) >= 9:
        tree = cKDTree(place)
        spacing = float(np.median(np.asarray(tree.query(place, k=2)[0])[:, 1]))
        middle = np.median(place, axis=0)
        for start in np.argsort(np.hypot(*(place - middle).T))[:20]:
            steps = _first_steps(place, tree, int(start), spacing)
            if steps is None:
                continue
            tried_index, tried = _spread(place, tree, int(start), steps)
            if tried.sum() > reached.sum():
                index, reached = tried_index, tried
            if reached.mean() > 0.5:
                break
    return GridHoles(
        place=place[reached], index=index[reached], covariance=spots.covariance[reached], left_out=place[~reached]
    )


def _first_steps(place: Array, tree: cKDTree, start: int, spacing: float) -> Array | None:
    """Return the steps to the next column and row, shape (2, 2), or None where a neighbour is missing."""
    near = [other for other in tree.query_ball_point(place[start], 1.3 * spacing) if other != start]
    steps = place[near] - place[start]
    if len(steps) < 2:
        return None
    chosen = np.stack([steps[np.argmax(steps @ axis / np.hypot(*steps.T))] for axis in np.eye(2)])
    lengths = np.hypot(*chosen.T)
    across = abs(float(np.linalg.det(chosen))) / float(lengths.prod())
    return chosen if across > 0.8 and chosen[0, 0] > 0.0 and chosen[1, 1] > 0.0 else None


def _spread(place: Array, tree: cKDTree, start: int, steps: Array) -> tuple[Indices, NDArray[np.bool_]]:
    index = np.zeros((len(place), 2), np.int64)
    reached = np.zeros(len(place), bool)
    reached[start] = True
    taken = {(0, 0)}
    waiting = deque([(start, steps)])
    while waiting:
        hole, own = waiting.popleft()
        for axis in (0, 1):
            for sign in (1, -1):
                step = sign * own[axis]
                distance, other = tree.query(place[hole] + step)
                cell = index[hole].copy()
                cell[axis] += sign
                key = (int(cell[0]), int(cell[1]))
                if reached[other] or key in taken or distance > _NEAR * float(np.hypot(*step)):
                    continue
                reached[other] = True
                taken.add(key)
                index[other] = cell
                learnt = own.copy()
                learnt[axis] += _FORGET * (sign * (place[other] - place[hole]) - own[axis])
                waiting.append((int(other), learnt))
    return index, reached


def residual_picture(image: Array, holes: GridHoles, residual: Array | None = None) -> NDArray[np.uint8]:
    """Draw the holes over the image, as `CalibrationRefusedError` describes it.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Grey image.
    holes : GridHoles
        What was found in it.
    residual : ndarray, shape (n, 2), optional
        Residual of each hole [px].
    """
    low, high = float(image.min()), float(image.max())
    grey = ((image - low) * (160.0 / max(high - low, 1e-9))).astype(np.uint8)
    picture = np.repeat(grey[:, :, None], 3, axis=2)

    def paint(points: Array, colour: tuple[int, int, int], radius: int) -> None:
        column, row = np.round(points).astype(int).T if len(points) else np.zeros((2, 0), int)
        for across in range(-radius, radius + 1):
            for down in range(-radius, radius + 1):
                u, v = column + across, row + down
                inside = (u >= 0) & (u < image.shape[1]) & (v >= 0) & (v < image.shape[0])
                picture[v[inside], u[inside]] = colour

    paint(holes.place, (0, 200, 0), 1)
    paint(holes.left_out, (230, 0, 0), 1)
    if residual is not None and len(residual):
        for part in np.linspace(0.0, 10.0, 41):
            paint(holes.place + part * residual, (255, 220, 0), 0)
    return picture
