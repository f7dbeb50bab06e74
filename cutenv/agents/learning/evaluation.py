"""Evaluation of policies on the same specimens.

They are rolled out in one compiled batch: every score of every cut.
"""

from __future__ import annotations

import contextlib
import difflib
import math
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv._base.output import progress_bar
from cutenv.agents.policy import BASELINES, SHIPPED, ArrayPolicy, Policy, named_policy
from cutenv.agents.policy.interface import as_array_policy
from cutenv.agents.policy.shipped import policy_of_class
from cutenv.envs import set_cores
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.vector import CutBatch, warn_before_first_batch
from cutenv.records.scoring import METRICS, Truth, score
from cutenv.sim.cutting.dtypes import READING, TICK
from cutenv.sim.plant.protocol import recorded_trace
from cutenv.sim.tissue.grid import SPACING
from cutenv.task.episode import Episode, ShownDepth
from cutenv.task.info import GROUPS, INFO, column
from cutenv.task.registry import TASKS, task_made_as, task_of
from cutenv.task.reward import TERMS

METRIC_PREFIX = "metric_"


@dataclass(frozen=True, kw_only=True, eq=False)
class FinishedCut:
    """One cut by one policy."""

    seed: int  # seed of the environment, whose first episode it was
    end: str
    success: bool
    truth: Mapping[str, Any]  # ``info["truth"]`` at the end
    reward_totals: Mapping[str, float]  # sum of each term of the reward over the cut
    cost_totals: Mapping[str, float]  # sum of each part of the cost: ``overshoot_mm``, ``long_runs_mm`` [mm]
    largest_jump_m: float  # largest unstable growth in a millisecond [m]
    time_s: float  # time of its end [s]
    readings: StructArray  # at 1 kHz, READING, shape (n,), hidden tip included; the scores need ``true_force`` alone
    # depth [m], as measured beforehand [m], and fracture resistance [J/m2] of the specimen along the line, shape (301,)
    depth: np.ndarray
    measured_depth: np.ndarray
    resistance: np.ndarray
    further: Mapping[str, float] = field(default_factory=dict)  # scores that the task adds
    shown_depth: ShownDepth | None = None  # depth of the cut for a picture, of a task with a third axis

    def scores(self) -> dict[str, Any]:
        """Return the scores that follow from task and hidden state."""
        truth, readings = self.truth, self.readings
        beyond = truth["tip_m"] - truth["target_length_m"]
        return {
            "seed": self.seed,
            "specimen_class": truth["specimen_class"],
            "target_length_mm": 1e3 * truth["target_length_m"],
            "return": math.fsum(self.reward_totals.values()),
            "success": float(self.success),
            "end": self.end,
            "tip_error_mm": 1e3 * abs(beyond),
            "cost_mm": math.fsum(self.cost_totals.values()),
            **self.cost_totals,
            "time_s": self.time_s,
            "peak_force_N": float(readings["true_force"].max()),
            "mean_force_N": float(readings["true_force"].mean()),
            "uncontrolled_share": truth["uncontrolled_m"] / max(truth["tip_m"], 1e-9),
            "largest_jump_mm": 1e3 * self.largest_jump_m,
            "runs": int(truth["units"]),
            **{f"reward_{name}": value for name, value in self.reward_totals.items()},
            **self.further,
        }

    def metrics(self) -> dict[str, float | str]:
        """Return all score card metrics by :func:`metric_column`; undefined ones empty."""
        readings, trace = self.readings, recorded_trace(self.readings, self.depth)
        cut = self.resistance[: max(int(self.truth["tip_m"] / SPACING), 0) + 1]
        truth = Truth(tip=readings["tip"], jump=readings["jump"], resistance=float(cut.mean()))
        card = score(trace, target_length=self.truth["target_length_m"], truth=truth)
        values = {name: scored.value for name, scored in card.metrics.items()}
        return {metric_column(name): "" if value is None else value for name, value in values.items()}


def metric_column(name: str) -> str:
    """Return a metric's column name with unit: ``metric_peak_force_N``."""
    unit = METRICS[name].unit.replace("F", "N")
    suffix = "" if unit == "1" else "_" + unit.replace("/", "_per_").replace(" ", "_")
    return METRIC_PREFIX + name + suffix


_SCORED = np.dtype([("true_force", "f8")])  # readings from which the scores follow: a ninth of the memory of all
_TERMS, _COSTS = ([column(field) for field in GROUPS[group]] for group in ("reward_terms", "cost_terms"))


