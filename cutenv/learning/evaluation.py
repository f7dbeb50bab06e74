"""Evaluation of policies on the same specimens: every score of every cut."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from tqdm import tqdm

from cutenv.envs import set_cores
from cutenv.learning.batched_rollout import batched_rollout
from cutenv.learning.finished_cut import FinishedCut
from cutenv.learning.seeds import ENVIRONMENT
from cutenv.policy import BASELINES, SHIPPED, Policy, PrivilegedPolicy, TrainedPolicy, named_policy

_CHUNK = 10  # cuts in one task of a process
_BATCH = 100  # cuts of a trained policy, which are simulated together


@dataclass(frozen=True)
class Contestant:
    """A policy and the keyword arguments of the environment that it needs, such as its decision rate."""

    policy: Policy
    arguments: Mapping[str, Any] = field(default_factory=dict)


def finished_cut(env: gymnasium.Env[Any, Any], policy: Policy, seed: int) -> FinishedCut:
    """Let a policy cut the specimen of a seed, its first episode."""
    observation, _ = env.reset(seed=seed)
    policy.reset(np.random.default_rng(seed))
    unwrapped: Any = env.unwrapped
    cutting = unwrapped.cutting
    if isinstance(policy, PrivilegedPolicy):
        policy.set_state(cutting)
    parts, over_limit = [], 0.0
    ended = False
    while not ended:
        observation, _, ended, _, info = env.step(policy(observation))
        parts.append(cutting.readings.copy())
        over_limit = max(over_limit, info["cost"]["force_N"])
    return FinishedCut(
        seed=seed,
        end=info["end"],
        success=info["is_success"],
        truth=info["truth"],
        reward_totals=dict(cutting.reward_totals),
        over_limit_N=over_limit,
        readings=np.concatenate(parts),
        depth=unwrapped.specimen.depth,
        resistance=unwrapped.specimen.fracture_resistance,
    )


def run_cut(env: gymnasium.Env[Any, Any], policy: Policy, seed: int) -> tuple[dict[str, Any], np.ndarray]:
    """Let a policy cut the specimen of a seed; return its scores, and the readings at 1 kHz, shape (n,)."""
    cut = finished_cut(env, policy, seed)
    return cut.scores(), cut.readings


def _end_with_parent() -> None:
    """End this worker when its parent is killed; otherwise it would wait for work for ever."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _begin_worker() -> None:
    """Use one core, as there are as many processes as cores, and leave Ctrl-C to the parent, which ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_cores(1)
    _end_with_parent()


@contextlib.contextmanager
def workers(processes: int | None = None) -> Iterator[Executor]:
    """Start processes to evaluate in, by default one per core; an error cancels the remaining work."""
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
    """Hold Ctrl-C back from this thread, and from the processes that it starts until they ignore it themselves."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows, where workers react to it until they have started
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _rows(
    contestant: Contestant, arguments: Mapping[str, Any], seeds: Sequence[int], metrics: bool
) -> list[dict[str, Any]]:
    whole = {**arguments, **contestant.arguments}
    if isinstance(contestant.policy, TrainedPolicy):
        return [_row(cut, metrics) for cut in batched_rollout(contestant.policy, seeds, whole)]
    env = gymnasium.make(ENVIRONMENT, **whole)
    rows = [_row(finished_cut(env, contestant.policy, seed), metrics) for seed in seeds]
    env.close()
    return rows


def _row(cut: FinishedCut, metrics: bool) -> dict[str, Any]:
    return cut.scores() | (cut.metrics() if metrics else {})


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
    """Return the scores of every contestant on every seed, one row for each cut, in order.

    Parameters
    ----------
    contestants : mapping of str to Contestant
        Policies by name; all cut the same specimens.
    seeds : sequence of int
        Seeds, one for each specimen.
    arguments : mapping
        Keyword arguments of the environment; those of a contestant take precedence.
    processes : int, optional
        Number of processes; default one per core.
    description : str
        Text before the progress bar.
    metrics : bool
        Whether to add every metric of the score card.
    pool : Executor, optional
        Processes of :func:`workers` to use instead.
    """
    with contextlib.ExitStack() as stack:
        pool = stack.enter_context(workers(processes)) if pool is None else pool
        bar = stack.enter_context(tqdm(total=len(contestants) * len(seeds), desc=description, unit="cut"))
        futures = {}
        for name, one in contestants.items():
            size = _BATCH if isinstance(one.policy, TrainedPolicy) else _CHUNK
            for k in range(0, len(seeds), size):
                with _without_ctrl_c():
                    futures[pool.submit(_rows, one, arguments, seeds[k : k + size], metrics)] = name
        for future in as_completed(futures):
            bar.update(len(future.result()))
    return [{"policy": name, **row} for future, name in futures.items() for row in future.result()]


def contestant(name: str) -> Contestant:
    """Return the baseline or shipped policy of that name, or the one in that folder.

    Raises
    ------
    ValueError
        If there is none; the message lists the known names.
    """
    if name in BASELINES:
        return Contestant(BASELINES[name]())
    if name in SHIPPED or Path(name).is_dir():
        policy = named_policy(name)
        return Contestant(policy, policy.environment_arguments)
    raise ValueError(
        f"{name!r} is neither a baseline nor a folder nor shipped; baselines: all, {', '.join(BASELINES)}; "
        f"shipped: {', '.join(SHIPPED)}"
    )
