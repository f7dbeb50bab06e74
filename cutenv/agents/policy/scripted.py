"""Scripted baselines: what an engineer would program before learning.

All of them end by stopping and unloading. Those with force feedback choose the speed by the force, and locate the tip
by probes that unload.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import Array, Array32, Indices, StructArray
from cutenv._base.validation import in_range
from cutenv.agents.policy.interface import (
    DEPTH_COLUMN,
    DISTANCE_COLUMN,
    FORCE_COLUMN,
    POSITION_COLUMN,
    SPEED_COLUMN,
    ArrayPolicy,
    choose,
    in_si,
    to_actions,
)
from cutenv.agents.policy.tip_estimate import CUT_ESTIMATE, TipEstimate
from cutenv.sim.quantities import SHALLOWEST
from cutenv.task.observation import COMPONENTS, Component, to_action

UPRIGHT = math.pi / 2
_DECELERATION = 0.1  # [m/s2]
_REACTION = 0.060  # [s]: some 50 ms more than the rig needs; every script's margin was tuned with this value


def coasting(speed: ArrayLike) -> Array:
    """Return a blade's stopping distance [m] from ``speed`` [m/s]."""
    v: Array = np.maximum(speed, 0.0)
    return v * _REACTION + v**2 / (2.0 * _DECELERATION)


_HELD_ACROSS = 0.35  # [N]: with what is left along the cut, less than friction holds by itself


class StopAndUnload:
    """Shared ending of a cut.

    Stop at the target, turn upright, draw back until the tissue is unloaded, rest.

    Parameters
    ----------
    margin : float
        Distance of the estimated tip before the target, once the blade has stopped, at which to command the stop [m].
    retreat_speed : float
        Speed of drawing back [m/s].
    tip_estimate : TipEstimate, optional
        Default: the estimator with the measured pig liver's mean stiffness.

    Attributes
    ----------
    tip, left : float, or array of shape (n,)
        The estimated tip and its distance to the target [m], at the last observation, or at those of n cuts.
    estimates : StructArray, shape (n,)
        All that is estimated of the cuts, :data:`cutenv.agents.policy.tip_estimate.CUT_ESTIMATE`.
    across : array of shape (n,), or float
        Force across the cut at the last observation [N], given by scripts whose blade feels one.
    unloaded : array of bool, shape (n,)
        True for cuts that end at rest, because nothing was felt any more while the blade drew back.
    """

    def __init__(
        self, *, margin: float = 0.0, retreat_speed: float = 0.005, tip_estimate: TipEstimate | None = None
    ) -> None:
        self._margin = in_range("margin", margin, -0.05, 0.05, "m", "3 mm is 0.003.")
        in_range("retreat_speed", retreat_speed, 1e-4, 0.0254, "m/s", "5 mm/s is 0.005.")
        self._draw_back, self._rest = to_action(-retreat_speed, UPRIGHT), to_action(0.0, UPRIGHT)
        self.tip_estimate = tip_estimate or TipEstimate()
        self.reset()

    def reset(self) -> None:
        """Forget the last cut."""
        self.begin(1)

    def begin(self, count: int) -> None:
        """Forget all cuts, and begin ``count``."""
        self.tip_estimate.begin(count)
        self.estimates: StructArray = np.zeros(count, CUT_ESTIMATE)
        self.tip: Any = np.zeros(count)
        self.left: Any = np.zeros(count)
        self.across: Array | float = 0.0
        self._stopping, self.unloaded = np.zeros(count, bool), np.zeros(count, bool)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self.tip_estimate.forget(cuts)
        self._stopping[cuts] = self.unloaded[cuts] = False

    def stop(self, cuts: NDArray[np.bool_]) -> None:
        """Begin the ending of ``cuts``, a mask of shape (n,), now."""
        self._stopping |= cuts

    def __call__(self, observation: Array32) -> Array32 | None:
        """Return the ending's action once begun, else None, for an observation, (12,)."""
        begun, actions = self.endings(in_si(observation)[None])
        self.tip, self.left = float(self.tip[0]), float(self.left[0])
        return actions[0] if begun[0] else None

    def endings(self, seen: Array) -> tuple[NDArray[np.bool_], Array32]:
        """Return which endings have begun, (n,), and actions, for SI observations, (n, 12)."""
        self.estimates = self.tip_estimate.estimates(seen)
        self.tip = self.estimates["tip"]
        self.left = seen[:, POSITION_COLUMN] + seen[:, DISTANCE_COLUMN] - self.tip
        self._stopping |= self.left - coasting(seen[:, SPEED_COLUMN]) <= self._margin
        # While the blade draws back, friction lowers the measured force, so that zero is reached while the tissue still
        # holds the blade with a force of friction's size: little energy is left, and the rest counts as unloaded.
        held = (seen[:, FORCE_COLUMN] > 0.0) | (np.abs(self.across) > _HELD_ACROSS)
        self.unloaded |= self._stopping & ~held
        return self._stopping, choose(self.unloaded, self._rest, self._draw_back)


