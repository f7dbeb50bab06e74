"""Scripts for ``cutenv/DepthCut-v1``, and features of a learned policy.

A cut is as deep as the blade is where the crack tip is, some millimetres behind.  So surface and wanted depth are
remembered as the blade passes, and the most useful features are by how much the blade must go down for the depth that
is wanted at the tip and ahead of it; the tip is estimated from the force along the cut, and from both forces
(:mod:`cutenv.agents.policy.tip_estimate`).  Nothing is included that a rig could not know.

How to move along the cut is a script of gentle cutting; how deep is that of the scripts here.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices, Struct, StructArray
from cutenv._base.validation import in_range
from cutenv._engine.elementary import tanh
from cutenv._engine.jit import njit, njit_internal
from cutenv.agents.policy.features import Features
from cutenv.agents.policy.interface import (
    DEPTH_COLUMN,
    FORCE_MEAN_COLUMN,
    POSITION_COLUMN,
    SPEED_COLUMN,
    ArrayPolicy,
    in_si,
)
from cutenv.agents.policy.scripted import OneReturnStroke, Script, ThirdAxisScript
from cutenv.agents.policy.tip_estimate import TwoForces, feel_two_forces, nothing_felt
from cutenv.sim.quantities import SHALLOWEST
from cutenv.sim.tissue.crack_tip import BladeReading
from cutenv.sim.tissue.description import measured_liver
from cutenv.sim.tissue.grid import N_POINTS, SPACING
from cutenv.sim.tissue.specimen import nominal_tissue
from cutenv.task.depth import DEPTH_COMPONENTS, DEPTH_CUT, DESCENT_SCALE
from cutenv.task.observation import CLIP, COMPONENTS, SCALES, SPEED_SCALE, speed_action

_FIRST = len(COMPONENTS)
_COLUMNS = {one.name: _FIRST + number for number, one in enumerate(DEPTH_COMPONENTS)}
_SCALES = np.array([one.scale for one in DEPTH_CUT.all_components])
_VERTICALS = [_COLUMNS[name] for name in ("vertical", "vertical_mean", "vertical_max")]
_VERTICAL_MEAN, _BLADE_DEPTH, _DESCENT_SPEED, _WANTED = (
    _COLUMNS[name] for name in ("vertical_mean", "blade_depth", "descent_speed", "wanted")
)
_AHEAD = 4  # wanted depths in an observation: at the blade, and at three places ahead of it
_LEADS = (0.0, 0.002, 0.004, 0.007, 0.010)  # distances ahead of the tip at which the error of the depth is told [m]
_LENGTH = 0.002  # [m], scale of errors of the depth
_LAG = 0.010  # [m], scale of the tip's lag
_FINE = 0.0005  # [m], scale of errors that a blade can still correct
_PER_FORCE = 0.002  # [m/N], depth to which a newton presses the floor of the cut
_OBSERVED = len(DEPTH_COMPONENTS)
_FELT = 3  # lag, stiffness and friction by two forces
_OF_DEPTH = _OBSERVED + 2 * len(_LEADS) + 2 * _AHEAD + 1 + _FELT + 2 * len(_LEADS)  # features that depth adds

DEPTH_MEMORY: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("passed", "i8"),  # number of points that the blade has passed
            ("surface", "f8", (N_POINTS,)),  # level of the surface, as measured [m]
            ("wanted", "f8", (N_POINTS,)),  # wanted depth [m]
        ],
    )
)
"""Structured dtype of what the features remember of one cut."""


class DepthFeatures(Features):
    """Features of one cut or many of ``cutenv/DepthCut-v1``.

    They are what depth adds to the observation, and what follows. Those of gentle cutting, which come first, have the
    blade's depth as the depth of cut.
    """

    components = len(DEPTH_CUT.all_components)
    added = _OF_DEPTH
    forces = (*Features.forces, *_VERTICALS)

    def __init__(self, count: int = 1, *, history: int = 0, force: bool = True) -> None:
        super().__init__(count, history=history, force=force)
        self._depths, self._felt = np.zeros(int(count), DEPTH_MEMORY), nothing_felt(int(count))

    def forget(self, cuts: int | Indices) -> None:
        """Forget one of the cuts, or several, given by index."""
        super().forget(cuts)
        self._depths["passed"][cuts] = 0
        self._felt[cuts] = nothing_felt(1)[0]

    def seen_along(self, seen: Array32) -> Array32:
        """Return gentle cutting's observations, with blade depth as cut depth."""
        along = seen[:, :_FIRST].copy()
        along[:, DEPTH_COLUMN] = seen[:, _BLADE_DEPTH] * (_SCALES[_BLADE_DEPTH] / SCALES[DEPTH_COLUMN])
        return along

    def add(self, seen: Array32, cuts: Indices, features: Array32) -> None:
        """Fill the features of the depth."""
        add_depth_some(
            self._depths, self._felt, self.estimates, self.memory, nominal_tissue(measured_liver()), cuts,
            seen, features,
        )  # fmt: skip


