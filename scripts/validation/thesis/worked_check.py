"""Worked check of the cutting law: homogeneous tissue, no friction, the blade moved by 10 cm."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Struct
from cutenv.sim.cutting.dtypes import READING, TICK
from cutenv.sim.cutting.law import stored_energy
from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue import CutModel, Specimen, local_effective_modulus
from cutenv.sim.tissue.description import tables_only
from scripts.validation.thesis.rows import Found, Row, at_most, check, near

ETA90, MODULUS, RESISTANCE, DEPTH = 0.28, 48.36e3, 211.0, 0.02  # [1], [Pa], [J/m2], [m]
TRAVEL = 0.1  # [m]
_BLOCK = 100  # updates between two checks of the energy account
_SHORTEST_RAMP = 5  # readings


class Expected(NamedTuple):
    """Results of one cut of the check by an independent calculation."""

    angle_deg: int
    speed: float  # [m/s]
    units: int
    unstable_share: float  # of the cut
    peak_force: float  # [N]

    @property
    def angle(self) -> float:
        """Angle of the blade [rad]."""
        return math.radians(self.angle_deg)

    @property
    def name(self) -> str:
        """Angle and speed in the thesis's units."""
        return f"{self.angle_deg} deg, {100 * self.speed:g} cm/s"


EXPECTED = [
    Expected(90, 0.0010, 27, 0.98, 5.40),
    Expected(90, 0.0038, 25, 0.91, 5.40),
    Expected(90, 0.0127, 19, 0.69, 5.40),
    Expected(90, 0.0254, 11, 0.38, 5.40),
    Expected(45, 0.0010, 32, 0.63, 4.81),
    Expected(45, 0.0038, 30, 0.59, 4.81),
    Expected(45, 0.0127, 25, 0.45, 4.81),
    Expected(45, 0.0254, 15, 0.25, 4.81),
]


class LawCut(NamedTuple):
    """Results of one cut by the law."""

    readings: NDArray[np.void]
    state: Struct
    stored: float  # at the end [J]
    residual: float  # largest absolute one [J]

    @property
    def lag(self) -> NDArray[np.float64]:
        """Distance by which the blade leads the tip at every instant [m]."""
        return np.maximum(self.readings["position"] - self.readings["tip"], 0.0)


@functools.cache
def cut(speed: float, angle_deg: float) -> LawCut:
    """Move the blade by ``TRAVEL`` at constant speed [m/s] and angle."""
    specimen = Specimen.homogeneous(
        modulus=MODULUS,
        fracture_resistance=RESISTANCE,
        depth=DEPTH,
        friction_share=0.0,
        tissue=tables_only(eta90=ETA90),
    )
    plant = SimulatedPlant(specimen, angle=math.radians(angle_deg))
    state = plant.states[0]
    n = round(TRAVEL / speed / TICK)
    positions, readings = np.arange(1, n + 1) * speed * TICK, np.zeros(n, READING)
    residual = stored = 0.0
    for start in range(0, n, _BLOCK):
        block = slice(start, start + _BLOCK)
        readings[block] = plant.lead(positions[block], math.radians(angle_deg))
        stored = float(stored_energy(plant.profiles[0], state.blade, state.tip))
        spent = state.fracture + state.friction + state.loss + state.ledger
        residual = max(residual, abs(state.work - stored - spent))
    return LawCut(readings=readings, state=state, stored=stored, residual=residual)


def loading_slopes(found: LawCut, expected: Expected) -> list[float]:
    """Return the slopes of the force while the crack grows steadily, each over LEM kappa B at that place."""
    r = found.readings
    growing = (np.diff(r["tip"], prepend=0.0) > 0.0) & (r["jump"] == 0.0)
    borders = np.flatnonzero(np.diff(np.concatenate(([False], growing, [False])).astype(int)))
    LEM, model = local_effective_modulus(expected.speed, expected.angle), CutModel()
    ratios: list[float] = []
    for start, stop in zip(borders[::2], borders[1::2], strict=True):
        if stop - start >= _SHORTEST_RAMP:
            ramp = r[start:stop]
            slope = np.polyfit(ramp["position"], ramp["elastic_force"], 1)[0]
            ratios.append(slope / (LEM * model.stiffness(float(ramp["tip"].mean())) * DEPTH))
    return ratios