INCLINED = math.radians(45.0)


class Script(ArrayPolicy):
    """Base class of scripts.

    Cut by :meth:`command` until the shared routine stops and unloads.
    """

    def __init__(self, unloading: StopAndUnload | None = None) -> None:
        self.unloading = unloading or StopAndUnload()

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``; a script uses no randomness."""
        self.unloading.begin(len(rngs))

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self.unloading.forget(cuts)

    def act(self, observations: Array32) -> Array32:
        """Return actions, (n, 2), for all cuts' observations, (n, 12)."""
        seen = in_si(observations)
        ending, endings = self.unloading.endings(seen)
        return choose(ending, endings, self.command(seen))

    @abstractmethod
    def command(self, seen: Array) -> Array32:
        """Return cutting actions, (n, 2) or (2,), for SI observations, (n, 12)."""


class ConstantFeed(Script):
    """A constant speed [m/s] and angle [rad] up to the target."""

    def __init__(self, *, speed: float, angle: float = UPRIGHT, unloading: StopAndUnload | None = None) -> None:
        super().__init__(unloading)
        self._action = to_action(*checked_motion(speed, angle))

    def command(self, seen: Array) -> Array32:
        """Return the constant action."""
        return self._action


class FastThenSlow(Script):
    """Fast feed until ``approach`` [m] before the target, then slow."""

    def __init__(
        self,
        *,
        fast: float = 0.019,
        slow: float = 0.0127,
        approach: float = 0.030,
        angle: float = INCLINED,
        unloading: StopAndUnload | None = None,
    ) -> None:
        super().__init__(unloading)
        self._fast, self._slow = to_action(*checked_motion(fast, angle)), to_action(*checked_motion(slow, angle))
        self._approach = checked_approach(approach)

    def command(self, seen: Array) -> Array32:
        """Return the slow action near the target, the fast one before."""
        return choose(self.unloading.left < self._approach, self._slow, self._fast)


class InclineBetween(Script):
    """Feed that is upright at both ends of the cut, inclined between.

    It is upright for the first ``start`` [m], and from ``approach`` [m] before the target.
    """

    def __init__(
        self,
        *,
        speed: float = 0.019,
        angle: float = INCLINED,
        start: float = 0.010,
        approach: float = 0.002,
        unloading: StopAndUnload | None = None,
    ) -> None:
        super().__init__(unloading)
        self._inclined = to_action(*checked_motion(speed, angle))
        self._upright = to_action(speed, UPRIGHT)
        self._start = in_range("start", start, 0.0, 0.15, "m", "10 mm is 0.010.")
        self._approach = checked_approach(approach)

    def command(self, seen: Array) -> Array32:
        """Return the inclined action mid-cut, the upright one at ends."""
        between = (self.unloading.tip > self._start) & (self.unloading.left > self._approach)
        return choose(between, self._inclined, self._upright)


