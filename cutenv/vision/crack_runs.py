"""Runs of the crack that a film shows: the tissue beside the blade springs back; and the sudden drops of the force.

While the blade loads the tissue it carries it along; when the crack runs, the tissue goes back. Each such run should be
a sudden drop of the force (thesis, section 3.3.2).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.measurement.segments import loading_segments, smoothing_readings_of
from cutenv.trace import Trace
from cutenv.vision.cameras import GreyImage
from cutenv.vision.depth_record import FilmedDepth
from cutenv.vision.film_source import VideoFrame
from cutenv.vision.marked_blade import BladeInView

_AHEAD, _BESIDE = 14e-3, 7e-3  # reach of the window around the blade along the travel and upright in the image [m]
_APART = 5.0  # of the points that are followed [px]
_WINDOW = 15  # about a point that is compared [px]
_FEWEST = 12  # points
_ASTRAY = 0.5  # of a point that is followed forth and back, from which on it is not trusted [px]
_NEIGHBOURS = 3  # steps to either side that tell the tissue's pace
_LEAST, _CLEAR = 0.05e-3, 4.0  # smallest lag behind this pace that is a run [m], and over its scatter [1]
_SLACK = 0.03  # between a run and its drop: time in which the force falls, and error of the lag [s]


class SeenRun(NamedTuple):
    """One run of the crack: middle and length of the time between the frames before and after it, and the step back.

    Attributes
    ----------
    time, interval : float
        On the record's clock [s].
    step_back : float
        Distance by which the tissue beside the blade fell behind the pace at which the blade carries it [m]: a median.
    """

    time: float
    interval: float
    step_back: float


@dataclass(frozen=True, kw_only=True)
class RunsAndDrops:
    """Runs of the crack as seen, and sudden drops of the force; each belongs to one of the others at most.

    Attributes
    ----------
    runs : tuple of SeenRun
        Runs in order of time.
    drops : tuple of float
        Times of the drops [s].
    pairs : tuple of (int, int)
        Run and drop that happened at the same time, by their numbers.
    """

    runs: tuple[SeenRun, ...]
    drops: tuple[float, ...]
    pairs: tuple[tuple[int, int], ...]

    @property
    def f1(self) -> float:
        """Twice the pairs over runs and drops [1]: 1 if each run is a drop and each drop a run; nan without either."""
        count = len(self.runs) + len(self.drops)
        return 2.0 * len(self.pairs) / count if count else math.nan


class _Seen(NamedTuple):
    time: float
    image: GreyImage
    view: BladeInView


def seen_runs(frames: Iterable[VideoFrame], filmed: FilmedDepth, trace: Trace, width: int) -> tuple[SeenRun, ...]:
    """Find the runs of the crack in a film.

    Points on the tissue beside the blade are followed from one usable frame to the next. Where their median goes back,
    by more than the blade itself does and clearly against the pace before and after, the crack has run. Two such steps
    in a row are one run.

    Parameters
    ----------
    frames : iterable of VideoFrame
        All frames of the film in order of time.
    filmed : FilmedDepth
        Depth of the same film.
    trace : Trace
        Record of the same cut, with position.
    width : int
        Width of the first camera's image [px].

    Raises
    ------
    ValueError
        If the record has no position.
    """
    (position,) = trace.require("position", by="seen_runs")
    views = {frame.number: frame.blade.view for frame in filmed.frames if frame.blade is not None}
    strips = np.array([view.strip for view in views.values()])
    per_m = np.polyfit(np.interp(filmed.time, trace.time, position), strips, 1)[0]  # travel in the image [px/m]
    steps: list[tuple[float, float, float]] = []
    before: _Seen | None = None
    for frame in frames:
        if frame.number not in views:
            continue
        after = _Seen(frame.time + filmed.alignment.lag, frame.image[:, :width], views[frame.number])
        if before is not None and (step := _tissue_step(before, after, per_m)) is not None:
            start, end = np.interp([before.time, after.time], trace.time, position)
            steps.append((before.time, after.time, step - min(float(end - start), 0.0)))
        before = after
    return _runs_of(steps)


def _runs_of(steps: list[tuple[float, float, float]]) -> tuple[SeenRun, ...]:
    """Return the runs among steps of the tissue: begin and end [s], and how far it went on [m]."""
    if len(steps) <= 2 * _NEIGHBOURS:
        return ()
    begins, ends, went = np.array(steps).T
    took = ends - begins
    padded = np.pad(went / took, _NEIGHBOURS, mode="edge")
    behind = went - took * np.median(sliding_window_view(padded, 2 * _NEIGHBOURS + 1), axis=1)
    least = max(_LEAST, _CLEAR * 1.4826 * float(np.median(np.abs(behind))))
    found: list[tuple[float, float, float]] = []
    for k in np.flatnonzero((behind < -least) & (went < 0.0)):
        begin, back = float(begins[k]), -float(behind[k])
        if found and found[-1][1] == begin:
            begin, back = found[-1][0], back + found.pop()[2]
        found.append((begin, float(ends[k]), back))
    return tuple(SeenRun(0.5 * (begin + end), end - begin, back) for begin, end, back in found)


def _tissue_step(before: _Seen, after: _Seen, per_m: Array) -> float | None:
    """Return the median step of the tissue beside the blade along the travel [m]; None if too little of it is seen."""
    scale = float(np.hypot(*per_m))
    reach = scale * np.array([_AHEAD, _BESIDE])
    axes = [np.arange(-far, far + 1.0, _APART) for far in reach]
    points = (before.view.surface + np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)).astype(np.float32)
    points = points[_beside(points, before)]
    if len(points) < _FEWEST:
        return None
    size = (_WINDOW, _WINDOW)
    there, found, _ = cv2.calcOpticalFlowPyrLK(before.image, after.image, points, None, winSize=size, maxLevel=3)  # type: ignore[call-overload]
    back, again, _ = cv2.calcOpticalFlowPyrLK(after.image, before.image, there, None, winSize=size, maxLevel=3)  # type: ignore[call-overload]
    good = (found.ravel() & again.ravel()).astype(bool) & (np.abs(back - points).max(axis=1) < _ASTRAY)
    good &= _beside(there, after)
    if good.sum() < _FEWEST:
        return None
    return float(np.median((there - points)[good] @ per_m)) / scale**2


def _beside(points: NDArray[np.float32], seen: _Seen) -> NDArray[np.bool_]:
    """Return which points, shape (n, 2) [px], are in the image, and neither on the blade nor on its mirror image."""
    view, border = seen.view, 0.5 * _WINDOW
    far = 0.5 * float(np.hypot(*(view.surface_line[1] - view.surface_line[0]))) + border
    height, width = seen.image.shape
    beside = np.asarray((points >= border).all(axis=1) & (points < (width - border, height - border)).all(axis=1))
    up = (view.strip - view.surface) / np.hypot(*(view.strip - view.surface))
    for axis in (up, up * (1.0, -1.0)):
        away = points - view.surface
        beside &= (away @ axis < -far) | (np.abs(away @ np.array([axis[1], -axis[0]])) > far)
    return beside


def runs_and_drops(runs: tuple[SeenRun, ...], trace: Trace) -> RunsAndDrops:
    """Match the runs of the crack that a film shows with the sudden drops of the force; the nearest in time first."""
    drops = _drops_of(trace)
    near = sorted(
        (abs(run.time - drop), i, k)
        for i, run in enumerate(runs)
        for k, drop in enumerate(drops)
        if abs(run.time - drop) <= 0.5 * run.interval + _SLACK
    )
    pairs: list[tuple[int, int]] = []
    for _, i, k in near:
        if all(i != other and k != taken for other, taken in pairs):
            pairs.append((i, k))
    return RunsAndDrops(runs=runs, drops=drops, pairs=tuple(sorted(pairs)))


def _drops_of(trace: Trace) -> tuple[float, ...]:
    """Return the times of the sudden drops that end loading segments [s]: when half of each has gone."""
    size = smoothing_readings_of(trace)
    found = []
    for segment in loading_segments(trace):
        if segment.drop > 0.0:
            after = slice(segment.stop, segment.stop + 4 * size)
            top = float(trace.force[max(segment.start, segment.stop - size) : segment.stop].mean())
            fallen = trace.force[after] < top - 0.5 * segment.drop
            found.append(float(trace.time[after][int(np.argmax(fallen)) if fallen.any() else -1]))
    return tuple(found)
