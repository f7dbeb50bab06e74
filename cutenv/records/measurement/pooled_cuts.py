"""All cuts of a calibration together, for bootstrap, scatter and variogram."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cutenv._base.arrays import Array
from cutenv.records.measurement.depth import fit_bulge
from cutenv.records.measurement.initiation import initiation_excess
from cutenv.records.measurement.measured_cut import MeasuredCut, by_specimen
from cutenv.records.measurement.speed_dependence import BETWEEN, LEAST_FIT, SpeedDependence, fit_speed_dependence
from cutenv.sim.tissue.description import measured_liver

LAGS = np.linspace(0.0, 0.08, 17)  # borders of the distance classes of the variogram [m]
SHORTEST_LENGTH, LONGEST_LENGTH = 0.005, 0.1
"""Range of the correlation lengths searched [m]: a unit hides shorter ones, a cut does not show longer ones."""
CENTRES = 0.5 * (LAGS[1:] + LAGS[:-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Variogram:
    """Variogram of a logarithm between positions of one cut.

    It is half the mean squared difference, over the distance. Differences within a cut do not contain what the whole
    cut has in common, and do not depend on the length of the cut relative to the correlation length, unlike a standard
    deviation within the cut.
    """

    squares: Array  # sums of half the squared differences, shape (n_cuts, n_lags)
    pairs: Array  # number of pairs, shape (n_cuts, n_lags)

    @classmethod
    def of(
        cls, positions: Sequence[Array], values: Sequence[Array], errors: Sequence[Array] | None = None
    ) -> Variogram:
        """Compute it from positive ``values`` at ``positions`` [m], less ``errors``.

        ``errors`` are relative standard errors.
        """
        errors = errors or [np.zeros(len(x)) for x in positions]
        squares, pairs = np.zeros((2, len(positions), len(CENTRES)))
        for n, (x, value, error) in enumerate(zip(positions, values, errors, strict=True)):
            i, j = np.triu_indices(len(x), 1)
            distance, difference = np.abs(x[i] - x[j]), np.diff(np.log(value)[[i, j]], axis=0)[0]
            noise = error[i] ** 2 + error[j] ** 2
            squares[n] = np.histogram(distance, LAGS, weights=0.5 * (difference**2 - noise))[0]
            pairs[n] = np.histogram(distance, LAGS)[0]
        return cls(squares=squares, pairs=pairs)

    def mean(self, counts: Array) -> tuple[Array, Array]:
        """Return weighted means by lag, shape (n_lags,), and pairs.

        Each cut is taken ``counts`` times; the mean is 0 without pairs.
        """
        pairs = counts @ self.pairs
        return counts @ self.squares / np.maximum(pairs, 1.0), pairs


def fit_variances(variograms: Sequence[Variogram], counts: Array, length: float) -> tuple[Array, float]:
    """Fit properties' log variances along cuts for a correlation length.

    gamma(d) = variance (1 - exp(-d^2 / (2 length^2))), as for sampled specimens; least squares, weighted with the
    number of pairs. The misfit is the weighted sum of squares, each property's relative to its own size.
    """
    shape = 1.0 - np.exp(-0.5 * (CENTRES / length) ** 2)
    variances, misfit = [], 0.0
    for variogram in variograms:
        gamma, pairs = variogram.mean(counts)
        total = float(pairs @ gamma**2)
        variance = float(pairs @ (gamma * shape)) / max(float(pairs @ shape**2), 1e-30)
        variances.append(variance)
        if total > 0.0:
            misfit += float(pairs @ (gamma - variance * shape) ** 2) / total
    return np.array(variances), misfit


def correlation_length(variograms: Sequence[Variogram], counts: Array) -> float:
    """Return the correlation length [m] for :func:`fit_variances`'s best fit."""

    def misfit(log_length: float) -> float:
        return fit_variances(variograms, counts, math.exp(log_length))[1]

    grid = np.linspace(math.log(SHORTEST_LENGTH), math.log(LONGEST_LENGTH), 16)
    best = int(np.argmin([misfit(each) for each in grid]))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    return math.exp(float(minimize_scalar(misfit, bounds=around, method="bounded", options={"xatol": 1e-3}).x))


def cv_of(log_variance: float) -> float:
    """Return a lognormal's coefficient of variation; 0 if negative."""
    return math.sqrt(math.expm1(max(log_variance, 0.0)))


class Places:
    """Positions along several cuts [m], for variances of field means."""

    def __init__(self, positions: Sequence[Array]) -> None:
        squares = [((x[:, None] - x[None, :]) ** 2).ravel() for x in positions]
        self._squares = np.concatenate([np.zeros(0), *squares])
        self._cut = np.repeat(np.arange(len(positions)), [len(each) for each in squares])
        self._pairs = np.array([max(len(each), 1) for each in squares])

    def mean_variances(self, variance: float, length: float) -> Array:
        """Return variances of a field's mean per cut, (n_cuts,).

        A cut without positions has 0.
        """
        correlation = np.exp(-0.5 * self._squares / length**2)
        return np.asarray(variance * np.bincount(self._cut, correlation, len(self._pairs)) / self._pairs)


