"""Tracks of beads in the tissue, and their registration.

A track is a bead's place over time, in three dimensions, with its uncertainty.

Their movement during each loading ramp of a cut are the increments that the thesis compared (section 7.3).

Registered tracks are in the specimen's frame and on the force record's clock.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import Array, Indices
from cutenv._base.output import atomic_write
from cutenv._base.validation import in_range
from cutenv.records.measurement import ModulusEstimate, Segment
from cutenv.sim.trace import Trace

TRACKS_SCHEMA = "cutenv.bead_tracks/1"  # name and version of the file's columns
TRACK_COLUMNS = ("bead", "time_s", "x_m", "y_m", "z_m", "xx_m2", "xy_m2", "xz_m2", "yy_m2", "yz_m2", "zz_m2")
"""Columns of the file: number of the bead, time, place in the specimen's frame, upper triangle of its covariance."""
_KEY, _METADATA = b"cutenv_schema", b"cutenv_metadata"
_UPPER = np.triu_indices(3)


@dataclass(frozen=True, kw_only=True, eq=False)
class BeadTracks:
    """Bead places over time, one row per bead and frame.

    Parameters
    ----------
    bead : ndarray of int64, shape (n,)
        Number of the bead.
    time : ndarray, shape (n,)
        Time on the clock of the force record [s].
    place : ndarray, shape (n, 3)
        Place in the specimen's frame [m]: across the cut line, along it from the clamp, up from the plate.
    covariance : ndarray, shape (n, 3, 3)
        Covariance of each place [m²].
    metadata : mapping
        What else is known of the tracks, as JSON: calibration, residuals.

    Raises
    ------
    ValueError
        If shapes disagree, a number is not finite, or a bead has two places at one time.
    """

    bead: Indices
    time: Array
    place: Array
    covariance: Array
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = len(self.bead)
        for name, shape in {"bead": (n,), "time": (n,), "place": (n, 3), "covariance": (n, 3, 3)}.items():
            kind = np.int64 if name == "bead" else np.float64
            values = np.array(getattr(self, name), kind)
            if values.shape != shape:
                raise ValueError(f"{name} has shape {values.shape}, but there are {n} rows: give {shape}.")
            if not np.isfinite(values).all():
                row = int(np.argmin(np.isfinite(values).reshape(n, -1).all(axis=1)))
                raise ValueError(f"{name} is not finite in row {row}: leave out what was not located.")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        pairs = np.stack([self.bead, self.time], axis=1)
        if len(np.unique(pairs, axis=0)) < n:
            raise ValueError("a bead has two places at the same time: give one row for each bead and time.")

    @property
    def beads(self) -> list[int]:
        """Numbers of the beads, ascending."""
        return [int(bead) for bead in np.unique(self.bead)]

    def of(self, bead: int) -> BeadTracks:
        """Return the rows of one bead in order of time.

        Raises
        ------
        KeyError
            If there is no such bead.
        """
        rows = np.flatnonzero(self.bead == bead)
        if rows.size == 0:
            raise KeyError(f"there is no bead {bead}; there are {self.beads}.")
        rows = rows[np.argsort(self.time[rows])]
        return replace(self, **{name: getattr(self, name)[rows] for name in ("bead", "time", "place", "covariance")})

    def save(self, path: Path | str) -> None:
        """Write the tracks as Parquet, with :data:`TRACK_COLUMNS`."""
        import pyarrow
        from pyarrow import parquet

        upper = self.covariance[:, *_UPPER]
        values = [self.bead, self.time, *self.place.T, *upper.T]
        table = pyarrow.table(dict(zip(TRACK_COLUMNS, values, strict=True)))
        noted = {_KEY: TRACKS_SCHEMA.encode(), _METADATA: json.dumps(dict(self.metadata)).encode()}
        with atomic_write(Path(path)) as part:
            parquet.write_table(table.replace_schema_metadata(noted), part, write_page_checksum=True)

    @classmethod
    def load(cls, path: Path | str) -> BeadTracks:
        """Read tracks from a Parquet file.

        Raises
        ------
        FileNotFoundError
            If there is no file.
        ValueError
            If it is not such a file, or lacks a column.
        """
        import pyarrow
        from pyarrow import parquet

        try:
            table = parquet.read_table(path, page_checksum_verification=True)
        except FileNotFoundError:  # its own text is the path alone
            raise FileNotFoundError(f"no such file: {path}.") from None
        except (pyarrow.ArrowException, OSError) as error:
            raise ValueError(f"{path} is not a Parquet file, or it is damaged: {error}") from None
        missing = [name for name in TRACK_COLUMNS if name not in table.column_names]
        if missing:
            raise ValueError(f"{path} lacks the columns {', '.join(missing)}; tracks have {', '.join(TRACK_COLUMNS)}.")
        try:
            column = {name: table[name].to_numpy() for name in TRACK_COLUMNS}
            metadata = json.loads((table.schema.metadata or {}).get(_METADATA, b"{}"))
            covariance = np.empty((len(table), 3, 3))
            for row, across, name in zip(*_UPPER, TRACK_COLUMNS[5:], strict=True):
                covariance[:, row, across] = covariance[:, across, row] = column[name]
            place = np.stack([column[name] for name in TRACK_COLUMNS[2:5]], axis=1)
            return cls(
                bead=column["bead"], time=column["time_s"], place=place, covariance=covariance, metadata=metadata
            )
        except (ValueError, TypeError, pyarrow.ArrowException) as error:
            raise ValueError(f"{path}: {error}") from None


