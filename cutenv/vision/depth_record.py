"""Depth of cut and crack runs from a film.

The film is aligned with the record by the blade's motion, and its depths are put into it.

While the blade loads the tissue it carries it along; when the crack runs, the tissue beside the blade springs back.
Each such run should be a sudden drop of the force (thesis, section 3.3.2).
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv._base.validation import one_of
from cutenv.records.measurement.depth import DEPTH_SD_KEY
from cutenv.records.measurement.segments import loading_segments, smoothing_readings_of
from cutenv.sim.trace import Trace
from cutenv.vision.blade_mark import MarkedBlade
from cutenv.vision.cameras import GreyImage, angle_between
from cutenv.vision.film_source import VideoFrame
from cutenv.vision.marked_blade import BladeInSpace, BladeInView, DepthFrame

TRAVELS = ("right", "left")  # ways in which the blade can go in the images when it cuts
FEWEST_FILMED = 10  # least number of usable frames
_SHORTEST_TRAVEL = 5e-3  # of the blade, from which its direction and the time are known [m]
_LARGEST_MISFIT = 1e-3  # root mean square between the blade's motion in film and record [m]
_SCALE_ERROR = 0.05  # between the travel in film and record
_ANGLE_ERROR = math.radians(4.0)  # between film and record
_LARGEST_LAG_SD = 0.05  # [s]
_LONGEST_GAP = 0.015  # motion of the blade without a usable frame [m]
_GRID = 0.02  # of lags tried [s]
_OTHER_RATES = (0.25, 0.5, 0.8, 25.0 / 30.0, 1.2, 1.25, 2.0, 4.0)
_NEIGHBOURS, _APART = 4, 1e-4  # to either side in place, and least distance of two of them that gives a slope [m]
_JUMP_SD, _JUMP = 5.0, 0.7e-3  # from the neighbours' line on which a frame is left out [1], [m]


@dataclass(frozen=True, kw_only=True)
class FilmAlignment:
    """Alignment of a film with a record in time and place."""

    lag: float  # time on the record's clock at the film's time 0, and its standard error [s]
    lag_sd: float
    misfit: float  # root mean square distance between the blade's motion in film and record [m]
    angle: float  # angle between the blade and its travel, from the images [rad]


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmedDepth:
    """Depth of cut in the usable frames, on the record's clock."""

    time: Array  # time of each usable frame on the record's clock [s], shape (n,)
    along: Array  # length of the blade in the tissue, along the blade, and its standard error [m], shape (n,)
    along_sd: Array
    vertical: Array  # depth of cut, at right angles to the travel, and its standard error [m], shape (n,)
    vertical_sd: Array
    sd: float  # of the depth of a frame [m]: by the frames' standard errors, or their scatter if it is larger
    frames: tuple[DepthFrame, ...]  # all frames; what is left out has its reason
    alignment: FilmAlignment  # how the film lies on the record

    @property
    def left_out(self) -> dict[str, int]:
        """Number of frames left out, by reason, most frequent first."""
        return dict(Counter(frame.reason for frame in self.frames if frame.blade is None).most_common())

    def onto(self, trace: Trace) -> Trace:
        """Return the record with interpolated vertical depth and its metadata."""
        depth = np.clip(np.interp(trace.time, self.time, self.vertical), 0.0, 0.1)
        about = {
            "frames": len(self.frames), "left_out": self.left_out, "lag_s": self.alignment.lag,
            "lag_sd_s": self.alignment.lag_sd, "angle_deg": math.degrees(self.alignment.angle),
        }  # fmt: skip
        metadata = {**trace.metadata, DEPTH_SD_KEY: self.sd, "depth_from_film": about}
        return dataclasses.replace(trace, depth=depth, metadata=metadata)


