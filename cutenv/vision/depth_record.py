"""Depth of cut over a record: the film aligned with the record by the blade's motion, and its depths put into it."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv._base.validation import one_of
from cutenv.measurement.depth import DEPTH_SD_KEY
from cutenv.trace import Trace
from cutenv.vision.blade_mark import MarkedBlade
from cutenv.vision.cameras import angle_between
from cutenv.vision.marked_blade import BladeInSpace, DepthFrame

TRAVELS = ("right", "left")
"""Ways in which the blade can go in the images when it cuts."""
FEWEST_FILMED = 10
"""Least number of usable frames."""
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
    """Position of a film in time and place on a record.

    Attributes
    ----------
    lag, lag_sd : float
        Time on the record's clock at the film's time 0, and its standard error [s].
    misfit : float
        Root mean square distance between the blade's motion in film and record [m].
    angle : float
        Angle between the blade and its travel, from the images [rad].
    """

    lag: float
    lag_sd: float
    misfit: float
    angle: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmedDepth:
    """Depth of cut in the usable frames, on the record's clock.

    Attributes
    ----------
    time : array, shape (n,)
        Time of each usable frame on the record's clock [s].
    along, along_sd : array, shape (n,)
        Length of the blade in the tissue, along the blade, and its standard error [m].
    vertical, vertical_sd : array, shape (n,)
        Depth of cut, at right angles to the travel, and its standard error [m]: along times the sine of the angle.
    sd : float
        Standard deviation of the depth of a frame: from the frames' standard errors, or their scatter if it is larger.
    frames : tuple of DepthFrame
        All frames; what is left out has its reason.
    alignment : FilmAlignment
        How the film lies on the record.
    """

    time: Array
    along: Array
    along_sd: Array
    vertical: Array
    vertical_sd: Array
    sd: float
    frames: tuple[DepthFrame, ...]
    alignment: FilmAlignment

    @property
    def left_out(self) -> dict[str, int]:
        """Number of frames left out, by reason, most frequent first."""
        return dict(Counter(frame.reason for frame in self.frames if frame.blade is None).most_common())

    def onto(self, trace: Trace) -> Trace:
        """Return the record with the vertical depth, interpolated in time, and what is known of it in the metadata."""
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
    """Align measured frames with the record of the same cut, and return the depth of cut.

    Parameters
    ----------
    frames : sequence of DepthFrame
        All frames of the film in order of time.
    trace : Trace
        Record with position, and angle if the rig knows it.
    blade : MarkedBlade
        Blade in the film.
    travel : {"right", "left"}
        Way in which the blade goes in the images when its position grows; tells mirrored and turned images.

    Raises
    ------
    ValueError
        If fewer than :data:`FEWEST_FILMED` are usable, the record lacks position, its motion or angle is not that of
        the film, or the blade moves far without a usable frame.
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
    """Return which frames agree with those nearest in place, forward or back: with the line by Theil and Sen."""
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
    """Return how far the strip went along the line of its travel, shape (n,) [m], and the line's direction."""
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
    """Return lag, sign of the motion and misfit of the best of a grid of lags."""
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
    """Return lag, its standard error, misfit and scale by Gauss-Newton steps from a lag that is nearly right."""
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
    """Return the message for a film whose motion is not that of the record."""
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
