"""A measured opening: the same feed at the start of every cut, and what the twin of its record makes of the rest.

Which policy takes over after the opening is drawn by a coin and has no part in it. What a twin that is fitted to the
opening alone foretells is therefore as independent of the coin as the tissue is: it can serve as a covariate of a
randomised comparison (:mod:`cutenv.scoring.study.sequential`), whether the twin is right or wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices
from cutenv._base.validation import in_range
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.policy import ConstantFeed, Policy
from cutenv.policy.interface import POSITION_COLUMN, ArrayPolicy, as_array_policy, choose, in_si
from cutenv.sim_to_real.measures import ComparedCut
from cutenv.sim_to_real.paired_experiment import cut_once
from cutenv.sim_to_real.specimen_twin import fit_twin
from cutenv.tissue.description import measured_liver
from cutenv.tissue.specimen import Specimen
from cutenv.trace import Trace

OPENING_SPEED = 0.0127
"""Speed of the opening [m/s]: half of the fastest measured."""
_SHORTEST, _LONGEST = 0.020, 0.050
"""Range of its length [m]: below, little is told of the tissue; above, little is left to the policy."""


class OpenedPolicy(ArrayPolicy):
    """A policy that takes over from a constant feed at a position of the blade; until then it looks on.

    Parameters
    ----------
    policy : Policy
        The policy.
    length : float
        Position of the blade at which it takes over [m].
    angle : float
        Angle of the blade in the opening [rad].
    """

    def __init__(self, policy: Policy, length: float, angle: float) -> None:
        self._policy = as_array_policy(policy)
        self._feed = ConstantFeed(speed=OPENING_SPEED, angle=angle)
        self._length = in_range("length", length, _SHORTEST, _LONGEST, "m", "Give 25 mm.")

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Begin the opening of ``len(rngs)`` cuts."""
        self._opening = np.ones(len(rngs), bool)
        self._policy.begin(rngs)
        self._feed.begin(rngs)

    def forget(self, cuts: Indices) -> None:
        """Begin the opening of those cuts again."""
        self._opening[cuts] = True
        self._policy.forget(cuts)
        self._feed.forget(cuts)

    def act(self, observations: Array32) -> Array32:
        """Return the feed's action up to the handover of each cut, and the policy's beyond."""
        self._opening &= in_si(observations)[:, POSITION_COLUMN] < self._length
        return choose(self._opening, self._feed.act(observations), self._policy.act(observations))


def opening_of(trace: Trace, length: float) -> Trace:
    """Return the part of a record before the blade first comes to ``length`` [m].

    Raises
    ------
    ValueError
        If it never comes there: the cut ended in its opening.
    """
    (position,) = trace.require("position", by="opening_of")
    if not bool((position >= length).any()):
        raise ValueError(f"the blade went {1e3 * float(position.max()):.1f} mm of an opening of {1e3 * length:g} mm.")
    return trace.select(slice(0, int(np.argmax(position >= length))))


def specimens_like(
    env: GentleCutEnv, opening: Trace, *, depth: Array, seed: int, episode: int, draws: int
) -> list[Specimen]:
    """Return specimens as the twin of an opening has them, each with other tissue beyond it.

    Parameters
    ----------
    env : GentleCutEnv
        The simulator.
    opening : Trace
        Record of the opening.
    depth : ndarray of shape (301,)
        Depth of the specimen along the cut, as measured beforehand [m].
    seed, episode : int
        Key of what the twin does not know.
    draws : int
        Number of specimens.

    Raises
    ------
    ValueError
        If the opening is too short for a twin.
    """
    sensor = env.constants.sensor
    twin = fit_twin(
        opening, env.tissue.tissue or measured_liver(), law=env.constants.law, force_delay=sensor.force_delay, share=1.0
    )
    rng = np.random.default_rng([seed, episode])
    return [twin.drawn(rng, depth) for _ in range(draws)]


def forecast(
    env: GentleCutEnv,
    policies: Sequence[Policy],
    specimens: Sequence[Specimen],
    *,
    depth: Array,
    target_length: float,
    seed: int,
    episode: int,
    value: Callable[[ComparedCut], Array],
) -> Array:
    """Return what each policy achieves in specimens on average, each with other noise.

    Parameters
    ----------
    env : GentleCutEnv
        The simulator.
    policies : sequence of Policy
        Policies, with the opening.
    specimens : sequence of Specimen
        Specimens, by :func:`specimens_like`.
    depth : ndarray of shape (301,)
        Depth of the specimen along the cut, as measured beforehand [m].
    target_length : float
        Length of the cut [m].
    seed, episode : int
        Key of the noise.
    value : callable
        Outcomes of a cut, shape (n,).

    Returns
    -------
    ndarray of shape (policies, n)
        Mean outcomes.
    """
    key: dict[str, Any] = {"seed": seed, "episode": episode, "target_length": target_length, "depth": depth}

    def mean(policy: Policy) -> Array:
        cuts = [
            cut_once(env, policy, noise=draw + 1, specimen=specimen, **key) for draw, specimen in enumerate(specimens)
        ]
        found: Array = np.mean([value(cut) for cut in cuts], axis=0)
        return found

    return np.array([mean(policy) for policy in policies])
