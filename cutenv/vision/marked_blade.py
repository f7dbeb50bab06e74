"""A marked blade in an image.

Mark, sides and tissue's line, to sub-pixels; and the depth of cut by one or two cameras.

All lines are found in a patch of the image that is resampled along the blade, free of the lens's distortion, so that
they are straight there. Nothing is guessed: what cannot be measured raises
:class:`~cutenv.vision.blade_mark.UnusableFrame` with the reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import cv2
import numpy as np

from cutenv._base.arrays import Array, Indices
from cutenv.vision.blade_mark import (
    EDGE_SIGMA,
    LEAST_CONTRAST,
    REACH,
    SATURATED,
    EdgePatch,
    Line,
    MarkedBlade,
    Neighbourhood,
    UnusableFrame,
    find_mark,
    fitted_line,
    line_strengths,
    smooth_slopes,
    strongest_line,
)
from cutenv.vision.cameras import CalibratedCameras, Camera, GreyImage
from cutenv.vision.film_source import VideoFrame

Chart = Callable[[Array], Array]
"""Map of points, shape (n, 2), between pixels and a chart of the scene in which straight lines are straight."""

_STEP = 0.5  # of the patch along the blade [px]
_WIDEST_EDGE = 2.6  # standard deviation of an edge's spread from which on a frame is blurred [px]
_SHADED = 0.12  # error of the surface's line by shade and mirror images where it meets the blade, at right angles [px]
_GLARE = 0.05  # share of the blade's face that is saturated, from which on a frame is left out
_FIRST = 0.5  # strength of a line, relative to the strongest, that can be the surface


class BladeInView(NamedTuple):
    """View of the blade in one image, in its chart."""

    strip: Array  # centre of the strip, and the point at which the blade's middle enters the tissue, shape (2,)
    surface: Array
    strip_ends: Array  # upper and lower end of the strip on the blade's middle, shape (2, 2)
    strip_covariance: Array  # covariances of the two points, shape (2, 2)
    surface_covariance: Array
    surface_line: Array  # ends of the surface's line at the blade's left and right side, shape (2, 2)


class _BladeAxes(NamedTuple):
    """Axes of the blade in the chart.

    Steps of 1 px along it and across it, and its scale [px/m].
    """

    origin: Array
    down: Array
    right: Array
    per_m: float

    def at(self, s: float, t: float) -> Array:
        """Return the chart place s px below and t px right."""
        return np.asarray(self.origin + s * self.down + t * self.right)


class _Patch(NamedTuple):
    """Piece of the image along the blade.

    Rows every `_STEP` px from ``first`` [px], columns 1 px apart, 0 amid.
    """

    values: Array
    first: float
    half: int
    axes: _BladeAxes

    def edges(self, columns: Indices, sign: float = 1.0) -> EdgePatch:
        """Return columns whose edge is brighter below (``sign`` 1) or above."""
        values = self.values[:, columns]
        slopes = sign * smooth_slopes(values, EDGE_SIGMA / _STEP) / _STEP
        return EdgePatch(slopes, values, self.first, _STEP, np.asarray(columns - self.half, np.float64))


def measure_view(
    image: GreyImage, blade: MarkedBlade, to_chart: Chart, to_pixels: Chart, near: Neighbourhood | None = None
) -> BladeInView:
    """Measure strip and surface in one image.

    The maps lead from pixels to the chart, and back; ``near`` is where the mark is looked for first.

    Raises UnusableFrame if the strip is hidden or there are two, an edge is blurred or in glare, or no single straight
    line is the surface.
    """
    centre, down, across = find_mark(image, blade, near)
    ends = to_chart(np.stack([centre, centre + down, centre + np.array([down[1], -down[0]])]))
    axes = _BladeAxes(ends[0], ends[1] - ends[0], ends[2] - ends[0], across / blade.width)
    # First with the strip's rough direction, then with that of the sides that were found.
    patch = _cut_out(image, to_pixels, axes, blade, wide=2.4)
    left, right = _sides(patch, blade, _surface(patch, blade), reach=0.5 * axes.per_m * blade.width)
    a, b, per_m = 0.5 * (left.a + right.a), 0.5 * (left.b + right.b), (right.a - left.a) / blade.width
    if per_m * blade.width < 6.0:
        raise UnusableFrame("the blade is not as wide as it should be")
    origin, down = axes.at(0.0, a), axes.at(1.0, a + b) - axes.at(0.0, a)
    down = down / math.hypot(1.0, b)
    normal = np.array([down[1], -down[0]]) / np.hypot(*down)
    # A pixel is as long across as before, whatever it is along.
    axes = _BladeAxes(origin, down, float(normal @ axes.right) * normal, per_m)
    patch = _cut_out(image, to_pixels, axes, blade, wide=1.6)
    upper, lower = _strip_lines(patch, blade)
    if max(upper.spread, lower.spread) > _WIDEST_EDGE:
        raise UnusableFrame(f"the {blade.mark} is blurred")
    surface = _surface(patch, blade, start=lower.a)
    face = patch.values[slice(*(round((s - patch.first) / _STEP) for s in (lower.a, surface.a)))]
    if (face[:, _inner(patch, blade.width * per_m)] >= SATURATED).mean() > _GLARE:
        raise UnusableFrame("glare on the blade")
    return _in_chart(axes, (upper, lower), surface, _sides(patch, blade, surface, reach=REACH))


def _in_chart(axes: _BladeAxes, strip: tuple[Line, Line], surface: Line, sides: tuple[Line, Line]) -> BladeInView:
    (upper, lower), (left, right) = strip, sides
    a, b = 0.5 * (left.a + right.a), 0.5 * (left.b + right.b)

    def on(line: Line, side: tuple[float, float]) -> Array:
        s = (line.a + line.b * side[0]) / (1.0 - line.b * side[1])
        return axes.at(s, side[0] + side[1] * s)

    def covariance(along: float, slope: float, s: float) -> Array:
        aside = 0.5 * math.hypot(left.sd_at(s), right.sd_at(s))
        steps = np.stack([axes.down, axes.right], axis=1)
        spread = np.array([[along**2 + (slope * aside) ** 2, slope * aside**2], [slope * aside**2, aside**2]])
        return np.asarray(steps @ spread @ steps.T)

    ends = np.stack([on(line, (a, b)) for line in strip])
    shaded = _SHADED * math.hypot(1.0, surface.b)
    return BladeInView(
        strip=ends.mean(axis=0),
        surface=on(surface, (a, b)),
        strip_ends=ends,
        strip_covariance=covariance(0.5 * math.hypot(upper.sd, lower.sd), 0.5 * (upper.b + lower.b), 0.0),
        surface_covariance=covariance(math.hypot(surface.sd, shaded), surface.b, surface.a),
        surface_line=np.stack([on(surface, (side.a, side.b)) for side in sides]),
    )


def _cut_out(image: GreyImage, to_pixels: Chart, axes: _BladeAxes, blade: MarkedBlade, *, wide: float) -> _Patch:
    """Resample the image along the blade, to 15 % beyond it."""
    origin, down, right, per_m = axes
    first, last = -_mark_and(blade, 0.75) * per_m, (1.15 * blade.total + 0.002) * per_m
    half = math.ceil(0.5 * wide * blade.width * per_m)
    s, t = np.arange(first, last, _STEP), np.arange(-half, half + 1.0)
    # Across so narrow a patch the map is a parabola to a thousandth of a pixel: three columns tell it.
    points = origin + s[:, None, None] * down + np.array([-half, 0, half])[None, :, None] * right
    columns, u = to_pixels(points.reshape(-1, 2)).reshape(len(s), 3, 2), t / half
    parabolas = np.stack([0.5 * u * (u - 1.0), 1.0 - u * u, 0.5 * u * (u + 1.0)], axis=1)
    at = (parabolas @ columns).astype(np.float32)
    values = cv2.remap(image.astype(np.float32), at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    inner = math.floor(0.5 * blade.width * per_m + REACH)
    sides = at[:, [half - inner, half + inner]]
    inside = ((sides >= 0) & (sides <= (image.shape[1] - 1, image.shape[0] - 1))).all(axis=(1, 2))
    outside, mark = np.flatnonzero(~inside), round(-first / _STEP)
    k = int(np.searchsorted(outside, mark))
    begin, end = int(outside[k - 1]) + 1 if k else 0, int(outside[k]) if k < len(outside) else len(s)
    if min(mark - begin, end - mark) * _STEP < 0.5 * blade.strip * per_m + REACH + 2.0:
        raise UnusableFrame(f"the {blade.mark} is at the border of the image")
    return _Patch(np.asarray(values, np.float64)[begin:end], float(s[begin]), half, axes)


def _mark_and(blade: MarkedBlade, share: float) -> float:
    """Return the mark's half-length plus a share of blade width [m]."""
    return 0.5 * blade.strip + share * blade.width


