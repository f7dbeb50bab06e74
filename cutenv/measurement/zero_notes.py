"""Notes of a calibration about the sensors' zeros in its records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cutenv.measurement.measured_cut import MeasuredCut
from cutenv.measurement.strokes import fit_return_stroke
from cutenv.measurement.zero import NOTABLE

_OFFSET = 0.1  # [N]; the note gives its effect on friction's share


def zero_notes(cuts: Sequence[MeasuredCut]) -> list[str]:
    """Return notes on the sensors' zeros: how much was subtracted, and which numbers an offset may distort.

    An unknown offset looks like friction, and where depth varies it looks like spread of the tissue.
    """
    notes = []
    unknown = [cut for cut in cuts if not cut.fracture.zero.is_known]
    if unknown:
        share = float(np.median([_OFFSET / (cut.depth.depth.max() * cut.fracture.corrected) for cut in unknown]))
        notes.append(
            f"{len(unknown)} of {len(cuts)} cuts do not show the sensor's zero: no rest out of the tissue, no way back "
            "along a depth that varies. Friction, an offset and the spread within and between cuts cannot be told "
            f"apart: {_OFFSET:g} N of offset change friction's share by {share:.2f} or more. Let the blade rest 0.2 s "
            "in air before and after every cut"
        )
    taken = [cut.fracture.zero.largest for cut in cuts if abs(cut.fracture.zero.largest) >= NOTABLE]
    if taken:
        notes.append(
            f"the sensor's zero was taken off the force: {min(taken):.2f} to {max(taken):.2f} N in {len(taken)} of "
            f"{len(cuts)} cuts"
        )
    left = [
        back.offset
        for cut in cuts
        if cut.return_stroke is not None
        and (back := fit_return_stroke(cut.trace, cut.depth, with_offset=True)) is not None
        and back.offset_error <= NOTABLE
    ]
    if left and abs(median := float(np.median(left))) > NOTABLE:
        notes.append(
            f"on the way back {len(left)} cuts show a constant {median:.2f} N (median) beside friction: the zero is "
            "not what the blade showed at rest, or friction does not follow the depth. Friction's share and the "
            "spreads are wrong by it"
        )
    return notes
