"""Scripts for ``cutenv/PathCut-v1``, and features of a learned policy.

The crack turns after the force.  So the most useful features are where the force points, the course of the tip that is
reckoned from it, and the rate of turn by which it would come back to the line.  Nothing is included that a rig could
not know.

A script of gentle cutting moves along the line; the scripts here steer.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices, Struct, StructArray
from cutenv._base.validation import in_range
from cutenv._engine.elementary import exp, tanh
from cutenv._engine.jit import njit, njit_internal
from cutenv.agents.policy.features import Features
from cutenv.agents.policy.interface import POSITION_COLUMN, SPEED_COLUMN, ArrayPolicy, in_si
from cutenv.agents.policy.scripted import OneReturnStroke, StopAndUnload, ThirdAxisScript
from cutenv.sim.tissue.grid import N_POINTS, POINTS_PER_METRE, SPACING
from cutenv.task.observation import CLIP, COMPONENTS, DEAD_ZONE, SPEED_SCALE, speed_action
from cutenv.task.path import LINE_AHEAD, PATH_COMPONENTS, PATH_CUT, TURN_SCALE

BACK = 0.020  # length within which the tip is to come back to the line [m]
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
    """Reckoning of where the cracks of n cuts go, :data:`COURSE`."""

    def __init__(self, count: int) -> None:
        self.courses = no_course(count)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self.courses[cuts] = no_course(1)[0]

    def follow(self, position: Array, line: tuple[Array, Array], tip: Array, force: tuple[Array, Array]) -> None:
        """Reckon on with a decision's observations, each of shape (n,).

        ``position`` and ``tip`` are the blade and the estimated tip [m]; ``line`` is its curvature at the blade [1/m]
        and the angle of the blade to the left of it [rad]; ``force`` is the elastic one along the blade, and that on
        the blade to its right [N].
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
_RETURN, _GAIN, _MAX_TURN = 0.004, 1.5, 0.5  # of the turn by which the tip would come back


class PathFeatures(Features):
    """Features of one cut or many of ``cutenv/PathCut-v1``.

    They are what the path adds to the observation, and what follows.
    """

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
    """Fill the path features, and estimate courses of n indexed cuts.

    ``estimates`` are those of all cuts, :data:`~cutenv.agents.policy.tip_estimate.CUT_ESTIMATE`; ``observations`` and
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
    turned = min(max(_GAIN * (wanted - course.crack), -_MAX_TURN), _MAX_TURN)
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


LATERAL, LATERAL_MEAN, ASIDE, DIRECTION, BEND, ASIDE_FURTHER = (
    _COLUMNS[name] - _FIRST for name in ("lateral", "lateral_mean", "aside", "direction", "bend", "aside_further")
)
"""Columns of what the path adds to an observation."""
_BENDS = [_COLUMNS[name] - _FIRST for name in ("bend", "bend_near", "bend_further")]
_RETURN_LENGTH = 0.004  # [m], length within which a blade comes back to its course
_LARGEST_TURN = 0.5  # [rad], of a blade to the line
_YIELDED = 0.003  # [m/N], by which the tissue yields to a side; less, since friction is felt too


class SeenPath(NamedTuple):
    """Observations of n cuts as a script sees them.

    Each of shape (n,) or (n, columns), SI.
    """

    along: Array  # components of gentle cutting, shape (n, 12)
    line: Array  # components that the path adds, shape (n, 16)
    estimates: StructArray  # estimates of the tip, :data:`~cutenv.agents.policy.tip_estimate.CUT_ESTIMATE`

    @property
    def lag(self) -> Array:
        """Distance by which the estimated tip is behind the blade [m]."""
        behind: Array = np.maximum(self.along[:, POSITION_COLUMN] - self.estimates["tip"], 0.0)
        return behind

    @property
    def turned(self) -> Array:
        """Angle of the blade to the left of the line [rad]."""
        angle: Array = -np.arcsin(np.clip(self.line[:, DIRECTION], -1.0, 1.0))
        return angle


class PathScript(ThirdAxisScript):
    """Base class of gentle-cutting policies that steer by :meth:`bends`."""

    components = PATH_CUT.all_components
    # keywords of the environment for which it was made; none: it may have any
    environment_arguments: Mapping[str, Any] = MappingProxyType({})

    def act(self, observations: Array32) -> Array32:
        """Return actions, (n, 3), for all cuts' observations, (n, 28)."""
        shown, line = self.parted(observations)
        along = in_si(shown)
        seen = SeenPath(along, line, self._estimate.estimates(along))
        actions = self.move(shown, line[:, LATERAL])
        turn = along[:, SPEED_COLUMN] * self.bends(seen, actions)
        actions[:, 2] = np.clip(speed_action(turn * (SPEED_SCALE / TURN_SCALE)), -1.0, 1.0)
        return actions

    @abstractmethod
    def bends(self, seen: SeenPath, actions: Array32) -> Array:
        """Return leftward bends of the ways [1/m], (n,); ``actions`` may change.

        Each is what a blade that moves forward turns by, over its way.
        """


