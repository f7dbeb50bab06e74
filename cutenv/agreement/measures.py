"""What is compared of a cut, and how much of a difference is none."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cutenv.agreement.curves import force_offset, force_rmse, position_rmse
from cutenv.agreement.cut import FORCE_RESOLUTION, ComparedCut
from cutenv.scoring import METRICS

RELATIVE = 0.01
"""Of the simulator's mean, below which a difference is none whatever the noise: a force sensor's gain, a depth by
caliper and a grid of SYNCs are not known better."""


@dataclass(frozen=True, kw_only=True)
class Measure:
    """One number of a cut that is compared.

    Attributes
    ----------
    name, unit, meaning : str
        "1" for a pure number.
    least_margin : float
        Below which a difference is none, whatever the noise of the sensor does; in the unit.
    share : bool
        Whether it is a yes or no, compared by its mean.
    paired : bool
        Whether it needs cuts of one specimen on both sides.
    value : callable
        Of a cut, given the simulator's other cuts of its specimen; None where there is none.
    harmless : callable, optional
        What of it, for a simulated cut, is no difference either.
    """

    name: str
    unit: str
    meaning: str
    least_margin: float
    share: bool = False
    paired: bool = False
    value: Callable[[ComparedCut, Sequence[ComparedCut]], float | None]
    harmless: Callable[[ComparedCut], float | None] | None = None


# Least margins are a tenth of what the task tolerates; what the force sensor resolves comes by its own way.
_LENGTH = 0.3e-3  # [m]; the tip of a success is within 3 mm
_BY_UNIT = {
    "m": _LENGTH,
    "s": 0.1,  # of 30 s
}
_BY_NAME = {
    "force_drops": 0.5,  # the typical cut has as many
    "reversals": 0.5,
    "wedge": 0.018,  # a degree of the 10 that success allows
    "uncontrolled_share": 0.02,
}
_COUNTED = 0.25  # of the cuts: one in four is what a dozen specimens can tell at all
_RETURN = 0.02  # a tenth of what lies between one honest script and the next


def _metric(name: str) -> Measure:
    about = METRICS[name]

    def value(cut: ComparedCut, others: Sequence[ComparedCut]) -> float | None:
        return cut.card.metrics[name].value

    def harmless(cut: ComparedCut) -> float | None:
        """What a zero shows that is off by what the sensor resolves."""
        own, displaced = cut.card.metrics[name].value, cut.displaced.metrics[name].value
        return None if own is None or displaced is None else abs(displaced - own)

    return Measure(
        name=name,
        unit=about.unit.replace("F", "N"),
        meaning=about.meaning,
        least_margin=_BY_NAME.get(name, _BY_UNIT.get(about.unit, 0.0)),
        value=value,
        harmless=harmless,
    )


def _beside(
    compared: Callable[[ComparedCut, ComparedCut], float | None],
) -> Callable[[ComparedCut, Sequence[ComparedCut]], float | None]:
    """Mean of a comparison with every other cut of the specimen in the simulator."""

    def value(cut: ComparedCut, others: Sequence[ComparedCut]) -> float | None:
        found = [each for other in others if (each := compared(cut, other)) is not None]
        return float(np.mean(found)) if found else None

    return value


_TASK = (
    Measure(
        name="return",
        unit="1",
        meaning="Rewards of the cut added up, by the estimates that a rig can make.",
        least_margin=_RETURN,
        value=lambda cut, others: cut.value,
    ),
    Measure(
        name="success",
        unit="1",
        meaning="Whether the cut was a success: finished, near the target and upright.",
        least_margin=_COUNTED,
        share=True,
        value=lambda cut, others: float(cut.success),
    ),
)
_BESIDE = (
    Measure(
        name="end_agreement",
        unit="1",
        meaning="Share of the simulator's cuts of the same specimen that end as this one.",
        least_margin=_COUNTED,
        share=True,
        paired=True,
        value=_beside(lambda cut, other: float(cut.end == other.end)),
    ),
    Measure(
        name="force_rmse",
        unit="N",
        meaning="Difference of force at equal positions from the simulator's cuts of the specimen (up to a retreat).",
        least_margin=FORCE_RESOLUTION,
        paired=True,
        value=_beside(lambda cut, other: force_rmse(cut.trace, other.trace)),
        # One run of the crack that comes a little later is a difference of newtons for a while.
        harmless=lambda cut: force_rmse(cut.trace, cut.trace, displaced=_LENGTH),
    ),
    Measure(
        name="force_offset",
        unit="N",
        meaning="Mean of that difference, without its sign: a zero that wanders shows, runs of the crack cancel out.",
        least_margin=FORCE_RESOLUTION,
        paired=True,
        value=_beside(lambda cut, other: force_offset(cut.trace, other.trace)),
    ),
    Measure(
        name="position_rmse",
        unit="m",
        meaning="Difference of position at equal times from the simulator's cuts of the same specimen.",
        least_margin=_LENGTH,
        paired=True,
        value=_beside(lambda cut, other: position_rmse(cut.trace, other.trace)),
    ),
)

MEASURES: Mapping[str, Measure] = {each.name: each for each in (*_TASK, *_BESIDE, *map(_metric, METRICS))}
"""Everything that is compared, by name: task, curves, and every metric of a score card."""