class NoAction(ArrayPolicy):
    """A policy that never moves the blade."""

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Do nothing: there is no state."""

    def forget(self, cuts: Indices) -> None:
        """Do nothing: there is no state."""

    def act(self, observations: Array32) -> Array32:
        """Return the action for speed zero, upright, for every observation."""
        return np.tile(to_action(0.0, UPRIGHT), (len(observations), 1))


class RandomAction(ArrayPolicy):
    """A policy of uniformly random actions."""

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Use ``rngs`` for the next cuts, one for each."""
        self._rngs = list(rngs)

    def forget(self, cuts: Indices) -> None:
        """Do nothing: the next cuts go on with the random numbers."""

    def act(self, observations: Array32) -> Array32:
        """Return a random action for each observation."""
        return np.array([rng.uniform(-1.0, 1.0, 2) for rng in self._rngs], np.float32)


def checked_motion(speed: float, angle: float) -> tuple[float, float]:
    """Return speed [m/s], angle [rad]; raise ValueError out of range."""
    in_range("speed", speed, 0.0, 0.0254, "m/s", "Speeds are in m/s: 2.54 cm/s is 0.0254.")
    in_range("angle", angle, math.radians(45.0) - 1e-9, UPRIGHT + 1e-9, "rad", "90 degrees is 1.5708.")
    return speed, angle


def checked_approach(approach: float) -> float:
    """Return a distance before the target [m]; raise ValueError beyond specimens."""
    return in_range("approach", approach, 0.0, 0.15, "m", "15 mm is 0.015.")