@njit
def add_depth_some(
    memory: StructArray,
    felt: StructArray,
    estimates: StructArray,
    tips: StructArray,
    nominals: StructArray,
    cuts: StructArray,
    observations: StructArray,
    features: StructArray,
) -> None:
    """Fill the depth features and update memory of n indexed cuts.

    ``estimates`` and ``tips`` are those of all cuts, :data:`~cutenv.agents.policy.tip_estimate.CUT_ESTIMATE` and
    :data:`~cutenv.agents.policy.tip_estimate.CUT_MEMORY`; ``felt`` is
    :data:`~cutenv.agents.policy.tip_estimate.TWO_FORCES`; ``observations`` and ``features`` have shape (n, 22) and (n,
    size).
    """
    for k in range(len(cuts)):
        n = cuts[k]
        _add_depth(memory[n], felt[n], estimates[n], tips[n].probed, nominals[0], observations[k], features[k])


@njit_internal
def _add_depth(
    memory: Struct, felt: Struct, estimate: Struct, probed: int, nominal: Struct, observation: StructArray,
    features: StructArray,
) -> None:  # fmt: skip
    position = max(observation[POSITION_COLUMN] * _SCALES[POSITION_COLUMN], 0.0)
    surface = observation[DEPTH_COLUMN] * _SCALES[DEPTH_COLUMN]  # depth of a blade at level 0
    blade = observation[_BLADE_DEPTH] * _SCALES[_BLADE_DEPTH]
    level = surface - blade
    _remember_depth(memory, position, surface, observation[_WANTED] * _SCALES[_WANTED])

    first = len(features) - _OF_DEPTH
    k = first
    for i in range(_OBSERVED):
        features[k + i] = observation[_FIRST + i]
    k += _OBSERVED
    k = _add_lower(memory, estimate.tip, level, features, k)
    for i in range(_AHEAD):
        lower = observation[_WANTED + i] * _SCALES[_WANTED + i] - blade
        features[k] = lower / _LENGTH
        features[k + 1] = tanh(lower / _LENGTH)
        k += 2
    pressed = _PER_FORCE * observation[_VERTICAL_MEAN] * _SCALES[_VERTICAL_MEAN]
    features[k] = tanh(pressed / _FINE)

    reading = BladeReading(
        position, observation[SPEED_COLUMN] * _SCALES[SPEED_COLUMN], max(blade, SHALLOWEST),
        observation[FORCE_MEAN_COLUMN] * _SCALES[FORCE_MEAN_COLUMN],
    )  # fmt: skip
    lag = feel_two_forces(
        felt, nominal, reading, observation[_VERTICAL_MEAN] * _SCALES[_VERTICAL_MEAN],
        observation[_DESCENT_SPEED] * _SCALES[_DESCENT_SPEED],
    )  # fmt: skip
    features[k + 1], features[k + 2], features[k + 3] = lag / _LAG, felt.stiffness, felt.friction
    _add_lower(memory, estimate.tip if probed == 1 else position - lag, level, features, k + 1 + _FELT)
    for i in range(first, len(features)):
        features[i] = min(max(features[i], -CLIP), CLIP)


