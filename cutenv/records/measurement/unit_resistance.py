"""Fracture resistance of single units, by unloading probes between them.

A probe goes back some millimetres and returns to where it turned. It is elastic: the force falls along a line that
ends at the crack tip, so the area between the lines of two probes is the energy of the crack growth between them
(thesis, section 2.4.2 and Figure 2.4). Neither loading ratio nor modulus is needed.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.records.measurement.depth import DepthProfile
from cutenv.records.measurement.segments import SMALLEST_DROP
from cutenv.records.measurement.strokes import Stroke, bin_means, bins_of_travel, fit_return_stroke, strokes
from cutenv.records.measurement.zero import zeroed
from cutenv.sim.quantities import MEASURABLE_DEPTH
from cutenv.sim.trace import Trace

_BIN = 0.1e-3  # [m] of travel
_TURNING = 0.3e-3  # [m] next to the turn, where the blade changes its speed and friction its sign
_MIN_BINS = 5  # smallest number of bins of a line
_LOADED = 0.15  # share of the elastic force at the turn below which the line may have ended at the tip


@dataclass(frozen=True, kw_only=True, eq=False)
class UnitResistances:
    """Fracture resistance between successive probes, arrays of shape (n_units,).

    Attributes
    ----------
    start, end : ndarray
        Crack tip at the probes before and after the unit [m].
    area : ndarray
        Area cut between them [m2].
    resistance : ndarray
        Fracture resistance [J/m2], friction's share included, as in ``FractureEstimate.corrected``.
    friction_per_depth : float
        Friction on the blade per depth of cut [N/m].
    flags : tuple of str
        Remarks on what weakens the estimate; empty if nothing does.
    """

    start: Array
    end: Array
    area: Array
    resistance: Array
    friction_per_depth: float
    flags: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.area)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Probe:
    """Retreat from reading ``turn`` and return by ``again``, on common positions."""

    turn: int
    again: int
    position: Array  # [m]
    mean: Array  # of both forces, in which friction cancels [N]
    half_difference: Array  # of both forces, which is friction [N]


@dataclass(frozen=True, kw_only=True)
class _Unloaded:
    """State of the cut at a probe, with tip and energy."""

    turn: int
    again: int
    tip: float
    stored: float


def estimate_unit_resistances(trace: Trace, *, friction_per_depth: float | None = None) -> UnitResistances:
    """Find the fracture resistance R between successive probes.

    The elastic line of a probe is the mean of the forces on its way back and forth, in which friction cancels; half
    their difference is friction. The line ends at the tip a, and the energy stored at the turn is the triangle below
    it, U = F (x - a)/2. Between two turns R dA = W - phi * integral of B |dx| + U_1 - U_2, the area OLMN of Figure 2.4,
    and dA is the integral of B from tip to tip. The first unit begins at the start of the record, unloaded; the last
    ends with the return stroke past the tip, if there is one.

    Parameters
    ----------
    trace : Trace
        Record with position and depth, from the start of the cut; force in newtons, less the sensor's zero
        (:func:`~cutenv.records.measurement.zeroed` subtracts it).
    friction_per_depth : float, optional
        phi [N/m], 0 to 1e5; by default from the probes.

    Returns
    -------
    UnitResistances
        Without units if there is no probe of 1.2 mm or more under load that returns to its turn.

    Raises
    ------
    ValueError
        If the trace lacks position, depth or newtons, or the argument is out of range.

    Notes
    -----
    Equations 2.1 to 2.6 of the thesis: with C = 1/K and the residual displacement u_r = a of an unloaded blade, they
    are this balance. A unit begins and ends where the blade was turned: probe in the same phase of each unit, best just
    after its drop of force. Energy that growth borrows from one unit and returns in the next shows as scatter between
    neighbours. A sensor's delay lowers the measured friction, by 3 % at 10 ms and probes of 4 mm/s.
    """
    by = "estimate_unit_resistances"
    trace.require_newtons(by=by)
    (position,) = trace.require("position", by=by)
    depth = DepthProfile.recorded(trace, by=by)
    trace, zero = zeroed(trace)
    way_back = fit_return_stroke(trace, depth)
    moved = strokes(trace)
    probes = _probes(trace, position, moved)
    if friction_per_depth is not None:
        phi = in_range("friction_per_depth", friction_per_depth, 0.0, 1e5, "N/m")
    elif probes:
        B = np.concatenate([depth.at(probe.position) for probe in probes])
        phi = max(float(B @ np.concatenate([probe.half_difference for probe in probes]) / (B @ B)), 0.0)
    else:
        phi = 0.0
    states = [_Unloaded(turn=0, again=0, tip=float(position[0]), stored=0.0)]
    states += [state for probe in probes if (state := _unloaded(probe, position)) is not None]
    if way_back is not None and probes:
        stop = way_back.stop - 1
        states.append(_Unloaded(turn=stop, again=stop, tip=way_back.tip, stored=0.0))
    F = trace.force
    work = np.concatenate(([0.0], np.cumsum(0.5 * (F[1:] + F[:-1]) * np.diff(position))))
    rubbed = _rubbed(position, depth, moved)
    units = []
    for first, last in itertools.pairwise(states):
        area = depth.area(first.tip, last.tip) if last.tip > first.tip else 0.0
        if area < MEASURABLE_DEPTH * MEASURABLE_DEPTH:
            continue  # nothing was cut between them
        spent = work[last.turn] - work[first.again] - phi * (rubbed[last.turn] - rubbed[first.again])
        units.append((first.tip, last.tip, area, (spent + first.stored - last.stored) / area + phi))
    start, end, areas, resistance = np.array(units).reshape(-1, 4).T
    return UnitResistances(
        start=start, end=end, area=areas, resistance=resistance, friction_per_depth=phi, flags=zero.flags
    )


def _probes(trace: Trace, position: Array, moved: list[Stroke]) -> list[_Probe]:
    """Return retreats from new ground that return to their turn."""
    found = []
    for i, stroke in enumerate(moved):
        turn = int(np.argmax(position[: stroke.stop]))
        if stroke.forward or turn < (moved[i - 1].start if i else 0):
            continue  # forward, or back from a position behind the deepest
        again = next((s for s in moved[i + 1 :] if s.forward), None)
        if again is None or any(not s.forward for s in moved[i + 1 : moved.index(again)]):
            continue  # the blade did not return, or went back by several strokes
        low, high = float(position[stroke.stop - 1]), float(position[turn]) - _TURNING
        top = float(position[again.samples].max())
        places = np.arange(low + _TURNING, min(high, top), _BIN)
        if len(places) < _MIN_BINS:
            continue
        down, up = (_force_at(places, trace, position, part) for part in (stroke, again))
        there = np.flatnonzero(position[again.samples] >= position[turn])
        back = again.start + int(there[0]) if len(there) else turn
        found.append(
            _Probe(turn=turn, again=back, position=places, mean=0.5 * (down + up), half_difference=0.5 * (up - down))
        )
    return found


def _force_at(places: Array, trace: Trace, position: Array, stroke: Stroke) -> Array:
    """Return a stroke's mean force [N] over 0.1 mm at ``places`` [m]."""
    borders = bins_of_travel(position[stroke.samples], _BIN)
    x, F = (bin_means(values[stroke.samples], borders) for values in (position, trace.force))
    return np.interp(places, *((x, F) if stroke.forward else (x[::-1], F[::-1])))


