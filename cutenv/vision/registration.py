"""Bead tracks in the specimen's frame and on the force record's clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.vision.bead_tracks import BeadTracks

_LEAST_CORRELATION = 0.6
_BAND = 1.5  # s: slower changes are not compared


@dataclass(frozen=True, kw_only=True, eq=False)
class SpecimenFrame:
    """Frame of the specimen: x across the cut line, y along it from the clamp, z up from the plate.

    Parameters
    ----------
    origin : ndarray, shape (3,)
        Where the cut line begins at the clamp, on the plate, in the frame of the calibration [m].
    axes : ndarray, shape (3, 3)
        Directions of x, y and z in the frame of the calibration, one in each row.
    """

    origin: Array
    axes: Array

    @classmethod
    def of_marks(cls, clamp: ArrayLike, cut_line: ArrayLike, up: ArrayLike) -> SpecimenFrame:
        """Build the frame from marks triangulated in the images.

        Parameters
        ----------
        clamp : array_like, shape (2, 3)
            Two points of the clamp's edge, on the plate [m].
        cut_line : array_like, shape (2, 3)
            Two points of the cut line, the first nearer the clamp [m].
        up : array_like, shape (3,)
            A direction that points up from the plate, roughly.

        Raises
        ------
        ValueError
            If points coincide, or the cut line is more than 20 degrees off the clamp's normal.
        """
        edge, line = np.asarray(clamp, float), np.asarray(cut_line, float)
        if edge.shape != (2, 3) or line.shape != (2, 3) or not (np.isfinite(edge).all() and np.isfinite(line).all()):
            raise ValueError("clamp and cut_line are two points of three finite coordinates each [m].")
        along, across = line[1] - line[0], edge[1] - edge[0]
        if min(np.linalg.norm(along), np.linalg.norm(across)) < 1e-3:
            raise ValueError("two marks of the clamp or of the cut line are less than 1 mm apart.")
        y, across = along / np.linalg.norm(along), across / np.linalg.norm(across)
        if abs(float(y @ across)) > np.sin(np.radians(20.0)):
            raise ValueError("the cut line is more than 20 degrees off the clamp's normal: which marks are they?")
        z = np.cross(across, y)
        z = z / np.linalg.norm(z) * (1.0 if float(z @ np.asarray(up, float)) >= 0.0 else -1.0)
        x = np.cross(y, z)
        # The point of the cut line's direction that the clamp's edge passes, in the plane of both.
        to_clamp = float((edge[0] - line[0]) @ np.cross(across, z)) / float(y @ np.cross(across, z))
        origin = line[0] + to_clamp * y
        origin = origin + float((edge.mean(axis=0) - origin) @ z) * z
        return cls(origin=origin, axes=np.stack([x, y, z]))

    def register(self, tracks: BeadTracks) -> BeadTracks:
        """Return tracks of the calibration's frame in the specimen's frame, covariances turned along."""
        return BeadTracks(
            bead=tracks.bead,
            time=tracks.time,
            place=(tracks.place - self.origin) @ self.axes.T,
            covariance=self.axes @ tracks.covariance @ self.axes.T,
            metadata=tracks.metadata,
        )


def clock_lag(
    frame_time: ArrayLike, motion: ArrayLike, record_time: ArrayLike, force: ArrayLike, largest: float = 2.0
) -> tuple[float, float]:
    """Find how far the force record's clock is ahead of the video's: where motion and force rise and fall together.

    Parameters
    ----------
    frame_time, motion : array_like, shape (n,)
        Times of the frames on the video's clock [s], and how far the beads are displaced in each, in any unit: the mean
        displacement along the cut of beads near the line.
    record_time, force : array_like, shape (m,)
        The force record [s], [N].
    largest : float
        Largest lag that is tried [s].

    Returns
    -------
    lag : float
        Add it to the video's times to get those of the record [s].
    correlation : float
        Correlation of the quick changes of motion and force there [1].

    Raises
    ------
    ValueError
        If no lag makes them correlate by 0.6: it is the record of another cut, or the frame rate is wrong.
    """
    t, u, when, f = (np.asarray(each, float).ravel() for each in (frame_time, motion, record_time, force))
    largest = in_range("largest", largest, 1e-3, 1e3, "s")
    if len(t) != len(u) or len(when) != len(f) or len(t) < 20 or len(when) < 20:
        raise ValueError("motion and force need 20 values or more, each with a time.")
    if not all(np.isfinite(each).all() for each in (t, u, when, f)):
        raise ValueError("times, motion and force are finite numbers.")
    step = float(np.median(np.diff(t)))
    smooth = np.convolve(f, np.ones(width := max(1, round(step / float(np.median(np.diff(when)))))) / width, "same")
    window = max(5, round(_BAND / step))

    def quick(values: Array) -> Array:
        # What is slow goes with the length of the cut, in one way or another; ramps and runs tell the time.
        slow = np.convolve(np.pad(values, window, mode="edge"), np.ones(window) / window, "same")[window:-window]
        return values - slow

    def agreement(lag: float) -> float:
        inside = (t + lag >= when[0]) & (t + lag <= when[-1])
        if inside.sum() < max(0.5 * len(t), 20):
            return -1.0
        a, b = quick(u[inside]), quick(np.interp(t[inside] + lag, when, smooth))
        spread = float(a.std() * b.std())
        return float(((a - a.mean()) * (b - b.mean())).mean()) / spread if spread > 0.0 else -1.0

    lags = np.arange(-largest, largest + step / 8, step / 4)
    found = np.array([agreement(float(lag)) for lag in lags])
    best = int(found.argmax())
    if found[best] < _LEAST_CORRELATION:
        raise ValueError(
            f"motion and force correlate by {found[best]:.2f} at best, within {largest:g} s: "
            "is it the record of another cut, or the frame rate wrong?"
        )
    shift = 0.0
    if 0 < best < len(lags) - 1:
        before, here, after = found[best - 1 : best + 2]
        bend = before - 2.0 * here + after
        shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return float(lags[best] + shift * step / 4), float(found[best])
