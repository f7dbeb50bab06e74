"""Initiation: excess of crack-starting force over the fracture resistance.

A blade loads the tissue up to a hilltop of the force, F = (1 + eta) R B, where the crack runs.  From one hilltop to
the next the energy balance (thesis, 6.1 to 6.4) gives R of just that piece of tissue: work less friction less the
change of stored energy, over the area cut.  Both together give eta, however uneven the tissue is.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cutenv._base.arrays import Array
from cutenv.records.measurement.depth import DepthProfile, stiffness_ratio
from cutenv.records.measurement.fracture import estimate_fracture_resistance
from cutenv.records.measurement.loading_ratio import LoadingRatio, loading_ratio_of
from cutenv.records.measurement.modulus import elastic_record, telling
from cutenv.records.measurement.segments import Segment, loading_segments, smoothing_readings_of
from cutenv.records.measurement.zero import zeroed
from cutenv.sim.quantities import MEASURABLE_DEPTH
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.trace import Trace

_MIN_READINGS, _PARTS = 30, 4  # readings, or a quarter of the ramp, fitted for the force at its end
_BEYOND = 3  # bins after a ramp's end within which the force must have fallen
_STEPS = 3  # fixed-point iterations for the tip at a hilltop


@dataclass(frozen=True, kw_only=True, eq=False)
class InitiationEstimate:
    """Initiation forces of one cut: hilltops and units between them.

    Attributes
    ----------
    position : ndarray of shape (n,)
        Estimated tip at each hilltop [m].
    force_per_depth : ndarray of shape (n,)
        Elastic force there over the depth of cut at the tip, (1 + eta) R [N/m].
    unit_position, unit_length : ndarray of shape (m,)
        Middle and length of each unit, by the tip [m].
    unit_area, unit_energy, unit_angle : ndarray of shape (m,)
        Area cut [m2], its fracture energy without friction [J], angle of the blade [rad].
    unit_force_per_depth : ndarray of shape (m,)
        Mean over its two hilltops [N/m].
    """

    position: Array
    force_per_depth: Array
    unit_position: Array
    unit_length: Array
    unit_area: Array
    unit_energy: Array
    unit_angle: Array
    unit_force_per_depth: Array


class Hilltop(NamedTuple):
    """End of a loading ramp, independent of the loading ratio."""

    speed: float  # of the blade [m/s]
    angle: float | None  # [rad]
    slope: float  # of the ramp [N/m]
    middle: float  # of the ramp, position of the blade [m]
    middle_force: float  # elastic, there [N]
    position: float  # of the blade [m]
    force: float  # elastic [N]
    work: float  # of the elastic force since the start of the record [J]


def estimate_initiation(
    trace: Trace,
    model: CutModel,
    *,
    friction_per_depth: float | None = None,
    loading_ratio: float | LoadingRatio | None = None,
) -> InitiationEstimate:
    """Find forces that start crack runs, and energies of units between.

    Parameters
    ----------
    trace : Trace
        Record with position and depth, and angle unless `loading_ratio` is given; force in newtons.
    friction_per_depth : float, optional
        phi [N/m]; by default from :func:`~cutenv.records.measurement.estimate_fracture_resistance`.
    loading_ratio : float or callable, optional
        r [1], 0.01 to 1, or a function of speed [m/s] and angle [rad]; by default that of pig liver.

    Returns
    -------
    InitiationEstimate
        Without units if there are no two steady ramps in a row.

    Raises
    ------
    ValueError
        If the trace lacks what is needed.
    """
    by = "estimate_initiation"
    depth = DepthProfile.recorded(trace, by=by)
    if loading_ratio is None:
        trace.require("angle", by=f"{by} without loading_ratio")
    ratio = loading_ratio_of(loading_ratio, low=0.01)
    trace, _ = zeroed(trace)
    if friction_per_depth is None:
        friction_per_depth = estimate_fracture_resistance(trace, loading_ratio=loading_ratio).friction_per_depth
    elastic = elastic_record(trace, depth, friction_per_depth)
    return initiation_at(hilltops(elastic, loading_segments(elastic)), depth, model, ratio)


def initiation_excess(estimates: Iterable[InitiationEstimate]) -> float:
    """Return eta90 of eta = eta90 sin(theta)^2 from cuts' units.

    Sums are taken before the ratio, so that short units, whose energy is less certain, have less weight. No unit at all
    is a ValueError.
    """
    force = energy = weighted = 0.0
    for each in estimates:
        force += float(each.unit_force_per_depth @ each.unit_area)
        energy += float(each.unit_energy.sum())
        weighted += float(np.sin(each.unit_angle) ** 2 @ each.unit_energy)
    if weighted <= 0.0:
        raise ValueError("no unit between two hilltops was found in any cut: eta is not measured.")
    return (force - energy) / weighted


def hilltops(elastic: Trace, ramps: list[Segment]) -> list[Hilltop | None]:
    """Return each ramp's end in elastic force, None if unusable."""
    (position,) = elastic.require("position", by="hilltops")
    F = elastic.force
    work = np.concatenate(([0.0], np.cumsum(0.5 * (F[1:] + F[:-1]) * np.diff(position))))
    found: list[Hilltop | None] = []
    told = {ramp.start for ramp in telling(ramps)}
    within = _BEYOND * smoothing_readings_of(elastic)
    for ramp in ramps:
        if ramp.start not in told:
            found.append(None)
            continue
        middle, slope, speed = ramp.require("position", "slope", "speed", by="hilltops")
        end = ramp.stop - 1
        # The ramp of an uneven tissue is bent: its last part determines where it ends.
        last = slice(max(ramp.start, ramp.stop - max(_MIN_READINGS, (ramp.stop - ramp.start) // _PARTS)), ramp.stop)
        from_here, F_last = position[last] - position[end], F[last]
        rise = float((from_here - from_here.mean()) @ F_last / ((from_here - from_here.mean()) @ from_here))
        force = float(F_last.mean()) - rise * float(from_here.mean())
        after = slice(ramp.stop, ramp.stop + within)
        ran = _run_after(ramp, F[after], force + rise * (position[after] - position[end]))
        x = 0.5 * float(position[ran - 1] + position[ran])
        dx = x - float(position[end])
        force += rise * dx
        found.append(
            Hilltop(
                speed=speed,
                angle=ramp.angle,
                slope=slope,
                middle=middle,
                middle_force=ramp.force,
                position=x,
                force=force,
                work=float(work[end]) + (force - 0.5 * rise * dx) * dx,
            )
        )
    return found


def _run_after(ramp: Segment, force: Array, line: Array) -> int:
    """Return the first reading after the crack run ending ``ramp``.

    A ramp leaves out its last bin, and the next contains the drop: the crack runs up to two bins after its end.  Force
    and line [N] are those of the readings after the ramp.
    """
    fallen = force < line - 0.5 * ramp.drop
    return ramp.stop + (int(np.argmax(fallen)) if fallen.any() else len(force) - 1)


def initiation_at(
    tops: list[Hilltop | None], depth: DepthProfile, model: CutModel, ratio: LoadingRatio
) -> InitiationEstimate:
    """Return hilltops' tips, forces and energies for a loading ratio."""
    points: list[tuple[float, float, float, Hilltop] | None] = [None] * len(tops)
    found = [(i, top) for i, top in enumerate(tops) if top is not None]
    r = np.array([ratio(top.speed, top.angle) for _, top in found])
    slope, x, F, x_middle, F_middle = np.array(
        [(top.slope, top.position, top.force, top.middle, top.middle_force) for _, top in found]
    ).reshape(-1, 5).T  # fmt: skip
    K = slope / r
    middle, a = np.maximum(x_middle - F_middle / K, 0.0), np.maximum(x - F / K, 0.0)
    for _ in range(_STEPS):  # the ramp's stiffness is that at its middle; depth and kappa scale it to its end
        there = K * stiffness_ratio(middle, a, depth, model)
        a = np.maximum(x - F / there, 0.0)
    B = depth.at(a)
    for n, (i, top) in enumerate(found):
        if B[n] >= MEASURABLE_DEPTH and F[n] > 0.0:
            points[i] = float(a[n]), float(F[n] / B[n]), float(0.5 * F[n] ** 2 / there[n]), top
    units = []
    for first, second in itertools.pairwise(points):
        if first is None or second is None or second[0] <= first[0]:
            continue
        (a, f, U, top), (next_a, next_f, next_U, next_top) = first, second
        angle = math.pi / 2 if next_top.angle is None else next_top.angle
        energy = next_top.work - top.work - (next_U - U)
        units.append((0.5 * (a + next_a), next_a - a, depth.area(a, next_a), energy, angle, 0.5 * (f + next_f)))
    position, length, area, energies, angles, force = np.array(units).reshape(-1, 6).T
    known = [point for point in points if point is not None]
    return InitiationEstimate(
        position=np.array([point[0] for point in known]),
        force_per_depth=np.array([point[1] for point in known]),
        unit_position=position,
        unit_length=length,
        unit_area=area,
        unit_energy=energies,
        unit_angle=angles,
        unit_force_per_depth=force,
    )
