"""Worked check of the cutting law: homogeneous tissue, no friction, the blade moved by 10 cm."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Struct
from cutenv.cutting.dtypes import READING, TICK, new_state
from cutenv.cutting.law import stored_energy
from cutenv.cutting.parameters import law_records, profile_records
from cutenv.cutting.simulate import follow
from cutenv.tissue import CutModel, Specimen, local_effective_modulus
from cutenv.tissue.description import tables_only
from reproduction.rows import Comparison, Row, at_most, near

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


class Found(NamedTuple):
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
def cut(speed: float, angle_deg: float) -> Found:
    """Move the blade by ``TRAVEL`` at constant speed [m/s] and angle."""
    specimen = Specimen.homogeneous(
        modulus=MODULUS,
        fracture_resistance=RESISTANCE,
        depth=DEPTH,
        friction_share=0.0,
        tissue=tables_only(eta90=ETA90),
    )
    profiles, laws = profile_records([specimen]), law_records([specimen])
    states = new_state(1, math.radians(angle_deg))
    state = states[0]
    n = round(TRAVEL / speed / TICK)
    positions, angles = np.arange(1, n + 1) * speed * TICK, np.full(n, math.radians(angle_deg))
    readings = np.zeros(n, READING)
    residual = stored = 0.0
    for start in range(0, n, _BLOCK):
        block = slice(start, start + _BLOCK)
        follow(states, profiles, laws, positions[block], angles[block], TICK, readings[block])
        stored = float(stored_energy(profiles[0], state.blade, state.tip))
        spent = state.fracture + state.friction + state.loss + state.ledger
        residual = max(residual, abs(state.work - stored - spent))
    return Found(readings=readings, state=state, stored=stored, residual=residual)


def loading_slope(found: Found, expected: Expected) -> float:
    """Return the mean slope of the force while the crack grows steadily, over LEM kappa B at that place."""
    r = found.readings
    growing = (np.diff(r["tip"], prepend=0.0) > 0.0) & (r["jump"] == 0.0)
    borders = np.flatnonzero(np.diff(np.concatenate(([False], growing, [False])).astype(int)))
    LEM, model = local_effective_modulus(expected.speed, math.radians(expected.angle_deg)), CutModel()
    ratios = []
    for start, stop in zip(borders[::2], borders[1::2], strict=True):
        if stop - start >= _SHORTEST_RAMP:
            ramp = r[start:stop]
            slope = np.polyfit(ramp["position"], ramp["elastic_force"], 1)[0]
            ratios.append(slope / (LEM * model.stiffness(float(ramp["tip"].mean())) * DEPTH))
    return float(np.mean(ratios))


def rows_of(of: str, quick: bool) -> list[Row]:
    """Return rows of one kind for every cut of the check; quick leaves out the two slow speeds."""
    rows = []
    for e in EXPECTED:
        if quick and e.speed < 0.01:
            continue
        found = cut(e.speed, e.angle_deg)
        s = found.state
        name = f"{e.name}: {of}"
        if of == "units":
            rows.append(near(name, e.units, s.units, absolute=1))
        elif of == "share of unstable growth":
            rows.append(near(name, e.unstable_share, s.uncontrolled / s.tip, absolute=0.02, form=".3f"))
        elif of == "peak force, N":
            rows.append(near(name, e.peak_force, found.readings["elastic_force"].max(), absolute=0.005, form=".3f"))
        elif of == "slope over LEM kappa B":
            rows.append(near(name, 1.0, loading_slope(found, e), absolute=0.005, form=".4f"))
        elif of == "mean lag, mm":
            rows.append(near(name, 5.8, 1e3 * float(found.lag.mean()), absolute=0.1, form=".2f"))
        elif of == "(work - stored)/(R B a)":
            ratio = (s.work - found.stored) / (RESISTANCE * DEPTH * s.tip)
            row = near(name, 1.0, ratio, form=".4f")
            rows.append(replace(row, tolerance="0.985 to 1.000", agrees=bool(0.985 <= ratio < 1.0005)))
        else:
            rows.append(at_most(name, found.residual, 1e-12))
    return rows


def span(rows: list[Row]) -> str:
    """Return smallest and largest of our values."""
    values = sorted((row.ours for row in rows), key=float)
    return f"{values[0]} to {values[-1]}"


def _comparison(title: str, tolerance: str, rows: list[Row], ours: str) -> Comparison:
    return Comparison(
        title=f"Law, worked-out check: {title}",
        source="independent calculation",
        ours=ours,
        tolerance=tolerance,
        rows=tuple(rows),
    )


def units_and_share(quick: bool) -> Comparison:
    """Compare the number of crack runs, and their share of the cut."""
    units, shares = rows_of("units", quick), rows_of("share of unstable growth", quick)
    off = max(abs(float(row.ours) - float(row.reference)) for row in units)
    share_off = max(abs(float(row.ours) - float(row.reference)) for row in shares)
    return _comparison(
        "units and share of unstable growth", "1; 0.02", [*units, *shares], f"off by {off:g}; {share_off:.3f} at most"
    )


def peak_and_slope(quick: bool) -> Comparison:
    """Compare the force at initiation, and its rise."""
    peaks, slopes = rows_of("peak force, N", quick), rows_of("slope over LEM kappa B", quick)
    ours = f"{peaks[0].ours} and {peaks[-1].ours} N; {span(slopes)}"
    return _comparison("peak force 5.40 and 4.81 N; slope over LEM kappa B", "0.005", [*peaks, *slopes], ours)


def lag_and_energy(quick: bool) -> Comparison:
    """Compare the distance of the tip behind the blade, and the distribution of the work."""
    lags, works = rows_of("mean lag, mm", quick), rows_of("(work - stored)/(R B a)", quick)
    residuals = rows_of("energy residual, J", quick)
    ours = f"{span(lags)} mm; {span(works)}; {span(residuals).partition(' to ')[2]} J"
    return _comparison(
        "mean lag 5.8 mm; (work - stored)/(R B a) 0.985 to 1; residual",
        "0.1 mm; range; 1e-12 J",
        [*lags, *works, *residuals],
        ours,
    )
