"""Straight edges in a patch of an image, to sub-pixels: the steepest line, fitted through its points."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from cutenv._base.arrays import Array

LEAST_CONTRAST = 18.0
"""Contrast of an edge that counts [grey values]."""
EDGE_SIGMA = 1.2
"""Standard deviation of the Gaussian whose derivative finds edges [px]."""
REACH = 3.0
"""Distance to either side of a known line within which its points are sought [px]."""
_ALONG = 2.0  # of the Gaussian along a line that is known roughly, before its points are sought [px]
SATURATED = 250
"""Grey value from which on the camera may have seen more."""
_GLARE = 0.25  # share of saturated points about an edge from which on it is not trusted
_ALIKE = 1.5  # standard error of a line over that of points with errors of their own; measured on rendered films [1]
_CROOKED = 0.6  # root mean square distance of a line's points from which on it is no line [px]
_BOWED = 1.2  # height of its arc from which on it is none, but the border of a drop, say [px]


class UnusableFrame(Exception):
    """A frame from which no depth can be read; the text is the reason."""


class Line(NamedTuple):
    """Line ``a + b t`` over the other axis of a patch [px], with the standard errors of a fit through an edge's points.

    Attributes
    ----------
    a, b : float
        Height at t = 0 [px], and slope.
    middle : float
        Mean place of its points [px].
    sd, slope_sd : float
        Standard errors of its height there [px], and of its slope.
    spread : float
        Standard deviation of the edge's spread [px].
    """

    a: float
    b: float
    middle: float = 0.0
    sd: float = 0.0
    slope_sd: float = 0.0
    spread: float = 0.0

    def sd_at(self, t: float) -> float:
        """Return the standard error of its height at t [px]."""
        return math.hypot(self.sd, self.slope_sd * (t - self.middle))


class EdgePatch(NamedTuple):
    """Piece of an image in which an edge runs across the columns.

    Attributes
    ----------
    slopes, values : ndarray, shape (rows, n)
        Derivative along the rows' index, positive at the edge, and the grey values.
    first, step : float
        Place of row 0, and distance of two rows [px].
    t : ndarray, shape (n,)
        Places of the columns [px].
    """

    slopes: Array
    values: Array
    first: float
    step: float
    t: Array


def smooth_slopes(values: Array, sigma: float) -> Array:
    """Return the derivative along the rows' index, smoothed by a Gaussian of ``sigma`` samples."""
    return np.asarray(cv2.GaussianBlur(np.gradient(values, axis=0), (1, 0), sigmaX=1e-6, sigmaY=sigma))