class OneReturnStroke(Script):
    """Constant feed with one return stroke that measures stiffness and friction.

    It gives up where the force tells that the crack would run beyond the target, as from a vessel that holds it.

    Parameters
    ----------
    speed, angle : float
        Speed [m/s] and angle [rad] of the feed.
    approach : float
        Distance of the estimated tip before the target at which to draw back [m].
    stroke, stroke_speed : float
        Length [m] and speed [m/s] of the return stroke.
    held : float
        Elastic force, in multiples of the resistance met so far, from which the tip counts as held.
    beyond : float
        Distance beyond the target that a predicted run may reach [m]; a held tip that would run further ends the cut.
    run_share : float
        Share of the predicted run that is expected.
    """

    def __init__(
        self,
        *,
        speed: float = 0.0165,
        angle: float = INCLINED,
        approach: float = 0.010,
        stroke: float = 0.0025,
        stroke_speed: float = 0.010,
        held: float = 1.3,
        beyond: float = 0.003,
        run_share: float = 0.7,
        unloading: StopAndUnload | None = None,
    ) -> None:
        super().__init__(unloading or StopAndUnload(margin=-0.0005, retreat_speed=0.012))
        self._speed, self._angle = checked_motion(speed, angle)
        self._approach = checked_approach(approach)
        self._stroke = in_range("stroke", stroke, 0.001, 0.05, "m", "2.5 mm is 0.0025.")
        self._stroke_speed = checked_motion(stroke_speed, angle)[0]
        self._held = in_range("held", held, 1.0, 10.0, "1", "A third above the resistance is 1.3.")
        self._beyond = in_range("beyond", beyond, -0.05, 0.05, "m", "3 mm is 0.003.")
        self._run_share = in_range("run_share", run_share, 0.0, 2.0, "1", "The whole run is 1.")

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``."""
        super().begin(rngs)
        self._drawing, self._drawn = np.zeros(len(rngs), bool), np.zeros(len(rngs), bool)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        super().forget(cuts)
        self._drawing[cuts] = self._drawn[cuts] = False

    def command(self, seen: Array) -> Array32:
        """Return the feed, or the return stroke."""
        position, speed = seen[:, POSITION_COLUMN], seen[:, SPEED_COLUMN]
        estimates, left = self.unloading.estimates, self.unloading.left
        self._drawing |= ~self._drawn & (left - coasting(speed) <= self._approach)
        self._drawn |= self._drawing
        back = self.unloading.tip_estimate.memory["furthest"] - position
        self._drawing &= (back < self._stroke) & ((seen[:, FORCE_COLUMN] > 0.0) | (speed > 0.0))
        resistance = estimates["resistance"] * np.maximum(seen[:, DEPTH_COLUMN], SHALLOWEST)
        held = (estimates["elastic"] > self._held * resistance) & (speed > 0.0)
        self.unloading.stop(held & (self._run_share * estimates["run"] > left + self._beyond))
        return to_actions(np.where(self._drawing, -self._stroke_speed, self._speed), self._angle)


class ForceFeedback(Script):
    """A feed whose speed rises with the force per depth.

    A loaded blade cuts more evenly when it moves fast.

    Parameters
    ----------
    unloaded, loaded : float
        Speeds at no force, and at ``full_load`` or above [m/s]; linear between.
    full_load : float
        Force per depth [N/m].
    angle : float
        Angle of the blade [rad].
    """

    def __init__(
        self,
        *,
        unloaded: float = 0.0064,
        loaded: float = 0.0254,
        full_load: float = 300.0,
        angle: float = INCLINED,
        unloading: StopAndUnload | None = None,
    ) -> None:
        super().__init__(unloading)
        self._unloaded, self._angle = checked_motion(unloaded, angle)
        self._loaded = checked_motion(loaded, angle)[0]
        self._full_load = in_range("full_load", full_load, 1.0, 1e4, "N/m", "3 N/cm is 300.")

    def command(self, seen: Array) -> Array32:
        """Return the actions while cutting."""
        force_per_depth = seen[:, FORCE_COLUMN] / np.maximum(seen[:, DEPTH_COLUMN], SHALLOWEST)
        load = np.clip(force_per_depth / self._full_load, 0.0, 1.0)
        return to_actions(self._unloaded + (self._loaded - self._unloaded) * load, self._angle)


class ProbeAndCreep(ArrayPolicy):
    """Cut to near the target, then alternate probes and short feeds.

    A probe unloads elastically: as the blade draws back, the force falls along a straight line whose slope is the
    stiffness K at the tip; where only friction is left, there is the tip.

    Parameters
    ----------
    speed, angle : float
        Speed [m/s] and angle [rad] of the main part of the cut.
    approach : float
        Distance of the estimated tip before the target, once the blade has stopped, at which the first probe
        begins [m].
    creep_speed, creep_angle : float
        Speed [m/s] and angle [rad] of the feeds between probes.
    near_enough : float
        Distance before the target up to which a probe's tip ends the cut [m].
    margin : float
        Distance by which a feed falls short of the missing length [m].
    probes : int
        Largest number of probes.
    """

    def __init__(
        self,
        *,
        speed: float = 0.019,
        angle: float = INCLINED,
        approach: float = 0.003,
        creep_speed: float = 0.019,
        creep_angle: float = INCLINED,
        near_enough: float = 0.0015,
        margin: float = 0.0,
        probes: int = 4,
    ) -> None:
        self._cut = to_action(*checked_motion(speed, angle))
        self._creep = to_action(*checked_motion(creep_speed, creep_angle))
        self._approach = checked_approach(approach)
        self._margin = in_range("margin", margin, -0.05, 0.05, "m", "3 mm is 0.003.")
        self._near_enough = in_range("near_enough", near_enough, 0.0, 0.05, "m", "2 mm is 0.002.")
        self._most = int(in_range("probes", probes, 1, 100, "1", "Two to four are plenty."))
        self._retreat, self._rest = to_action(-UnloadProbe.SPEED, UPRIGHT), to_action(0.0, UPRIGHT)
        self._estimate = TipEstimate()

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``; a script uses no randomness."""
        count = len(rngs)
        self._estimate.begin(count)
        self._probing: dict[int, UnloadProbe] = {}
        self._retreats = np.zeros(count, bool)
        self._probes, self._resting = np.zeros(count, int), np.zeros(count, bool)
        self._furthest, self._goal = np.zeros(count), np.zeros(count)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self._estimate.forget(cuts)
        for n in cuts.tolist():
            self._probing.pop(n, None)
        self._retreats[cuts] = self._probes[cuts] = self._resting[cuts] = self._furthest[cuts] = self._goal[cuts] = 0

    def act(self, observations: Array32) -> Array32:
        """Return actions, (n, 2), for all cuts' observations, (n, 12)."""
        seen = in_si(observations)
        position, target = seen[:, POSITION_COLUMN], seen[:, POSITION_COLUMN] + seen[:, DISTANCE_COLUMN]
        self._furthest = np.maximum(self._furthest, position)
        tips = self._estimate.tips(seen)
        left = np.where(self._probes > 0, self._goal - position, target - self._approach - tips)
        self._retreats |= ~self._resting & (left <= coasting(seen[:, SPEED_COLUMN]))
        felt = seen[:, [POSITION_COLUMN, FORCE_COLUMN, SPEED_COLUMN]]
        for n in np.flatnonzero(self._retreats).tolist():
            probe = self._probing.setdefault(n, UnloadProbe())
            self._retreats[n] = probe.feel(*felt[n].tolist())
            if not self._retreats[n]:
                self._learn(n, probe.tip, target[n])
        actions = choose(self._probes > 0, self._creep, self._cut)
        return choose(self._retreats, self._retreat, choose(self._resting, self._rest, actions))

    def _learn(self, n: int, tip: float, target: float) -> None:
        """Set cut ``n``'s goal after a probe located its tip [m]."""
        del self._probing[n]
        self._probes[n] += 1
        missing = target - tip
        self._resting[n] = missing < self._near_enough or self._probes[n] >= self._most
        self._goal[n] = self._furthest[n] + missing - self._margin  # the tip will lag by as much as it did