def filmed_depth(
    frames: Sequence[DepthFrame], trace: Trace, blade: MarkedBlade, *, travel: str = "right"
) -> FilmedDepth:
    """Align all frames of a film with a record; return the depth of cut.

    The record has the position, and the angle if the rig knows it. ``travel`` is the way, right or left, in which the
    blade goes in the images when its position grows; it tells mirrored and turned images.

    Raises ValueError if fewer than :data:`FEWEST_FILMED` are usable, the record lacks position, its motion or angle is
    not that of the film, or the blade moves far without a usable frame.
    """
    one_of("travel", travel, TRAVELS)
    (position,) = trace.require("position", by="depth")
    good = [frame for frame in frames if frame.blade is not None]
    if len(good) < FEWEST_FILMED:
        reasons = Counter(frame.reason for frame in frames if frame.blade is None).most_common(3)
        listed = "; ".join(f"{reason}: {count}" for reason, count in reasons)
        raise ValueError(
            f"{len(good)} of {len(frames)} frames are usable, {FEWEST_FILMED} or more are needed ({listed}). If all "
            "fail alike, check the blade's lengths, the calibration, and that the blade's end points down in the image."
        )
    blades = [frame.blade for frame in good if frame.blade is not None]
    time = np.array([frame.time for frame in good])
    along = blade.total - np.array([each.exposed for each in blades])
    place, _ = _travelled(blades)
    smooth = _fits_around(place, along, np.array([each.exposed_sd for each in blades]))
    if smooth.sum() < FEWEST_FILMED:
        raise ValueError("the depth jumps from frame to frame: the film does not show one blade in one tissue.")
    jumped = {good[k].number for k in np.flatnonzero(~smooth)}
    kept = [frame for frame in good if frame.number not in jumped]
    all_frames = tuple(
        frame._replace(blade=None, reason="the depth jumps against the frames around") if frame.number in jumped
        else frame for frame in frames
    )  # fmt: skip
    blades = [frame.blade for frame in kept if frame.blade is not None]
    time, along = time[smooth], along[smooth]
    alignment = _aligned(time, blades, trace, travel)
    clock = time + alignment.lag
    _check_gaps(clock, trace, position)
    angle = np.full(len(clock), alignment.angle) if trace.angle is None else np.interp(clock, trace.time, trace.angle)
    along_sd = np.array([each.exposed_sd for each in blades])
    vertical_sd = along_sd * np.sin(angle)
    vertical = along * np.sin(angle)
    scatter = 1.4826 * float(np.median(np.abs(np.diff(vertical, 4)))) / math.sqrt(70.0)  # a smooth depth leaves none
    return FilmedDepth(
        time=clock, along=along, along_sd=along_sd, vertical=vertical, vertical_sd=vertical_sd,
        sd=max(float(np.sqrt(np.mean(vertical_sd**2))), scatter), frames=all_frames, alignment=alignment,
    )  # fmt: skip


def _fits_around(place: Array, depth: Array, sd: Array) -> NDArray[np.bool_]:
    """Return which frames agree with a Theil-Sen line of neighbours."""
    order = np.argsort(place, kind="stable")
    x, y = place[order], depth[order]
    agrees = np.ones(len(x), bool)
    for k in range(len(x)):
        first = min(max(k - _NEIGHBOURS, 0), max(len(x) - 2 * _NEIGHBOURS - 1, 0))
        near = [j for j in range(first, min(first + 2 * _NEIGHBOURS + 1, len(x))) if j != k]
        dx, dy = x[near][:, None] - x[near], y[near][:, None] - y[near]
        apart = dx > _APART
        slope = float(np.median(dy[apart] / dx[apart])) if apart.any() else 0.0
        expected = float(np.median(y[near] + slope * (x[k] - x[near])))
        agrees[order[k]] = abs(y[k] - expected) <= max(_JUMP_SD * sd[order[k]], _JUMP)
    return agrees


def _travelled(blades: Sequence[BladeInSpace]) -> tuple[Array, Array]:
    """Return the strip's travel [m], shape (n,), and direction."""
    places = np.array([each.strip for each in blades])
    middle = np.median(places, axis=0)
    axis = np.linalg.svd(places - middle, full_matrices=False)[2][0]
    return (places - middle) @ axis, axis


def _aligned(time: Array, blades: Sequence[BladeInSpace], trace: Trace, travel: str) -> FilmAlignment:
    along, axis = _travelled(blades)
    (position,) = trace.require("position", by="depth")
    travelled, moved = float(np.ptp(along)), float(np.ptp(position))
    if travelled < _SHORTEST_TRAVEL or moved < _SHORTEST_TRAVEL:
        raise ValueError(
            f"the blade moves {1e3 * travelled:.1f} mm in the film and {1e3 * moved:.1f} mm in the record: at least "
            f"{1e3 * _SHORTEST_TRAVEL:g} mm are needed to align them."
        )
    lag, sign, misfit = _best_lag(time, along, trace.time, position)
    if misfit > _LARGEST_MISFIT:
        raise ValueError(_other_cut(time, along, trace.time, position, misfit))
    pixels = np.array([each.view.strip[0] for each in blades])
    if (float(np.polyfit(sign * along, pixels, 1)[0]) > 0.0) != (travel == "right"):
        raise ValueError(
            f"the blade goes to the {TRAVELS[travel == 'right']} in the images when it cuts, not to the {travel}: the "
            f"images are mirrored or turned, or the camera is on the other side: --travel {TRAVELS[travel == 'right']}."
        )
    lag, lag_sd, misfit, scale = _refined(time, sign * along, trace.time, position, lag)
    if abs(scale - 1.0) > _SCALE_ERROR:
        raise ValueError(
            f"the blade moves {scale:.3f} times as far in the film as in the record: the calibration is of another "
            "camera, plane or board spacing."
        )
    if lag_sd > _LARGEST_LAG_SD:
        raise ValueError(
            f"the film's time is uncertain by {1e3 * lag_sd:.0f} ms: film the blade's start, stop or turn as well."
        )
    down = np.median([(each.surface - each.strip) / each.exposed for each in blades], axis=0)
    angle = angle_between(down, axis)
    angle = min(angle, math.pi - angle)
    if trace.angle is not None:
        recorded = float(np.median(trace.angle))
        recorded = min(recorded, math.pi - recorded)
        if abs(recorded - angle) > _ANGLE_ERROR:
            raise ValueError(
                f"the blade stands at {math.degrees(angle):.1f} degrees in the film and {math.degrees(recorded):.1f} "
                "in the record: it is the record of another cut."
            )
    return FilmAlignment(lag=lag, lag_sd=lag_sd, misfit=misfit, angle=angle)


