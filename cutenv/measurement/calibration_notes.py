"""Notes of a calibration: what is less certain in it, and why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cutenv.measurement.measured_cut import MeasuredCut
from cutenv.measurement.speed_dependence import BETWEEN, LEAST_SPEED_RATIO
from cutenv.measurement.strokes import fit_return_stroke
from cutenv.measurement.zero import NOTABLE
from cutenv.tissue.cut_model import CutModel

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


def calibration_notes(cuts: Sequence[MeasuredCut], model: CutModel, found: dict[str, float]) -> list[str]:
    """Return notes on cuts of which a tissue was made, and on what was found from them."""
    notes: list[str] = []
    silent = sum(not len(cut.moduli) for cut in cuts)
    if silent:
        notes.append(
            f"{silent} of {len(cuts)} cuts show no steady loading segment: they give a resistance but no modulus"
        )
    notes += _extrapolated(cuts)
    notes += zero_notes(cuts)
    errors = [e / cut.fracture.corrected for cut in cuts if (e := cut.fracture.depth_error) is not None]
    if errors:
        worst = 100.0 * max(errors)
        notes.append(f"{len(errors)} of {len(cuts)} cuts tell their depth's error: by it, R to {worst:.1f} % or better")
    without = sum(cut.return_stroke is None for cut in cuts)
    if without:
        notes.append(f"{without} of {len(cuts)} cuts have no return stroke past the tip: less certain by about 5 %")
    unloading = [modulus for cut in cuts if (modulus := cut.unloading_modulus(model)) is not None]
    if unloading:
        over = float(np.mean(unloading)) / found["intercept_90"]
        notes.append(
            f"{len(unloading)} return strokes unload with {over:.2f} of the modulus for v -> 0 at 90 degrees: "
            "1 if the fall of the modulus with speed is growth of the cut while loading, as in the law"
        )
    if len({cut.specimen for cut in cuts}) == 1 and cuts[0].specimen == "":
        notes.append('no record names its specimen (metadata "specimen"): all count as cuts of one')
    flagged: dict[str, int] = {}
    for cut in cuts:
        for flag in cut.flags:
            if flag not in cut.fracture.zero.flags:  # zero_notes reports on the zero
                flagged[flag] = flagged.get(flag, 0) + 1
    notes += [f"{n} of {len(cuts)} cuts: {flag}" for flag, n in flagged.items()]
    return notes


def _extrapolated(cuts: Sequence[MeasuredCut]) -> list[str]:
    """Return notes on an angle whose line is extrapolated, as it was cut over a shorter range of speeds."""
    known = [cut for cut in cuts if len(cut.moduli)]
    slowest, fastest = (100.0 * end([cut.speed for cut in known]) for end in (min, max))
    notes = []
    for angle_deg, steep in ((90, True), (45, False)):
        own = [100.0 * cut.speed for cut in known if (cut.angle >= BETWEEN) is steep]
        if own and (max(own) * LEAST_SPEED_RATIO < fastest or min(own) > LEAST_SPEED_RATIO * slowest):
            notes.append(
                f"the modulus near {angle_deg} degrees was measured from {min(own):.2g} to {max(own):.2g} cm/s only: "
                f"from {slowest:.2g} to {fastest:.2g} cm/s, the range of the tissue, its line is extrapolated"
            )
    return notes
