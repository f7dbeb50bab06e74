"""Grid of points along the cut line at which a specimen is described."""

from __future__ import annotations

LENGTH = 0.15
"""Length of a specimen [m]."""

# Linear interpolation between points errs by less than 0.1 % of K at the shortest admitted correlation length (15 mm),
# and a specimen's profile fits into 7 kB, inside a first-level cache.
SPACING = 0.5e-3
"""Distance between the points of a specimen's profiles [m]."""

POINTS_PER_METRE = 1.0 / SPACING
N_POINTS = round(LENGTH / SPACING) + 1
