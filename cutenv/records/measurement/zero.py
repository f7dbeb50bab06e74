"""Sensor zero: reading at rest outside the tissue.

An offset of 0.2 N is a quarter of the friction on a blade 2 cm deep: it distorts friction, modulus and resistance.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv.records.measurement.depth import DepthProfile
from cutenv.records.measurement.strokes import fit_return_stroke
from cutenv.sim.trace import Trace

_Mean = tuple[float, float]  # mid-time [s] and mean [N] of a rest

TAKEN_OFF = "zero_taken_off_N"
"""Key in a trace's metadata for the zero that :func:`zeroed` has subtracted, so that it is subtracted only once."""
TARED = "tare_N"
"""Key in a trace's metadata for a tare that was subtracted when the trace was read, or while it was recorded."""
_RIG_ZERO = "zero_N"  # key for the axes' zeros in air, which a rig has subtracted
NOTABLE = 0.05  # smallest offset that is reported [N]: the resolution of the thesis's sensor (section 3.1)
_MIN_READINGS, _MIN_REST = 10, 0.1  # smallest number of readings, and duration [s], of a rest
_BEFORE_MOTION, _AFTER_MOTION = 0.01, 0.05  # [s] of a rest left out: filters look ahead, sensors respond late
_STANDS = 1e-6  # [m], tolerance of a standing blade's position, if it has no noise
_NOISE = 5.0  # standard deviations of noise beyond which a change is significant
_STEADY = 0.02  # [N] by which the halves of a rest may differ, whatever the noise
_MAX_OFFSET_ERROR = 2.0 * NOTABLE  # standard error [N] of a constant on the way back, above which it is not used
_RETURNED = 1e-3  # [m], largest distance from the start at which a blade has come back
_SHALLOW_SHARE, _SHALLOW = 0.1, 2e-3  # share of the greatest depth, and [m]: friction there is small
_LET_GO = 0.5  # share of the friction on the way back by which the force must rise where the blade is released
_ROUNDS = 6  # iterations for friction and zero in turn; each at least halves the error
_SLIDING = 0.5e-3  # [m] of the way back over which the force before the stop is averaged


@dataclass(frozen=True, kw_only=True)
class SensorZero:
    """Sensor reading without force on the blade [N], or None.

    Attributes
    ----------
    before, after : float or None
        Mean readings of the rests before and after the cut.
    return_stroke : float or None
        Constant part of the force on the way back, if there was no rest out of the tissue.
    tared : bool
        True if the record was tared already, by its metadata.
    """

    before: float | None = None
    after: float | None = None
    return_stroke: float | None = None
    tared: bool = False

    @property
    def is_known(self) -> bool:
        """True if the record determines the zero."""
        return self.tared or any(value is not None for value in (self.before, self.after, self.return_stroke))

    @property
    def largest(self) -> float:
        """The subtracted value farthest from 0 [N]."""
        return max((v for v in (self.before, self.after, self.return_stroke) if v is not None), key=abs, default=0.0)

    @property
    def flags(self) -> tuple[str, ...]:
        """Remarks on an unknown or large zero, else empty."""
        if not self.is_known:
            return ("the sensor's zero is not seen: no rest out of the tissue before or after; force as recorded",)
        if abs(self.largest) < NOTABLE:
            return ()
        if self.return_stroke is not None:
            return (f"{self.return_stroke:.2f} N taken off the force: its constant part on the way back",)
        seen = (("before", self.before), ("after", self.after))
        means = " and ".join(f"{value:.2f} N {when}" for when, value in seen if value is not None)
        return (f"the sensor's zero taken off the force: at rest it shows {means} the cut",)


def zeroed(trace: Trace) -> tuple[Trace, SensorZero]:
    """Subtract the sensor's zero from a record's force.

    The zero is the mean force while the blade rests out of the tissue for 0.1 s or more: before it first moves, and
    after it has come back to where it began. A line between both means, constant beyond them, removes drift too; a
    single rest gives a constant. Without either, if the record has a return stroke past the tip along which depth
    varies, the constant part of the force there is the zero (:func:`~cutenv.records.measurement.fit_return_stroke`), if
    it is larger than 0.05 N and than three of its standard errors.

    A blade that presses on tissue from the first reading cannot be distinguished from an offset. Friction may hold a
    blade that rests in tissue: after the cut, a rest counts where the depth is at most 2 mm or a tenth of the
    greatest, less the friction on the way back if the force did not rise by it as the blade stopped; elsewhere only
    if the force is not lower than at the rest before by more than it rose.

    Parameters
    ----------
    trace : Trace
        Record with position; with depth where it is known. Force in newtons.

    Returns
    -------
    Trace
        The same record, its force less the zero; its metadata ``zero_taken_off_N`` contain what was subtracted, so
        that a second call subtracts nothing.
    SensorZero
    """
    (position,) = trace.require("position", by="zeroed")
    tared = TARED in trace.metadata or _RIG_ZERO in trace.metadata
    if TAKEN_OFF in trace.metadata:
        return trace, SensorZero(**trace.metadata[TAKEN_OFF], tared=tared)
    before = _mean_at_rest(trace, _rest(trace, position, at_end=False), at_end=False)
    after = _after(trace, position, before)
    constant = None
    offset: Array | float
    if before is not None or after is not None:
        offset = _line(trace.time, before, after)
    else:
        constant = None if tared or trace.depth is None else _on_the_way_back(trace)
        offset = constant or 0.0
    zero = SensorZero(
        before=None if before is None else before[1],
        after=None if after is None else after[1],
        return_stroke=constant,
        tared=tared,
    )
    taken = {f.name: getattr(zero, f.name) for f in dataclasses.fields(zero) if f.name != "tared"}
    metadata = {**trace.metadata, TAKEN_OFF: taken}
    return dataclasses.replace(trace, force=trace.force - offset, metadata=metadata), zero


