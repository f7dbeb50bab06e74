"""Features of a learned policy of ``cutenv/PathCut-v1``: those of gentle cutting, and those of the path.

The crack turns after the force.  So the most useful features are where the force points, the course of the tip that is
reckoned from it, and the rate of turn by which it would come back to the line.  Nothing is included that a rig could
not know.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices, Struct, StructArray
from cutenv._engine.elementary import exp, tanh
from cutenv._engine.jit import njit, njit_internal
from cutenv.policy.features import Features
from cutenv.policy.interface import POSITION_COLUMN, SPEED_COLUMN
from cutenv.task.observation import CLIP, COMPONENTS, SPEED_SCALE, speed_action
from cutenv.task.path import PATH_COMPONENTS, PATH_CUT, TURN_SCALE
from cutenv.tissue.grid import N_POINTS, POINTS_PER_METRE, SPACING

BACK = 0.020
"""Length within which the tip is to come back to the line [m]."""
_LEAST_FORCE = 0.3  # [N], below which its direction tells nothing
_LARGEST_ANGLE = 0.3  # [rad], of a crack to the line; what tells of more is an error
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
    course.crack = min(max(crack, -_LARGEST_ANGLE), _LARGEST_ANGLE)
    if not math.isnan(course.tip):
        grown = max(tip - course.tip, 0.0)
        course.aside = exp(-grown / _BELIEVED) * course.aside + grown * course.crack
        course.tip = max(course.tip, tip)
    else:
        course.tip = tip


_FIRST = len(COMPONENTS)
_COLUMNS = {one.name: _FIRST + number for number, one in enumerate(PATH_COMPONENTS)}
_SCALES = np.array([one.scale for one in PATH_CUT.all_components])
_LATERALS = [_COLUMNS[name] for name in ("lateral", "lateral_mean", "lateral_peak")]
_LATERAL_MEAN, _ASIDE, _DIRECTION, _BEND, _BEND_FURTHER = (
    _COLUMNS[name] for name in ("lateral_mean", "aside", "direction", "bend", "bend_further")
)
_OBSERVED = len(PATH_COMPONENTS)
_OF_PATH = _OBSERVED + 9  # features that the path adds
_TURN, _LENGTH, _FINE = 0.2, 0.002, 0.0005  # scales: angle [rad], distances [m]
_RETURN, _GAIN, _LARGEST = 0.004, 1.5, 0.5  # of the turn by which the tip would come back


class PathFeatures(Features):
    """Features of one cut or many of ``cutenv/PathCut-v1``: what the path adds to the observation, and what follows."""

    components = len(PATH_CUT.all_components)
    added = _OF_PATH
    forces = (*Features.forces, *_LATERALS)

    def __init__(self, count: int = 1, *, history: int = 0, force: bool = True) -> None:
        super().__init__(count, history=history, force=force)
        self._courses = no_course(int(count))

    def forget(self, cuts: int | Indices) -> None:
        """Forget one of the cuts, or several, given by index."""
        super().forget(cuts)
        self._courses[cuts] = no_course(1)[0]

    def add(self, seen: Array32, cuts: Indices, features: Array32) -> None:
        """Fill the features of the path."""
        add_path_some(self._courses, self.estimates, cuts, seen, features)


@njit
def add_path_some(
    courses: StructArray,
    estimates: StructArray,
    cuts: StructArray,
    observations: StructArray,
    features: StructArray,
) -> None:
    """Fill the last features, of the path, and reckon on the courses of the n cuts given by index.

    ``estimates`` are those of all cuts, :data:`~cutenv.policy.tip_estimate.CUT_ESTIMATE`; ``observations`` and
    ``features`` have shape (n, 28) and (n, size).
    """
    for k in range(len(cuts)):
        _add_path(courses[cuts[k]], estimates[cuts[k]], observations[k], features[k])


@njit_internal
def _add_path(course: Struct, estimate: Struct, observation: StructArray, features: StructArray) -> None:
    position = max(observation[POSITION_COLUMN] * _SCALES[POSITION_COLUMN], 0.0)
    speed = observation[SPEED_COLUMN] * _SCALES[SPEED_COLUMN]
    blade, bend = 0.0 - observation[_DIRECTION] * _SCALES[_DIRECTION], observation[_BEND] * _SCALES[_BEND]
    lateral = observation[_LATERAL_MEAN] * _SCALES[_LATERAL_MEAN]
    follow_course(course, position, (bend, blade), estimate.tip, (estimate.elastic, lateral))
    wanted = 0.0 - min(max(course.aside / BACK, -1.0), 1.0)
    turned = min(max(_GAIN * (wanted - course.crack), -_LARGEST), _LARGEST)
    rate = speed * (bend + (turned - blade) / _RETURN)  # by which the tip would come back
    lag = max(position - estimate.tip, 0.0)
    behind = course.turned[min(max(int(estimate.tip * POINTS_PER_METRE + 0.5), 0), course.passed)]
    outside = observation[_ASIDE] * _SCALES[_ASIDE] - 0.5 * bend * lag * lag

    first = len(features) - _OF_PATH
    k = first
    for i in range(_OBSERVED):
        features[k + i] = observation[_FIRST + i]
    k += _OBSERVED
    features[k] = course.crack / _TURN
    features[k + 1] = course.aside / _LENGTH
    features[k + 2] = tanh(course.aside / _FINE)
    features[k + 3] = (wanted - course.crack) / _TURN
    features[k + 4] = min(max(speed_action(rate * (SPEED_SCALE / TURN_SCALE)), -1.0), 1.0)  # that action
    features[k + 5] = blade / _TURN
    features[k + 6] = (course.turned[course.passed] - behind) / _TURN
    features[k + 7] = outside / _LENGTH
    features[k + 8] = max(abs(bend), abs(observation[_BEND_FURTHER] * _SCALES[_BEND_FURTHER])) * lag
    for i in range(first, len(features)):
        features[i] = min(max(features[i], -CLIP), CLIP)
