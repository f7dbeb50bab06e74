"""A recorded cut, reduced to what a rig can measure."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.validation import array_in_range, one_of

FORCE_UNITS = ("N", "1")
"""Units of force: newtons, or "1" for a record whose force was normalised."""

SPEED_WINDOW = 0.025
"""Time to either side over which speed is the difference of positions, which averages encoder steps [s]."""
_SENSED = ("position", "speed", "angle", "depth")
COMPONENTS_OF_FORCE = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")
"""Fields of a :class:`Trace` for all six components that a force sensor measures, in its own axes [N], [N m]."""
PLACE = ("blade_x", "blade_y")
"""Fields of a :class:`Trace` for the place of a blade that is steered, along and across the slab to the left [m]."""
CHANNELS = ("height", "vertical_force", *COMPONENTS_OF_FORCE, *PLACE, "lateral_force")
"""Fields that a :class:`Trace` may hold beside those of a :class:`Reading`; only scores of depth and path need them."""
_RANGES: dict[str, tuple[float, float, str, str]] = {
    "time": (-1e12, 1e12, "s", "Give seconds."),
    "position": (-0.05, 0.5, "m", "Give metres from the clamp: 5 looks like centimetres, which is 0.05."),
    "speed": (-2.0, 2.0, "m/s", "Give metres per second: 2.54 looks like cm/s, which is 0.0254."),
    "angle": (0.0, np.pi, "rad", "Give radians: 90 looks like degrees, which is math.radians(90)."),
    "depth": (0.0, 0.1, "m", "Give the depth of cut in metres: 2 looks like centimetres, which is 0.02."),
}
_CHANNEL_RANGES: dict[str, tuple[float, float, str, str]] = {
    "height": (-0.2, 0.2, "m", "Give metres, upwards: 2 looks like millimetres, which is 0.002."),
    **dict.fromkeys(PLACE, (-0.5, 0.5, "m", "Give metres from the middle of the clamp: 2 looks like millimetres.")),
    **dict.fromkeys(COMPONENTS_OF_FORCE[3:], (-1e3, 1e3, "N m", "Give newton metres.")),
}
_FORCE_RANGES: dict[str, tuple[float, float, str, str]] = {
    "N": (-1e3, 1e3, "N", 'Give newtons; 2000 looks like millinewtons. Without a unit: force_unit="1".'),
    "1": (-1e9, 1e9, "1", "Give numbers, in whatever one unit the record was normalised to."),
}
# A cut is sampled many times a second; steps as long as this are milliseconds taken for seconds.
_LONGEST_STEP = 0.5  # [s]
_GAP = 10.0  # median steps: a longer step is a gap in the record, over which speed is not integrated
_DISAGREEMENT = 10.0  # a wrong unit is off by 10 or more, a noisy or commanded speed by less
_STILL = 1e-3  # [m] to which noise of the speed may integrate


def limits(name: str, force_unit: str = "N") -> tuple[float, float]:
    """Return a field's accepted range, in SI; force in its unit.

    ValueError if a trace has no such field or unit.
    """
    one_of("force_unit", force_unit, FORCE_UNITS)
    ranges = _ranges(force_unit)
    return ranges[one_of("field", name, ranges)][:2]


def _ranges(force_unit: str) -> dict[str, tuple[float, float, str, str]]:
    """Return every field's least and greatest value, unit and cure."""
    force = _FORCE_RANGES[force_unit]
    forces = ("vertical_force", "lateral_force", *COMPONENTS_OF_FORCE[:3])
    return {"force": force} | _RANGES | dict.fromkeys(forces, force) | _CHANNEL_RANGES


