"""Scripts for ``cutenv/PathCut-v1``: a script of gentle cutting moves along the line, and they steer."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices, StructArray
from cutenv._base.validation import in_range
from cutenv.policy.interface import POSITION_COLUMN, SPEED_COLUMN, ArrayPolicy, in_si
from cutenv.policy.path_features import BACK, CrackCourse
from cutenv.policy.scripted import OneReturnStroke, Script, StopAndUnload
from cutenv.policy.tip_estimate import TipEstimate
from cutenv.task.observation import COMPONENTS, DEAD_ZONE, SPEED_SCALE, speed_action
from cutenv.task.path import LINE_AHEAD, PATH_COMPONENTS, PATH_CUT, TURN_SCALE

_SCALES = np.array([one.scale for one in PATH_COMPONENTS])
_COLUMNS = {one.name: number for number, one in enumerate(PATH_COMPONENTS)}
LATERAL, LATERAL_MEAN, ASIDE, DIRECTION, BEND, ASIDE_FURTHER = (
    _COLUMNS[name] for name in ("lateral", "lateral_mean", "aside", "direction", "bend", "aside_further")
)
"""Columns of what the path adds to an observation."""
_BENDS = [_COLUMNS[name] for name in ("bend", "bend_near", "bend_further")]
_RETURN = 0.004  # [m], length within which a blade comes back to its course
_LARGEST_TURN = 0.5  # [rad], of a blade to the line
_YIELDED = 0.003  # [m/N], by which the tissue yields to a side; less, since friction is felt too


class SeenPath(NamedTuple):
    """Observations of n cuts as a script sees them; each of shape (n,) or (n, columns), SI."""

    along: Array
    """Components of gentle cutting, shape (n, 12)."""
    line: Array
    """Components that the path adds, shape (n, 16)."""
    estimates: StructArray
    """Estimates of the tip, :data:`~cutenv.policy.tip_estimate.CUT_ESTIMATE`."""

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


class PathScript(ArrayPolicy):
    """Base class: a policy of gentle cutting moves along the line, and :meth:`bends` says how to steer.

    Parameters
    ----------
    along : ArrayPolicy, optional
        Policy of gentle cutting.  Default: the best script.

    Attributes
    ----------
    environment_arguments : dict
        Keywords of the environment for which it was made; none: it may have any.
    """

    environment_arguments: Mapping[str, Any] = MappingProxyType({})

    def __init__(self, along: ArrayPolicy | None = None) -> None:
        self.along = along or OneReturnStroke()
        self._estimate = TipEstimate()

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``; a script uses no randomness."""
        self.along.begin(rngs)
        self._estimate.begin(len(rngs))
        self.start(len(rngs))

    def start(self, count: int) -> None:
        """Begin ``count`` cuts."""

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self.along.forget(cuts)
        self._estimate.forget(cuts)

    def act(self, observations: Array32) -> Array32:
        """Return the actions, shape (n, 3), for the observations of all cuts, shape (n, 28)."""
        observations = np.asarray(observations, np.float32)
        if observations.shape[1:] != (len(PATH_CUT.all_components),):
            raise ValueError(f"observations have shape {observations.shape}; give (n, {len(PATH_CUT.all_components)}).")
        shown = observations[:, : len(COMPONENTS)]
        along = in_si(shown)
        seen = SeenPath(along, observations[:, len(COMPONENTS) :] * _SCALES, self._estimate.estimates(along))
        actions = np.empty((len(shown), 3), np.float32)
        if isinstance(self.along, Script):
            self.along.unloading.across = seen.line[:, LATERAL]
        actions[:, :2] = self.along.act(shown)
        turn = along[:, SPEED_COLUMN] * self.bends(seen, actions)
        actions[:, 2] = np.clip(speed_action(turn * (SPEED_SCALE / TURN_SCALE)), -1.0, 1.0)
        return actions

    @abstractmethod
    def bends(self, seen: SeenPath, actions: Array32) -> Array:
        """Return the bends of the blade's way to the left [1/m], shape (n,); ``actions``, shape (n, 3), may be changed.

        Each is what a blade that moves forward turns by, over its way.
        """


def course(seen: SeenPath, aside: Array | float) -> Array:
    """Return the bends [1/m], shape (n,), of a way that comes to a distance ``aside`` to the left of the line [m]."""
    back = np.where(seen.along[:, SPEED_COLUMN] < 0.0, -1.0, 1.0)
    off = aside + seen.line[:, ASIDE]
    bends: Array = seen.line[:, BEND] + off / _RETURN**2 - back * 2.0 / _RETURN * seen.turned
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
    """A blade that heads for the line 10 mm further, as a driver does: inside the bends."""

    def bends(self, seen: SeenPath, actions: Array32) -> Array:
        """Return the bends of arcs to the line ahead; backwards, the blade goes back along the line."""
        ahead: Array = 2.0 * seen.line[:, ASIDE_FURTHER] / LINE_AHEAD[1] ** 2
        return np.where(seen.along[:, SPEED_COLUMN] < 0.0, course(seen, 0.0), ahead)


