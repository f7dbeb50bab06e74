"""Scripts for ``cutenv/DepthCut-v1``: how to move along the cut is a script of gentle cutting, how deep is theirs."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices
from cutenv._base.validation import in_range
from cutenv.policy.interface import ArrayPolicy
from cutenv.policy.one_return_stroke import OneReturnStroke
from cutenv.policy.signals import DEPTH_COLUMN
from cutenv.task.depth_terms import ALL_COMPONENTS, DEPTH_COMPONENTS, DESCENT_SCALE, LOOK_AHEAD
from cutenv.task.observation import COMPONENTS, SPEED_SCALE, speed_action

_SCALES = np.array([one.scale for one in DEPTH_COMPONENTS])
_COLUMNS = {one.name: number for number, one in enumerate(DEPTH_COMPONENTS)}
VERTICAL, VERTICAL_MEAN, BLADE_DEPTH, DESCENT_SPEED, WANTED, WANTED_NEAR = (
    _COLUMNS[name] for name in ("vertical", "vertical_mean", "blade_depth", "descent_speed", "wanted", "wanted_near")
)
"""Columns of what depth adds to an observation."""
_DEPTH_SCALE = COMPONENTS[DEPTH_COLUMN].scale


class DepthScript(ArrayPolicy):
    """Base class: a policy of gentle cutting moves along the cut, and :meth:`descent` up and down.

    Parameters
    ----------
    along : ArrayPolicy, optional
        Policy of gentle cutting; it is shown the depth of the blade as the depth of cut.  Default: the best script.
    gain : float
        Descent speed over the error of the depth [1/s].
    """

    def __init__(self, along: ArrayPolicy | None = None, *, gain: float = 8.0) -> None:
        self.along = along or OneReturnStroke()
        self._gain = in_range("gain", gain, 0.1, 100.0, "1/s", "A drive with a lag of 40 ms follows 8 well.")

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``; a script uses no randomness."""
        self.along.begin(rngs)
        self.start(len(rngs))

    def start(self, count: int) -> None:
        """Begin ``count`` cuts."""

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self.along.forget(cuts)

    def act(self, observations: Array32) -> Array32:
        """Return the actions, shape (n, 3), for the observations of all cuts, shape (n, 22)."""
        observations = np.asarray(observations, np.float32)
        if observations.shape[1:] != (len(ALL_COMPONENTS),):
            raise ValueError(f"observations have shape {observations.shape}; give (n, {len(ALL_COMPONENTS)}).")
        shown, seen = observations[:, : len(COMPONENTS)].copy(), observations[:, len(COMPONENTS) :] * _SCALES
        shown[:, DEPTH_COLUMN] = seen[:, BLADE_DEPTH] / _DEPTH_SCALE
        actions = np.empty((len(shown), 3), np.float32)
        actions[:, :2] = self.along.act(shown)
        descent = self.descent(seen, actions)
        actions[:, 2] = np.clip(speed_action(descent * (SPEED_SCALE / DESCENT_SCALE)), -1.0, 1.0)
        return actions

    @abstractmethod
    def descent(self, seen: Array, actions: Array32) -> Array:
        """Return speeds downwards [m/s], shape (n,), for what depth adds to the observations, SI, shape (n, 10).

        ``actions``, shape (n, 3), has the speeds and angles, which may be changed.
        """

    def toward(self, wanted: Array, seen: Array) -> Array:
        """Return the speeds downwards [m/s] that bring the blade to a wanted depth [m]."""
        descent: Array = self._gain * (wanted - seen[:, BLADE_DEPTH])
        return descent


class HoldDepth(DepthScript):
    """The depth that is wanted at the start, held throughout."""

    def start(self, count: int) -> None:
        """Begin ``count`` cuts."""
        self._depth = np.full(count, np.nan)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        super().forget(cuts)
        self._depth[cuts] = np.nan

    def descent(self, seen: Array, actions: Array32) -> Array:
        """Return the speeds that keep the blade as deep below the measured surface as it was."""
        self._depth = np.where(np.isnan(self._depth), seen[:, WANTED], self._depth)
        return self.toward(self._depth, seen)


class FollowDepth(DepthScript):
    """The wanted depth, of which some is seen ahead.

    Parameters
    ----------
    ahead : float
        Distance ahead of the blade at which the wanted depth is followed [m], up to 5 mm.
    """

    def __init__(self, along: ArrayPolicy | None = None, *, gain: float = 8.0, ahead: float = 0.001) -> None:
        super().__init__(along, gain=gain)
        self._share = in_range("ahead", ahead, 0.0, LOOK_AHEAD[0], "m", "1 mm is 0.001.") / LOOK_AHEAD[0]

    def wanted(self, seen: Array) -> Array:
        """Return the depth to be followed [m], shape (n,)."""
        wanted: Array = seen[:, WANTED] + self._share * (seen[:, WANTED_NEAR] - seen[:, WANTED])
        return wanted

    def descent(self, seen: Array, actions: Array32) -> Array:
        """Return the speeds that follow the wanted depth."""
        return self.toward(self.wanted(seen), seen)


