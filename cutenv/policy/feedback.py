"""Scripts with force feedback: speed as a function of force, and unloading probes that locate the tip."""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array32
from cutenv._base.validation import in_range
from cutenv.policy.scripted import INCLINED, Script, checked_approach, checked_motion
from cutenv.policy.tip_estimate import TipEstimate
from cutenv.policy.unloading import UPRIGHT, StopAndUnload, coasting
from cutenv.task.observation import COMPONENTS, SCALES, to_action
from cutenv.task_quantities import SHALLOWEST

_NAMES = [component.name for component in COMPONENTS]
_FORCE, _POSITION, _SPEED, _DEPTH, _DISTANCE = (
    _NAMES.index(name) for name in ("force", "position", "speed", "depth", "distance")
)


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

    def command(self, observation: Array32) -> Array32:
        """Return the action while cutting."""
        depth = max(float(observation[_DEPTH]) * SCALES[_DEPTH], SHALLOWEST)
        force_per_depth = float(observation[_FORCE]) * SCALES[_FORCE] / depth
        load = min(max(force_per_depth / self._full_load, 0.0), 1.0)
        return to_action(self._unloaded + (self._loaded - self._unloaded) * load, self._angle)


class ProbeAndCreep:
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
        self._estimate = TipEstimate()

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last cut."""
        self._estimate.reset()
        self._probe: UnloadProbe | None = None
        self._probes = 0
        self._resting = False
        self._furthest = self._goal = 0.0

    def __call__(self, observation: Array32) -> Array32:
        """Return the action for an observation."""
        position, speed, distance = (float(observation[k]) * SCALES[k] for k in (_POSITION, _SPEED, _DISTANCE))
        self._furthest = max(self._furthest, position)
        target = position + distance
        if self._probe is None and not self._resting:
            left = self._goal - position if self._probes else target - self._approach - self._estimate(observation)
            if left > coasting(speed):
                return self._creep if self._probes else self._cut
            self._probe = UnloadProbe()
        if self._probe is not None:
            if self._probe.feel(observation):
                return to_action(-UnloadProbe.SPEED, UPRIGHT)
            self._learn(self._probe.tip, target)
        return to_action(0.0, UPRIGHT) if self._resting else self._creep

    def _learn(self, tip: float, target: float) -> None:
        self._probe = None
        self._probes += 1
        missing = target - tip
        self._resting = missing < self._near_enough or self._probes >= self._most
        self._goal = self._furthest + missing - self._margin  # the tip will lag by as much as it did


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

    def feel(self, observation: Array32) -> bool:
        """Add an observation; return True while the retreat must go on."""
        position, force, speed = (float(observation[k]) * SCALES[k] for k in (_POSITION, _FORCE, _SPEED))
        if speed > -0.9 * self.SPEED:
            return True
        self._felt.append((position, force))
        before = [f for x, f in self._felt if x > position + self._FLAT_OVER]
        if not before or force > 0.0 or before[-1] - force > self._FLAT:
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