FEWEST_FRAMES = 5  # smallest number of frames in which a bead must be seen during a ramp

_UNLOADED = 0.05  # share of the largest force below which the beads count as at rest


@dataclass(frozen=True, kw_only=True, eq=False)
class RampLoad:
    """Load at start and end of a loading ramp, shape (2,)."""

    tip: Array  # tip of the cut [m]; it grows while the blade loads it, if the loading ratio is below 1
    force: Array  # force less friction, on the ramp's line [N]
    displacement: Array  # displacement of the tip, by which the blade leads it [m]
    time: Array
    stiffness: float  # force over displacement [N/m]
    relative_error: float  # standard error of the stiffness over it [1], from the scatter about the ramp's line

    @classmethod
    def of(cls, ramp: Segment, tip: float, relative_error: float, trace: Trace) -> RampLoad:
        """Return the load of a ramp with measured mean tip [m]."""
        middle, slope = ramp.require("position", "slope", by="RampLoad")
        (position,) = trace.require("position", by="RampLoad")
        ends = [ramp.start, ramp.stop - 1]
        x = position[ends]
        force = ramp.force + slope * (x - middle)
        stiffness = ramp.force / max(middle - tip, 1e-6)
        lead = force / stiffness
        return cls(
            tip=np.maximum(x - lead, 0.0),
            force=force,
            displacement=lead,
            time=trace.time[ends],
            stiffness=stiffness,
            relative_error=relative_error,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class BeadRises:
    """Displacements of beads over loading ramps.

    There is one row for each bead in each ramp.
    """

    ramps: list[RampLoad]  # the steady ramps in which a bead was seen
    ramp: Indices  # number of the ramp in `ramps`, and of the bead, shape (n,)
    bead: Indices
    place: Array  # place of the bead before the cut [m], shape (n, 3)
    rise: Array  # displacement [m], shape (n, 3)
    covariance: Array  # its covariance [m2], shape (n, 3, 3)
    flags: tuple[str, ...] = ()  # remarks on what weakens it

    def __len__(self) -> int:
        return len(self.bead)

    def select(self, rows: NDArray[np.bool_], *flags: str) -> BeadRises:
        """Return the rows of a mask, with further flags."""
        kept = {name: getattr(self, name)[rows] for name in ("ramp", "bead", "place", "rise", "covariance")}
        return BeadRises(ramps=self.ramps, flags=(*self.flags, *flags), **kept)


def bead_rises(tracks: BeadTracks, trace: Trace, moduli: ModulusEstimate) -> BeadRises:
    """Find each bead's displacement during every steady loading ramp.

    Over a ramp, a segment of ``moduli``, the blade advances steadily, and force and beads follow. A line of the bead's
    places against the blade's position gives the displacement from start to end; many frames make it much more accurate
    than two. Tracks are on the clock of the record, of the same cut, with position and the force in newtons.

    Raises ValueError if there are no beads, a covariance is none, the times do not overlap, no ramp is steady, or no
    bead was seen in one.
    """
    if not tracks.beads:
        raise ValueError("the tracks hold no bead: nothing was tracked.")
    (position,) = trace.require("position", by="bead_rises")
    first, last = float(tracks.time.min()), float(tracks.time.max())
    if last < trace.time[0] or first > trace.time[-1]:
        raise ValueError(
            f"the tracks run from {first:.3g} to {last:.3g} s and the record from {trace.time[0]:.3g} to "
            f"{trace.time[-1]:.3g} s: they are of different cuts, or their clocks are not in step."
        )
    if not len(moduli):
        raise ValueError("the record has no steady loading ramp: there is no increment to compare the beads in.")
    errors = moduli.relative_error
    loads = [RampLoad.of(s, a, e, trace) for s, a, e in zip(moduli.segments, moduli.position, errors, strict=True)]
    unloaded_until, flags = _unloaded_until(trace), []
    if first > unloaded_until:
        flags.append("tracks begin after the cut did: places of beads are off by what had moved them before")
    rows = []
    _check_covariance(tracks)
    in_order = np.lexsort((tracks.time, tracks.bead))
    blade_at = np.interp(tracks.time, trace.time, position)
    for own in np.split(in_order, np.flatnonzero(np.diff(tracks.bead[in_order])) + 1):
        time, place, blade = tracks.time[own], tracks.place[own], blade_at[own]
        still = np.searchsorted(time, unloaded_until, side="right")
        rest = np.median(place[: max(still, 1)], axis=0)
        for number, load in enumerate(loads):
            seen = slice(*np.searchsorted(time, load.time, side="left"))
            if len(blade[seen]) >= FEWEST_FRAMES:
                travel = float(np.diff(np.interp(load.time, trace.time, position))[0])
                rise, covariance = _along_the_ramp(blade[seen], place[seen], tracks.covariance[own[seen]], travel)
                rows.append((number, tracks.bead[own[0]], rest, rise, covariance))
    if not rows:
        raise ValueError(
            f"no bead was seen in {FEWEST_FRAMES} frames of one loading ramp: of the record's {len(loads)} ramps the "
            f"first runs from {loads[0].time[0]:.3g} to {loads[0].time[1]:.3g} s. Film faster, or cut more slowly."
        )
    ramp, bead, rest, rise, covariance = map(np.array, zip(*rows, strict=True))
    return BeadRises(
        ramps=loads, ramp=ramp, bead=bead, place=rest, rise=rise, covariance=covariance, flags=tuple(flags)
    )


def _check_covariance(tracks: BeadTracks) -> None:
    """Raise for an invalid covariance, or one above a square metre."""
    uncertain = np.linalg.eigvalsh(tracks.covariance)  # ascending
    bad = (uncertain[:, 0] < -1e-9 * np.abs(uncertain[:, -1])) | (uncertain[:, -1] > 1.0)
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(
            f"the covariance of bead {tracks.bead[row]} at {tracks.time[row]:.3g} s is no covariance of a place in "
            "metres: its eigenvalues must lie between 0 and 1 m2."
        )


def _unloaded_until(trace: Trace) -> float:
    """Return the time of the first notable force [s]."""
    force = trace.force - np.median(trace.force[: max(1, len(trace) // 200)])
    return float(trace.time[int(np.argmax(force > _UNLOADED * force.max()))])


def _along_the_ramp(blade: Array, place: Array, covariance: Array, travel: float) -> tuple[Array, Array]:
    """Return displacement over ``travel`` [m] and covariance by a line fit.

    The stated covariance is enlarged along each axis on which the places scatter more than it says.
    """
    x = blade - blade.mean()
    xx = float((x * x).sum())
    slope = x @ place / xx
    residual = place - place.mean(axis=0) - np.outer(x, slope)
    stated = covariance.mean(axis=0)
    scatter = (residual * residual).sum(axis=0) / (len(x) - 2)
    more = np.sqrt(np.maximum(1.0, scatter / np.maximum(np.diag(stated), 1e-18)))
    return slope * travel, stated * np.outer(more, more) * travel**2 / xx


_LEAST_CORRELATION = 0.6
_BAND = 1.5  # s: slower changes are not compared


@dataclass(frozen=True, kw_only=True, eq=False)
class SpecimenFrame:
    """Frame of the specimen.

    X across the cut line, y along it from the clamp, z up from the plate.
    """

    origin: Array  # where the cut line begins at the clamp, on the plate, in the calibration's frame [m], shape (3,)
    axes: Array  # directions of x, y and z in the frame of the calibration, one in each row, shape (3, 3)

    @classmethod
    def of_marks(cls, clamp: ArrayLike, cut_line: ArrayLike, up: ArrayLike) -> SpecimenFrame:
        """Build the frame from marks triangulated in the images [m].

        They are two points of the clamp's edge, on the plate; two of the cut line, the first nearer the clamp; and a
        direction that points up from the plate, roughly.

        Raises ValueError if points coincide, or the cut line is more than 20 degrees off the clamp's normal.
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
        """Return tracks transformed from the calibration's into the specimen's frame."""
        place, covariance = (tracks.place - self.origin) @ self.axes.T, self.axes @ tracks.covariance @ self.axes.T
        return replace(tracks, place=place, covariance=covariance)


def clock_lag(
    frame_time: ArrayLike, motion: ArrayLike, record_time: ArrayLike, force: ArrayLike, largest: float = 2.0
) -> tuple[float, float]:
    """Find the clock lag between video and force record.

    ``motion`` is how far the beads are displaced in each frame, in any unit: the mean displacement along the cut of
    beads near the line. Times are in seconds; lags are tried up to ``largest``.

    Return the lag, which is added to the video's times to get those of the record [s], and the correlation of the quick
    changes of motion and force there [1].

    Raises ValueError if no lag makes them correlate by 0.6: it is the record of another cut, or the frame rate is
    wrong.
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
