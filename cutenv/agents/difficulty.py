"""Difficulty of a specimen.

The scores that scripts get on this very one, so that a hard liver is not a bad hand.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from cutenv._base.arrays import StructArray, joined_records
from cutenv.agents.policy import BASELINES, ORACLE, PrivilegedPolicy
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.records.scoring import score
from cutenv.records.scoring.score_card import ScriptScore
from cutenv.records.scoring.truth import TIP_AT_END
from cutenv.sim.cutting.dtypes import READING
from cutenv.sim.plant import to_trace
from cutenv.sim.tissue.grid import depth_below
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.sim.trace import Trace

COMPARED_SCRIPTS = (ORACLE, "return stroke", "probe and creep", "constant 1.27 cm/s 90 deg")
"""Scripts that cut the specimen again: one that knows the truth, the two best that do not, and one without any plan."""
_SAME_DEPTH = 1e-6  # [m]


def scripts_on_specimen_of(trace: Trace) -> tuple[ScriptScore, ...]:
    """Return the scripts' scores on a simulated record's specimen, or ().

    A record names its specimen by class, seed and number. They count only if the specimen drawn from them has the depth
    that was recorded: another version of the tissue, or a real rig with the same seed, has another.
    """
    facts = trace.metadata
    kind, seed, number = (facts.get(name) for name in ("specimen_class", "specimen_seed", "specimen_episode"))
    length = facts.get("target_length_m")
    known = kind in CLASSES and all(isinstance(each, int) and each >= 0 for each in (seed, number))
    if not known or not isinstance(length, float) or trace.position is None or trace.depth is None:
        return ()
    if trace.height is not None or trace.blade_x is not None:  # these scripts cut straight on, at one level
        return ()
    try:
        env = GentleCutEnv(specimen_class=str(kind), target_length=length)
        env.reset(seed=seed, options={"episode": number})
    except ValueError:  # a length or a seed that nobody can cut
        return ()
    if not np.allclose(depth_below(env.plant.depth, trace.position), trace.depth, rtol=0.0, atol=_SAME_DEPTH):
        return ()
    return _scripts_on(str(kind), seed, number, length)


@cache  # a class often cuts the same specimens
def _scripts_on(specimen_class: str, seed: Any, episode: Any, target_length: float) -> tuple[ScriptScore, ...]:
    env = GentleCutEnv(specimen_class=specimen_class, target_length=target_length)
    return tuple(_scored_script(env, name, seed, episode) for name in COMPARED_SCRIPTS)


def _scored_script(env: GentleCutEnv, name: str, seed: int, episode: int) -> ScriptScore:
    policy: Any = BASELINES[name]()
    observation, _ = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng(seed))
    if isinstance(policy, PrivilegedPolicy):
        policy.set_state(env.cutting)
    parts: list[StructArray] = [np.zeros(0, READING)]
    ended = False
    while not ended:
        observation, _, ended, _, _ = env.step(policy(observation))
        assert env.cutting.readings is not None  # a step was made
        parts.append(env.cutting.readings.copy())
    readings = joined_records(parts)
    noted = {TIP_AT_END: float(readings["tip"][-1]), "end": env.cutting.end}
    card = score(to_trace(env.plant, readings, **noted), target_length=env.cutting.target_length)
    return ScriptScore(name=name, overall_score=float(card.overall_score or 0.0), outcome=card.outcome)