def _best_lag(time: Array, along: Array, clock: Array, position: Array) -> tuple[float, float, float]:
    """Return lag, motion's sign and misfit of the best grid point."""
    lags = np.arange(clock[0] - time[-1], clock[-1] - time[0] + _GRID, _GRID)
    at = np.interp(time[None, :] + lags[:, None], clock, position)
    at -= np.median(at, axis=1, keepdims=True)
    best = (0.0, 1.0, math.inf)
    for sign in (1.0, -1.0):
        moved = sign * (along - np.median(along))
        misfit = np.sqrt(np.mean((at - moved - (at - moved).mean(axis=1, keepdims=True)) ** 2, axis=1))
        k = int(np.argmin(misfit))
        best = min(best, (float(lags[k]), sign, float(misfit[k])), key=lambda each: each[2])
    return best


def _refined(time: Array, along: Array, clock: Array, position: Array, lag: float) -> tuple[float, float, float, float]:
    """Refine a lag by Gauss-Newton; return it, error, misfit and scale."""
    speed = np.gradient(position, clock)
    window = max(1, round(0.02 * (len(clock) - 1) / float(clock[-1] - clock[0])))
    speed = np.convolve(speed, np.full(window, 1.0 / window), mode="same")
    kept = np.ones(len(time), bool)
    for _ in range(6):
        at = time + lag
        expected, rate = np.interp(at, clock, position), np.interp(at, clock, speed)
        terms = np.column_stack([np.ones(len(time)), rate, expected - expected.mean()])
        far = along - expected
        found, *_ = np.linalg.lstsq(terms[kept], far[kept], rcond=None)
        rest = far - terms @ found
        lag += float(np.clip(found[1], -_GRID, _GRID))
        kept = np.abs(rest) <= max(5.0 * 1.4826 * float(np.median(np.abs(rest))), 1e-5)
    misfit = float(np.sqrt(np.mean(rest[kept] ** 2)))
    covariance = np.linalg.pinv(terms[kept].T @ terms[kept]) * misfit**2
    return lag, math.sqrt(max(float(covariance[1, 1]), 0.0)), misfit, 1.0 + float(found[2])


def _other_cut(time: Array, along: Array, clock: Array, position: Array, misfit: float) -> str:
    """Return the message for a film of another cut."""
    for factor in _OTHER_RATES:
        if _best_lag(time * factor, along, clock, position)[2] < 0.5 * _LARGEST_MISFIT:
            return (
                f"the film runs {1.0 / factor:g} times as long as the record says: its rate is wrong. Give the "
                f"camera's own, --rate: {1.0 / factor:g} times that of the file."
            )
    return (
        f"the blade's motion in the film is not that of the record (they differ by {1e3 * misfit:.1f} mm; it moves "
        f"{1e3 * float(np.ptp(along)):.1f} mm in the film, {1e3 * float(np.ptp(position)):.1f} mm in the record): it "
        "is the record of another cut, or the calibration of another camera."
    )


def _check_gaps(clock: Array, trace: Trace, position: Array) -> None:
    """Raise if the blade moves far while no frame is usable."""
    border = np.concatenate([[trace.time[0]], clock, [trace.time[-1]]])
    at = np.interp(border, trace.time, position)
    k = int(np.argmax(np.abs(np.diff(at))))
    if abs(at[k + 1] - at[k]) > _LONGEST_GAP:
        raise ValueError(
            f"no frame is usable from {1e3 * at[k]:.0f} to {1e3 * at[k + 1]:.0f} mm of the cut ({border[k]:.1f} to "
            f"{border[k + 1]:.1f} s of the record): film the whole cut, without glare or a hidden strip."
        )


