"""A blade with a black strip in one image: the strip, the blade's sides and the tissue's line on it, to sub-pixels.

All lines are found in a patch of the image that is resampled along the blade, free of the lens's distortion, so that
they are straight there. Nothing is guessed: what cannot be measured raises :class:`UnusableFrame` with the reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.vision.cameras import GreyImage

Chart = Callable[[Array], Array]
"""Map of points, shape (n, 2), between pixels and a chart of the scene in which straight lines are straight."""

_COARSE = 400  # width of the image in which the strip is looked for first [px]
_STEP = 0.5  # of the patch along the blade [px]
_SIGMA = 1.2  # of the Gaussian whose derivative finds edges [px]
_ALONG = 2.0  # of the Gaussian along a line that is known roughly, before its points are sought [px]
_LEAST_CONTRAST = 18.0  # of an edge that counts [grey values]
_SATURATED = 250
_GLARE = 0.25  # share of saturated points about an edge from which on it is not trusted
_WIDEST_EDGE = 2.6  # standard deviation of an edge's spread from which on a frame is blurred [px]
_CROOKED = 0.6  # root mean square distance of a line's points from which on it is no line [px]
_RIVAL = 0.6  # contrast of a second strip, relative, from which on there are two
_FIRST = 0.5  # strength of a line, relative to the strongest, that can be the surface
_REACH = 3.0  # to either side of a known line within which its points are sought [px]


class UnusableFrame(Exception):
    """A frame from which no depth can be read; the text is the reason."""


@dataclass(frozen=True, kw_only=True)
class MarkedBlade:
    """Blade with a black strip across it.

    Parameters
    ----------
    total : float
        Length from the strip's centre to the blade's end [m]; the thesis has 4.25 cm.
    strip : float
        Length of the strip along the blade [m].
    width : float
        Width of the blade, across which the strip goes [m].
    """

    total: float = 0.0425
    strip: float = 0.004
    width: float = 0.008

    def __post_init__(self) -> None:
        in_range("total", self.total, 0.005, 0.2, "m", "4.25 cm is 0.0425.")
        in_range("strip", self.strip, 0.0005, 0.5 * self.total, "m", "4 mm is 0.004.")
        in_range("width", self.width, 0.001, 0.05, "m", "8 mm is 0.008.")


class Line(NamedTuple):
    """Line ``a + b t`` over the other axis of a patch [px], standard error of ``a``, and the edge's spread [px]."""

    a: float
    b: float
    sd: float
    spread: float


class BladeInView(NamedTuple):
    """View of the blade in one image, in its chart.

    Attributes
    ----------
    strip, surface : ndarray, shape (2,)
        Centre of the strip, and the point at which the blade's middle enters the tissue.
    strip_ends : ndarray, shape (2, 2)
        Upper and lower end of the strip on the blade's middle.
    strip_covariance, surface_covariance : ndarray, shape (2, 2)
        Covariances of the two points.
    surface_line : ndarray, shape (2, 2)
        Ends of the surface's line at the blade's left and right side.
    """

    strip: Array
    surface: Array
    strip_ends: Array
    strip_covariance: Array
    surface_covariance: Array
    surface_line: Array


class _Patch(NamedTuple):
    """Piece of the image along the blade: rows every `_STEP` px from ``first`` [px], columns 1 px apart, 0 amid."""

    values: Array
    first: float
    half: int
    origin: Array  # in the chart
    down: Array  # step of 1 px along the blade, in the chart
    right: Array

    def at(self, s: float, t: float) -> Array:
        """Return the place in the chart of a point s px below and t px right of the origin."""
        return np.asarray(self.origin + s * self.down + t * self.right)


