"""The crack tip estimated from observations, and its run.

The tip is that of :mod:`cutenv.sim.tissue.crack_tip`; the run is the one that it would make now.

While the blade advances the tip is also estimated from two forces at once: that along the cut, and that upwards.

A blade that leads the tip by a lag L loads a tissue of stiffness K with K L along the cut.  The stiffness grows with
the depth D to which the blade is engaged, so that the tissue also pushes the blade up, by half of dK/dD L^2
(:mod:`cutenv.sim.cutting.descent`).  How K grows with D in proportion is geometry, the same for a soft and a stiff
tissue: the two forces together tell the lag.  Friction adds to both, a vector against the blade's motion along the cut
and down or up.  An extended Kalman filter estimates stiffness and friction, each over
that of the mean tissue, from the upward force at every decision.

It needs no return stroke.  Once one has measured the stiffness, that measurement counts as above.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, Indices, Struct, StructArray
from cutenv._engine.elementary import exp
from cutenv._engine.jit import njit, njit_internal
from cutenv.agents.policy.interface import (
    DEPTH_COLUMN,
    FORCE_COLUMN,
    FORCE_MEAN_COLUMN,
    POSITION_COLUMN,
    SPEED_COLUMN,
    in_si,
)
from cutenv.sim.quantities import SHALLOWEST
from cutenv.sim.tissue.crack_tip import (
    PRESLIDING,
    TIP_FIELDS,
    BladeReading,
    MeanTissue,
    believe_mean,
    follow_tip,
    stiffness_behind,
    tip_behind,
)
from cutenv.sim.tissue.description import TissueDescription, measured_liver
from cutenv.sim.tissue.grid import N_POINTS, POINTS_PER_METRE, SPACING
from cutenv.sim.tissue.specimen import nominal_stiffness, nominal_tissue

_CUTTING_FROM = 0.015  # [m], position of the blade from which the force shows the resistance to cutting
_BELIEVED_FOR = 0.005  # [m] of cut that count as much as the mean tissue's resistance

CUT_MEMORY: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            *TIP_FIELDS,
            ("stiffness", "f8", (N_POINTS,)),  # K of the mean tissue as far as the blade has been [N/m]
            ("passed", "i8"),  # number of these that are known
            ("depth", "f8"),  # at the last of them [m]
            ("furthest", "f8"),  # of the blade so far [m]
            ("resisted", "f8"),  # integral of elastic force per depth over new ground [N]
            ("ground", "f8"),  # length of that ground [m]
        ],
    )
)
"""Structured dtype of what an estimate remembers of one cut; begin with :func:`nothing_yet`."""

CUT_ESTIMATE: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("tip", "f8"),  # [m]
            ("nominal_tip", "f8"),  # with stiffness and friction of the mean tissue [m]
            ("stiffness", "f8"),  # K at the tip [N/m]
            ("elastic", "f8"),  # force without friction [N]
            ("resistance", "f8"),  # mean elastic force per depth at which this tissue was cut [N/m]
            ("run", "f8"),  # length that an unstable run would have if it began now [m]
        ],
    )
)
"""Structured dtype of an estimate."""


class TipEstimate:
    """Estimator of the crack tip from observations.

    It begins with the mean tissue and learns from return strokes.

    An observation contains the depth at the blade; the tip is behind it, where the bulge is thinner.  So the depth
    is stored as the blade passes.

    Parameters
    ----------
    tissue : TissueDescription, optional
        The tissue that the rig assumes; default the measured pig liver.

    Attributes
    ----------
    memory : StructArray, shape (n,)
        What is known of each cut, :data:`CUT_MEMORY`.
    """

    def __init__(self, tissue: TissueDescription | None = None) -> None:
        self._tissue = tissue or measured_liver()
        self._nominal = nominal_tissue(self._tissue)
        self.reset()

    def reset(self) -> None:
        """Forget the last cut."""
        self.begin(1)

    def begin(self, count: int) -> None:
        """Forget all cuts, and begin ``count``."""
        self.memory = np.repeat(nothing_yet(self._tissue), count)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self.memory[cuts] = nothing_yet(self._tissue)[0]

    def __call__(self, observation: NDArray[np.float32]) -> float:
        """Return the tip [m] for an observation, (12,), since :meth:`reset`."""
        return float(self.tips(in_si(observation)[None])[0])

    def tips(self, seen: Array) -> Array:
        """Return tips [m], (n,), for all cuts' SI observations, (n, 12)."""
        tips: Array = self.estimates(seen)["tip"]
        return tips

    def estimates(self, seen: Array) -> StructArray:
        """Return :data:`CUT_ESTIMATE`, (n,), for all cuts' SI observations, (n, 12)."""
        estimates: StructArray = np.zeros(len(seen), CUT_ESTIMATE)
        _estimate_all(self.memory, self._nominal, seen, estimates)
        return estimates


