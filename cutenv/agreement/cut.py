"""One cut as it is compared: what was recorded of it, and what it comes to."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass, field

from cutenv.scoring import ScoreCard, score
from cutenv.trace import Trace

FORCE_RESOLUTION = 0.05
"""Of the force sensor, worst case in the cutting plane [N]; thesis 3.1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedCut:
    """One cut, on the rig or in the simulator, judged by the same means.

    Attributes
    ----------
    trace : Trace
        What was recorded.
    value : float
        Return: the rewards added up, both sides by the same estimates.
    success : bool
        As the task has it.
    end : str
        Why the cut ended.
    card : ScoreCard
        Of the trace.
    """

    trace: Trace
    value: float
    success: bool
    end: str
    card: ScoreCard = field(init=False)

    @functools.cached_property
    def displaced(self) -> ScoreCard:
        """The card that the record would have if the sensor's zero were off by its resolution."""
        return score(dataclasses.replace(self.trace, force=self.trace.force + FORCE_RESOLUTION))

    def __post_init__(self) -> None:
        object.__setattr__(self, "card", score(self.trace))
