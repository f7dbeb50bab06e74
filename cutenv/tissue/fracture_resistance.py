"""The measured fracture resistance (Table 6.1)."""

from __future__ import annotations

import math
from typing import NamedTuple

from cutenv.tissue.tables import table


class FractureResistance(NamedTuple):
    """Mean and between-cut standard deviation of the fracture resistance [J/m2]."""

    mean: float
    sd: float


def measured_fracture_resistance() -> FractureResistance:
    """Return the apparent fracture resistance of pig liver: mean and standard deviation between cuts.

    Returns
    -------
    FractureResistance
        ``mean`` (211) and ``sd`` (78) [J/m2]; unpacks as two.

    Notes
    -----
    Source: Table 6.1, cuts of 0.0254 to 0.1016 m. The mean is that of its seven averages. The standard
    deviation is that of a cut from any row: the root of the mean variance within the rows plus the population
    variance of the row averages. Rows have equal weight, because the thesis does not say how many of the forty cuts
    are in each. Apparent: work of the blade per depth and length of cut (equations 6.1 to 6.4), which contains the
    blade's friction and the lag of the tip. The thesis's force is the norm of the sensor's three components (section
    3.3.2), so that it counts the work of vertical and lateral force as if they acted along the cut.
    """
    data = table("6.1")
    averages = data["fracture_resistance_J_m2"]
    variance_within = float((data["sd_fracture_resistance_J_m2"] ** 2).mean())
    return FractureResistance(mean=float(averages.mean()), sd=math.sqrt(variance_within + float(averages.var(ddof=0))))