def course(seen: SeenPath, aside: Array | float) -> Array:
    """Return bends [1/m], (n,), that approach ``aside`` left of the line [m]."""
    back = np.where(seen.along[:, SPEED_COLUMN] < 0.0, -1.0, 1.0)
    off = aside + seen.line[:, ASIDE]
    bends: Array = seen.line[:, BEND] + off / _RETURN_LENGTH**2 - back * 2.0 / _RETURN_LENGTH * seen.turned
    return bends


class StraightOn(PathScript):
    """A blade that is never turned."""

    def bends(self, seen: SeenPath, actions: Array32) -> Array:
        """Return zeros."""
        return np.zeros(len(actions))


class BladeOnLine(PathScript):
    """A blade that follows the line."""

    def bends(self, seen: SeenPath, actions: Array32) -> Array:
        """Return bends that keep the blade on the line."""
        return course(seen, 0.0)


class LookAhead(PathScript):
    """Blade that heads for the line 10 mm ahead, inside bends."""

    def bends(self, seen: SeenPath, actions: Array32) -> Array:
        """Return bends of arcs to the line ahead, or backwards along it."""
        ahead: Array = 2.0 * seen.line[:, ASIDE_FURTHER] / LINE_AHEAD[1] ** 2
        return np.where(seen.along[:, SPEED_COLUMN] < 0.0, course(seen, 0.0), ahead)


class SlowInBends(PathScript):
    """Blade that follows the line, slower before bends within 10 mm.

    At the curvature ``bend`` [1/m] the speed is half.
    """

    def __init__(self, along: ArrayPolicy | None = None, *, bend: float = 40.0) -> None:
        super().__init__(along)
        self._bend = in_range("bend", bend, 1.0, 1000.0, "1/m", "A radius of 25 mm is 40.")

    def bends(self, seen: SeenPath, actions: Array32) -> Array:
        """Return bends that keep to the line, and slow blades down."""
        bend = np.abs(seen.line[:, _BENDS]).max(axis=1)
        forward = actions[:, 0] > DEAD_ZONE
        slower = DEAD_ZONE + (actions[:, 0] - DEAD_ZONE) / (1.0 + bend / self._bend)
        actions[:, 0] = np.where(forward, slower, actions[:, 0])
        return course(seen, 0.0)


class OutsideTheBend(PathScript):
    """A blade outside the bend, on the line's tangent.

    The tangent is at the estimated tip, so that the tip trails along the line; the blade is at a ``share`` of that
    distance.
    """

    def __init__(self, along: ArrayPolicy | None = None, *, share: float = 1.0) -> None:
        super().__init__(along)
        self._share = in_range("share", share, -5.0, 5.0, "1", "The whole distance is 1.")

    def bends(self, seen: SeenPath, actions: Array32) -> Array:
        """Return bends that keep the blade beside the line."""
        return course(seen, -0.5 * self._share * seen.line[:, BEND] * seen.lag**2)


class SteerByForce(PathScript):
    """Blade that is steered sideways until the force points as wanted.

    The crack turns after the force, whose direction is felt.  So the way of the tip is reckoned
    (:mod:`cutenv.agents.policy.path_policies`), and the blade is led to that side where the force must be for the tip
    to come back to the line within ``back`` [m]: by an angle of ``gain`` times that by which the crack is to turn.
    """

    def __init__(self, along: ArrayPolicy | None = None, *, gain: float = 1.5, back: float = BACK) -> None:
        super().__init__(along)
        self._gain = in_range("gain", gain, 0.0, 20.0, "1", "A few.")
        self._back = in_range("back", back, 0.001, 0.2, "m", "10 mm is 0.01.")

    def start(self, count: int) -> None:
        """Begin ``count`` cuts."""
        self._course = CrackCourse(count)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        super().forget(cuts)
        self._course.forget(cuts)

    def bends(self, seen: SeenPath, actions: Array32) -> Array:
        """Return bends that turn the force to the wanted crack direction."""
        aside, crack = self.reckon(seen)
        wanted = -np.clip(aside / self._back, -1.0, 1.0)
        turned = np.clip(self._gain * (wanted - crack), -_LARGEST_TURN, _LARGEST_TURN)
        ahead: Array = seen.line[:, BEND] + (turned - seen.turned) / _RETURN_LENGTH
        return np.where(seen.along[:, SPEED_COLUMN] <= 0.0, course_back(seen), ahead)

    def reckon(self, seen: SeenPath) -> tuple[Array, Array]:
        """Return tips' leftward distances [m] and crack angles [rad] to the line."""
        force = seen.estimates["elastic"], seen.line[:, LATERAL_MEAN]
        line = seen.line[:, BEND], seen.turned
        self._course.follow(seen.along[:, POSITION_COLUMN], line, seen.estimates["tip"], force)
        return self._course.courses["aside"], self._course.courses["crack"]


