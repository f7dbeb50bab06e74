"""Cuts by a person.

Mouse, gamepad or haptic device lead the hand; law, task and score are those of an agent.

The window needs pygame-ce and pymunk, which the extra ``cutenv[play]`` installs; a cut without a window needs neither.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cutenv._base.imports import import_when_used
from cutenv.people.play.haptics import HapticDevice, Stylus, VirtualCoupling

if TYPE_CHECKING:
    from cutenv.people.play.hand_model import PLAYED_HAND
    from cutenv.people.play.play_session import Session, SessionPlan
    from cutenv.people.play.played_cut import PlayedCut

__all__ = ["PLAYED_HAND", "HapticDevice", "PlayedCut", "Session", "SessionPlan", "Stylus", "VirtualCoupling"]

__getattr__ = import_when_used(  # an emulated handle is a process of its own, and needs neither law nor score
    __name__,
    {
        "PLAYED_HAND": "cutenv.people.play.hand_model",
        "PlayedCut": "cutenv.people.play.played_cut",
        "Session": "cutenv.people.play.play_session",
        "SessionPlan": "cutenv.people.play.play_session",
    },
)