@njit_internal
def _add_lower(memory: Struct, tip: float, level: float, features: StructArray, k: int) -> int:
    """Fill how far to descend for a tip [m]; return the next feature."""
    for lead in _LEADS:
        i = min(max(int((tip + lead) / SPACING + 0.5), 0), memory.passed - 1)
        lower = level - (memory.surface[i] - memory.wanted[i])
        features[k] = lower / _LENGTH
        features[k + 1] = tanh(lower / _FINE)
        k += 2
    return k


@njit_internal
def _remember_depth(memory: Struct, position: float, surface: float, wanted: float) -> None:
    """Remember interpolated surface and wanted depth [m] up to the blade."""
    passed = memory.passed
    reached = min(int(position / SPACING + 0.5), N_POINTS - 1) + 1
    before = memory.surface[passed - 1] if passed > 0 else surface
    wanted_before = memory.wanted[passed - 1] if passed > 0 else wanted
    for i in range(passed, reached):
        share = (i + 1 - passed) / (reached - passed)
        memory.surface[i] = before + (surface - before) * share
        memory.wanted[i] = wanted_before + (wanted - wanted_before) * share
    memory.passed = max(passed, reached)


VERTICAL_MEAN, BLADE_DEPTH, WANTED = (_COLUMNS[name] - _FIRST for name in ("vertical_mean", "blade_depth", "wanted"))
"""Columns of what depth adds to an observation."""
_MOTION = [POSITION_COLUMN, SPEED_COLUMN, DEPTH_COLUMN, FORCE_MEAN_COLUMN]
_TIME_LEFT = [one.name for one in COMPONENTS].index("time_left")
_PROBE_TIME = 0.2  # [s]
_DEPTH_SCALE = COMPONENTS[DEPTH_COLUMN].scale


class DepthScript(ThirdAxisScript):
    """Base class: gentle cutting along the cut, with depth by :meth:`depths`.

    A cut is as deep as the blade is where the crack tip is, some millimetres behind. So the surface and the wanted
    depth are remembered as the blade passes, and the blade is as high as they ask for at the estimated tip.  The policy
    ``along`` the cut, by default the best script of gentle cutting, is shown the depth of the blade as the depth of
    cut. ``gain`` is the descent speed over the error of the level [1/s]; ``lead`` is how far ahead of the tip the depth
    is followed, for the time that the blade takes [m].
    """

    components = DEPTH_CUT.all_components

    def __init__(self, along: ArrayPolicy | None = None, *, gain: float = 4.0, lead: float = 0.004) -> None:
        super().__init__(along)
        self._gain = in_range("gain", gain, 0.1, 100.0, "1/s", "A drive with a lag of 40 ms follows 4 well.")
        self._lead = in_range("lead", lead, 0.0, 0.05, "m", "1 mm is 0.001.")

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``; a script uses no randomness."""
        self._surface, self._wanted = np.zeros((len(rngs), N_POINTS)), np.zeros((len(rngs), N_POINTS))
        self._passed, self._begun = np.full(len(rngs), -1), np.full(len(rngs), np.nan)
        self.elapsed: Array = np.zeros(len(rngs))  # time since each cut began [s], shape (n,)
        super().begin(rngs)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        super().forget(cuts)
        self._passed[cuts], self._begun[cuts] = -1, np.nan

    def act(self, observations: Array32) -> Array32:
        """Return actions, (n, 3), for all cuts' observations, (n, 22)."""
        shown, seen = self.parted(observations)
        along = in_si(shown)
        self._begun = np.where(np.isnan(self._begun), along[:, _TIME_LEFT], self._begun)
        self.elapsed = self._begun - along[:, _TIME_LEFT]
        self._remember(along[:, POSITION_COLUMN], along[:, DEPTH_COLUMN], seen[:, WANTED])
        shown[:, DEPTH_COLUMN] = seen[:, BLADE_DEPTH] / _DEPTH_SCALE
        tips = self.tips(in_si(shown), seen)
        point = np.clip(((tips + self._lead) / SPACING + 0.5).astype(int), 0, self._passed)
        actions = self.move(shown, seen[:, VERTICAL_MEAN])
        depths = self.depths(self._wanted[np.arange(len(point)), point], seen, actions)
        level = along[:, DEPTH_COLUMN] - seen[:, BLADE_DEPTH]
        descent = self._gain * (level - (self.surfaces(point) - depths))
        actions[:, 2] = np.clip(speed_action(descent * (SPEED_SCALE / DESCENT_SCALE)), -1.0, 1.0)
        if isinstance(self.along, Script):  # a blade that is moved up or down at rest is held by friction
            actions[self.along.unloading.unloaded, 2] = 0.0
        return actions

    def tips(self, along: Array, seen: Array) -> Array:
        """Return the tips [m], shape (n,).

        ``along``, (n, 12), are components of gentle cutting with the blade's depth as the depth of cut, and ``seen``,
        (n, 10), those that depth adds; SI.
        """
        return self._estimate.tips(along)

    def surfaces(self, point: Indices) -> Array:
        """Return surface levels [m], (n,), at these grid points."""
        levels: Array = self._surface[np.arange(len(point)), point]
        return levels

    def _remember(self, position: Array, surface: Array, wanted: Array) -> None:
        """Remember surface and wanted depth [m] at the points that blades passed."""
        point = np.clip((position / SPACING + 0.5).astype(int), 0, N_POINTS - 1)
        for n in np.flatnonzero(point > self._passed).tolist():
            self._surface[n, self._passed[n] + 1 : point[n] + 1] = surface[n]
            self._wanted[n, self._passed[n] + 1 : point[n] + 1] = wanted[n]
            self._passed[n] = point[n]

    @abstractmethod
    def depths(self, wanted: Array, seen: Array, actions: Array32) -> Array:
        """Return the blades' target depths below the surface [m], (n,).

        ``wanted`` are those at the tips [m], (n,); ``seen`` the components that depth adds, SI, (n, 10); ``actions``,
        (n, 3), with speeds and angles, may be changed.
        """


