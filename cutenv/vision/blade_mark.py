"""A blade's mark in an image, and straight edges.

The mark is a black strip across the blade, or an ArUco tag on it. Edges are found to sub-pixels.
"""

from __future__ import annotations

import contextlib
import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.vision.cameras import GreyImage

LEAST_CONTRAST = 18.0  # contrast of an edge that counts [grey values]
EDGE_SIGMA = 1.2  # standard deviation of the Gaussian whose derivative finds edges [px]
REACH = 3.0  # distance to either side of a known line within which its points are sought [px]
_ALONG = 2.0  # of the Gaussian along a line that is known roughly, before its points are sought [px]
SATURATED = 250  # grey value from which on the camera may have seen more
_GLARE = 0.25  # share of saturated points about an edge from which on it is not trusted
_ERROR_RATIO = (
    1.5  # standard error of a line over that of points with errors of their own; measured on rendered films [1]
)
_CROOKED = 0.6  # root mean square distance of a line's points from which on it is no line [px]
_BOWED = 1.2  # height of its arc from which on it is none, but the border of a drop, say [px]


class UnusableFrame(Exception):
    """A frame from which no depth can be read.

    The text is the reason.
    """


class Line(NamedTuple):
    """Line ``a + b t`` fitted to an edge [px]."""

    a: float  # height at t = 0 [px], and slope
    b: float
    middle: float = 0.0  # mean place of its points [px]
    sd: float = 0.0  # standard errors of its height there [px], and of its slope
    slope_sd: float = 0.0
    spread: float = 0.0  # standard deviation of the edge's spread [px]

    def sd_at(self, t: float) -> float:
        """Return the standard error of its height at t [px]."""
        return math.hypot(self.sd, self.slope_sd * (t - self.middle))


class EdgePatch(NamedTuple):
    """Piece of an image with an edge across its columns."""

    slopes: Array  # derivative along the rows' index, positive at the edge, and the grey values, shape (rows, n)
    values: Array
    first: float  # place of row 0, and distance of two rows [px]
    step: float
    t: Array  # places of the columns [px], shape (n,)


def smooth_slopes(values: Array, sigma: float) -> Array:
    """Return the derivative along rows, Gaussian-smoothed by ``sigma`` samples."""
    return np.asarray(cv2.GaussianBlur(np.gradient(values, axis=0), (1, 0), sigmaX=1e-6, sigmaY=sigma))