_AHEAD, _BESIDE = 14e-3, 7e-3  # reach of the window around the blade along the travel and upright in the image [m]
_POINT_SPACING = 5.0  # of the points that are followed [px]
_WINDOW = 15  # about a point that is compared [px]
_MIN_POINTS = 12  # points
_ASTRAY = 0.5  # of a point that is followed forth and back, from which on it is not trusted [px]
_PACE_STEPS = 3  # steps to either side that tell the tissue's pace
_MIN_LAG, _CLEAR = 0.05e-3, 4.0  # smallest lag behind this pace that is a run [m], and over its scatter [1]
_SLACK = 0.03  # between a run and its drop: time in which the force falls, and error of the lag [s]


class SeenRun(NamedTuple):
    """One run of the crack.

    Middle and length of the time between the frames before and after it, and the step back.
    """

    time: float  # on the record's clock [s]
    interval: float
    step_back: float  # by which the tissue beside the blade fell behind the pace of the blade [m]: a median


@dataclass(frozen=True, kw_only=True)
class RunsAndDrops:
    """Runs of the crack, and sudden drops of the force.

    Each belongs to one of the others at most.
    """

    runs: tuple[SeenRun, ...]  # runs in order of time
    drops: tuple[float, ...]  # times of the drops [s]
    pairs: tuple[tuple[int, int], ...]  # run and drop that happened at the same time, by their numbers

    @property
    def f1(self) -> float:
        """F1 score of matched runs and drops [1]; nan without either."""
        count = len(self.runs) + len(self.drops)
        return 2.0 * len(self.pairs) / count if count else math.nan


class _Seen(NamedTuple):
    time: float
    image: GreyImage
    view: BladeInView


def seen_runs(frames: Iterable[VideoFrame], filmed: FilmedDepth, trace: Trace, width: int) -> tuple[SeenRun, ...]:
    """Find the runs of the crack in a film.

    Points on the tissue beside the blade are followed from one usable frame to the next, in the first camera's image of
    this width [px]. Where their median goes back, by more than the blade itself does and clearly against the pace
    before and after, the crack has run. Two such steps in a row are one run.

    Raises ValueError if the record has no position.
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
    """Return the tissue's runs: begin, end [s] and distance [m]."""
    if len(steps) <= 2 * _PACE_STEPS:
        return ()
    begins, ends, went = np.array(steps).T
    took = ends - begins
    padded = np.pad(went / took, _PACE_STEPS, mode="edge")
    behind = went - took * np.median(sliding_window_view(padded, 2 * _PACE_STEPS + 1), axis=1)
    least = max(_MIN_LAG, _CLEAR * 1.4826 * float(np.median(np.abs(behind))))
    found: list[tuple[float, float, float]] = []
    for k in np.flatnonzero((behind < -least) & (went < 0.0)):
        begin, back = float(begins[k]), -float(behind[k])
        if found and found[-1][1] == begin:
            begin, back = found[-1][0], back + found.pop()[2]
        found.append((begin, float(ends[k]), back))
    return tuple(SeenRun(0.5 * (begin + end), end - begin, back) for begin, end, back in found)


def _tissue_step(before: _Seen, after: _Seen, per_m: Array) -> float | None:
    """Return the tissue's median step along the travel [m], or None."""
    scale = float(np.hypot(*per_m))
    reach = scale * np.array([_AHEAD, _BESIDE])
    axes = [np.arange(-far, far + 1.0, _POINT_SPACING) for far in reach]
    points = (before.view.surface + np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)).astype(np.float32)
    points = points[_beside(points, before)]
    if len(points) < _MIN_POINTS:
        return None
    size = (_WINDOW, _WINDOW)
    there, found, _ = cv2.calcOpticalFlowPyrLK(before.image, after.image, points, None, winSize=size, maxLevel=3)  # type: ignore[call-overload]
    back, again, _ = cv2.calcOpticalFlowPyrLK(after.image, before.image, there, None, winSize=size, maxLevel=3)  # type: ignore[call-overload]
    good = (found.ravel() & again.ravel()).astype(bool) & (np.abs(back - points).max(axis=1) < _ASTRAY)
    good &= _beside(there, after)
    if good.sum() < _MIN_POINTS:
        return None
    return float(np.median((there - points)[good] @ per_m)) / scale**2


def _beside(points: NDArray[np.float32], seen: _Seen) -> NDArray[np.bool_]:
    """Return which points [px], shape (n, 2), show tissue.

    Neither the blade nor its mirror image is tissue.
    """
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
    """Match filmed crack runs with force drops nearest in time."""
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
    """Return mid-times of drops that end loading segments [s]."""
    size = smoothing_readings_of(trace)
    found = []
    for segment in loading_segments(trace):
        if segment.drop > 0.0:
            after = slice(segment.stop, segment.stop + 4 * size)
            top = float(trace.force[max(segment.start, segment.stop - size) : segment.stop].mean())
            fallen = trace.force[after] < top - 0.5 * segment.drop
            found.append(float(trace.time[after][int(np.argmax(fallen)) if fallen.any() else -1]))
    return tuple(found)