def _paid(what: str, ratio: float) -> Row:
    return replace(near(what, 1.0, ratio, form=".4f"), tolerance="0.985 to 1.000", agrees=bool(0.985 <= ratio < 1.0005))


MEASURES: dict[str, Callable[[str, Expected, LawCut], Row]] = {  # rows of a cut of the check
    "units": lambda what, e, found: near(what, e.units, found.state.units, absolute=1),
    "share of unstable growth": lambda what, e, found: near(
        what, e.unstable_share, found.state.uncontrolled / found.state.tip, absolute=0.02, form=".3f"
    ),
    "peak force, N": lambda what, e, found: near(
        what, e.peak_force, found.readings["elastic_force"].max(), absolute=0.005, form=".3f"
    ),
    "slope over LEM kappa B": lambda what, e, found: near(
        what, 1.0, float(np.mean(loading_slopes(found, e) or math.nan)), absolute=0.005, form=".4f"
    ),
    "mean lag, mm": lambda what, e, found: near(what, 5.8, 1e3 * float(found.lag.mean()), absolute=0.1, form=".2f"),
    "(work - stored)/(R B a)": lambda what, e, found: _paid(
        what, (found.state.work - found.stored) / (RESISTANCE * DEPTH * found.state.tip)
    ),
    "energy residual, J": lambda what, e, found: at_most(what, found.residual, 1e-12),
}


def rows_of(of: str, quick: bool) -> list[Row]:
    """Return rows of one kind for every cut of the check; quick leaves out the two slow speeds."""
    chosen = [e for e in EXPECTED if e.speed > 0.01 or not quick]
    return [MEASURES[of](f"{e.name}: {of}", e, cut(e.speed, e.angle_deg)) for e in chosen]


def span(rows: list[Row]) -> str:
    """Return smallest and largest of our values."""
    values = sorted((row.ours for row in rows), key=float)
    return f"{values[0]} to {values[-1]}"


@check("law-units", "Law, worked-out check: units and share of unstable growth", "independent calculation", "1; 0.02")
def units_and_share(quick: bool) -> Found:
    """Compare the number of crack runs, and their share of the cut."""
    units, shares = rows_of("units", quick), rows_of("share of unstable growth", quick)
    off, share_off = (max(abs(float(row.ours) - float(row.reference)) for row in rows) for rows in (units, shares))
    return [*units, *shares], f"off by {off:g}; {share_off:.3f} at most"


@check(
    "law-force",
    "Law, worked-out check: peak force 5.40 and 4.81 N; slope over LEM kappa B",
    "independent calculation",
    "0.005",
)
def peak_and_slope(quick: bool) -> Found:
    """Compare the force at initiation, and its rise."""
    peaks, slopes = rows_of("peak force, N", quick), rows_of("slope over LEM kappa B", quick)
    return [*peaks, *slopes], f"{peaks[0].ours} and {peaks[-1].ours} N; {span(slopes)}"


@check(
    "law-energy",
    "Law, worked-out check: mean lag 5.8 mm; (work - stored)/(R B a) 0.985 to 1; residual",
    "independent calculation",
    "0.1 mm; range; 1e-12 J",
)
def lag_and_energy(quick: bool) -> Found:
    """Compare the distance of the tip behind the blade, and the distribution of the work."""
    lags, works = rows_of("mean lag, mm", quick), rows_of("(work - stored)/(R B a)", quick)
    residuals = rows_of("energy residual, J", quick)
    ours = f"{span(lags)} mm; {span(works)}; {span(residuals).partition(' to ')[2]} J"
    return [*lags, *works, *residuals], ours