def mean_field_variance(positions: Array, variance: float, length: float) -> float:
    """Return the variance of a field's mean over ``positions`` [m]."""
    return float(Places([positions]).mean_variances(variance, length)[0])


def nested_variances(values: Array, groups: NDArray[np.intp], counts: Array) -> tuple[float, float]:
    """Estimate variances between and within groups by one-way random-effects analysis.

    Each cut's value is taken `counts` times (a bootstrap resample). Unbiased, so ``between`` may be negative; NaN for
    lack of groups or of members.
    """
    sizes = np.bincount(groups, counts)
    present = sizes > 0
    sums = np.bincount(groups, counts * values)
    means = sums[present] / sizes[present]
    n, k = float(counts.sum()), int(present.sum())
    total = float(counts @ values**2)
    explained = float(sizes[present] @ means**2)
    within = (total - explained) / (n - k) if n > k else math.nan
    if k < 2 or not n > k:
        return math.nan, within
    mean_square = (explained - float(counts @ values) ** 2 / n) / (k - 1)
    typical = (n - float(sizes[present] @ sizes[present]) / n) / (k - 1)
    return (mean_square - within) / typical, within


FEWEST_FOR_CORRELATION = 8  # smallest number of cuts from which a correlation length along the cut is estimated

FEWEST_FOR_INCLINED = 4
"""Smallest number of cuts on either side of 67.5 degrees for an estimate of the inclined cuts' additional spread."""

FIELDS = (
    "intercept_90", "slope_90", "intercept_45", "slope_45", "speed_min", "speed_max", "modulus_between_liver_cv",
    "modulus_between_cut_cv", "modulus_within_cut_cv", "inclined_between_cut_cv", "correlation_length",
    "fracture_resistance", "fracture_between_cut_cv", "fracture_within_cut_cv", "friction_share", "eta90",
    "edge_depth", "crown_depth", "rise_length", "mean_depth",
)  # fmt: skip
"""Fields of a tissue description that are estimated from records."""

_MODULUS_SPREAD = (
    "modulus_between_liver_cv", "modulus_between_cut_cv", "modulus_within_cut_cv", "inclined_between_cut_cv",
)  # fmt: skip

NOT_RESAMPLED = ("speed_min", "speed_max", "edge_depth", "crown_depth", "rise_length", "mean_depth")
"""Those of them that describe the records rather than estimate a property, and are not resampled."""


