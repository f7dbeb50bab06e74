"""Prediction of a cut's ramps by other cuts' moduli (thesis, 7.4).

The blade's measured displacement goes into the finite-element model with the average modulus of other cuts, of the
same piece of tissue and of another one; the resulting force is compared with the measured one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv.records.measurement.depth import unit_stiffness
from cutenv.records.measurement.measured_cut import MeasuredCut, by_specimen
from cutenv.records.measurement.speed_dependence import LEAST_FIT, SpeedDependence, fit_speed_dependence
from cutenv.sim.tissue.cut_model import CutModel

_ROUNDS = 10  # iterations of the line and the specimens' factors in turn: each at least halves the error


@dataclass(frozen=True, kw_only=True)
class LeftOutCut:
    """One cut predicted from the others, None where impossible.

    Attributes
    ----------
    speed, angle : float
        Speed [m/s] and angle [rad].
    peak_force : float
        Largest measured force on them [N].
    modulus : float
        The cut's own mean modulus, of the material [Pa].
    same_modulus, other_modulus : float or None
        Prediction from the other cuts of the same specimen, and from another specimen [Pa], at this speed and angle.
    own_rmse : float
        Root mean square difference [N] with every segment's own modulus: due to noise and curvature only.
    same_rmse, other_rmse : float or None
        Root mean square differences with the predicted moduli [N]; ``other_rmse`` is the mean over all other
        specimens, ``other_modulus`` that of the next one.
    """

    name: str
    specimen: str
    speed: float
    angle: float
    segments: int
    peak_force: float
    modulus: float
    same_modulus: float | None
    other_modulus: float | None
    own_rmse: float
    same_rmse: float | None
    other_rmse: float | None

    def percent_of_peak(self, rmse: float | None) -> float | None:
        """Return an error in percent of peak force [%]."""
        return None if rmse is None else 100.0 * rmse / self.peak_force


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedRamp:
    """Loading ramp: position [m], measured and predicted force [N], (n,)."""

    position: Array
    measured: Array
    predicted: Array


def predicted_ramps(cut: MeasuredCut, model: CutModel, modulus: float | None = None) -> list[PredictedRamp]:
    """Predict a cut's steady ramps for a material modulus [Pa].

    The default modulus is each ramp's own. Every ramp starts at the measured start, as in Figure 7.13: only its rise is
    predicted.
    """
    (position,) = cut.trace.require("position", by="predicted_ramps")
    friction = cut.moduli.friction_per_depth
    ramps = []
    for segment, tip, own in zip(cut.moduli.segments, cut.moduli.position, cut.material_moduli, strict=True):
        x, F = position[segment.samples], cut.trace.force[segment.samples]
        slope = (own if modulus is None else modulus) * float(unit_stiffness(tip, cut.depth, model))
        middle, measured_slope = segment.require("position", "slope", by="predicted_ramps")
        start = segment.force + measured_slope * (float(x[0]) - middle)
        predicted = start + slope * (x - x[0]) + friction * cut.depth.at(x)
        ramps.append(PredictedRamp(position=x, measured=F, predicted=predicted))
    return ramps


def leave_one_out(cuts: Sequence[MeasuredCut], model: CutModel) -> list[LeftOutCut]:
    """Predict every cut from others of its own and other specimens.

    A specimen's factor is the stiffness of its cuts relative to the fit over speed and angle. Both are found together,
    so that it does not matter which specimen was cut at which speed, and without the cut that is predicted.

    Returns
    -------
    list of LeftOutCut
        In the order of ``cuts``, without those that have no modulus.
    """
    found = []
    known = [cut for cut in cuts if len(cut.moduli)]
    for cut in known:
        others = [each for each in known if each is not cut]
        same = other = next_modulus = None
        line, factors = _line_and_factors(others)
        # A line from others at very different speeds may end below zero here: it predicts nothing.
        if line is not None and (here := line.modulus(cut.speed, cut.angle)) > 0.0:
            own = factors.pop(cut.specimen, None)
            same = None if own is None else own * here
            if factors:
                next_modulus = next(iter(factors.values())) * here
                other = float(np.mean([_rmse(predicted_ramps(cut, model, k * here)) for k in factors.values()]))
        ramps = predicted_ramps(cut, model)
        found.append(
            LeftOutCut(
                name=cut.name,
                specimen=cut.specimen,
                speed=cut.speed,
                angle=cut.angle,
                segments=len(ramps),
                peak_force=float(max(ramp.measured.max() for ramp in ramps)),
                modulus=cut.material_modulus,
                same_modulus=same,
                other_modulus=next_modulus,
                own_rmse=_rmse(ramps),
                same_rmse=None if same is None else _rmse(predicted_ramps(cut, model, same)),
                other_rmse=other,
            )
        )
    return found


def _line_and_factors(cuts: list[MeasuredCut]) -> tuple[SpeedDependence | None, dict[str, float]]:
    """Fit the speed line and specimen factors by alternating least squares."""
    factors = dict.fromkeys(by_specimen(cuts), 1.0)
    line = None
    for _ in range(_ROUNDS if cuts else 0):
        line = fit_speed_dependence(
            [cut.speed for cut in cuts],
            [cut.angle for cut in cuts],
            [cut.material_modulus / factors[cut.specimen] for cut in cuts],
        )
        factors = {
            specimen: float(np.mean([_stiffer(cut, line) for cut in group]))
            for specimen, group in by_specimen(cuts).items()
        }
    return line, factors


def _stiffer(cut: MeasuredCut, line: SpeedDependence) -> float:
    E = cut.material_modulus
    return E / max(line.modulus(cut.speed, cut.angle), LEAST_FIT * E)


def _rmse(ramps: list[PredictedRamp]) -> float:
    squares = sum(float(((ramp.predicted - ramp.measured) ** 2).sum()) for ramp in ramps)
    return float(np.sqrt(squares / sum(len(ramp.measured) for ramp in ramps)))
