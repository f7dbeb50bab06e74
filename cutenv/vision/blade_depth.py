"""Depth of cut from one frame: of a pair of cameras by triangulation, of one camera by the plane of the cut."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import cv2
import numpy as np

from cutenv._base.arrays import Array
from cutenv.vision.blade_mark import MarkedBlade, Neighbourhood
from cutenv.vision.cameras import CalibratedCameras, Camera, GreyImage
from cutenv.vision.edge_lines import UnusableFrame
from cutenv.vision.marked_blade import BladeInView, Chart, measure_view
from cutenv.vision.video import VideoFrame

_EPIPOLAR = 1.5  # rows by which the two views of a point may differ [px]
_STRIP_ERROR = 0.15  # relative error of the strip's length from which on it is another strip or calibration
_SCALE = 1e-3  # standard error of all lengths by the calibration, relative
_OFF_PLANE = 0.5e-3  # standard deviation of a blade's distance from the plane of the board, for one camera [m]
_AROUND = 2.5  # reach of the neighbourhood in which the mark is looked for next, over its length and the blade's width
_BEYOND = 1.5e-3  # length by which a blade may seem longer than it is [m]


class BladeInSpace(NamedTuple):
    """Blade as measured in one frame; places in the frame of the first camera, or of the plane of the cut [m].

    Attributes
    ----------
    strip, surface : ndarray, shape (3,)
        Centre of the strip, and the point at which the blade's middle enters the tissue.
    exposed, exposed_sd : float
        Distance between them, and its standard error [m].
    view : BladeInView
        What the first camera shows, in pixels.
    """

    strip: Array
    surface: Array
    exposed: float
    exposed_sd: float
    view: BladeInView


class DepthFrame(NamedTuple):
    """One frame: number, time on the video's clock [s], and the blade, or the reason for which it is left out."""

    number: int
    time: float
    blade: BladeInSpace | None
    reason: str


class BladeCameras:
    """Calibrated cameras that measure a marked blade, and look for its mark first where they saw it last.

    Parameters
    ----------
    cameras : CalibratedCameras
        One camera with the plane of the cut, or a pair.
    blade : MarkedBlade
        Blade to look for.
    """

    def __init__(self, cameras: CalibratedCameras, blade: MarkedBlade) -> None:
        self.cameras, self.blade = cameras, blade
        self._charts = [_chart(cameras, k) for k in range(len(cameras.cameras))]
        self._seen: list[Neighbourhood | None] = [None] * len(self._charts)
        off = 0.0 if cameras.plane is None else _OFF_PLANE / float(np.linalg.norm(cameras.plane.translation))
        self._scale_sd = math.hypot(_SCALE, 0.0 if cameras.second is not None else off)

    def measure(self, image: GreyImage) -> BladeInSpace:
        """Measure the blade in a frame; images of a pair stand side by side.

        Raises
        ------
        UnusableFrame
            If it cannot be measured.
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
        """Measure frame after frame; those that cannot be measured carry the reason."""
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
    """Return the maps of a camera's pixels to its chart and back: rectified pixels of a pair, metres on the plane."""
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
    """Return the points of a view in pixels; covariances stay in the chart."""
    points = to_pixels(np.vstack([view.strip, view.surface, view.strip_ends, view.surface_line]))
    return view._replace(strip=points[0], surface=points[1], strip_ends=points[2:4], surface_line=points[4:])