@lru_cache(maxsize=8)
def nothing_yet(tissue: TissueDescription) -> StructArray:
    """Return an unbegun cut's :data:`CUT_MEMORY`, (1,), read-only."""
    memory = np.zeros(1, CUT_MEMORY)
    believe_mean(memory, float(nominal_tissue(tissue)["friction_per_depth"][0]))
    memory.setflags(write=False)
    return memory


@njit
def _estimate_all(memory: StructArray, nominals: StructArray, seen: StructArray, estimates: StructArray) -> None:
    for n in range(len(memory)):
        reading = BladeReading(
            max(seen[n, POSITION_COLUMN], 0.0), seen[n, SPEED_COLUMN], max(seen[n, DEPTH_COLUMN], SHALLOWEST),
            seen[n, FORCE_COLUMN],
        )  # fmt: skip
        estimate_cut(memory[n], nominals[0], reading, seen[n, FORCE_MEAN_COLUMN], estimates[n])


@njit_internal
def estimate_cut(memory: Struct, nominal: Struct, reading: BladeReading, mean_force: float, estimate: Struct) -> None:
    """Fill ``estimate`` from an observation, and remember what it shows.

    ``memory``, :data:`CUT_MEMORY`, is changed in place; ``nominal`` is :data:`cutenv.sim.tissue.specimen.NOMINAL`;
    ``mean_force`` is that since the last observation [N].
    """
    position, _, depth, force = reading
    remember_stiffness(memory, nominal, position, depth)
    mean = MeanTissue(memory.stiffness, memory.passed, nominal.friction_per_depth)
    tip, elastic = follow_tip(memory, mean, reading)
    new_ground = position - max(memory.furthest, _CUTTING_FROM)
    memory.furthest = max(memory.furthest, position)

    mobilised = memory.bristle / PRESLIDING * depth
    estimate.tip = tip
    estimate.nominal_tip = tip_behind(mean, position, max(force - mobilised * mean.friction_per_depth, 0.0))
    estimate.elastic = elastic
    estimate.stiffness = memory.stiffness_ratio * stiffness_behind(mean, tip)
    if new_ground > 0.0:
        memory.resisted += max(mean_force - mobilised * memory.friction_per_depth, 0.0) / depth * new_ground
        memory.ground += new_ground
    resistance = (memory.resisted + _BELIEVED_FOR * nominal.toughness_per_depth) / (memory.ground + _BELIEVED_FOR)
    estimate.resistance = resistance
    # At fixed blade and constant K, the energy of a run of length l is F l - K l^2/2 = R B l.
    estimate.run = 2.0 * max(elastic - resistance * depth, 0.0) / estimate.stiffness


@njit_internal
def remember_stiffness(memory: Struct, nominal: Struct, position: float, depth: float) -> None:
    """Fill mean stiffness up to the blade by interpolated depth [m]."""
    passed = memory.passed
    reached = min(round(position / SPACING), len(memory.stiffness) - 1) + 1
    before = memory.depth if passed > 0 else depth
    for k in range(passed, reached):
        memory.depth = before + (depth - before) * (k + 1 - passed) / (reached - passed)
        memory.stiffness[k] = nominal_stiffness(nominal, k, memory.depth)
    memory.passed = max(passed, reached)


_STIFFNESS_SPREAD, _FRICTION_SPREAD = 0.30, 0.45  # SD of the logarithms over slices, as drawn
_CHANGE = (
    0.03  # SD by which the stiffness's logarithm changes along a millimetre; assumed, chosen on validation specimens
)
_NOISE, _MODEL = 0.1, 0.3  # [N], and share of the tissue's push: SD of the upward force about the model; likewise
_UNUSUAL = (
    2.0  # SDs beyond which a deviation counts no more; upwards it may be the floor's push, and counts for nothing
)
_MOST_STIFFNESS, _MOST_FRICTION = 0.8, 1.5  # largest sizes of the logarithms
_ADVANCING, _FROM = 0.008, 0.006  # speed [m/s] and position [m] from which the forces are those of cutting
_MOVING = 1e-4  # [m/s], speed from which friction is against the motion, and from which a descent presses the floor
_ASIDE = 0.5e-3  # depths on either side from which the stiffness's rise with depth is taken [m]
_FIRST_LAG, _LONGEST_LAG = 0.003, 0.040  # [m]

TWO_FORCES: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("stiffness", "f8"),  # logarithm of K over that of the mean tissue
            ("friction", "f8"),  # logarithm of the friction over that of the mean tissue
            ("stiffness_variance", "f8"),
            ("covariance", "f8"),
            ("friction_variance", "f8"),
            ("lag", "f8"),  # of the tip behind the blade [m]
            ("furthest", "f8"),  # position of the blade so far [m]
            ("sense", "f8"),  # share of friction that is upwards, at the last decision [1]
        ],
    )
)
"""Structured dtype of what two forces have told of one cut; begin with :func:`nothing_felt`."""


def nothing_felt(count: int) -> StructArray:
    """Return the :data:`TWO_FORCES` of cuts that have not begun, shape (count,)."""
    felt = np.zeros(count, TWO_FORCES)
    felt["stiffness_variance"], felt["friction_variance"] = _STIFFNESS_SPREAD**2, _FRICTION_SPREAD**2
    felt["lag"] = _FIRST_LAG
    return felt


