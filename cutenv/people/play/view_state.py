"""State of a session that a picture shows.

Numbers, without drawing.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from cutenv._base.arrays import Array, StructArray
from cutenv.display.viewer.scene import Moment
from cutenv.people.play.course import ShownFeedback
from cutenv.people.play.handle_body import HandlePose
from cutenv.records.scoring import ScoreCard
from cutenv.sim.tissue import CutModel

PlayPhase = Literal["ready", "countdown", "cutting", "ended"]


@dataclass(frozen=True, kw_only=True)
class ViewState:
    """State of a session to be drawn at one moment.

    Nothing in it changes afterwards.
    """

    phase: PlayPhase
    countdown: float
    moment: Moment
    readings: StructArray
    hand: float
    hand_place: tuple[float, float]
    """Along and across the slab, to the left [m]."""
    lateral_force: Array
    """Force on the blade to its right at every reading [N]; of shape (0,) where it is not steered."""
    pose: HandlePose | None
    missing: tuple[str, ...]
    practice: bool
    practised: bool
    truth: dict[str, Any]
    specimen_class: str
    chosen_class: str
    serial: int
    model: CutModel
    number: int
    finished: int
    count: int | None
    card: ScoreCard | None
    saved: Path | None
    operator: str | None
    shown: ShownFeedback
    feedback_words: str
    task: str
    verdict: tuple[str, ...]
    leader: str
    """Words that say who leads a shared cut; empty where only a person cuts."""
    done: bool
