"""Size of a pixel in the tissue against distance from the detector: the thesis's fits, and a cone beam."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.validation import one_of

MAGNIFICATION_MODELS = {"linear": 1, "quadratic": 2, "cone_beam": 1}
"""Models, with the degree of the polynomial in the distance that each one is."""


@dataclass(frozen=True, kw_only=True)
class Magnification:
    """Length in the object for one pixel of the image, m(d), at distance d from the detector.

    Parameters
    ----------
    model : {"linear", "quadratic", "cone_beam"}
        The thesis's for its top view (7.3) and side view (7.4), or what a point source gives: p (1 - d/D), with the
        pixel p on the detector and the source's distance D from it. The cone beam is the linear one with a meaning.
    coefficients : tuple of float
        Highest power first, [length per pixel / distance^n].

    Notes
    -----
    Erratum: the thesis prints no units for m and d. (7.3) is a cone beam with p = 0.3411 and D = 426 in the unit of
    d. With m in mm/px that is a pixel of 0.34 mm; d in mm would put the source 43 cm from the detector, less than any
    C-arm has. (7.4) is no cone beam: it is smallest at d = 69.7 and grows beyond.

    Examples
    --------
    >>> round(THESIS_MAGNIFICATION["top"].at(100.0), 4)
    0.2611
    >>> THESIS_MAGNIFICATION["top"].source_distance
    426.375
    """

    model: str
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        one_of("model of the magnification", self.model, MAGNIFICATION_MODELS)
        needed = MAGNIFICATION_MODELS[self.model] + 1
        if len(self.coefficients) != needed or not np.isfinite(self.coefficients).all():
            raise ValueError(f"the magnification {self.model!r} has {needed} finite coefficients.")

    def at(self, distance: float) -> float:
        """Return the length of one pixel at a distance from the detector."""
        return float(np.polyval(self.coefficients, distance))

    @property
    def source_distance(self) -> float:
        """Distance D of the source from the detector, in the unit of d.

        Raises
        ------
        ValueError
            For the quadratic model, which belongs to no point source.
        """
        if self.model == "quadratic":
            raise ValueError("a quadratic magnification belongs to no point source; fit the cone beam.")
        slope, pixel = self.coefficients
        return -pixel / slope


THESIS_MAGNIFICATION = {
    "top": Magnification(model="linear", coefficients=(-0.0008, 0.3411)),
    "side": Magnification(model="quadratic", coefficients=(0.000784, -0.1093, 5.1358)),
}
"""The thesis's equations (7.3) and (7.4), units not printed."""


def fit_magnification(
    distance: ArrayLike, length_per_pixel: ArrayLike, model: str = "cone_beam"
) -> tuple[Magnification, NDArray[np.float64]]:
    """Fit a magnification to images of a ruler or a grid at several distances.

    Parameters
    ----------
    distance : array_like, shape (n,)
        Distances from the detector, in any unit of length.
    length_per_pixel : array_like, shape (n,)
        Length of one pixel found in each image: spacing of the grid over its spacing in pixels.
    model : str
        One of `MAGNIFICATION_MODELS`.

    Returns
    -------
    magnification : Magnification
        The fit.
    residual : ndarray, shape (n,)
        Relative error of the fit at each distance [1].

    Raises
    ------
    ValueError
        If distances are too few, or a cone beam would have its source on the wrong side.
    """
    one_of("model of the magnification", model, MAGNIFICATION_MODELS)
    d, m = np.asarray(distance, float).ravel(), np.asarray(length_per_pixel, float).ravel()
    degree = MAGNIFICATION_MODELS[model]
    if len(d) != len(m) or len(np.unique(d)) < degree + 1 or not (np.isfinite(d).all() and np.isfinite(m).all()):
        raise ValueError(f"the magnification {model!r} needs finite lengths at {degree + 1} or more distances.")
    if (m <= 0.0).any():
        raise ValueError("lengths of a pixel are positive.")
    # Each image errs by a share of its length.
    found = Magnification(model=model, coefficients=tuple(np.polyfit(d, m, degree, w=1.0 / m).tolist()))
    if model == "cone_beam" and (found.coefficients[0] >= 0.0 or found.source_distance <= d.max()):
        raise ValueError(
            f"a pixel covers {m[np.argmin(d)]:g} at the least distance and {m[np.argmax(d)]:g} at the largest; in a "
            "cone beam it covers less away from the detector. Are the distances those from the source?"
        )
    return found, np.asarray(np.polyval(found.coefficients, d) / m - 1.0)