def _strip_lines(patch: _Patch, blade: MarkedBlade) -> tuple[Line, Line]:
    half, columns = 0.5 * blade.strip * patch.axes.per_m, _inner(patch, blade.mark_width * patch.axes.per_m)
    found = []
    for sign in (-1.0, 1.0):
        name = f"the {blade.mark}'s {'upper' if sign < 0 else 'lower'} edge"
        near = sign * half + np.array([-0.6, 0.6]) * half
        edges = patch.edges(columns, sign)
        found.append(fitted_line(edges, strongest_line(edges, near, np.linspace(-0.6, 0.6, 25)), name))
    return found[0], found[1]


def _surface(patch: _Patch, blade: MarkedBlade, start: float | None = None) -> Line:
    """Return the line between the bright blade and darker tissue."""
    per_m = patch.axes.per_m
    edges = patch.edges(_inner(patch, blade.width * per_m), -1.0)
    low = (0.5 * blade.strip * per_m if start is None else start) + 4.0
    last = patch.first + _STEP * (len(patch.values) - 1) - 2.0
    if last - low < 8.0:
        raise UnusableFrame("the blade leaves the image above the tissue")
    tilts = np.linspace(-2.0, 2.0, 41)
    strength, places = line_strengths(edges, np.array([low, last]), tilts)
    best = strength.max(axis=0)
    if best.max() < 0.3 * LEAST_CONTRAST / EDGE_SIGMA / 2.5:
        raise UnusableFrame("no line of the tissue's surface is seen on the blade")
    # Tissue below has lines of its own, steel above has none: the first line is the surface.
    first = int(np.argmax(best >= _FIRST * best.max()))
    row = first + int(np.argmax(best[first : first + round(6.0 / _STEP)]))
    line = Line(float(places[row]), float(tilts[int(np.argmax(strength[:, row]))]))
    return line if start is None else fitted_line(edges, line, "the surface's line")