def _median(values: Array) -> float:
    """Return the upper median, ten times as fast as NumPy's."""
    return float(np.sort(values)[len(values) // 2])


def _weighted_line(t: Array, s: Array, weight: Array) -> tuple[float, float]:
    """Return slope and height by weighted least squares, faster than polyfit."""
    share = weight / weight.sum()
    middle, height = float(share @ t), float(share @ s)
    from_middle = share * (t - middle)
    slope = float(from_middle @ s) / float(from_middle @ t)
    return slope, height - slope * middle


def line_strengths(patch: EdgePatch, near: Array, tilts: Array) -> tuple[Array, Array]:
    """Return mean slopes along lines a + b t, (tilts, places), and places."""
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
    """Return the line with the steepest mean slope."""
    strength, places = line_strengths(patch, near, tilts)
    k, row = np.unravel_index(int(np.argmax(strength)), strength.shape)
    return Line(float(places[row]), float(tilts[k]))


def fitted_line(patch: EdgePatch, near: Line, name: str) -> Line:
    """Fit a line to an edge near a known one, without outliers.

    ``name`` is that of the edge, for the reason: raises UnusableFrame if it is not seen on its whole length, in glare,
    of little contrast, or no straight line.
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
    sd = max(_ERROR_RATIO * scatter * math.sqrt(2.0 * math.sqrt(math.pi) * _ALONG / good.sum()), 0.01)
    middle, extent = float(t[good].mean()), float(t[good].std())
    return Line(float(height), float(slope), middle, sd, sd / extent, spread)


_COARSE = 400  # width of the image in which the strip is looked for first [px]
_RIVAL = 0.6  # contrast of a second strip, relative, from which on there are two


TAGS = 50  # number of tags of the dictionary, OpenCV's ``DICT_4X4_50``


@dataclass(frozen=True, kw_only=True)
class MarkedBlade:
    """Blade with a transverse black strip or an ArUco tag."""

    total: float = 0.0425  # length from the mark's centre to the blade's end [m]; the thesis has 4.25 cm
    strip: float = 0.004  # length of the strip along the blade, or side of the tag with its black border [m]
    width: float = 0.008  # width of the blade, across which the strip goes [m]
    # number of the tag, of OpenCV's dictionary ``DICT_4X4_50``; its upper side is toward the holder. None: a strip
    tag: int | None = None

    def __post_init__(self) -> None:
        in_range("total", self.total, 0.005, 0.2, "m", "4.25 cm is 0.0425.")
        in_range("strip", self.strip, 0.0005, 0.5 * self.total, "m", "4 mm is 0.004.")
        in_range("width", self.width, 0.001, 0.05, "m", "8 mm is 0.008.")
        if self.tag is not None:
            in_range("tag", self.tag, 0, TAGS - 1, "1", f"A tag's number is 0 to {TAGS - 1}.")
            if not 0.25 * self.width <= self.strip <= 0.9 * self.width:
                raise ValueError(
                    f"strip = {self.strip:g} m is the side of a tag on a blade {self.width:g} m wide: it must be 0.25 "
                    "to 0.9 of that, so that bright steel is seen on both sides of it."
                )

    @property
    def mark(self) -> str:
        """Name of the mark: strip or tag."""
        return "strip" if self.tag is None else "tag"

    @property
    def mark_width(self) -> float:
        """Extent of the mark across the blade [m]."""
        return self.width if self.tag is None else self.strip


class Neighbourhood(NamedTuple):
    """Square of an image.

    Its middle, shape (2,), and how far it reaches to every side [px].
    """

    middle: Array
    reach: float


def find_mark(image: GreyImage, blade: MarkedBlade, near: Neighbourhood | None = None) -> tuple[Array, Array, float]:
    """Find the mark's centre, direction and blade width [px].

    Centre and direction, which points down the blade, have shape (2,). The mark is looked for in the neighbourhood
    first, where it was in the frame before, say, and then in the whole image.

    Raises UnusableFrame if there is none, or more than one.
    """
    find = _find_strip if blade.tag is None else _find_tag
    if near is not None:
        left, top = np.maximum(np.rint(near.middle - near.reach), 0).astype(int)
        right, bottom = np.maximum(np.rint(near.middle + near.reach), 1).astype(int)
        with contextlib.suppress(UnusableFrame):
            centre, down, across = find(image[top:bottom, left:right], blade)
            return centre + np.array([left, top]), down, across
    return find(image, blade)


def _tags(image: GreyImage, number: int | None, enlarged: int) -> list[Array]:
    """Return corners, shape (4, 2) [px], of every tag of this number.

    Clockwise from the upper left corner.
    """
    if enlarged > 1:
        image = np.asarray(cv2.resize(image, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_CUBIC), np.uint8)
    corners, numbers, _ = _tag_detector().detectMarkers(image)
    found = zip(corners, () if numbers is None else numbers.ravel(), strict=False)
    return [(np.asarray(each, np.float64).reshape(4, 2) + 0.5) / enlarged - 0.5 for each, n in found if n == number]


@functools.cache
def _tag_detector() -> cv2.aruco.ArucoDetector:
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))


def _find_tag(image: GreyImage, blade: MarkedBlade) -> tuple[Array, Array, float]:
    seen = _tags(image, blade.tag, 1) or _tags(image, blade.tag, 2)  # some are too small for OpenCV as they are
    if len(seen) != 1:
        raise UnusableFrame("two tags are seen" if seen else "the tag is not seen")
    upper_left, upper_right, lower_right, lower_left = seen[0]
    down = 0.5 * (lower_left + lower_right - upper_left - upper_right)
    across = 0.5 * (upper_right + lower_right - upper_left - lower_left)
    centre = 0.25 * (upper_left + upper_right + lower_right + lower_left)
    return centre, down / np.hypot(*down), float(np.hypot(*across)) * blade.width / blade.strip


def _find_strip(image: GreyImage, blade: MarkedBlade) -> tuple[Array, Array, float]:
    coarse = max(1, round(image.shape[1] / _COARSE))
    small = cv2.resize(image, (image.shape[1] // coarse, image.shape[0] // coarse), interpolation=cv2.INTER_AREA)
    smooth: GreyImage = np.asarray(cv2.GaussianBlur(small, (0, 0), 1.2), np.uint8)
    darker = np.cumsum(np.bincount(smooth.ravel(), minlength=256)) / smooth.size
    dark, middle = (float(np.searchsorted(darker, share)) for share in (0.002, 0.5))
    found: list[tuple[float, Array, Array, float]] = []
    for level in (dark + 6.0, *np.linspace(dark + 12.0, max(middle, dark + 24.0), 4)[:3]):
        mask = (smooth < level).astype(np.uint8)
        contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        for contour in contours:
            if 12 <= len(contour) <= 0.25 * sum(smooth.shape) and cv2.contourArea(contour) >= 10.0:
                found += _candidates(smooth, contour, blade)
    if not found:
        raise UnusableFrame("the strip is not seen")
    found.sort(key=lambda each: -each[0])
    contrast, centre, down, width = found[0]
    if any(c > _RIVAL * contrast and np.hypot(*(other - centre)) > 1.5 * width for c, other, _, _ in found[1:]):
        raise UnusableFrame("two strips are seen")
    return coarse * centre + 0.5 * (coarse - 1), down, coarse * width


def _candidates(
    smooth: GreyImage, contour: NDArray[np.int32], blade: MarkedBlade
) -> list[tuple[float, Array, Array, float]]:
    """Return contrast, centre, direction and width of possible strips."""
    (x, y), sides, turn = cv2.minAreaRect(contour)
    if min(sides) < 3.0 or cv2.contourArea(contour) < 0.6 * sides[0] * sides[1]:
        return []
    cosine, sine = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    made = []
    for dx, dy, along, across in ((cosine, sine, *sides), (-sine, cosine, sides[1], sides[0])):
        if dy < 0.0:
            dx, dy = -dx, -dy
        if not 0.5 < (along / across) / (blade.strip / blade.width) < 2.0 or dy < 0.2:
            continue
        far = 0.5 * along + 4.0
        quick = [_grey(smooth, x + k * far * dx, y + k * far * dy) for k in (0, -1, 1)]  # most are dark tissue
        if min(quick[1:]) < quick[0] + 1.5 * LEAST_CONTRAST:
            continue
        centre, down = np.array([x, y]), np.array([dx, dy])
        right = np.array([down[1], -down[0]])
        ahead = (0.5 * along + 3.0 + np.array([0.0, 2.0]))[:, None, None]
        aside = (across * np.array([-0.25, 0.0, 0.25]))[None, :, None]
        below, above, within = (
            _sampled(smooth, centre + sign * ahead * down + aside * right) for sign in (1.0, -1.0, 0.0)
        )
        if min(below.size, above.size, within.size) == 0:
            continue
        contrast = float(min(below.min(), above.min()) - within.mean())
        if contrast > 1.5 * LEAST_CONTRAST and below.mean() < 2.5 * above.mean() < 6.0 * below.mean():
            made.append((contrast, centre, down, float(across)))
    return made


def _grey(image: GreyImage, x: float, y: float) -> float:
    """Return the grey value at a point; -inf outside."""
    u, v = round(x), round(y)
    return float(image[v, u]) if 0 <= v < image.shape[0] and 0 <= u < image.shape[1] else -math.inf


def _sampled(image: GreyImage, points: Array) -> Array:
    """Return grey values at points, shape (..., 2); empty if outside."""
    u, v = np.rint(points.T).astype(int)
    if u.min() < 0 or v.min() < 0 or u.max() >= image.shape[1] or v.max() >= image.shape[0]:
        return np.empty(0)
    return np.asarray(image[v, u], np.float64)
