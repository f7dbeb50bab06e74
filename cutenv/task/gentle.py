"""The task of ``cutenv/GentleCut-v1``: a straight cut, to which nothing is added."""

from __future__ import annotations

from cutenv.task.declare import Task

GENTLE_CUT = Task(place=f"{__name__}:GENTLE_CUT", environment="cutenv/GentleCut-v1")
"""Gentle cutting to a target length."""