def find_strip(image: GreyImage, blade: MarkedBlade) -> tuple[Array, Array, float]:
    """Find the strip: its centre, shape (2,), direction down the blade, shape (2,), and its width across [px].

    Raises
    ------
    UnusableFrame
        If there is no strip, or more than one.
    """
    coarse = max(1, round(image.shape[1] / _COARSE))
    small = cv2.resize(image, (image.shape[1] // coarse, image.shape[0] // coarse), interpolation=cv2.INTER_AREA)
    smooth: GreyImage = np.asarray(cv2.GaussianBlur(small, (0, 0), 1.2), np.uint8)
    dark, middle = (float(each) for each in np.percentile(smooth, [0.2, 50.0]))
    found: list[tuple[float, Array, Array, float]] = []
    for level in np.linspace(dark + 12.0, max(middle, dark + 24.0), 4):
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
    """Return contrast, centre, direction and width of a dark contour if it can be the strip."""
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
        if min(quick[1:]) < quick[0] + 1.5 * _LEAST_CONTRAST:
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
        if contrast > 1.5 * _LEAST_CONTRAST and below.mean() < 2.5 * above.mean() < 6.0 * below.mean():
            made.append((contrast, centre, down, float(across)))
    return made


def _grey(image: GreyImage, x: float, y: float) -> float:
    """Return the grey value at a point; -inf outside."""
    u, v = round(x), round(y)
    return float(image[v, u]) if 0 <= v < image.shape[0] and 0 <= u < image.shape[1] else -math.inf


def _sampled(image: GreyImage, points: Array) -> Array:
    """Return grey values at points, shape (..., 2); none if one is outside."""
    u, v = np.rint(points.T).astype(int)
    if u.min() < 0 or v.min() < 0 or u.max() >= image.shape[1] or v.max() >= image.shape[0]:
        return np.empty(0)
    return np.asarray(image[v, u], np.float64)


def measure_view(image: GreyImage, blade: MarkedBlade, to_chart: Chart, to_pixels: Chart) -> BladeInView:
    """Measure strip and surface in one image.

    Parameters
    ----------
    image : ndarray of uint8, shape (height, width)
        Grey values.
    blade : MarkedBlade
        Blade that it shows.
    to_chart, to_pixels : callable
        Maps from pixels to the chart, and back.

    Raises
    ------
    UnusableFrame
        If the strip is hidden or there are two, an edge is blurred or in glare, or no single straight line is the
        surface.
    """
    centre, down, across = find_strip(image, blade)
    ends = to_chart(np.stack([centre, centre + down, centre + np.array([down[1], -down[0]])]))
    origin, down, right = ends[0], ends[1] - ends[0], ends[2] - ends[0]
    per_m = across / blade.width  # [px/m]
    # First with the strip's rough direction, then with that of the sides that were found.
    patch = _cut_out(image, to_pixels, origin, down, right, blade, per_m, wide=2.4)
    surface = _surface(patch, blade, per_m)
    left, right_side = _sides(patch, blade, per_m, surface, reach=0.5 * per_m * blade.width)
    a, b, per_m = 0.5 * (left.a + right_side.a), 0.5 * (left.b + right_side.b), (right_side.a - left.a) / blade.width
    if per_m * blade.width < 6.0:
        raise UnusableFrame("the blade is not as wide as its strip")
    origin, down = patch.at(0.0, a), patch.at(1.0, a + b) - patch.at(0.0, a)
    down = down / math.hypot(1.0, b)
    right = np.array([[0.0, 1.0], [-1.0, 0.0]]) @ down * math.copysign(1.0, down[1])
    right *= math.copysign(1.0, float(right @ patch.right))
    patch = _cut_out(image, to_pixels, origin, down, right, blade, per_m, wide=1.6)
    upper, lower = _strip_lines(patch, blade, per_m)
    if max(upper.spread, lower.spread) > _WIDEST_EDGE:
        raise UnusableFrame("the strip is blurred")
    surface = _surface(patch, blade, per_m, start=lower.a)
    left, right_side = _sides(patch, blade, per_m, surface, reach=_REACH)
    return _in_chart(patch, upper, lower, surface, left, right_side)


def _in_chart(patch: _Patch, upper: Line, lower: Line, surface: Line, left: Line, right: Line) -> BladeInView:
    a, b = 0.5 * (left.a + right.a), 0.5 * (left.b + right.b)
    aside = 0.5 * math.hypot(left.sd, right.sd)

    def on(line: Line, side: tuple[float, float]) -> Array:
        s = (line.a + line.b * side[0]) / (1.0 - line.b * side[1])
        return patch.at(s, side[0] + side[1] * s)

    def covariance(along: float, slope: float) -> Array:
        axes = np.stack([patch.down, patch.right], axis=1)
        spread = np.array([[along**2 + (slope * aside) ** 2, slope * aside**2], [slope * aside**2, aside**2]])
        return np.asarray(axes @ spread @ axes.T)

    ends = np.stack([on(line, (a, b)) for line in (upper, lower)])
    return BladeInView(
        strip=ends.mean(axis=0),
        surface=on(surface, (a, b)),
        strip_ends=ends,
        strip_covariance=covariance(0.5 * math.hypot(upper.sd, lower.sd), 0.5 * (upper.b + lower.b)),
        surface_covariance=covariance(surface.sd, surface.b),
        surface_line=np.stack([on(surface, (side.a, side.b)) for side in (left, right)]),
    )


def _cut_out(
    image: GreyImage, to_pixels: Chart, origin: Array, down: Array, right: Array, blade: MarkedBlade, per_m: float, *,
    wide: float,
) -> _Patch:  # fmt: skip
    """Resample the image along the blade, to 15 % beyond its end."""
    first, last = -2.0 * blade.strip * per_m, (1.15 * blade.total + 0.002) * per_m
    half = math.ceil(0.5 * wide * blade.width * per_m)
    s, t = np.arange(first, last, _STEP), np.arange(-half, half + 1.0)
    points = origin + s[:, None, None] * down + t[None, :, None] * right
    at = to_pixels(points.reshape(-1, 2)).reshape(len(s), len(t), 2).astype(np.float32)
    values = cv2.remap(image.astype(np.float32), at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    inner = at[:, np.abs(t) <= 0.5 * blade.width * per_m + _REACH]
    seen = (inner >= 0) & (inner <= (image.shape[1] - 1, image.shape[0] - 1))
    inside: NDArray[np.bool_] = np.asarray(seen.all(axis=(1, 2)))
    if not inside[s <= 3.0 * blade.strip * per_m].all():
        raise UnusableFrame("the strip is at the border of the image")
    rows = slice(None) if inside.all() else slice(int(np.argmin(inside)))
    return _Patch(np.asarray(values, np.float64)[rows], float(s[0]), half, origin, down, right)


def _slopes(values: Array, sigma: float) -> Array:
    """Return the derivative along the rows' index, smoothed by a Gaussian of ``sigma`` samples."""
    return np.asarray(cv2.GaussianBlur(np.gradient(values, axis=0), (1, 0), sigmaX=1e-6, sigmaY=sigma))


def _strip_lines(patch: _Patch, blade: MarkedBlade, per_m: float) -> tuple[Line, Line]:
    half, columns = 0.5 * blade.strip * per_m, _inner(patch, blade, per_m)
    slopes = _slopes(patch.values[:, columns], _SIGMA / _STEP) / _STEP
    found = []
    for sign in (-1.0, 1.0):
        name = f"the strip's {'upper' if sign < 0 else 'lower'} edge"
        near = sign * half + np.array([-0.6, 0.6]) * half
        t = _aside(patch, columns)
        a, b = _strongest(sign * slopes, patch.first, t, near, np.linspace(-0.6, 0.6, 25), step=_STEP)
        found.append(_fitted(sign * slopes, patch, columns, a, b, name))
    return found[0], found[1]


def _surface(patch: _Patch, blade: MarkedBlade, per_m: float, start: float | None = None) -> Line:
    """Return the line at which the bright blade ends and darker tissue begins."""
    columns = _inner(patch, blade, per_m)
    slopes = -_slopes(patch.values[:, columns], _SIGMA / _STEP) / _STEP
    low = (0.5 * blade.strip * per_m if start is None else start) + 4.0
    last = patch.first + _STEP * (len(slopes) - 1) - 2.0
    if last - low < 8.0:
        raise UnusableFrame("the blade leaves the image above the tissue")
    strength, places, tilts = _line_strengths(
        slopes, patch.first, _aside(patch, columns), np.array([low, last]), np.linspace(-2.0, 2.0, 41), step=_STEP
    )
    best = strength.max(axis=0)
    if best.max() < 0.3 * _LEAST_CONTRAST / _SIGMA / 2.5:
        raise UnusableFrame("no line of the tissue's surface is seen on the blade")
    # Tissue below has lines of its own, steel above has none: the first line is the surface.
    first = int(np.argmax(best >= _FIRST * best.max()))
    row = first + int(np.argmax(best[first : first + round(6.0 / _STEP)]))
    a, b = float(places[row]), float(tilts[int(np.argmax(strength[:, row]))])
    return Line(a, b, 0.0, 0.0) if start is None else _fitted(slopes, patch, columns, a, b, "the surface's line")


def _sides(patch: _Patch, blade: MarkedBlade, per_m: float, surface: Line, *, reach: float) -> tuple[Line, Line]:
    """Return the blade's left and right side, as lines over the rows."""
    s: Array = np.asarray(patch.first + _STEP * np.arange(len(patch.values)), np.float64)
    half = 0.5 * blade.width * per_m
    end = surface.a - abs(surface.b) * half - 2.0
    rows = np.flatnonzero((s > -1.6 * blade.strip * per_m) & (s < end))[::2]
    if len(rows) < 12:
        raise UnusableFrame("too little of the blade is seen")
    turned = patch.values[rows].T
    slopes = np.abs(_slopes(turned, _SIGMA))
    found = []
    for sign in (-1.0, 1.0):
        near = sign * half + np.array([-1.0, 1.0]) * min(reach, 0.5 * half)
        tilts = np.linspace(-0.3, 0.3, 25) * min(1.0, reach / 6.0)
        a, b = _strongest(slopes, -patch.half, s[rows], near, tilts, step=1.0)
        found.append(_points_fitted(slopes, -patch.half, 1.0, s[rows], a, b, turned, "the blade's side"))
    return found[0], found[1]


def _aside(patch: _Patch, columns: NDArray[np.int64]) -> Array:
    """Return how far right of the middle some columns are [px]."""
    return np.asarray(columns - patch.half, np.float64)


def _inner(patch: _Patch, blade: MarkedBlade, per_m: float) -> NDArray[np.int64]:
    """Return the columns well inside the blade."""
    t = np.arange(-patch.half, patch.half + 1)
    return np.flatnonzero(np.abs(t) <= 0.5 * blade.width * per_m - 2.5)


def _weighted_line(t: Array, s: Array, weight: Array) -> tuple[float, float]:
    """Return slope and height of the line of weighted least squares; NumPy's polyfit takes ten times as long."""
    share = weight / weight.sum()
    middle, height = float(share @ t), float(share @ s)
    from_middle = share * (t - middle)
    slope = float(from_middle @ s) / float(from_middle @ t)
    return slope, height - slope * middle


def _line_strengths(
    slopes: Array, first: float, t: Array, near: Array, tilts: Array, *, step: float
) -> tuple[Array, Array, Array]:
    """Return the mean slope along every line a + b t, shape (tilts, places), the places a and the tilts b."""
    places: Array = np.asarray(first + step * np.arange(len(slopes)), np.float64)
    rows = np.flatnonzero((places >= near[0]) & (places <= near[1]))
    if rows.size == 0:
        raise UnusableFrame("the blade is not where the strip says")
    shift = np.rint(np.outer(tilts, t) / step).astype(np.int64)
    index = np.clip(rows[None, :, None] + shift[:, None, :], 0, len(slopes) - 1)
    return np.asarray(slopes[index, np.arange(len(t))].mean(axis=2)), places[rows], tilts


def _strongest(slopes: Array, first: float, t: Array, near: Array, tilts: Array, *, step: float) -> tuple[float, float]:
    """Return the line a + b t along which the slopes are steepest on the mean."""
    strength, places, tilts = _line_strengths(slopes, first, t, near, tilts, step=step)
    k, row = np.unravel_index(int(np.argmax(strength)), strength.shape)
    return float(places[row]), float(tilts[k])


def _fitted(slopes: Array, patch: _Patch, columns: NDArray[np.int64], a: float, b: float, name: str) -> Line:
    values = patch.values[:, columns]
    return _points_fitted(slopes, patch.first, _STEP, _aside(patch, columns), a, b, values, name)


def _points_fitted(
    slopes: Array, first: float, step: float, t: Array, a: float, b: float, values: Array, name: str
) -> Line:
    """Fit a line to the steepest points near a known one, to sub-pixels; outliers are left out."""
    span = math.ceil(_REACH / step)
    exact = (a + b * t - first) / step
    kept = (exact >= span + 1) & (exact < len(slopes) - span - 2)
    if kept.sum() < max(6, 0.6 * len(t)):
        raise UnusableFrame(f"{name} is not seen on its whole length")
    t, column = t[kept], np.flatnonzero(kept)
    at = exact[kept, None] + np.arange(-span, span + 1)
    rows = at.astype(np.int64)
    if (values[rows, column[:, None]] >= _SATURATED).mean() > _GLARE:
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
        good = np.abs(far) <= max(2.5 * 1.4826 * float(np.median(np.abs(far))), 0.15)
        if good.sum() < max(6, 0.6 * len(t)):
            raise UnusableFrame(f"{name} is not clear")
    scatter = float(np.sqrt(np.mean(far[good] ** 2)))
    if scatter > _CROOKED * math.hypot(1.0, slope):
        raise UnusableFrame(f"{name} is not straight")
    rise = np.abs(values[rows[:, -1], column] - values[rows[:, 0], column])
    spread = float(np.median(rise[good])) / max(float(np.median(top[good])), 1e-9) / math.sqrt(2.0 * math.pi)
    if float(np.median(rise[good])) < _LEAST_CONTRAST:
        raise UnusableFrame(f"{name} has too little contrast")
    sd = scatter * math.sqrt(2.0 * math.sqrt(math.pi) * _ALONG / good.sum())  # neighbours are smoothed together
    return Line(float(height), float(slope), max(sd, 0.01), spread)