def _rest(trace: Trace, position: Array, *, at_end: bool) -> slice:
    """Return readings before the first motion, or after the last."""
    x = position[::-1] if at_end else position
    least = _least(trace)
    noise = float(np.diff(x[:least]).std()) / np.sqrt(2.0)
    away = np.abs(x - np.median(x[:least])) > max(_STANDS, _NOISE * noise)
    left_out = round((_AFTER_MOTION if at_end else _BEFORE_MOTION) * trace.sample_rate)
    count = (int(np.argmax(away)) if away.any() else 0) - left_out  # a blade that never moves cuts nothing
    if count < least:
        return slice(0, 0)
    return slice(len(x) - count, len(x)) if at_end else slice(0, count)


def _least(trace: Trace) -> int:
    return max(_MIN_READINGS, round(_MIN_REST * trace.sample_rate))


def _mean_at_rest(trace: Trace, rest: slice, *, at_end: bool) -> _Mean | None:
    """Return mid-time [s] and mean [N] of steady rest, or None."""
    while rest.stop - rest.start >= _least(trace):
        F, middle = trace.force[rest], (rest.start + rest.stop) // 2
        first, last = (float(half.mean()) for half in np.array_split(F, 2))
        noise = float(np.sqrt(np.mean(np.diff(F) ** 2) / 2.0))
        if abs(last - first) <= max(_STEADY, 2.0 * _NOISE * noise / np.sqrt(len(F))):
            return float(trace.time[rest].mean()), float(F.mean())
        rest = slice(middle, rest.stop) if at_end else slice(rest.start, middle)  # away from the motion
    return None


def _line(time: Array, *rests: _Mean | None) -> Array:
    """Return the zero at every instant, linear between rests [N]."""
    return np.asarray(np.interp(time, *np.transpose([rest for rest in rests if rest is not None])))


def _after(trace: Trace, position: Array, before: _Mean | None) -> _Mean | None:
    """Return the zero after a cut, None if friction hides it.

    It is also None if the blade did not come back.
    """
    rest = _rest(trace, position, at_end=True)
    mean = _mean_at_rest(trace, rest, at_end=True)
    here = float(position[rest].mean()) if mean is not None else np.inf
    if mean is None or here > float(position[: _least(trace)].mean()) + _RETURNED:
        return None
    way = np.abs(position[: rest.start] - here)
    sliding = trace.force[: rest.start][(way > _STANDS) & (way < _SLIDING)][-_least(trace) :]
    if not len(sliding):
        return None
    rise = mean[1] - float(sliding.mean())
    if trace.depth is not None:
        B = float(trace.depth[rest].mean())
        if max(_SHALLOW, _SHALLOW_SHARE * float(trace.depth.max())) >= B:
            return mean[0], mean[1] + _held(trace, before, mean, rise, B)
    return mean if before is not None and before[1] - mean[1] < rise else None


def _held(trace: Trace, before: _Mean | None, after: _Mean, rise: float, B: float) -> float:
    """Return friction holding the blade after a cut [N].

    The tissue is ``B`` [m] deep. The friction is 0 if the force rose by the friction when the blade stopped. If
    ``rise`` [N] is less than half of that, the rest is taken from friction on the way back, which depends on the zero
    in turn, but less: the way back is deeper.
    """
    profile, held = DepthProfile.recorded(trace, by="zeroed"), 0.0
    for number in range(_ROUNDS):
        force = trace.force - _line(trace.time, before, (after[0], after[1] + held))
        back = fit_return_stroke(dataclasses.replace(trace, force=force), profile)
        if back is None or (number == 0 and rise >= _LET_GO * back.friction_per_depth * B):
            return 0.0
        held = max(back.friction_per_depth * B - rise, 0.0)
    return held


def _on_the_way_back(trace: Trace) -> float | None:
    """Return the return stroke's constant force [N], None if hidden.

    The force is 0 if negligible.
    """
    back = fit_return_stroke(trace, DepthProfile.recorded(trace, by="zeroed"), with_offset=True)
    if back is None or back.offset_error > _MAX_OFFSET_ERROR:
        return None
    if abs(back.offset) > max(NOTABLE, 3.0 * back.offset_error):
        return back.offset
    return 0.0 if back.offset_error <= NOTABLE else None