class Reading(NamedTuple):
    """One instant of a cut: what a rig can measure; unknown fields are None."""

    time: float  # [s]
    force: float  # on the blade along the cut line, positive against forward motion; in the trace's force unit
    position: float | None = None  # of the blade from the clamp [m]
    speed: float | None = None  # [m/s]
    angle: float | None = None  # of the blade against the surface [rad]; upright is pi/2
    depth: float | None = None  # of cut at the blade [m]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Trace:
    """A whole cut as recorded: read-only arrays of equal length, SI and radians.

    Parameters
    ----------
    time, force : array_like of shape (n,)
        Time [s], strictly increasing, n is 2 or more; force on the blade along the cut line, positive against forward
        motion [N], -1000 to 1000.
    position, speed, angle, depth : array_like of shape (n,), optional
        Of the blade: from the clamp [m], -0.05 to 0.5; [m/s], -2 to 2 (a sudden run reaches 1), must agree with
        `position` within a factor of 10; against the surface [rad], 0 to pi, upright is pi/2; of cut [m], 0 to 0.1.
    height, vertical_force : array_like of shape (n,), optional
        Of the blade's lower end [m], upwards, as a rig with a height axis counts it, -0.2 to 0.2; of the tissue on the
        blade, upwards [N].
    force_x, force_y, force_z, torque_x, torque_y, torque_z : array_like of shape (n,), optional
        All six components in the sensor's own axes [N], [N m]; all or none. The score uses `force` alone.
    blade_x, blade_y, lateral_force : array_like of shape (n,), optional
        Place of a steered blade along and across the slab, from the middle of the clamp, to the left [m], -0.5 to 0.5,
        both or none; force of the tissue on it to its right, across its own direction [N]. `position` is then the
        length along the line, at the blade.
    force_unit : {"N", "1"}
        "1": the force is normalised, and nothing that needs newtons can be computed from the trace.
    metadata : mapping
        Additional information by name, JSON-serialisable; stored as JSON returns it.

    Raises
    ------
    TypeError, ValueError
        If a field is not an array of numbers, or the metadata cannot be serialised to JSON; if a value is not finite or
        looks like another unit, lengths differ, or time does not increase.

    Examples
    --------
    >>> trace = Trace(time=[0.0, 0.001, 0.002], force=[0.0, 0.1, 0.2])
    >>> len(trace), trace[1].force
    (3, 0.1)
    >>> trace.require("depth", by="score")
    Traceback (most recent call last):
    ...
    ValueError: score needs depth, which this trace does not hold; it holds time, force.
    """

    time: NDArray[np.float64]
    force: NDArray[np.float64]
    position: NDArray[np.float64] | None = None
    speed: NDArray[np.float64] | None = None
    angle: NDArray[np.float64] | None = None
    depth: NDArray[np.float64] | None = None
    height: NDArray[np.float64] | None = None
    vertical_force: NDArray[np.float64] | None = None
    force_x: NDArray[np.float64] | None = None
    force_y: NDArray[np.float64] | None = None
    force_z: NDArray[np.float64] | None = None
    torque_x: NDArray[np.float64] | None = None
    torque_y: NDArray[np.float64] | None = None
    torque_z: NDArray[np.float64] | None = None
    blade_x: NDArray[np.float64] | None = None
    blade_y: NDArray[np.float64] | None = None
    lateral_force: NDArray[np.float64] | None = None
    force_unit: str = "N"
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        one_of("force_unit", self.force_unit, FORCE_UNITS)
        for name, limits in _ranges(self.force_unit).items():
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, _column(name, values, limits))
        for name in self.known:
            values = getattr(self, name)
            if values.shape != self.time.shape:
                raise ValueError(
                    f"{name} has {len(values)} values and time has {len(self.time)}. Give one per instant."
                )
        if 0 < len(held := [name for name in COMPONENTS_OF_FORCE if getattr(self, name) is not None]) < 6:
            raise ValueError(f"of the six components it holds {', '.join(held)} only. Give all six, or none.")
        if (self.blade_x is None) != (self.blade_y is None):
            raise ValueError("of blade_x and blade_y it holds one only. Give both, or none.")
        _check_time(self.time)
        if self.speed is not None and self.position is not None:
            _check_speed(self.time, self.position, self.speed)
        object.__setattr__(self, "metadata", _json_copy(self.metadata))

    @classmethod
    def from_readings(
        cls, readings: Iterable[Reading], *, force_unit: str = "N", metadata: Mapping[str, Any] | None = None
    ) -> Trace:
        """Collect two or more readings, in order of time, into a trace.

        A field is known if every reading has it.  ValueError if one is known to some readings only, or for the same
        reasons as in `Trace`.
        """
        columns = {
            name: list(values) for name, values in zip(Reading._fields, zip(*readings, strict=True), strict=False)
        }
        for name in _SENSED:
            unknown = sum(value is None for value in columns.get(name, ()))
            if unknown == len(columns.get(name, ())):
                columns[name] = None  # type: ignore[assignment]
            elif unknown:
                raise ValueError(f"{name} is None in {unknown} readings, but not in all. Leave these out.")
        return cls(
            time=columns.get("time", []),  # type: ignore[arg-type]
            force=columns.get("force", []),  # type: ignore[arg-type]
            **{name: columns[name] for name in _SENSED},  # type: ignore[arg-type]
            force_unit=force_unit,
            metadata=metadata or {},
        )

    @property
    def known(self) -> tuple[str, ...]:
        """Names of fields in the trace, including time and force."""
        return tuple(name for name in (*Reading._fields, *CHANNELS) if getattr(self, name) is not None)

    @property
    def wrench(self) -> NDArray[np.float64] | None:
        """Three forces [N] and torques [N m], (n, 6), or None."""
        if self.force_x is None:
            return None
        return np.column_stack([getattr(self, name) for name in COMPONENTS_OF_FORCE])

    @property
    def duration(self) -> float:
        """Time from the first reading to the last [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def sample_rate(self) -> float:
        """Mean number of readings a second [Hz]."""
        return (len(self) - 1) / self.duration

    @functools.cached_property
    def blade_speed(self) -> NDArray[np.float64]:
        """Speed [m/s] by :func:`blade_speed`, shape (n,), read-only; needs positions."""
        speed = blade_speed(self.time, *self.require("position", by="blade_speed"))
        speed.setflags(write=False)
        return speed

    def require(self, *names: str, by: str) -> tuple[NDArray[np.float64], ...]:
        """Return the named fields, shape (n,) each, in the order of the names.

        ValueError, which says who needs them (``by``), if the trace lacks one, or there is no such field.
        """
        for name in names:
            one_of("field", name, (*Reading._fields, *CHANNELS))
        missing = [name for name in names if getattr(self, name) is None]
        if missing:
            raise ValueError(
                f"{by} needs {' and '.join(missing)}, which this trace does not hold; it holds {', '.join(self.known)}."
            )
        return tuple(getattr(self, name) for name in names)

    def require_newtons(self, *, by: str) -> NDArray[np.float64]:
        """Return the force [N], shape (n,).

        ValueError, which says who needs it (``by``), if the force is normalised (`force_unit` "1").
        """
        if self.force_unit != "N":
            raise ValueError(
                f'{by} needs force in newtons (force_unit "N"), but this trace has force_unit '
                f'"{self.force_unit}". Multiply by the force that it was normalised with, if that is known.'
            )
        return self.force

    def select(self, which: slice | ArrayLike) -> Trace:
        """Return a part of the trace, for example ``trace.select(slice(0, 120))``.

        ``which`` may also be a mask, or indices in order of time.  ValueError if fewer than 2 instants remain, a mask
        has another length, or time no longer increases.
        """
        index = which if isinstance(which, slice) else np.asarray(which)
        if isinstance(index, np.ndarray) and index.dtype == np.bool_ and index.shape != self.time.shape:
            raise ValueError(f"a mask of shape {index.shape} does not fit a trace of {len(self)} instants.")
        columns = {name: getattr(self, name)[index] for name in self.known}
        return Trace(**columns, force_unit=self.force_unit, metadata=self.metadata)

    def with_metadata(self, metadata: Mapping[str, Any]) -> Trace:
        """Return the same readings, not checked again, with other metadata.

        TypeError if the metadata cannot be serialised to JSON.
        """
        copy = object.__new__(Trace)
        copy.__dict__.update(self.__dict__, metadata=_json_copy(metadata))
        return copy

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, i: int) -> Reading:
        values = (getattr(self, name) for name in Reading._fields)
        return Reading(*(None if column is None else float(column[i]) for column in values))  # type: ignore[arg-type]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Trace):
            return NotImplemented
        return (
            (self.known, self.force_unit) == (other.known, other.force_unit)
            and all(np.array_equal(getattr(self, name), getattr(other, name)) for name in self.known)
            and self.metadata == other.metadata
        )

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        known = ", ".join(self.known)
        return f"Trace({known}; {len(self)} instants in {self.duration:g} s, force_unit={self.force_unit!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        # Rebuilt through the constructor, so that a copy's arrays are read-only too.
        return functools.partial(Trace, **{f.name: getattr(self, f.name) for f in fields(self)}), ()


def blade_speed(time: NDArray[np.float64], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return speed [m/s], (n,), by differences over 50 ms or two samples."""
    n = len(time)
    half = max(1, round(SPEED_WINDOW * (n - 1) / float(time[-1] - time[0])))
    before = np.maximum(np.arange(n) - half, 0)
    after = np.minimum(np.arange(n) + half, n - 1)
    return np.asarray((position[after] - position[before]) / (time[after] - time[before]))


