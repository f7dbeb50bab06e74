"""Scripts with force feedback: speed as a function of force, and unloading probes that locate the tip."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices
from cutenv._base.validation import in_range
from cutenv.policy.interface import (
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
from cutenv.policy.scripted import INCLINED, UPRIGHT, Script, StopAndUnload, checked_approach, checked_motion, coasting
from cutenv.policy.tip_estimate import TipEstimate
from cutenv.task.observation import to_action
from cutenv.task_quantities import SHALLOWEST


class ForceFeedback(Script):
    """A feed whose speed rises with the force per depth, because a loaded blade cuts more evenly when it moves fast.

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
    """A cut to near the target, then probes and short feeds in turn, until the tip is near enough.

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
        """Return the actions, shape (n, 2), for the observations of all cuts, shape (n, 12)."""
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
        """Set the goal of cut ``n`` after a probe that found its tip [m]."""
        del self._probing[n]
        self._probes[n] += 1
        missing = target - tip
        self._resting[n] = missing < self._near_enough or self._probes[n] >= self._most
        self._goal[n] = self._furthest[n] + missing - self._margin  # the tip will lag by as much as it did


class UnloadProbe:
    """A retreat at constant speed until only friction is measured.

    Attributes
    ----------
    tip : float
        Position at which the force has fallen to friction [m].
    stiffness : float
        Stiffness K from the slope of the force during the retreat [N/m]; 0 if there was nothing to unload.
    """

    SPEED = 0.010  # [m/s]
    _SETTLED = 0.08  # [s] of retreat after which the delayed force no longer contains the earlier friction
    _FLAT, _FLAT_OVER = 0.07, 0.001  # [N], [m]: pure friction changes by less than this over this distance
    _STEEP = 0.15  # [N] above friction: still elastic

    def __init__(self) -> None:
        self._felt: list[tuple[float, float]] = []
        self.tip = self.stiffness = 0.0

    def feel(self, position: float, force: float, speed: float) -> bool:
        """Add the blade's position [m], force [N] and speed [m/s]; return True while the retreat must go on."""
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
