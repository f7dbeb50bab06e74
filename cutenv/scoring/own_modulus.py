"""Modulus of the very tissue that was cut, from the loading ramps in its record: livers differ by a third."""

from __future__ import annotations

import numpy as np

from cutenv.measurement import DepthProfile, estimate_local_effective_moduli
from cutenv.measurement.loading_ratio import loading_ratio
from cutenv.tissue import TissueDescription
from cutenv.tissue.slab import effective_depth
from cutenv.trace import Trace

_DROP = 0.03  # fraction of the peak force by which a fall ends a loading ramp
_FEWEST_RAMPS = 3  # loading ramps needed for the cut's own modulus


def modulus_of_ramps(trace: Trace, profile: DepthProfile, tissue: TissueDescription) -> float | None:
    """Return the material's modulus [Pa] from the steady loading ramps of a record; None for fewer than three.

    Parameters
    ----------
    trace : Trace
        Record with angle, and with the depth at the blade.
    profile : DepthProfile
        Depth of cut over position.
    tissue : TissueDescription
        Tissue whose model and friction are used.

    Raises
    ------
    ValueError
        If speed or angle of a ramp are outside the range measured for liver.
    """
    found = estimate_local_effective_moduli(
        trace,
        tissue.cut_model(),
        friction_per_depth=tissue.nominal_friction_per_depth,
        smallest_drop=max(_DROP * float(trace.force.max()), 1e-6),
    )
    depth = profile.at(found.position)
    moduli = found.modulus * depth / effective_depth(found.position, depth, tissue.thickness)
    slow = [E / loading_ratio(float(s.speed or 0.0), s.angle) for E, s in zip(moduli, found.segments, strict=True)]
    return float(np.median(slow)) if len(slow) >= _FEWEST_RAMPS else None
