"""Twin of a specimen that was cut on a rig.

The tissue that the first half of its record tells of, and what is open.

The specimens of a lab are unknown to the simulator. The first half of a record tells their moduli, fracture resistance
and friction there; how far that reaches into the second half follows from the correlation length of the tissue. What it
does not reach is drawn, again and again: specimens that are alike where the record has told of them, and differ beyond
as two livers of the same kind do.

Forces alone cannot tell a tougher tissue from a sensor that reads too much: if modulus, fracture resistance and
friction are all greater by a factor, so is every force, and nothing else changes. So a twin takes up any constant gain
of the sensor. Known weights find it (``cutenv rig weigh``), or a specimen whose tissue is known.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from scipy.optimize import least_squares

from cutenv._base.arrays import Array
from cutenv.sim.cutting.dtypes import TICK, LawParameters
from cutenv.sim.plant import ReplayPlant, SimulatedPlant
from cutenv.sim.plant.simulator import ANGLE_RANGE
from cutenv.sim.tissue.description import TissueDescription
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, SPACING, lognormal_sigma
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.trace import Trace

SHARE = 0.5  # share of the blade's way that a twin is fitted to; the rest is held out
_MODES = 4  # of a field, within the fitted part: 99 % of its variance over two correlation lengths
_WINDOW = 5e-3  # [m] in which mean and spread of the force are taken: some runs of the crack
_MIN_READINGS = 20  # readings of a window
_SMOOTH = 21  # [ms] over which positions are averaged: an encoder's steps are no motion
_MISFIT = 0.15  # [N] usual difference of either, by runs that fall into a window or not
_FRICTION = 0.5  # SD of the logarithm of friction about its usual share
_MIN_WAY = 0.015  # [m] of way, of which half tells of modulus and resistance
_FADES = 0.01  # [m] over which an error of the depth stays alike
_INCLINED = math.radians(85.0)  # angle below which the ratio of the inclined cut matters


@dataclass(frozen=True, eq=False)
class SpecimenTwin:
    """Tissue of a specimen as its record tells."""

    specimen: Specimen  # the most likely specimen
    until: float  # position of the blade up to which the record was used [m]
    misfit: float  # RMS difference of the force's mean and spread from the record's, in windows up to there [N]
    numbers: Array  # what was fitted, in standard deviations of the tissue's spread, shape (4 + 2 * modes,)
    spread: Array  # root of their covariance, as far as the record leaves it open, shape (4 + 2 * modes, n)

    def drawn(self, rng: np.random.Generator, measured: Array | None = None) -> Specimen:
        """Return a specimen that agrees with the record, the rest drawn.

        Its depth as it could have been ``measured`` [m], (301,), is beyond the fitted part taken for the true one,
        whose difference from what was measured the record does not tell.
        """
        modes, beyond = _fields(self.specimen.tissue.correlation_length, round(self.until / SPACING))
        further = [beyond @ rng.standard_normal(beyond.shape[1]) for _ in range(2)]
        numbers = self.numbers + self.spread @ rng.standard_normal(self.spread.shape[1])
        depth = self.specimen.depth
        if measured is not None:
            ahead = np.maximum(np.arange(N_POINTS) * SPACING - self.until, 0.0)
            depth = depth + (1.0 - np.exp(-ahead / _FADES)) * (measured - depth)
        return _specimen(numbers, modes, self.specimen.tissue, depth, further)


@lru_cache(maxsize=64)
def _fields(correlation_length: float, points: int) -> tuple[Array, Array]:
    """Return a unit Gaussian field's modes that the fitted part tells of, and the root of the covariance left.

    Their shapes are (301, modes) and (301, n).
    """
    at = np.arange(N_POINTS) * SPACING
    covariance = np.exp(-0.5 * ((at[:, None] - at[None, :]) / correlation_length) ** 2)
    told = slice(0, max(points, 2))
    values, vectors = np.linalg.eigh(covariance[told, told])
    kept = slice(-min(_MODES, len(values)), None)
    modes = covariance[:, told] @ vectors[:, kept] / np.sqrt(values[kept])
    left, roots = np.linalg.eigh(covariance - modes @ modes.T)
    clear = left > 1e-6
    return modes, roots[:, clear] * np.sqrt(left[clear])


def _specimen(
    numbers: Array, modes: Array, tissue: TissueDescription, depth: Array, further: list[Array] | None = None
) -> Specimen:
    """Return the specimen of fitted levels, friction, ratio and fields."""
    field = numbers[4:].reshape(2, -1) @ modes.T
    if further is not None:
        field = field + np.array(further)
    between = math.hypot(*map(lognormal_sigma, (tissue.modulus_between_liver_cv, tissue.modulus_between_cut_cv)))
    modulus = tissue.modulus * np.exp(between * numbers[0] + lognormal_sigma(tissue.modulus_within_cut_cv) * field[0])
    level = math.exp(lognormal_sigma(tissue.fracture_between_cut_cv) * numbers[1])
    resistance = tissue.fracture_resistance * level
    return Specimen(
        modulus=modulus,
        fracture_resistance=resistance * np.exp(lognormal_sigma(tissue.fracture_within_cut_cv) * field[1]),
        depth=depth,
        thickness=max(tissue.thickness, float(depth.max())),
        friction_per_depth=tissue.friction_share * resistance * math.exp(_FRICTION * numbers[2]),
        inclined_ratio=math.exp(lognormal_sigma(tissue.inclined_between_cut_cv) * numbers[3]),
        tissue=tissue,
    )


def fit_twin(
    trace: Trace,
    tissue: TissueDescription,
    *,
    law: LawParameters | None = None,
    force_delay: float = 0.0,
    share: float = SHARE,
) -> SpecimenTwin:
    """Fit a specimen to the first half, or ``share``, of a record.

    The blade is led along the recorded positions and angles, without drive and sensor; modulus, fracture resistance and
    friction are those that give the recorded force best, weighed against the spread of the tissue.  The record begins
    at the clamp, with force in newtons, position, angle and depth; the force is behind the position by ``force_delay``
    [s].

    Raises ValueError if the record lacks a field, or the blade goes less than 15 mm.
    """
    tape = ReplayPlant(trace)
    readings, depth = tape.readings, np.clip(tape.depth, 1e-4, LENGTH)
    way = float(readings["position"].max())
    if way < _MIN_WAY:
        raise ValueError(f"the blade goes {1e3 * way:.1f} mm: {1e3 * _MIN_WAY:g} mm or more tell of the tissue.")
    until = share * way
    stop = int(np.argmax(readings["position"] >= until))
    kernel = np.ones(_SMOOTH) / _SMOOTH
    padded = np.pad(readings["position"][:stop], _SMOOTH // 2, mode="edge")
    position = np.clip(np.convolve(padded, kernel, "valid"), 0.0, LENGTH - SPACING)
    angle = np.clip(readings["angle"][:stop], *ANGLE_RANGE)
    late = round(force_delay / TICK)
    force = readings["force"][np.minimum(np.arange(stop) + late, len(readings) - 1)]
    ahead = np.maximum.accumulate(position)
    windows = [np.floor(ahead / _WINDOW + part).astype(int) for part in (0.0, 0.5)]
    new = np.flatnonzero(np.diff(ahead, prepend=-1.0) > 0.0)

    def binned(values: Array) -> Array:
        """Return windowed mean and spread, robust to timing of runs."""
        found = []
        for window in windows:
            count = np.maximum(np.bincount(window[new]), 1)
            mean = np.bincount(window[new], values[new]) / count
            variance = np.bincount(window[new], (values[new] - mean[window[new]]) ** 2) / count
            found.append(np.concatenate((mean, np.sqrt(variance)))[np.tile(count >= _MIN_READINGS, 2)])
        return np.concatenate(found)

    told, (modes, _) = binned(force), _fields(tissue.correlation_length, round(until / SPACING))
    upright = float(np.median(angle)) > _INCLINED

    def off(numbers: Array) -> Array:
        plant = SimulatedPlant(_specimen(numbers, modes, tissue, depth), law=law, angle=float(angle[0]))
        return binned(plant.lead(position, angle)["force"]) - told

    def misfits(numbers: Array) -> Array:
        weighed = off(numbers) / _MISFIT
        robust = np.sign(weighed) * np.sqrt(2.0 * (np.sqrt(1.0 + weighed**2) - 1.0))
        return np.concatenate((robust, numbers))

    start = np.zeros(4 + 2 * modes.shape[1])
    free = np.arange(len(start)) != 3 if upright else np.ones(len(start), bool)

    def of_free(chosen: Array) -> Array:
        numbers = start.copy()
        numbers[free] = chosen
        return numbers

    def free_misfits(chosen: Array) -> Array:
        return misfits(of_free(chosen))

    def slopes(chosen: Array, step: float) -> Array:
        each = step * np.eye(len(chosen))
        higher, lower = ([free_misfits(chosen + way * one) for one in each] for way in (1.0, -1.0))
        return np.asarray((np.array(higher) - np.array(lower)).T / (2.0 * step))

    def squares(numbers: Array) -> float:
        misfit = misfits(numbers)
        return float(misfit @ misfit)

    levels = [np.array([*three, *np.zeros(len(start) - 3)]) for three in itertools.product(*_LEVELS)]
    numbers = min(levels, key=squares)  # the crack's runs make many hollows: begin in the deepest
    for step in _STEPS:
        found = least_squares(
            free_misfits, numbers[free], jac=partial(slopes, step=step), bounds=(-_MAX_FACTOR, _MAX_FACTOR),
            max_nfev=_MOST_STEPS,
        )  # fmt: skip
        numbers = min((numbers, of_free(found.x)), key=squares)
    at_best = slopes(numbers[free], step=_STEPS[-1])
    spread = np.zeros((len(start), int(free.sum())))
    spread[free] = np.linalg.cholesky(np.linalg.inv(at_best.T @ at_best))
    return SpecimenTwin(
        specimen=_specimen(numbers, modes, tissue, depth),
        until=until,
        misfit=float(np.sqrt(np.mean(off(numbers) ** 2))),
        numbers=numbers,
        spread=spread,
    )


_LEVELS = ((-2.0, -1.0, 0.0, 1.0, 2.0), (-1.5, -0.75, 0.0, 0.75, 1.5, 2.25), (-1.0, 0.0, 1.0))
_STEPS = (0.3, 0.1)  # differences of the numbers, for slopes over the noise of the runs
_MOST_STEPS, _MAX_FACTOR = 12, 5.0


def held_out(trace: Trace, until: float) -> Trace:
    """Return the record after the blade first reached ``until`` [m]."""
    (position,) = trace.require("position", by="held_out")
    first = int(np.argmax(position >= until)) if bool((position >= until).any()) else len(position) - 2
    return trace.select(slice(min(first, len(position) - 2), None))