def _sides(patch: _Patch, blade: MarkedBlade, surface: Line, *, reach: float) -> tuple[Line, Line]:
    """Return the blade's left and right side as lines."""
    s: Array = np.asarray(patch.first + _STEP * np.arange(len(patch.values)), np.float64)
    per_m = patch.axes.per_m
    half = 0.5 * blade.width * per_m
    end = surface.a - abs(surface.b) * half - 2.0
    seen = (s > -_mark_and(blade, 0.55) * per_m) & (s < end)
    if blade.tag is not None:  # its own sides are near those of the blade
        seen &= np.abs(s) > 0.5 * blade.strip * per_m + REACH
    rows = np.flatnonzero(seen)[::2]
    if len(rows) < 12:
        raise UnusableFrame("too little of the blade is seen")
    turned = patch.values[rows].T
    edges = EdgePatch(np.abs(smooth_slopes(turned, EDGE_SIGMA)), turned, -patch.half, 1.0, s[rows])
    found = []
    for sign in (-1.0, 1.0):
        near = sign * half + np.array([-1.0, 1.0]) * min(reach, 0.5 * half)
        tilts = np.linspace(-0.3, 0.3, 25) * min(1.0, reach / 6.0)
        found.append(fitted_line(edges, strongest_line(edges, near, tilts), "the blade's side"))
    return found[0], found[1]