def batched_rollout(
    policy: Policy,
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
    *,
    readings: bool = False,
    finished: Callable[[int], Any] = lambda count: None,
) -> list[FinishedCut]:
    """Let a policy cut the first episode of each seed.

    A policy that was written for single cuts is copied for each.  ``arguments`` are those of the environment, and
    "task" if it is not gentle cutting; with ``readings`` the finished cuts hold every field of them, else only what the
    scores need; ``finished`` is called with the number of cuts that have ended with a decision.
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


_BATCH, _SMALL_BATCH = 200, 100  # cuts simulated together; fewer where all readings are kept, or a policy is copied
_MIN_CUTS = 2000  # cuts, below which starting processes takes longer than they save
_PARTS = 4  # of a planner's cuts, at least
_PLANNED = 100  # cuts of others, which take as long as one that is planned


@dataclass(frozen=True)
class Contestant:
    """A policy and the environment's keywords that it needs.

    One is its decision rate.
    """

    policy: Policy
    arguments: Mapping[str, Any] = field(default_factory=dict)
    specimens: int | None = None  # number of the first specimens, which it cuts alone; by default it cuts all


def _begin_worker() -> None:
    """Use one core, leave Ctrl-C to the parent, and end when that is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_cores(1)

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextlib.contextmanager
def workers(processes: int | None = None) -> Iterator[Executor]:
    """Start evaluating processes, one per core; errors cancel remaining work."""
    # Fresh processes: a fork of one that runs threads (torch, Numba) may hang.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes or os.cpu_count(), context, initializer=_begin_worker) as pool:
        try:
            yield pool
        except BaseException:
            started = list(pool._processes.values())
            pool.shutdown(wait=False, cancel_futures=True)
            for process in started:  # they are in the middle of cuts that are no longer needed
                process.terminate()
            raise


@contextlib.contextmanager
def _without_ctrl_c() -> Iterator[None]:
    """Block Ctrl-C in this thread and the processes it starts."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows, where workers react to it until they have started
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _rows(
    policy: Policy,
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
    metrics: bool,
    finished: Callable[[int], Any] = lambda count: None,
) -> list[dict[str, Any]]:
    cuts = batched_rollout(policy, seeds, arguments, readings=metrics, finished=finished)
    return [cut.scores() | (cut.metrics() if metrics else {}) for cut in cuts]


def evaluate(
    contestants: Mapping[str, Contestant],
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
    *,
    processes: int | None = None,
    description: str = "evaluating",
    metrics: bool = False,
    pool: Executor | None = None,
) -> list[dict[str, Any]]:
    """Return every contestant's scores per seed, one row per cut.

    All cut the same specimens, or the first of them, in environments of ``arguments``, over which a contestant's take
    precedence; ``metrics`` adds every metric of the score card.  They cut in ``processes``, by default one per core, or
    none of their own for few cuts, or in a ``pool`` of :func:`workers`.
    """
    parts, work = [], 0
    for name, one in contestants.items():
        planned = as_array_policy(one.policy).privileged
        size = _SMALL_BATCH if planned or metrics or not isinstance(one.policy, ArrayPolicy) else _BATCH
        whole = {**arguments, **one.arguments}
        warn_before_first_batch(task_of(whole)[0].task)
        own = seeds[: one.specimens]
        if planned:  # a part for every core
            size = min(size, math.ceil(len(own) / _PARTS) or 1)
        parts += [(name, (one.policy, own[k : k + size], whole, metrics)) for k in range(0, len(own), size)]
        work += len(own) * (_PLANNED if planned else 1)
    cuts = sum(len(part[1]) for _, part in parts)
    with contextlib.ExitStack() as stack:
        started = processes or (os.cpu_count() if work >= _MIN_CUTS else 1)
        if pool is None and started != 1:
            pool = stack.enter_context(workers(started))
        count = stack.enter_context(progress_bar(description, "cut", total=cuts))
        if pool is None:
            return [{"policy": name, **row} for name, part in parts for row in _rows(*part, count)]
        futures = {}
        for place in sorted(range(len(parts)), key=lambda place: not as_array_policy(parts[place][1][0]).privileged):
            with _without_ctrl_c():  # planners first: they take longest
                futures[pool.submit(_rows, *parts[place][1])] = place
        for future in as_completed(futures):
            count(len(future.result()))
    done = {place: future.result() for future, place in futures.items()}
    return [{"policy": name, **row} for place, (name, _) in enumerate(parts) for row in done[place]]


def contestant(name: str) -> Contestant:
    """Return the contestant of a name: baseline, script, policy, folder or class.

    Its arguments have "task" if it is not for gentle cutting. A folder is that of a policy or of a training run; a
    class is ``MODULE:CLASS``.

    Raises ValueError if there is none; the message names the nearest.
    """
    if name in BASELINES:
        return Contestant(BASELINES[name]())
    for one in TASKS.values():
        if name in one.scripts:
            script = one.scripts[name]()
            return Contestant(script, {"task": one.name, **getattr(script, "environment_arguments", {})})
    if name in SHIPPED or Path(name).is_dir():
        policy = named_policy(name)
        task = task_made_as(policy.card.environment)
        named = {} if task is TASKS["gentle"] else {"task": task.name}
        return Contestant(policy, policy.environment_arguments | named)
    own = policy_of_class(name)
    if own is not None:
        return Contestant(own, dict(getattr(own, "environment_arguments", {})))
    known = [*BASELINES, *(script for one in TASKS.values() for script in one.scripts), *SHIPPED]
    nearest = difflib.get_close_matches(name.lower(), known, n=1)
    hint = f"Did you mean {nearest[0]!r}? " if nearest else ""
    raise ValueError(
        f"policy {name!r} is not known. {hint}'cutenv evaluate --list' prints the names; a folder of a policy or run, "
        "or MODULE:CLASS of your own, does as well."
    )