class HoldDepth(DepthScript):
    """The depth that is wanted at the start, held throughout."""

    def start(self, count: int) -> None:
        """Begin ``count`` cuts."""
        self._depth = np.full(count, np.nan)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        super().forget(cuts)
        self._depth[cuts] = np.nan

    def depths(self, wanted: Array, seen: Array, actions: Array32) -> Array:
        """Return the depth that was wanted first."""
        self._depth = np.where(np.isnan(self._depth), wanted, self._depth)
        return self._depth


class FollowDepth(DepthScript):
    """The wanted depth below the surface, as it was measured."""

    def depths(self, wanted: Array, seen: Array, actions: Array32) -> Array:
        """Return the wanted depths."""
        return wanted


class DepthByTwoForces(FollowDepth):
    """The wanted depth at a tip that two forces tell.

    The forces along the cut and upwards tell it together, before any return stroke. It gives up earlier before a
    predicted run than the other scripts: the tissue below the cut is spared with it.
    """

    def __init__(self, along: ArrayPolicy | None = None, *, gain: float = 4.0, lead: float = 0.006) -> None:
        super().__init__(along or OneReturnStroke(run_share=1.0, beyond=0.002), gain=gain, lead=lead)
        self._forces = TwoForces()

    def start(self, count: int) -> None:
        """Begin ``count`` cuts."""
        self._forces.begin(count)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        super().forget(cuts)
        self._forces.forget(cuts)

    def tips(self, along: Array, seen: Array) -> Array:
        """Return the tips by two forces, or by a return stroke's measurement."""
        located = super().tips(along, seen)
        lags = self._forces.lags(
            np.column_stack([along[:, _MOTION], seen[:, VERTICAL_MEAN], seen[:, _DESCENT_SPEED - _FIRST]])
        )  # fmt: skip
        tips: Array = np.where(self._estimate.memory["probed"] == 1, located, along[:, POSITION_COLUMN] - lags)
        return tips


