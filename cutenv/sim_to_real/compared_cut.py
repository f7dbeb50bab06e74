"""One cut prepared for comparison: its record, return and score card."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass, field

from cutenv.scoring import ScoreCard, score
from cutenv.trace import Trace

FORCE_RESOLUTION = 0.05
"""Resolution of the force sensor, worst case in the cutting plane [N]; thesis 3.1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedCut:
    """One cut, on the rig or in the simulator, assessed in the same way.

    Attributes
    ----------
    trace : Trace
        Record of the cut.
    value : float
        Return: the sum of rewards, on both sides from the same estimates.
    success : bool
        Success by the definition of the task.
    end : str
        Reason why the cut ended.
    card : ScoreCard
        Score card of the trace.
    """

    trace: Trace
    value: float
    success: bool
    end: str
    card: ScoreCard = field(init=False)

    @functools.cached_property
    def displaced(self) -> ScoreCard:
        """Score card that the record would have if the sensor's zero were off by its resolution."""
        return score(dataclasses.replace(self.trace, force=self.trace.force + FORCE_RESOLUTION))

    def __post_init__(self) -> None:
        object.__setattr__(self, "card", score(self.trace))