class TwoForces:
    """Estimator of many tips' lag by two forces."""

    def begin(self, count: int) -> None:
        """Forget all cuts, and begin ``count``."""
        self._felt, self._lags = nothing_felt(count), np.zeros(count)
        self._nominal = nominal_tissue(measured_liver())

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self._felt[cuts] = nothing_felt(1)[0]

    def lags(self, felt: Array) -> Array:
        """Return the tips' lags behind the blades [m], (n,).

        ``felt``, (n, 6), are position [m], speed [m/s] and depth [m] of the blade, mean forces along the cut and
        upwards since the last decision [N], and speed downwards [m/s].
        """
        _feel_all(self._felt, self._nominal, felt, self._lags)
        return self._lags


@njit
def _feel_all(felt: StructArray, nominals: StructArray, values: Array, lags: Array) -> None:
    for n in range(len(felt)):
        reading = BladeReading(max(values[n, 0], 0.0), values[n, 1], max(values[n, 2], SHALLOWEST), values[n, 3])
        lags[n] = feel_two_forces(felt[n], nominals[0], reading, values[n, 4], values[n, 5])


@njit_internal
def feel_two_forces(
    felt: Struct, nominal: Struct, reading: BladeReading, upwards: float, descent_speed: float
) -> float:
    """Update :data:`TWO_FORCES` by a decision; return the tip's lag [m].

    ``nominal`` is :data:`cutenv.sim.tissue.specimen.NOMINAL`; the reading has the depth to which the blade is in the
    tissue, and the mean force since the last decision, as ``upwards`` is [N]; ``descent_speed`` is downwards [m/s].
    """
    position, speed, depth, force = reading
    way = math.sqrt(speed * speed + descent_speed * descent_speed)
    sense, against = (descent_speed / way, abs(speed) / way) if way >= _MOVING else (0.0, 1.0)
    grown = max(position - felt.furthest, 0.0)
    felt.furthest = max(felt.furthest, position)
    felt.stiffness_variance += _CHANGE**2 * grown * 1e3
    i = min(max(int((position - felt.lag) * POINTS_PER_METRE + 0.5), 0), N_POINTS - 1)
    stiffness = nominal_stiffness(nominal, i, depth)
    low = max(depth - _ASIDE, 0.0)
    rise = (nominal_stiffness(nominal, i, depth + _ASIDE) - nominal_stiffness(nominal, i, low)) / (depth + _ASIDE - low)
    # While the blade presses on the floor of the cut, or has just done so, the floor's push is not known.
    if speed > _ADVANCING and position > _FROM and max(sense, felt.sense) * speed < _MOVING:
        mean = _MeanCut(nominal.friction_per_depth * depth, stiffness, rise)
        _correct(felt, mean, force, upwards, (against, 0.5 * (sense + felt.sense)))
    felt.sense = sense
    elastic = max(force - nominal.friction_per_depth * exp(felt.friction) * depth * against, 0.0)
    felt.lag = min(elastic / (stiffness * exp(felt.stiffness)), _LONGEST_LAG)
    return felt.lag  # type: ignore[no-any-return]


class _MeanCut(NamedTuple):
    """Forces of the mean tissue on this blade."""

    friction: float  # [N]
    stiffness: float  # [N/m]
    rise: float  # rise of the stiffness with depth [N/m2]


@njit_internal
def _correct(felt: Struct, mean: _MeanCut, force: float, upwards: float, shares: tuple[float, float]) -> None:
    """Correct stiffness and friction by the upward force.

    ``shares`` of friction are along the cut and upwards.
    """
    full = mean.friction * exp(felt.friction)
    rubbing, raised = full * shares[0], full * shares[1]
    elastic = max(force - rubbing, 0.0)
    if elastic == 0.0:
        return
    lag = elastic / (mean.stiffness * exp(felt.stiffness))
    push = 0.5 * mean.rise / mean.stiffness * elastic * lag
    by_stiffness, by_friction = -push, raised - 2.0 * push * rubbing / elastic  # derivatives by the logarithms
    first = felt.stiffness_variance * by_stiffness + felt.covariance * by_friction
    second = felt.covariance * by_stiffness + felt.friction_variance * by_friction
    variance = first * by_stiffness + second * by_friction + _NOISE**2 + (_MODEL * push) ** 2
    most = _UNUSUAL * math.sqrt(variance)
    deviation = upwards - push - raised
    if deviation > most:
        return
    deviation = max(deviation, -most) / variance
    felt.stiffness = min(max(felt.stiffness + first * deviation, -_MOST_STIFFNESS), _MOST_STIFFNESS)
    felt.friction = min(max(felt.friction + second * deviation, -_MOST_FRICTION), _MOST_FRICTION)
    felt.stiffness_variance -= first * first / variance
    felt.covariance -= first * second / variance
    felt.friction_variance -= second * second / variance