def _median(values: Array) -> float:
    """Return the upper median; for some hundred values NumPy's takes ten times as long."""
    return float(np.sort(values)[len(values) // 2])


def _weighted_line(t: Array, s: Array, weight: Array) -> tuple[float, float]:
    """Return slope and height of the line of weighted least squares; NumPy's polyfit takes ten times as long."""
    share = weight / weight.sum()
    middle, height = float(share @ t), float(share @ s)
    from_middle = share * (t - middle)
    slope = float(from_middle @ s) / float(from_middle @ t)
    return slope, height - slope * middle


def line_strengths(patch: EdgePatch, near: Array, tilts: Array) -> tuple[Array, Array]:
    """Return the mean slope along every line a + b t of some tilts b, shape (tilts, places), and the places a."""
    slopes, _, first, step, t = patch
    places: Array = np.asarray(first + step * np.arange(len(slopes)), np.float64)
    rows = np.flatnonzero((places >= near[0]) & (places <= near[1]))
    if rows.size == 0:
        raise UnusableFrame("the blade is not where the strip says")
    shift = np.rint(np.outer(t, tilts) / step).astype(np.int64)
    index = np.clip(rows + shift[:, :, None], 0, len(slopes) - 1)
    index += len(slopes) * np.arange(len(t))[:, None, None]
    return np.take(np.ascontiguousarray(slopes.T), index).mean(axis=0), places[rows]


def strongest_line(patch: EdgePatch, near: Array, tilts: Array) -> Line:
    """Return the line along which the slopes are steepest on the mean."""
    strength, places = line_strengths(patch, near, tilts)
    k, row = np.unravel_index(int(np.argmax(strength)), strength.shape)
    return Line(float(places[row]), float(tilts[k]))


def fitted_line(patch: EdgePatch, near: Line, name: str) -> Line:
    """Fit a line to the steepest points near a known one, to sub-pixels; outliers are left out.

    Parameters
    ----------
    patch : EdgePatch
        Piece of the image.
    near : Line
        Line near which the edge is.
    name : str
        Name of the edge, for the reason.

    Raises
    ------
    UnusableFrame
        If the edge is not seen on its whole length, in glare, of little contrast, or no straight line.
    """
    slopes, values, first, step, t = patch
    span = math.ceil(REACH / step)
    exact = (near.a + near.b * t - first) / step
    kept = (exact >= span + 1) & (exact < len(slopes) - span - 2)
    if kept.sum() < max(6, 0.6 * len(t)):
        raise UnusableFrame(f"{name} is not seen on its whole length")
    t, column = t[kept], np.flatnonzero(kept)
    at = exact[kept, None] + np.arange(-span, span + 1)
    rows = at.astype(np.int64)
    if (values[rows, column[:, None]] >= SATURATED).mean() > _GLARE:
        raise UnusableFrame(f"glare on {name}")
    share = at - rows
    window = (1.0 - share) * slopes[rows, column[:, None]] + share * slopes[rows + 1, column[:, None]]
    window = np.asarray(
        cv2.GaussianBlur(window, (1, 0), sigmaX=1e-6, sigmaY=_ALONG), np.float64
    )  # along the line: it is straight
    peak = np.clip(np.argmax(window, axis=1), 1, 2 * span - 1)
    each = np.arange(len(peak))
    before, top, after = window[each, peak - 1], window[each, peak], window[each, peak + 1]
    bend = before - 2.0 * top + after
    offset = np.where(bend < 0.0, 0.5 * (before - after) / np.where(bend < 0.0, bend, -1.0), 0.0)
    s = first + step * (at[each, peak] + np.clip(offset, -1.0, 1.0))
    good = np.ones(len(t), bool)
    for _ in range(4):
        slope, height = _weighted_line(t[good], s[good], np.maximum(top[good], 1e-9))
        far = s - height - slope * t
        good = np.abs(far) <= max(2.5 * 1.4826 * _median(np.abs(far)), 0.15)
        if good.sum() < max(6, 0.6 * len(t)):
            raise UnusableFrame(f"{name} is not clear")
    scatter = float(np.sqrt(np.mean(far[good] ** 2)))
    bow = (t[good] - t[good].mean()) ** 2
    bow -= bow.mean()
    sagitta = abs(float(bow @ far[good]) / float(bow @ bow)) * 0.25 * float(np.ptp(t[good])) ** 2
    if scatter > _CROOKED * math.hypot(1.0, slope) or sagitta > _BOWED * math.hypot(1.0, slope):
        raise UnusableFrame(f"{name} is not straight")
    rise = np.abs(values[rows[:, -1], column] - values[rows[:, 0], column])
    spread = _median(rise[good]) / max(_median(top[good]), 1e-9) / math.sqrt(2.0 * math.pi)
    if _median(rise[good]) < LEAST_CONTRAST:
        raise UnusableFrame(f"{name} has too little contrast")
    # Neighbours are smoothed together, and share the tissue's texture.
    sd = max(_ALIKE * scatter * math.sqrt(2.0 * math.sqrt(math.pi) * _ALONG / good.sum()), 0.01)
    middle, extent = float(t[good].mean()), float(t[good].std())
    return Line(float(height), float(slope), middle, sd, sd / extent, spread)