def course_back(seen: SeenPath) -> Array:
    """Return bends [1/m], (n,), of a retreat without sideways push."""
    return course(seen, -seen.line[:, ASIDE] - _YIELDED * seen.line[:, LATERAL])


ALONG_NUMBERS = ("speed", "angle", "approach", "stroke", "stroke_speed", "held", "beyond", "run_share")
"""Numbers of :class:`~cutenv.agents.policy.scripted.OneReturnStroke`, by which a script moves along the line."""
ENDING_NUMBERS = ("margin", "retreat_speed")
"""Those of :class:`~cutenv.agents.policy.scripted.StopAndUnload`, by which it ends."""


TUNED_AT: Mapping[str, Any] = {"control_hz": 10}
"""Keywords of the environment in which ``scripts/benchmarks/policies/tune_scripts.py`` finds numbers."""


def with_numbers(kind: type[PathScript], numbers: Mapping[str, float]) -> PathScript:
    """Return a script of a kind with numbers by name.

    Those that are not given are usual.  They are those of :data:`ALONG_NUMBERS` and :data:`ENDING_NUMBERS`, and the
    kind's own. The script decides as often as when the numbers were found.
    """
    rest = dict(numbers)
    margin, retreat_speed = rest.pop("margin", -0.0005), rest.pop("retreat_speed", 0.012)
    along = {name: rest.pop(name) for name in ALONG_NUMBERS if name in rest}
    unloading = StopAndUnload(margin=margin, retreat_speed=retreat_speed)
    script = kind(OneReturnStroke(**along, unloading=unloading), **rest)
    script.environment_arguments = TUNED_AT
    return script


PATH_SCRIPTS: dict[str, Callable[[], ArrayPolicy]] = {
    "straight on": StraightOn,
    "blade on the line": BladeOnLine,
    "look ahead": LookAhead,
    "slow in bends": SlowInBends,
    "outside the bend": OutsideTheBend,
    "steer by force": SteerByForce,
}
"""Scripts for ``cutenv/PathCut-v1`` by name."""
EXCISION_NUMBERS: Mapping[str, float] = {
    "speed": 0.0172, "angle": 0.814, "approach": 0.0051, "stroke": 0.00303, "stroke_speed": 0.0065, "held": 1.134,
    "beyond": 0.00295, "run_share": 0.763, "margin": -0.00166, "retreat_speed": 0.0104, "gain": 1.37, "back": 0.032,
}  # fmt: skip
"""Numbers of *steer by force* for excisions, in SI units."""
HAND_NUMBERS: Mapping[str, float] = {
    "speed": 0.0173, "angle": 0.818, "approach": 0.00706, "stroke": 0.0042, "stroke_speed": 0.00792, "held": 1.282,
    "beyond": 0.00334, "run_share": 1.207, "margin": -0.00396, "retreat_speed": 0.0121, "gain": 1.457, "back": 0.0237,
}  # fmt: skip
"""The same for excisions with a hand that yields."""
EXCISION_SCRIPTS: dict[str, Callable[[], ArrayPolicy]] = {
    "excision by force": partial(with_numbers, SteerByForce, EXCISION_NUMBERS),
    "excision on the line": BladeOnLine,
}
"""Scripts for ``cutenv/Excision-v1`` by name, tuned by ``scripts/benchmarks/policies/tune_scripts.py``."""
HAND_SCRIPTS: dict[str, Callable[[], ArrayPolicy]] = {
    "excision by hand and force": partial(with_numbers, SteerByForce, HAND_NUMBERS),
    "excision by hand on the line": BladeOnLine,
}
"""Scripts for ``cutenv/HandExcision-v1`` by name, tuned likewise."""
