"""Batched rollout of a policy: all cuts in one compiled batch, bit for bit equal to single cuts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, Array32, Indices, StructArray
from cutenv.cutting.dtypes import READING, TICK
from cutenv.envs.batch import CutBatch
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.learning.finished_cut import FinishedCut
from cutenv.policy import Policy, PrivilegedPolicy
from cutenv.policy.interface import CopiedPolicy, as_array_policy
from cutenv.task.episode_dtypes import ENDS, TERMS
from cutenv.task.info import COST, INFO_FIELDS, INFO_SIZE, TRUTH

_SCORED = np.dtype([("true_force", "f8")])
"""Readings from which the scores follow: a ninth of the memory of all."""
_PLACES = {group: place for group, _, place in INFO_FIELDS}


def batched_rollout(
    policy: Policy,
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
    *,
    readings: bool = False,
    finished: Callable[[int], Any] = lambda count: None,
) -> list[FinishedCut]:
    """Let a policy cut the specimens of some seeds, the first episode of each.

    Parameters
    ----------
    policy : Policy
        The policy; one that was written for single cuts is copied for each.
    seeds : sequence of int
        Seeds, one for each cut.
    arguments : mapping
        Keyword arguments of the environment.
    readings : bool
        Whether the finished cuts hold every field of their readings; else only those that the scores need.
    finished : callable, optional
        Called with the number of cuts that have ended with a decision.
    """
    count, environment = len(seeds), GentleCutEnv(**arguments)
    batch, many = CutBatch(count, environment), as_array_policy(policy)
    batch.give_seeds(seeds, np.arange(count), np.random.default_rng())
    batch.begin(np.arange(count))
    many.begin([np.random.default_rng(seed) for seed in seeds])
    if isinstance(many, CopiedPolicy):
        _show_states(many, seeds, GentleCutEnv(**arguments))
    ticks = environment.ticks
    decisions = math.ceil(environment.deadline / (ticks * TICK))
    felt = np.zeros((count, ticks), READING)
    kept = np.empty((count, decisions * ticks), READING if readings else _SCORED)
    told, totals = np.zeros((count, INFO_SIZE)), np.zeros((count, len(TERMS)))
    over_limit, jumps, ends = np.zeros(count), np.zeros(count), np.zeros(count, np.int64)
    for first in range(0, decisions * ticks, ticks):
        going = ends == 0
        ended, terms, over = _decide(batch, many.act(batch.observations), ~going, told, felt)
        which = np.flatnonzero(going)
        for name in kept.dtype.names:
            kept[name][which, first : first + ticks] = felt[name][which]
        totals[which] += terms[which]
        for largest, values in ((over_limit, over), (jumps, felt["jump"].max(axis=1))):
            np.maximum(largest, values, out=largest)  # those of an ended cut stay as they are
        ends += ended
        if ended.any():
            finished(int(np.count_nonzero(ended)))
        if ends.all():
            break
    times, success = felt["time"].max(axis=1), batch.succeeded()
    return [
        FinishedCut(
            seed=int(seeds[n]),
            end=ENDS[ends[n]],
            success=bool(success[n]),
            truth=_truth(told[n]) | {"specimen_class": batch.classes[n]},
            reward_totals=dict(zip(TERMS, totals[n].tolist(), strict=True)),
            over_limit_N=float(over_limit[n]),
            largest_jump_m=float(jumps[n]),
            time_s=float(times[n]),
            readings=kept[n, : round(times[n] / TICK)],
            depth=batch.cuts.profiles["depth"][n].copy(),
            measured_depth=batch.cuts.nominals["depth"][n].copy(),
            resistance=batch.cuts.specimens["fracture_resistance"][n].copy(),
        )
        for n in range(count)
    ]


def _show_states(policies: CopiedPolicy, seeds: Sequence[int], environment: GentleCutEnv) -> None:
    """Show each copy of a privileged policy its cut at the start."""
    for policy, seed in zip(policies.copies, seeds, strict=True):
        if isinstance(policy, PrivilegedPolicy):
            environment.reset(seed=seed)
            policy.set_state(environment.cutting)


def _decide(
    batch: CutBatch, actions: Array32, waiting: NDArray[np.bool_], told: Array, readings: StructArray
) -> tuple[Indices, Array, Array]:
    """Advance the batch; return ends, terms of the reward, and largest force above the limit [N], shape (n, ...)."""
    _, (ends, *_) = batch.decide(actions, waiting, told, readings=readings)
    return ends, told[:, _PLACES["reward_terms"]], told[:, _PLACES["cost"]][:, COST.index("force_N")]


def _truth(told: Array) -> dict[str, Any]:
    """Return ``info["truth"]`` of one cut, but for the class of its specimen."""
    truth: dict[str, Any] = dict(zip(TRUTH, told[_PLACES["truth"]].tolist(), strict=True))
    return truth | {"units": int(truth["units"])}