def _inner(patch: _Patch, width: float) -> Indices:
    """Return the columns well inside a width amid the patch [px]."""
    t = np.arange(-patch.half, patch.half + 1)
    return np.flatnonzero(np.abs(t) <= 0.5 * width - 2.5)


_EPIPOLAR = 1.5  # rows by which the two views of a point may differ [px]
_STRIP_ERROR = 0.15  # relative error of the strip's length from which on it is another strip or calibration
_SCALE = 1e-3  # standard error of all lengths by the calibration, relative
_OFF_PLANE = 0.5e-3  # standard deviation of a blade's distance from the plane of the board, for one camera [m]
_AROUND = 2.5  # reach of the neighbourhood in which the mark is looked for next, over its length and the blade's width
_BEYOND = 1.5e-3  # length by which a blade may seem longer than it is [m]


class BladeInSpace(NamedTuple):
    """Blade as measured in one frame.

    Places in the frame of the first camera, or of the plane of the cut [m].
    """

    strip: Array  # centre of the strip, and the point at which the blade's middle enters the tissue, shape (3,)
    surface: Array
    exposed: float  # distance between them, and its standard error [m]
    exposed_sd: float
    view: BladeInView  # what the first camera shows, in pixels


class DepthFrame(NamedTuple):
    """Frame number, time [s], and blade or reason for omission."""

    number: int
    time: float
    blade: BladeInSpace | None
    reason: str


class BladeCameras:
    """Calibrated cameras that measure a marked blade.

    They look for its mark first where they saw it last. There is one camera with the plane of the cut, or a pair.
    """

    def __init__(self, cameras: CalibratedCameras, blade: MarkedBlade) -> None:
        self.cameras, self.blade = cameras, blade
        self._charts = [_chart(cameras, k) for k in range(len(cameras.cameras))]
        self._seen: list[Neighbourhood | None] = [None] * len(self._charts)
        off = 0.0 if cameras.plane is None else _OFF_PLANE / float(np.linalg.norm(cameras.plane.translation))
        self._scale_sd = math.hypot(_SCALE, 0.0 if cameras.second is not None else off)

    def measure(self, image: GreyImage) -> BladeInSpace:
        """Measure the blade in a frame.

        Images of a pair stand side by side.

        Raises UnusableFrame if it cannot be measured.
        """
        width = self.cameras.cameras[0].width
        views = []
        for k, (to_chart, to_pixels) in enumerate(self._charts):
            half = np.ascontiguousarray(image[:, k * width : (k + 1) * width])
            view = measure_view(half, self.blade, to_chart, to_pixels, self._seen[k])
            views.append(view)
            upper, lower = to_pixels(view.strip_ends)
            reach = _AROUND * (1.0 + self.blade.width / self.blade.strip) * float(np.hypot(*(lower - upper)))
            self._seen[k] = Neighbourhood(0.5 * (upper + lower), reach)
        place = self._triangulated if len(views) == 2 else self._on_plane
        points = np.array([[view.strip, view.surface, *view.strip_ends] for view in views])
        strip, surface, *ends = place(points)
        length = float(np.linalg.norm(ends[0] - ends[1]))
        if abs(length / self.blade.strip - 1.0) > _STRIP_ERROR:
            given = 1e3 * self.blade.strip
            raise UnusableFrame(f"the {self.blade.mark} seems {1e3 * length:.1f} mm long and not {given:g}")
        if len(views) == 2 and float(np.abs(points[0, :, 1] - points[1, :, 1]).max()) > _EPIPOLAR:
            raise UnusableFrame("the two cameras do not see the same blade or surface")
        exposed = float(np.linalg.norm(surface - strip))
        if exposed > self.blade.total + _BEYOND:
            raise UnusableFrame(f"{1e3 * exposed:.1f} mm of the blade are seen, more than it has")
        variance = 0.0
        for k, view in enumerate(views):
            for which, covariance in enumerate((view.strip_covariance, view.surface_covariance)):
                slope = np.empty(2)
                for axis in (0, 1):
                    step = math.sqrt(covariance[axis, axis])
                    moved = points.copy()
                    moved[k, which, axis] += step
                    there = place(moved)
                    slope[axis] = (float(np.linalg.norm(there[1] - there[0])) - exposed) / step
                variance += float(slope @ covariance @ slope)
        variance += (self._scale_sd * exposed) ** 2
        to_pixels = self._charts[0][1]
        return BladeInSpace(strip, surface, exposed, math.sqrt(variance), _in_pixels(views[0], to_pixels))

    def measure_all(self, frames: Iterable[VideoFrame]) -> Iterator[DepthFrame]:
        """Measure all frames; unusable ones carry the reason."""
        for number, time, image in frames:
            try:
                yield DepthFrame(number, time, self.measure(image), "")
            except UnusableFrame as unusable:
                yield DepthFrame(number, time, None, str(unusable))

    def _on_plane(self, points: Array) -> Array:
        return np.column_stack([points[0], np.zeros(len(points[0]))])

    def _triangulated(self, points: Array) -> Array:
        (_, p1), (_, p2) = self.cameras.rectified
        rows = points[..., 1].mean(axis=0)
        apart = points[0, :, 0] - points[1, :, 0] - (p1[0, 2] - p2[0, 2])
        baseline = -p2[0, 3] / p2[0, 0]
        if (apart * baseline <= 0.0).any():
            raise UnusableFrame("the blade would lie behind the cameras: left and right are exchanged or mirrored")
        z = p1[0, 0] * baseline / apart
        return np.column_stack([(points[0, :, 0] - p1[0, 2]) * z / p1[0, 0], (rows - p1[1, 2]) * z / p1[1, 1], z])