class PooledCuts:
    """Measured cuts as arrays, for cheap resampling.

    Attributes
    ----------
    measured : set of str
        Names of the fields that are estimated from the cuts, where they are not NaN; the others follow pig liver's
        proportions.
    """

    def __init__(self, cuts: list[MeasuredCut]) -> None:
        self.cuts = cuts
        self.speed, self.angle, self.modulus, self.resistance, self.friction = np.array(
            [
                (
                    cut.speed,
                    cut.angle,
                    cut.material_modulus if len(cut.moduli) else math.nan,
                    cut.fracture.corrected,
                    math.nan if cut.return_stroke is None else cut.fracture.friction_per_depth,
                )
                for cut in cuts
            ]
        ).T
        names = list(by_specimen(cuts))
        self.specimen = np.array([names.index(cut.specimen) for cut in cuts])
        self.variograms = [
            Variogram.of(
                [cut.moduli.position for cut in cuts],
                [cut.material_moduli for cut in cuts],
                [cut.moduli.relative_error for cut in cuts],
            ),
            Variogram.of([cut.initiation.position for cut in cuts], [cut.initiation.force_per_depth for cut in cuts]),
        ]
        self.ramps = Places([cut.moduli.position for cut in cuts])
        self.tops = Places([cut.initiation.position for cut in cuts])
        first = [float(cut.moduli.position.min()) if len(cut.moduli) else 0.0 for cut in cuts]
        self.depth = fit_bulge([cut.surface or cut.depth for cut in cuts], first)
        self.length: float | None = None
        if len(cuts) < FEWEST_FOR_CORRELATION:
            self.length = measured_liver().correlation_length
        self.has_modulus = np.isfinite(self.modulus)
        speed = self.speed[self.has_modulus]  # the range in which the modulus is known
        self.speed_min = float(speed.min())
        self.speed_max = float(max(speed.max(), 1.01 * self.speed_min))
        free = self._line(np.flatnonzero(self.has_modulus)).measured
        self.measured = set(FIELDS) - ({"intercept_90", "slope_90", "intercept_45", "slope_45"} - free)

    def numbers(self, counts: Array) -> dict[str, float]:
        """Estimate every number with cut weights ``counts``, NaN if undetermined."""
        taken = np.repeat(np.arange(len(self.cuts)), counts.astype(int))
        with_modulus = taken[self.has_modulus[taken]]
        line = self._line(with_modulus if len(with_modulus) else np.flatnonzero(self.has_modulus))
        length = self.length or correlation_length(self.variograms, counts)
        (modulus_within, resistance_within), _ = fit_variances(self.variograms, counts, length)
        return {
            "intercept_90": line.intercept_90,
            "slope_90": line.slope_90,
            "intercept_45": line.intercept_45,
            "slope_45": line.slope_45,
            "speed_min": self.speed_min,
            "speed_max": self.speed_max,
            "correlation_length": math.nan if self.length else length,
            **self._modulus_spread(line, counts, modulus_within, length),
            **self._fracture(counts, resistance_within, length),
            "friction_share": self._friction_share(counts),
            "eta90": self._eta90(taken),
            **self.depth,
        }

    def _line(self, taken: NDArray[np.intp]) -> SpeedDependence:
        return fit_speed_dependence(self.speed[taken], self.angle[taken], self.modulus[taken])

    def _modulus_spread(self, line: SpeedDependence, counts: Array, within: float, length: float) -> dict[str, float]:
        enough = self._tells(self.variograms[0], within)
        spread = dict.fromkeys(_MODULUS_SPREAD, math.nan)
        spread["modulus_within_cut_cv"] = cv_of(within) if enough else math.nan
        known = self.has_modulus
        if known.sum() <= len(line.measured):  # the line goes through every cut, whatever their spread
            return spread
        fitted = line.moduli(self.speed[known], self.angle[known])
        # A resample of cuts at one end of the speeds may have a line that falls below zero at the other end.
        ratio = np.log(self.modulus[known] / np.maximum(fitted, LEAST_FIT * self.modulus[known]))
        steep = self.angle[known] >= BETWEEN
        specimen, times = self.specimen[known], counts[known]
        if min(times[steep].sum(), times[~steep].sum()) >= FEWEST_FOR_INCLINED:
            inclined = variance(ratio[~steep], times[~steep])
            ratio, specimen, times = ratio[steep], specimen[steep], times[steep]
            spread["inclined_between_cut_cv"] = _cv(inclined - variance(ratio, times))
        between_liver, between_cut = nested_variances(ratio, specimen, times)
        along = self._added(self.ramps, within if enough else 0.0, length, counts)
        spread["modulus_between_liver_cv"] = _cv(between_liver)
        spread["modulus_between_cut_cv"] = _cv(between_cut - along)
        return spread

    def _fracture(self, counts: Array, within: float, length: float) -> dict[str, float]:
        n = float(counts.sum())
        mean = float(counts @ self.resistance) / n
        logs = np.log(self.resistance)
        between = variance(logs, counts) if n > 1 else math.nan
        enough = self._tells(self.variograms[1], within)
        along = self._added(self.tops, within if enough else 0.0, length, counts)
        return {
            "fracture_resistance": mean,
            "fracture_between_cut_cv": _cv(between - along),
            "fracture_within_cut_cv": cv_of(within) if enough else math.nan,
        }

    def _tells(self, variogram: Variogram, variance: float) -> bool:
        """Return True if pairs allow a spread beyond noise."""
        return bool(variogram.pairs.sum() >= 1.0) and (variance > 0.0 or len(self.cuts) > 1)

    def _added(self, places: Places, variance: float, length: float, counts: Array) -> float:
        """Return the fields' mean contribution to variance between cuts."""
        return float(counts @ places.mean_variances(variance, length)) / float(counts.sum())

    def _friction_share(self, counts: Array) -> float:
        known = np.isfinite(self.friction)
        total = float(counts[known] @ self.resistance[known])
        return float(np.clip(counts[known] @ self.friction[known] / total, 0.0, 0.9)) if total else math.nan

    def _eta90(self, taken: NDArray[np.intp]) -> float:
        chosen = [self.cuts[i].initiation for i in taken]
        if not sum(len(each.unit_area) for each in chosen):
            return math.nan
        return float(np.clip(initiation_excess(chosen), 0.0, 0.95))


def resampled(rng: np.random.Generator, n: int) -> Array:
    """Sample n cuts with replacement; return their counts, shape (n,)."""
    return np.bincount(rng.integers(n, size=n), minlength=n).astype(np.float64)


def variance(values: Array, counts: Array) -> float:
    """Return the unbiased variance of ``values``, weighted by ``counts``.

    More than one value is needed.
    """
    n = float(counts.sum())
    return float(counts @ (values - counts @ values / n) ** 2) / (n - 1.0)


def _cv(log_variance: float) -> float:
    return math.nan if math.isnan(log_variance) else cv_of(log_variance)