class SlowInBends(PathScript):
    """A blade that follows the line, slower where the line bends within the next 10 mm.

    Parameters
    ----------
    bend : float
        Curvature at which the speed is half [1/m].
    """

    def __init__(self, along: ArrayPolicy | None = None, *, bend: float = 40.0) -> None:
        super().__init__(along)
        self._bend = in_range("bend", bend, 1.0, 1000.0, "1/m", "A radius of 25 mm is 40.")

    def bends(self, seen: SeenPath, actions: Array32) -> Array:
        """Return bends that keep the blade on the line, and slow it down."""
        bend = np.abs(seen.line[:, _BENDS]).max(axis=1)
        forward = actions[:, 0] > DEAD_ZONE
        slower = DEAD_ZONE + (actions[:, 0] - DEAD_ZONE) / (1.0 + bend / self._bend)
        actions[:, 0] = np.where(forward, slower, actions[:, 0])
        return course(seen, 0.0)


class OutsideTheBend(PathScript):
    """A blade outside the bend, on the tangent of the line at the estimated tip, so that the tip trails along the line.

    Parameters
    ----------
    share : float
        Share of that distance.
    """

    def __init__(self, along: ArrayPolicy | None = None, *, share: float = 1.0) -> None:
        super().__init__(along)
        self._share = in_range("share", share, -5.0, 5.0, "1", "The whole distance is 1.")

    def bends(self, seen: SeenPath, actions: Array32) -> Array:
        """Return bends that keep the blade beside the line."""
        return course(seen, -0.5 * self._share * seen.line[:, BEND] * seen.lag**2)


class SteerByForce(PathScript):
    """A blade that is led to the side until the force points where the crack is to go.

    The crack turns after the force, whose direction is felt.  So the way of the tip is reckoned
    (:mod:`cutenv.policy.path_features`), and the blade is led to that side where the force must be for the tip to come
    back to the line.

    Parameters
    ----------
    gain : float
        Angle of the blade to the line over that by which the crack is to turn [1].
    back : float
        Length within which the tip is to come back to the line [m].
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
        """Return bends that bring the force to where the crack is to go."""
        aside, crack = self.reckon(seen)
        wanted = -np.clip(aside / self._back, -1.0, 1.0)
        turned = np.clip(self._gain * (wanted - crack), -_LARGEST_TURN, _LARGEST_TURN)
        ahead: Array = seen.line[:, BEND] + (turned - seen.turned) / _RETURN
        return np.where(seen.along[:, SPEED_COLUMN] <= 0.0, course_back(seen), ahead)

    def reckon(self, seen: SeenPath) -> tuple[Array, Array]:
        """Return the distances of the tips to the left of the line [m], and the angles of the cracks to it [rad]."""
        force = seen.estimates["elastic"], seen.line[:, LATERAL_MEAN]
        line = seen.line[:, BEND], seen.turned
        self._course.follow(seen.along[:, POSITION_COLUMN], line, seen.estimates["tip"], force)
        return self._course.courses["aside"], self._course.courses["crack"]


def course_back(seen: SeenPath) -> Array:
    """Return the bends [1/m], shape (n,), of a blade that draws back, to where the cut does not push it to a side."""
    return course(seen, -seen.line[:, ASIDE] - _YIELDED * seen.line[:, LATERAL])


ALONG_NUMBERS = ("speed", "angle", "approach", "stroke", "stroke_speed", "held", "beyond", "run_share")
"""Numbers of :class:`~cutenv.policy.scripted.OneReturnStroke`, by which a script moves along the line."""
ENDING_NUMBERS = ("margin", "retreat_speed")
"""Those of :class:`~cutenv.policy.scripted.StopAndUnload`, by which it ends."""


TUNED_AT: Mapping[str, Any] = {"control_hz": 10}
"""Keywords of the environment in which ``scripts/benchmarks/agents/tune_scripts.py`` finds numbers."""


def with_numbers(kind: type[PathScript], numbers: Mapping[str, float]) -> PathScript:
    """Return a script of a kind with numbers by name; those that are not given are usual.

    They are those of :data:`ALONG_NUMBERS` and :data:`ENDING_NUMBERS`, and the kind's own.  The script decides as often
    as when the numbers were found.
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
"""Scripts for ``cutenv/Excision-v1`` by name, tuned by ``scripts/benchmarks/agents/tune_scripts.py``."""
HAND_SCRIPTS: dict[str, Callable[[], ArrayPolicy]] = {
    "excision by hand and force": partial(with_numbers, SteerByForce, HAND_NUMBERS),
    "excision by hand on the line": BladeOnLine,
}
"""Scripts for ``cutenv/HandExcision-v1`` by name, tuned likewise."""
