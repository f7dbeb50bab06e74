"""One cut as it is compared: what was recorded of it, and what it comes to."""

from __future__ import annotations

from dataclasses import dataclass, field

from cutenv.scoring import ScoreCard, score
from cutenv.trace import Trace


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

    def __post_init__(self) -> None:
        object.__setattr__(self, "card", score(self.trace))