def _unloaded(probe: _Probe, position: Array) -> _Unloaded | None:
    """Return a probe's tip and stored energy, None without load."""
    x, F = probe.position, probe.mean
    loaded = F > _LOADED * float(F[-_MIN_BINS:].mean())
    first = len(F) - int(np.argmin(loaded[::-1])) if not loaded.all() else 0
    x, F = x[first:], F[first:]
    if len(x) < _MIN_BINS or float(F[-_MIN_BINS:].mean()) < SMALLEST_DROP:
        return None
    K, F0 = np.polyfit(x - x[-1], F, 1)
    if K <= 0.0:
        return None
    tip, turn = float(x[-1] - F0 / K), float(position[probe.turn])
    return _Unloaded(turn=probe.turn, again=probe.again, tip=tip, stored=0.5 * float(K) * (turn - tip) ** 2)


def _rubbed(position: Array, depth: DepthProfile, moved: list[Stroke]) -> Array:
    """Return the cumulative integral of B |dx| [m2], shape (n,)."""
    step = np.zeros(len(position))
    B = depth.at(position)
    for stroke in moved:
        x = position[stroke.samples]
        net = np.diff(x) * (1.0 if stroke.forward else -1.0)  # noise of the position causes no friction
        step[stroke.start + 1 : stroke.stop] = (
            0.5 * (B[stroke.start + 1 : stroke.stop] + B[stroke.start : stroke.stop - 1]) * net
        )
    return np.cumsum(step)