class DepthByForce(DepthScript):
    """The wanted depth, by the floor of the cut.

    It is not by the blade: where the floor resists, the blade presses on.  The floor is above the blade by as much as
    it is pressed, by ``per_force`` [m/N] of vertical force, for which the blade is at most ``most`` lower than wanted
    [m].
    """

    def __init__(
        self,
        along: ArrayPolicy | None = None,
        *,
        gain: float = 4.0,
        lead: float = 0.007,
        per_force: float = 0.002,
        most: float = 0.0005,
    ) -> None:
        super().__init__(along, gain=gain, lead=lead)
        self._per_force = in_range("per_force", per_force, 0.0, 0.1, "m/N", "1 mm for each newton is 0.001.")
        self._most = in_range("most", most, 0.0, 0.02, "m", "1 mm is 0.001.")

    def depths(self, wanted: Array, seen: Array, actions: Array32) -> Array:
        """Return depths at which the floor becomes the wanted one."""
        pressed: Array = wanted + np.clip(self._per_force * seen[:, VERTICAL_MEAN], 0.0, self._most)
        return pressed


class ProbeDown(DepthScript):
    """The wanted depth, with probes downwards every so often.

    At a stop ``every`` so many seconds the blade goes down by ``probe`` [m], is felt, and comes up again.  The layer
    below tells itself by a force that differs from that of the tissue: where it was found, the blade keeps above it, by
    ``margin`` [m].
    """

    def __init__(
        self,
        along: ArrayPolicy | None = None,
        *,
        gain: float = 4.0,
        lead: float = 0.004,
        every: float = 3.0,
        probe: float = 0.0004,
        margin: float = 0.0005,
    ) -> None:
        super().__init__(along, gain=gain, lead=lead)
        self._every = in_range("every", every, 0.5, 60.0, "s", "A few seconds.")
        self._probe = in_range("probe", probe, 0.0, 0.01, "m", "1 mm is 0.001.")
        self._margin = in_range("margin", margin, 0.0, 0.01, "m", "1 mm is 0.001.")

    def start(self, count: int) -> None:
        """Begin ``count`` cuts."""
        self._probes, self._most = np.zeros(count, int), np.zeros(count)
        self._usual, self._floor = np.full(count, np.nan), np.full(count, np.inf)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        super().forget(cuts)
        self._probes[cuts], self._most[cuts] = 0, 0.0
        self._usual[cuts], self._floor[cuts] = np.nan, np.inf

    def depths(self, wanted: Array, seen: Array, actions: Array32) -> Array:
        """Return depths of a probe, or the wanted ones above its finding."""
        due = (self.elapsed / self._every).astype(int)  # the first one after a while, not at the start
        down = (due > self._probes) & (self.elapsed - due * self._every < _PROBE_TIME)
        done = (due > self._probes) & ~down
        self._most = np.where(down, np.maximum(self._most, seen[:, VERTICAL_MEAN]), self._most)
        usual = np.where(np.isnan(self._usual), self._most, self._usual)
        other = done & (np.abs(self._most - usual) > 0.5 * np.maximum(usual, 0.2))
        self._floor = np.where(other, np.minimum(self._floor, seen[:, BLADE_DEPTH] - self._margin), self._floor)
        self._usual = np.where(done & ~other, 0.5 * (usual + self._most), self._usual)
        self._most, self._probes = np.where(done, 0.0, self._most), np.where(done, due, self._probes)
        actions[down, 0] = np.minimum(actions[down, 0], 0.0)  # it stands while it goes down
        depths: Array = np.where(down, wanted + self._probe, np.minimum(wanted, self._floor))
        return depths


DEPTH_SCRIPTS: dict[str, Callable[[], ArrayPolicy]] = {
    "hold one depth": HoldDepth,
    "follow the depth": FollowDepth,
    "depth by force": DepthByForce,
    "probe down": ProbeDown,
    "depth by two forces": DepthByTwoForces,
}
"""Scripts for ``cutenv/DepthCut-v1`` by name."""