def _column(name: str, values: ArrayLike, limits: tuple[float, float, str, str]) -> NDArray[np.float64]:
    low, high, unit, cure = limits
    column = array_in_range(name, values, low, high, unit, cure)
    if column.ndim != 1:
        raise ValueError(f"{name} has shape {column.shape}; give one value per instant, shape (n,).")
    column = column.copy()
    column.setflags(write=False)
    return column


def _check_time(time: NDArray[np.float64]) -> None:
    if len(time) < 2:
        raise ValueError(f"a trace has 2 instants or more, got {len(time)}.")
    step = np.diff(time)
    if not (step > 0).all():
        i = int(np.argmin(step > 0))
        raise ValueError(
            f"time must increase strictly, but goes from {time[i]:g} s to {time[i + 1]:g} s at instant "
            f"{i + 1}. Sort the record, and drop repeated instants."
        )
    if np.median(step) > _LONGEST_STEP:
        raise ValueError(
            f"time steps by {np.median(step):g} s, more than {_LONGEST_STEP} s. Give seconds: it looks like "
            "milliseconds; divide it by 1000."
        )


def _check_speed(time: NDArray[np.float64], position: NDArray[np.float64], speed: NDArray[np.float64]) -> None:
    """Raise if integrated speed and positions differ tenfold, by a wrong unit."""
    step = np.diff(time)
    steady = step <= _GAP * np.median(step)
    by_speed = float(np.ptp(np.cumsum(np.append(0.0, (0.5 * (speed[1:] + speed[:-1]) * step)[steady]))))
    by_position = float(np.ptp(np.cumsum(np.append(0.0, np.diff(position)[steady]))))
    low, high = sorted((by_speed, by_position))
    if high > _DISAGREEMENT * low + _STILL:
        raise ValueError(
            f"speed and position disagree: integrated, the speed spans {by_speed:g} m and the position "
            f"{by_position:g} m. Give both in SI: position in m, speed in m/s (1 cm/s is 0.01)."
        )


class _Copied(dict[str, Any]):
    """Metadata that a trace has copied.

    Traces made of that trace share their values: to copy a person's movements anew took half the time of a score.
    """


def _json_copy(metadata: Mapping[str, Any]) -> dict[str, Any]:
    if isinstance(metadata, _Copied):
        return _Copied(metadata)
    if not isinstance(metadata, Mapping):
        raise TypeError(f"metadata must map names to values, got {metadata!r}.")
    copy = _Copied()
    for name, value in metadata.items():
        if not isinstance(name, str):
            raise TypeError(f"metadata names are strings, got {name!r}.")
        try:
            copy[name] = json.loads(json.dumps(value, allow_nan=False))
        except (TypeError, ValueError) as error:
            raise TypeError(
                f"metadata[{name!r}] = {value!r} is not what JSON can hold ({error}). "
                "Give text, finite numbers, booleans, None, lists or dicts of these; for arrays .tolist()."
            ) from None
    return copy