class DepthByForce(FollowDepth):
    """The wanted depth, by the floor of the cut instead of the blade: where the floor resists, the blade presses on.

    The floor is above the blade by as much as it is pressed, which the vertical force tells.

    Parameters
    ----------
    per_force : float
        Depth to which a newton presses the floor [m/N].
    most : float
        Largest depth below the wanted one to which the blade is driven [m].
    """

    def __init__(
        self,
        along: ArrayPolicy | None = None,
        *,
        gain: float = 8.0,
        ahead: float = 0.001,
        per_force: float = 0.002,
        most: float = 0.002,
    ) -> None:
        super().__init__(along, gain=gain, ahead=ahead)
        self._per_force = in_range("per_force", per_force, 0.0, 0.1, "m/N", "1 mm for each newton is 0.001.")
        self._most = in_range("most", most, 0.0, 0.02, "m", "2 mm is 0.002.")

    def descent(self, seen: Array, actions: Array32) -> Array:
        """Return the speeds that bring the floor to the wanted depth."""
        pressed = np.clip(self._per_force * seen[:, VERTICAL_MEAN], 0.0, self._most)
        return self.toward(self.wanted(seen) + pressed, seen)


class ProbeDown(FollowDepth):
    """The wanted depth, with a stop every so often in which the blade goes down a little, is felt, and comes up again.

    The layer below tells itself by a force that differs from that of the tissue: where it was found, the blade keeps
    above it.

    Parameters
    ----------
    every : float
        Time between probes [s].
    probe : float
        Depth of a probe below the wanted depth [m].
    margin : float
        Distance that is kept above a layer that was found [m].
    """

    def __init__(
        self,
        along: ArrayPolicy | None = None,
        *,
        gain: float = 8.0,
        ahead: float = 0.001,
        every: float = 1.5,
        probe: float = 0.0008,
        margin: float = 0.0005,
        control_hz: int = 50,
    ) -> None:
        super().__init__(along, gain=gain, ahead=ahead)
        self._every = round(in_range("every", every, 0.1, 60.0, "s", "A second or two.") * control_hz)
        self._probe = in_range("probe", probe, 0.0, 0.01, "m", "1 mm is 0.001.")
        self._margin = in_range("margin", margin, 0.0, 0.01, "m", "1 mm is 0.001.")
        self._lasts = round(0.2 * control_hz)

    def start(self, count: int) -> None:
        """Begin ``count`` cuts."""
        self._decided, self._most = np.zeros(count, int), np.zeros(count)
        self._usual, self._floor = np.full(count, np.nan), np.full(count, np.inf)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        super().forget(cuts)
        self._decided[cuts], self._most[cuts] = 0, 0.0
        self._usual[cuts], self._floor[cuts] = np.nan, np.inf

    def descent(self, seen: Array, actions: Array32) -> Array:
        """Return the speeds of a probe, or those that follow the wanted depth above what was found."""
        wanted, phase = self.wanted(seen), self._decided % self._every
        self._decided += 1
        down = (phase < self._lasts) & (self._decided > self._lasts)
        felt = seen[:, VERTICAL_MEAN]
        self._most = np.where(down, np.maximum(self._most, felt), self._most)
        done = (phase == self._lasts) & (self._decided > self._lasts)
        usual = np.where(np.isnan(self._usual), self._most, self._usual)
        other = done & (np.abs(self._most - usual) > 0.5 * np.maximum(usual, 0.2))
        self._floor = np.where(other, np.minimum(self._floor, seen[:, BLADE_DEPTH] - self._margin), self._floor)
        self._usual = np.where(done & ~other, 0.5 * (usual + self._most), self._usual)
        self._most = np.where(done, 0.0, self._most)
        actions[down, 0] = np.minimum(actions[down, 0], 0.0)  # it stands while it goes down
        return self.toward(np.where(down, wanted + self._probe, np.minimum(wanted, self._floor)), seen)


DEPTH_SCRIPTS: dict[str, Callable[[], ArrayPolicy]] = {
    "hold one depth": HoldDepth,
    "follow the depth": FollowDepth,
    "depth by force": DepthByForce,
    "probe down": ProbeDown,
}
"""Scripts for ``cutenv/DepthCut-v1`` by name."""
