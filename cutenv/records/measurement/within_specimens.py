"""Comparison of cut settings within specimens by a mixed model."""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.records.measurement.measured_cut import MeasuredCut, by_specimen

SAME_SPEED = 1.1  # ratio of neighbouring speeds up to which they are one setting
_SAME_ANGLE = math.radians(5.0)


@dataclass(frozen=True, kw_only=True)
class CutSetting:
    """Setting of a cut: median speed [m/s] and angle [rad]."""

    speed: float
    angle: float

    def __str__(self) -> str:
        return f"{100.0 * self.speed:.2f} cm/s {math.degrees(self.angle):.0f} deg"


@dataclass(frozen=True, kw_only=True)
class SettingEffect:
    """Quantity at one setting relative to the reference, within specimens."""

    setting: CutSetting
    cuts: int  # number of cuts at it
    ratio: float  # ratio, and the ends of its 95 % interval
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class WithinSpecimens:
    """Comparison of the settings for one quantity."""

    quantity: str
    reference: CutSetting  # setting of the reference cuts: that which most specimens were cut at
    effects: tuple[SettingEffect, ...]
    # standard deviation of the logarithm between specimens, and between cuts of one at the same setting
    between_sd: float
    within_sd: float
    specimens: int
    # specimens without a reference cut: their settings are compared with the reference by way of the others
    without_reference: tuple[str, ...]


def compare_settings(cuts: Sequence[MeasuredCut]) -> tuple[WithinSpecimens, ...]:
    """Compare settings' modulus and fracture resistance within specimens.

    The cuts are of two specimens or more, at two settings or more. The modulus is over all cuts that show one.
    """
    nameless = [cut.name for cut in cuts if not cut.specimen]
    if nameless:
        raise ValueError(
            f"{', '.join(nameless)} do not name the specimen. Write it into the records, or use --specimen."
        )
    specimens = np.array([list(by_specimen(list(cuts))).index(cut.specimen) for cut in cuts])
    settings = _settings(cuts)
    moduli = np.array([cut.material_modulus if len(cut.moduli) else np.nan for cut in cuts])
    resistances = np.array([cut.fracture.corrected for cut in cuts])
    names = list(by_specimen(list(cuts)))
    return tuple(
        _compared(quantity, values[known], specimens[known], [settings[n] for n in np.flatnonzero(known)], names)
        for quantity, values in (("modulus", moduli), ("fracture resistance", resistances))
        if (known := np.isfinite(values) & (values > 0.0)).any()
    )


def _settings(cuts: Sequence[MeasuredCut]) -> list[CutSetting]:
    """Return each cut's setting, shared by nearly equal cuts."""
    order = sorted(range(len(cuts)), key=lambda n: (round(cuts[n].angle / _SAME_ANGLE), cuts[n].speed))
    groups: list[list[int]] = []
    for n in order:
        last = cuts[groups[-1][-1]] if groups else None
        near = last is not None and abs(last.angle - cuts[n].angle) < _SAME_ANGLE
        if last is not None and near and cuts[n].speed <= SAME_SPEED * last.speed:
            groups[-1].append(n)
        else:
            groups.append([n])
    found: dict[int, CutSetting] = {}
    for group in groups:
        speed, angle = (float(np.median([getattr(cuts[n], name) for n in group])) for name in ("speed", "angle"))
        found |= dict.fromkeys(group, CutSetting(speed=speed, angle=angle))
    return [found[n] for n in range(len(cuts))]


def _compared(
    quantity: str, values: Array, specimens: Array, settings: Sequence[CutSetting], names: Sequence[str]
) -> WithinSpecimens:
    held = {
        setting: {int(s) for s, each in zip(specimens, settings, strict=True) if each == setting}
        for setting in settings
    }
    counts = Counter(settings)
    reference = max(held, key=lambda setting: (len(held[setting]), counts[setting]))
    others = sorted(
        (each for each in held if each != reference), key=lambda each: (round(math.degrees(each.angle)), each.speed)
    )
    count = len(set(specimens.tolist()))
    degrees = len(values) - count - len(others)
    if count < 2 or not others or degrees < 1:
        raise ValueError(
            f"the {quantity} of {len(values)} cuts of {count} specimens at {len(held)} settings allows no comparison "
            "within specimens. Cut two specimens or more, each at the reference setting and at others."
        )
    design = np.stack([np.ones(len(values)), *([each == other for each in settings] for other in others)], axis=1)
    fixed, errors, between, within = mixed_model(np.log(values), design.astype(np.float64), specimens)
    reach = float(student.ppf(0.975, degrees)) * errors
    return WithinSpecimens(
        quantity=quantity,
        reference=reference,
        effects=tuple(
            SettingEffect(
                setting=other,
                cuts=counts[other],
                ratio=math.exp(fixed[k]),
                low=math.exp(fixed[k] - reach[k]),
                high=math.exp(fixed[k] + reach[k]),
            )
            for k, other in enumerate(others, 1)
        ),
        between_sd=between,
        within_sd=within,
        specimens=count,
        without_reference=tuple(names[s] for s in sorted(set(specimens.tolist()) - held[reference])),
    )


def mixed_model(values: Array, design: Array, groups: Array) -> tuple[Array, Array, float, float]:
    """Fit a linear mixed model by restricted maximum likelihood.

    Each group has a random level. Returned are the fixed effects of the design's columns, shape (k,), their standard
    errors, and the standard deviations between the groups and within them.

    The fit is that of ``statsmodels.regression.mixed_linear_model.MixedLM``. Its intervals are by the normal
    distribution, too narrow for few groups: take Student's t with n - groups - (k - 1) degrees of freedom, which is
    exact if every group has each setting once.
    """
    in_range(
        "rank of the design", np.linalg.matrix_rank(design), design.shape[1], design.shape[1], "1", "Leave one out."
    )
    from statsmodels.regression.mixed_linear_model import MixedLM  # an extra

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns of a variance of zero between groups, which is a result; a method
        # with gradients would fail there
        fitted = MixedLM(values, design, groups).fit(reml=True, method="powell")
    between = math.sqrt(max(float(np.asarray(fitted.cov_re)[0, 0]), 0.0))
    fixed, errors = np.asarray(fitted.fe_params), np.asarray(fitted.bse_fe)
    return fixed, errors, between, math.sqrt(float(fitted.scale))
