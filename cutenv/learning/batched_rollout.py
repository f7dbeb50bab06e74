"""Batched rollout of a policy: all cuts in one compiled batch, bit for bit equal to single cuts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cutenv.cutting.dtypes import READING, TICK
from cutenv.envs.batch import CutBatch
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.learning.finished_cut import FinishedCut
from cutenv.policy import Policy
from cutenv.policy.interface import as_array_policy
from cutenv.task.episode import Episode
from cutenv.task.info import GROUPS, INFO, column
from cutenv.task.registry import task_of
from cutenv.task.reward import TERMS

_SCORED = np.dtype([("true_force", "f8")])
"""Readings from which the scores follow: a ninth of the memory of all."""
_TERMS, _COSTS = ([column(field) for field in GROUPS[group]] for group in ("reward_terms", "cost_terms"))


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
        Keyword arguments of the environment, and "task" if it is not that of gentle cutting.
    readings : bool
        Whether the finished cuts hold every field of their readings; else only those that the scores need.
    finished : callable, optional
        Called with the number of cuts that have ended with a decision.
    """
    task, own = task_of(arguments)
    count, environment = len(seeds), task.single(**own)
    batch, many = CutBatch(count, environment), as_array_policy(policy)
    batch.give_seeds(seeds, np.arange(count), np.random.default_rng())
    batch.begin(np.arange(count))
    many.begin([np.random.default_rng(seed) for seed in seeds])
    if many.privileged:
        shown = task.single(**own)
        many.set_states([_at_start(shown, seed) for seed in seeds])
    ticks = environment.ticks
    decisions = math.ceil(environment.deadline / (ticks * TICK))
    felt = np.zeros((count, ticks), READING)
    kept = np.empty((count, decisions * ticks), READING if readings else _SCORED)
    infos, totals, costs = np.zeros(count, INFO), np.zeros((count, len(_TERMS))), np.zeros((count, len(_COSTS)))
    added = {name: np.zeros(count) for name in batch.extra_terms()}
    jumps, ends = np.zeros(count), np.zeros(count, np.int64)
    for first in range(0, decisions * ticks, ticks):
        going = ends == 0
        _, ended = batch.decide(many.act(batch.observations), ~going, infos, readings=felt)
        which = np.flatnonzero(going)
        for name in kept.dtype.names:
            kept[name][which, first : first + ticks] = felt[name][which]
        for sums, names in ((totals, _TERMS), (costs, _COSTS)):
            sums[which] += np.stack([infos[name][which] for name in names], axis=1)
        for name, term in batch.extra_terms().items():
            added[name][which] += term[which]
        np.maximum(jumps, felt["jump"].max(axis=1), out=jumps)  # readings of an ended cut stay as they are
        ends += ended
        if ended.any():
            finished(int(np.count_nonzero(ended)))
        if ends.all():
            break
    times, success, further = felt["time"].max(axis=1), batch.succeeded(), batch.further_scores()
    return [
        FinishedCut(
            seed=int(seeds[n]),
            end=batch.end_names[ends[n]],
            success=bool(success[n]),
            truth={field.name: infos[column(field)][n].item() for field in GROUPS["truth"]}
            | {"specimen_class": batch.classes[n]},
            reward_totals=dict(zip(TERMS, totals[n].tolist(), strict=True))
            | {name: float(term[n]) for name, term in added.items()},
            cost_totals={field.name: cost for field, cost in zip(GROUPS["cost_terms"], costs[n].tolist(), strict=True)},
            largest_jump_m=float(jumps[n]),
            time_s=float(times[n]),
            readings=kept[n, : round(times[n] / TICK)],
            depth=batch.cuts.profiles["depth"][n].copy(),
            measured_depth=batch.cuts.nominals["depth"][n].copy(),
            resistance=batch.cuts.specimens["fracture_resistance"][n].copy(),
            further={name: float(score[n]) for name, score in further.items()},
            shown_depth=batch.shown_depth(n) if readings else None,
        )
        for n in range(count)
    ]


def _at_start(environment: GentleCutEnv, seed: int) -> Episode:
    """Return the cut of a seed at its start."""
    environment.reset(seed=seed)
    return environment.cutting
