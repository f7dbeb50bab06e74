"""Cuts by a person: mouse, gamepad or haptic device lead the hand; law, task and score are those of an agent.

The window needs pygame-ce and pymunk, which the extra ``cutenv[play]`` installs; a cut without a window needs neither.
"""

from __future__ import annotations

from cutenv.play.hand_model import PLAYED_HAND
from cutenv.play.haptics import HapticDevice, Stylus, VirtualCoupling
from cutenv.play.play_session import Session, SessionPlan
from cutenv.play.played_cut import PlayedCut

__all__ = ["PLAYED_HAND", "HapticDevice", "PlayedCut", "Session", "SessionPlan", "Stylus", "VirtualCoupling"]
