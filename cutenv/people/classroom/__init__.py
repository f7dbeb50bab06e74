"""Class that cuts in browsers, with codes, courses and records.

Needs the extra ``cutenv[serve]``.  The browser runs the law (:mod:`cutenv.people.browser`); the server draws the
specimens, repeats every cut from the movements of the hand, and keeps it only if its own law confirms it.
"""

from __future__ import annotations

from cutenv.people.classroom.class_store import ClassStore
from cutenv.people.classroom.lesson import Lesson, RefusedCut

__all__ = ["ClassStore", "Lesson", "RefusedCut"]
