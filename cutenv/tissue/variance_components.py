"""Variance components of the modulus: between livers, between cuts, within a cut; and the mean depth of the cuts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range, one_of
from cutenv.tissue.effective_modulus import Formulation
from cutenv.tissue.tables import table

CUTS_PER_LIVER = 4
"""Number of parallel cuts in a liver (section 5.3, Figure 3.8)."""

_MODEL_THICKNESS = 0.01  # the finite-element specimen behind Table 5.5 is 1 cm thick (section 4.2) [m]


@dataclass(frozen=True, kw_only=True)
class ModulusSpread:
    """Coefficients of variation (SD over mean) of the LEM at three levels.

    Attributes
    ----------
    between_liver_cv : float
        CV of the livers' mean LEM; 0 if the variance estimate was negative.
    between_cut_cv : float
        CV of the cuts' mean LEM within one liver.
    within_cut_cv : float
        CV of the loading segments of one cut. Not normalised by depth: it contains the liver's bulge.
    between_liver_clipped : bool
        True if the between-liver variance was negative and was set to zero.
    """

    between_liver_cv: float
    between_cut_cv: float
    within_cut_cv: float
    between_liver_clipped: bool = False

    def __post_init__(self) -> None:
        """Raise ValueError if a coefficient of variation is out of range."""
        for name in ("between_liver_cv", "between_cut_cv", "within_cut_cv"):
            in_range(name, getattr(self, name), 0.0, 2.0, "1", "It is the SD over the mean, 0.2 for 20 %.")


def modulus_spread(formulation: Formulation = "plane_stress") -> ModulusSpread:
    """Return the spread of the LEM at 90 deg between livers, between cuts and within a cut.

    Parameters
    ----------
    formulation : str
        ``"plane_stress"`` or ``"plane_strain"``.

    Returns
    -------
    ModulusSpread
        Pure numbers.

    Notes
    -----
    Source: Tables 5.2 to 5.4, twelve cuts at each of 0.1, 1.27 and 2.54 cm/s; not
    depth-normalised. Assumption: the rows 1-4, 5-8 and 9-12 are three livers of four cuts each; the thesis
    says four cuts a liver but not which. Every table is divided by its mean, so that the speeds may be
    pooled; the mean squares of the one-way random-effects analysis of variance are averaged over the three
    tables before the components are taken. The within-cut value is the mean over all 36 cuts of the printed
    SD over the printed average.

    A caution: the rows of Tables 5.2 and 5.3 correlate (0.79 in plane stress), as if equal numbers shared a
    liver, so the three tables are not three independent samples and the between-liver value is a rough one.
    """
    one_of("formulation", formulation, ("plane_stress", "plane_strain"))
    tables = [table(number) for number in ("5.2", "5.3", "5.4")]
    averages = [data[f"lem_{formulation}_Pa"] for data in tables]
    within_cut = [data[f"sd_{formulation}_Pa"] / mean for data, mean in zip(tables, averages, strict=True)]
    between_liver, between_cut = variance_components(
        np.stack([mean.reshape(-1, CUTS_PER_LIVER) / mean.mean() for mean in averages])
    )
    return ModulusSpread(
        between_liver_cv=math.sqrt(max(between_liver, 0.0)),
        between_cut_cv=math.sqrt(between_cut),
        within_cut_cv=float(np.mean(within_cut)),
        between_liver_clipped=between_liver < 0,
    )


def inclined_spread(formulation: Formulation = "plane_stress") -> float:
    """Return the CV between cuts that an inclined blade shows beyond an upright one: 0.46 in plane stress.

    Parameters
    ----------
    formulation : str
        ``"plane_stress"`` or ``"plane_strain"``.

    Returns
    -------
    float
        Coefficient of variation [1].

    Notes
    -----
    Source: Table 5.6, SD over mean at seven speeds. Its mean square at 90 deg is subtracted from that at 45 deg, which
    assumes that the stiffness of a cut and the effect of an inclined blade on it are independent.
    """
    one_of("formulation", formulation, ("plane_stress", "plane_strain"))
    data = table("5.6")
    upright, inclined = (
        np.mean((data[f"sd_{formulation}_{angle}_deg_Pa"] / data[f"lem_{formulation}_{angle}_deg_Pa"]) ** 2)
        for angle in (90, 45)
    )
    return math.sqrt(max(float(inclined - upright), 0.0))


def variance_components(groups: Array) -> tuple[float, float]:
    """Return the variances between and within groups, by one-way random-effects analysis of variance.

    Parameters
    ----------
    groups : ndarray of float64, shape (tables, groups, members)
        Balanced; the mean squares are averaged over the tables.

    Returns
    -------
    between, within : float
        Variances, in the square of the unit of ``groups``. ``between`` is unbiased, so it may be negative.
    """
    n_groups, n_members = groups.shape[-2:]
    group_means = groups.mean(axis=-1, keepdims=True)
    squares_within = ((groups - group_means) ** 2).sum(axis=(-2, -1))
    mean_square_within = float(squares_within.mean()) / (n_groups * (n_members - 1))
    mean_square_between = n_members * float(group_means.var(axis=-2, ddof=1).mean())
    return (mean_square_between - mean_square_within) / n_members, mean_square_within


def mean_depth_of_cut(formulation: Formulation = "plane_stress") -> float:
    """Return the mean depth of the measured cuts [m]: 1.43 cm in plane stress.

    Parameters
    ----------
    formulation : str
        ``"plane_stress"`` or ``"plane_strain"``.

    Returns
    -------
    float
        [m]

    Notes
    -----
    Source: Table 5.5 treats the force of a cut as if it were 1 cm deep, Table 5.6 the force per depth, so their
    ratio is the depth in cm. The depth does not depend on speed or angle: the geometric mean, which treats a ratio
    and its inverse alike, over the thirteen pairs that both tables have. A rough value: the ratios range from 0.9
    to 2.3, where section 5.4 has depths of 0 to about 2 cm.
    """
    return float(np.exp(_log_depths(formulation).mean()))


def depth_standard_error(formulation: Formulation = "plane_stress") -> float:
    """Return the relative standard error of :func:`mean_depth_of_cut` [1], from the scatter of its thirteen pairs."""
    logs = _log_depths(formulation)
    return float(logs.std(ddof=1) / math.sqrt(len(logs)))


def _log_depths(formulation: Formulation) -> Array:
    """Return the logarithm of the depth [m] from each pair of Tables 5.5 and 5.6."""
    one_of("formulation", formulation, ("plane_stress", "plane_strain"))
    columns = [f"lem_{formulation}_{angle}_deg_Pa" for angle in (90, 45)]
    ratios = np.concatenate([table("5.5")[column] / table("5.6")[column] for column in columns])
    return np.asarray(np.log(ratios[np.isfinite(ratios)] * _MODEL_THICKNESS))