def _chart(cameras: CalibratedCameras, k: int) -> tuple[Chart, Chart]:
    """Return maps between a camera's pixels and its chart.

    The chart is rectified pixels of a pair, or metres on the plane.
    """
    camera = cameras.cameras[k]
    if cameras.second is not None:
        return _rectified_chart(camera, *cameras.rectified[k])
    assert cameras.plane is not None
    rotation, translation = cameras.plane.rotation, cameras.plane.translation
    homography = np.column_stack([rotation[:, :2], translation])
    inverse = np.linalg.inv(homography)

    def to_chart(pixels: Array) -> Array:
        ideal = camera.ideal(pixels)
        on = np.column_stack([ideal, np.ones(len(ideal))]) @ inverse.T
        return np.asarray(on[:, :2] / on[:, 2:])

    def to_pixels(points: Array) -> Array:
        return camera.pixels(points @ rotation[:, :2].T + translation)

    return to_chart, to_pixels


def _rectified_chart(camera: Camera, rotation: Array, projection: Array) -> tuple[Chart, Chart]:
    focal, centre = np.array([projection[0, 0], projection[1, 1]]), projection[:2, 2]

    def to_chart(pixels: Array) -> Array:
        found = cv2.undistortPoints(
            np.asarray(pixels, np.float64).reshape(-1, 1, 2), camera.matrix, camera.distortion, R=rotation, P=projection
        )
        return np.asarray(found, np.float64).reshape(-1, 2)

    def to_pixels(points: Array) -> Array:
        return camera.pixels(np.column_stack([(points - centre) / focal, np.ones(len(points))]) @ rotation)

    return to_chart, to_pixels


def _in_pixels(view: BladeInView, to_pixels: Chart) -> BladeInView:
    """Return a view's points in pixels, covariances in the chart."""
    points = to_pixels(np.vstack([view.strip, view.surface, view.strip_ends, view.surface_line]))
    return view._replace(strip=points[0], surface=points[1], strip_ends=points[2:4], surface_line=points[4:])