class UnloadProbe:
    """A retreat at constant speed until only friction is measured.

    ``tip`` is where the force has fallen to friction [m]; ``stiffness`` is K from the slope of the force during the
    retreat [N/m], 0 if there was nothing to unload.
    """

    SPEED = 0.010  # [m/s]
    _SETTLED = 0.08  # [s] of retreat after which the delayed force no longer contains the earlier friction
    _FLAT, _FLAT_OVER = 0.07, 0.001  # [N], [m]: pure friction changes by less than this over this distance
    _STEEP = 0.15  # [N] above friction: still elastic

    def __init__(self) -> None:
        self._felt: list[tuple[float, float]] = []
        self.tip = self.stiffness = 0.0

    def feel(self, position: float, force: float, speed: float) -> bool:
        """Add position [m], force [N], speed [m/s]; return True while retreating."""
        if speed > -0.9 * self.SPEED:
            return True
        self._felt.append((position, force))
        if force > 0.0:
            return True
        before = next((f for x, f in reversed(self._felt) if x > position + self._FLAT_OVER), np.inf)
        if before - force > self._FLAT:
            return True
        self._find()
        return False

    def _find(self) -> None:
        felt = np.array(self._felt)
        friction = float(felt[-3:, 1].mean())
        settled = felt[felt[:, 0] < felt[0, 0] - self._SETTLED * self.SPEED]
        slope = settled[settled[:, 1] > friction + self._STEEP]
        self.tip = float(felt[felt[:, 1] > friction + self._STEEP, 0].min(initial=felt[0, 0]))
        if len(slope) >= 3:
            self.stiffness, offset = (float(c) for c in np.polyfit(slope[:, 0], slope[:, 1] - friction, 1))
            if self.stiffness > 0.0:
                self.tip = -offset / self.stiffness


class ThirdAxisScript(ArrayPolicy):
    """Base class of scripts for a third action, which move along the cut as gentle cutting does.

    ``along`` is a policy of gentle cutting, by default the best script.
    """

    components: ClassVar[Sequence[Component]]  # all those of the task's observation

    def __init__(self, along: ArrayPolicy | None = None) -> None:
        self.along = along or OneReturnStroke()
        self._estimate = TipEstimate()
        self._scales = np.array([one.scale for one in self.components[len(COMPONENTS) :]])

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

    def parted(self, observations: Array32) -> tuple[Array32, Array]:
        """Return gentle cutting's part, (n, 12), and what the task adds, SI."""
        observations = np.asarray(observations, np.float32)
        if observations.shape[1:] != (len(self.components),):
            raise ValueError(f"observations have shape {observations.shape}; give (n, {len(self.components)}).")
        return observations[:, : len(COMPONENTS)].copy(), observations[:, len(COMPONENTS) :] * self._scales

    def move(self, shown: Array32, across: Array) -> Array32:
        """Return actions, (n, 3), with the first two of ``along``, given the force across [N]."""
        actions = np.empty((len(shown), 3), np.float32)
        if isinstance(self.along, Script):
            self.along.unloading.across = across
        actions[:, :2] = self.along.act(shown)
        return actions
