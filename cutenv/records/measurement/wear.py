"""Blade wear: rise of fracture resistance with the length cut."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from cutenv._base.arrays import Array
from cutenv._base.validation import array_in_range
from cutenv.records.measurement.fracture import FractureEstimate
from cutenv.records.measurement.measured_cut import MeasuredCut, by_specimen
from cutenv.sim.trace import Trace

USED_KEY = "blade_used_m"  # key of a record's metadata: length that its blade had cut before [m]
BLADE_KEY = "blade"  # key of a record's metadata: the blade, such as "7"; records without it are of one blade
MIN_CUTS = 4  # least number of cuts of a series
_SURE = 0.95


@dataclass(frozen=True, kw_only=True)
class WearEstimate:
    """Wear of blades from cuts, with 95 % intervals.

    Attributes
    ----------
    wear, low, high : float
        Rise of the fracture resistance for each metre cut, over that of a new blade [1/m], and its interval.
    fresh, fresh_low, fresh_high : float
        Fracture resistance with a new blade, without friction's share [J/m2], and its interval.
    spread : float
        Standard deviation between cuts, relative to the fit [1].
    cuts, specimens : int
        Number of cuts, and of pieces of tissue whose own level was fitted; 1: all had one level.
    used : float
        Greatest length that a blade had cut in the middle of a cut [m].
    """

    wear: float
    low: float
    high: float
    fresh: float
    fresh_low: float
    fresh_high: float
    spread: float
    cuts: int
    specimens: int
    used: float

    @property
    def seen(self) -> bool:
        """True if the interval excludes a blade without wear."""
        return self.low > 0.0

    @property
    def lines(self) -> list[str]:
        """Result as lines of text."""
        of = f"{self.cuts} cuts" + (f" of {self.specimens} specimens, each with its own level" * (self.specimens > 1))
        return [
            f"blade wear: {of}, up to {self.used:.2f} m cut by a blade, 95 % intervals",
            f"  rise of R per metre cut         {self.wear:5.3f}  {self.low:.3f} to {self.high:.3f} 1/m",
            f"  R of a new blade, less friction {self.fresh:5.4g}  {self.fresh_low:.4g} to {self.fresh_high:.4g} J/m2",
            f"  {'wear' if self.seen else 'no wear'} is seen; besides, cuts differ by {100 * self.spread:.0f} %",
        ]


def fit_wear(
    resistance: Array | Sequence[float], used: Array | Sequence[float], specimen: Sequence[str] | None = None
) -> WearEstimate:
    """Fit wear R = R0 (1 + w L) to cuts.

    L is the length that the blade had cut in the middle of each. Cuts of one piece of tissue share a level. Least
    squares on the logarithm, as cuts differ by a factor; the slope of ln(1 + w L) is found by iteration, and intervals
    are by Student's t from the residuals between cuts.

    Parameters
    ----------
    resistance : array, shape (n,)
        Fracture resistance of each cut, without friction's share [J/m2]; see :func:`without_friction`.
    used : array, shape (n,)
        Length that its blade had cut in the middle of the cut [m].
    specimen : sequence of str, optional
        Piece of tissue of each cut; default one for all, so that the spread between pieces is noise.

    Raises
    ------
    ValueError
        If there are fewer than :data:`MIN_CUTS` cuts, or too few for so many specimens, or all have the same length.
    """
    R = array_in_range("resistance", resistance, 1.0, 1e6, "J/m2", "Liver has some 200.")
    L = array_in_range("used", used, 0.0, 1e3, "m", "Lengths are in metres: 8 cm is 0.08.")
    pieces = ["" for _ in R] if specimen is None else list(specimen)
    if not len(R) == len(L) == len(pieces):
        raise ValueError(f"{len(R)} resistances, {len(L)} lengths and {len(pieces)} specimens: give one of each a cut.")
    kinds = sorted(set(pieces))
    freedom = len(R) - len(kinds) - 1
    if len(R) < MIN_CUTS or freedom < 2:
        raise ValueError(
            f"{len(R)} cuts of {len(kinds)} specimens are too few: a series needs {MIN_CUTS} cuts, and 3 more than "
            "it has specimens."
        )
    levels = np.array([[float(piece == kind) for kind in kinds] for piece in pieces])
    within = L - levels @ (levels.T @ L / levels.sum(axis=0))
    if np.ptp(within) < 1e-3:
        raise ValueError(
            f"within a specimen all cuts were made at one age of the blade, {L.mean():.3g} m: give cuts of one blade, "
            f'one after the other, with metadata["{USED_KEY}"].'
        )
    wear, y = 0.0, np.log(R)
    for _ in range(100):  # Gauss-Newton from no wear
        columns = np.column_stack((levels, L / (1.0 + wear * L)))
        found = np.linalg.lstsq(columns, y - np.log1p(wear * L), rcond=None)[0]
        step = float(found[-1])
        least = -0.9 / float(L.max())  # 1 + w L stays above zero
        wear = max(wear + step, least + 0.1 * (wear - least))
        if abs(step) < 1e-10:
            break
    off = y - np.log1p(wear * L) - levels @ found[:-1]
    columns = np.column_stack((levels, L / (1.0 + wear * L)))
    variance = float(off @ off) / freedom
    covariance = variance * np.linalg.inv(columns.T @ columns)
    t = float(stdtrit(freedom, 0.5 + 0.5 * _SURE))
    error = t * math.sqrt(float(covariance[-1, -1]))
    shares = levels.sum(axis=0) / len(R)
    level = float(shares @ found[:-1])
    level_error = t * math.sqrt(float(shares @ covariance[:-1, :-1] @ shares))
    return WearEstimate(
        wear=wear,
        low=wear - error,
        high=wear + error,
        fresh=math.exp(level),
        fresh_low=math.exp(level - level_error),
        fresh_high=math.exp(level + level_error),
        spread=math.sqrt(variance),
        cuts=len(R),
        specimens=len(kinds),
        used=float(L.max()),
    )


def blade_wear(cuts: Sequence[MeasuredCut]) -> WearEstimate:
    """Estimate wear from measured cuts in order of making.

    The length that a blade had cut before is the record's metadata, :data:`USED_KEY`; where no record has it, the cuts
    of a blade (:data:`BLADE_KEY`) count one after the other, from a new blade. Specimens that are named have a level of
    their own where each has two cuts or more. It is a ValueError if some records tell the length and others do not, or
    the cuts are too few; see :func:`fit_wear`.
    """
    used = used_before([cut.trace for cut in cuts], [cut.fracture.cut_length for cut in cuts])
    middle = [before + 0.5 * cut.fracture.cut_length for before, cut in zip(used, cuts, strict=True)]
    groups = by_specimen(list(cuts))
    own = len(groups) > 1 and "" not in groups and all(len(group) > 1 for group in groups.values())
    names = [cut.specimen for cut in cuts] if own else None
    return fit_wear([without_friction(cut.fracture) for cut in cuts], middle, names)


def without_friction(fracture: FractureEstimate) -> float:
    """Return R less friction on the blade's faces [J/m2].

    Friction is the blade's faces', and is not taken to change with its edge.
    """
    return fracture.corrected - fracture.friction_per_depth


def used_before(traces: Sequence[Trace], lengths: Sequence[float]) -> list[float]:
    """Return the length each blade had cut before [m]."""
    told = [trace.metadata.get(USED_KEY) for trace in traces]
    if all(each is not None for each in told):
        bad = [each for each in told if isinstance(each, bool) or not isinstance(each, (int, float)) or not each >= 0.0]
        if bad:
            raise ValueError(f'metadata["{USED_KEY}"] = {bad[0]!r} is no length in metres, 0 or more.')
        return [float(each) for each in told]  # type: ignore[arg-type]
    if any(each is not None for each in told):
        count = sum(each is None for each in told)
        raise ValueError(f'{count} of {len(told)} records lack metadata["{USED_KEY}"]: give it to all, or to none.')
    so_far: dict[str, float] = {}
    found = []
    for trace, length in zip(traces, lengths, strict=True):
        blade = str(trace.metadata.get(BLADE_KEY, ""))
        found.append(so_far.get(blade, 0.0))
        so_far[blade] = found[-1] + length
    return found
