"""The course of the crack reckoned from the force: it turns after the force, whose direction is felt."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Indices, Struct, StructArray
from cutenv._engine.elementary import exp
from cutenv._engine.jit import njit, njit_internal
from cutenv.tissue.grid import N_POINTS, SPACING

BACK = 0.020
"""Length within which the tip is to come back to the line [m]."""
_LEAST_FORCE = 0.3  # [N], below which its direction tells nothing
_LARGEST = 0.3  # [rad], of a crack to the line; what tells of more is an error
_BELIEVED = 0.050  # [m] of cut, after which a third of what was reckoned before still counts

COURSE: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("passed", "i8"),  # last point of the line that the blade has passed
            ("turned", "f8", (N_POINTS,)),  # direction of the line at these points, from that at the start [rad]
            ("tip", "f8"),  # last estimate [m]; NaN: none yet
            ("crack", "f8"),  # angle of the crack to the left of the line at the tip [rad]
            ("aside", "f8"),  # distance of the tip to the left of the line [m]
        ],
    )
)
"""Structured dtype of what is reckoned of one cut; begin with :func:`no_course`."""


def no_course(count: int) -> StructArray:
    """Return the courses of ``count`` cuts that have not begun, :data:`COURSE`."""
    courses = np.zeros(count, COURSE)
    courses["tip"] = math.nan
    return courses


class CrackCourse:
    """Reckoning of where the cracks of n cuts go.

    Attributes
    ----------
    courses : Records, shape (n,)
        What is reckoned, :data:`COURSE`.
    """

    def __init__(self, count: int) -> None:
        self.courses = no_course(count)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self.courses[cuts] = no_course(1)[0]

    def follow(self, position: Array, line: tuple[Array, Array], tip: Array, force: tuple[Array, Array]) -> None:
        """Reckon on with a decision's observations, each of shape (n,).

        Parameters
        ----------
        position, tip : array
            Blade, and estimated tip [m].
        line : tuple of array
            Curvature of the line at the blade [1/m]; angle of the blade to the left of it [rad].
        force : tuple of array
            Elastic force along the blade, and force on the blade to its right [N].
        """
        _follow_all(self.courses, position, line, tip, force)


@njit
def _follow_all(
    courses: StructArray, position: Array, line: tuple[Array, Array], tip: Array, force: tuple[Array, Array]
) -> None:
    (bend, blade), (elastic, lateral) = line, force
    for n in range(len(courses)):
        follow_course(courses[n], position[n], (bend[n], blade[n]), tip[n], (elastic[n], lateral[n]))


@njit_internal
def follow_course(
    course: Struct, position: float, line: tuple[float, float], tip: float, force: tuple[float, float]
) -> None:
    """Reckon one course on, see :meth:`CrackCourse.follow`."""
    (bend, blade), (elastic, lateral) = line, force
    reached = min(max(int(position / SPACING + 0.5), 0), N_POINTS - 1)
    for i in range(course.passed + 1, reached + 1):
        course.turned[i] = course.turned[i - 1] + bend * SPACING
    course.passed = max(course.passed, reached)
    here, behind = course.turned[reached], course.turned[min(max(int(tip / SPACING + 0.5), 0), course.passed)]
    crack = lateral / max(elastic, _LEAST_FORCE) + blade + here - behind
    course.crack = min(max(crack, -_LARGEST), _LARGEST)
    if not math.isnan(course.tip):
        grown = max(tip - course.tip, 0.0)
        course.aside = exp(-grown / _BELIEVED) * course.aside + grown * course.crack
        course.tip = max(course.tip, tip)
    else:
        course.tip = tip
