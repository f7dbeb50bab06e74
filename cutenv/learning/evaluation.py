"""Evaluation of policies on the same specimens: every score of every cut."""

from __future__ import annotations

import contextlib
import difflib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tqdm import tqdm

from cutenv.envs import set_cores
from cutenv.learning.batched_rollout import batched_rollout
from cutenv.policy import BASELINES, SHIPPED, ArrayPolicy, Policy, PrivilegedPolicy, named_policy
from cutenv.policy.shipped import policy_of_class
from cutenv.task.registry import TASKS, task_made_as

_BATCH, _SMALL_BATCH = 200, 100  # cuts simulated together; fewer where all readings are kept, or a policy is copied
_FEWEST = 2000  # cuts, below which starting processes takes longer than they save


@dataclass(frozen=True)
class Contestant:
    """A policy and the keyword arguments of the environment that it needs, such as its decision rate."""

    policy: Policy
    arguments: Mapping[str, Any] = field(default_factory=dict)


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
        Number of processes; default one per core, or none of their own for few cuts.
    description : str
        Text before the progress bar.
    metrics : bool
        Whether to add every metric of the score card.
    pool : Executor, optional
        Processes of :func:`workers` to use instead.
    """
    parts = []
    for name, one in contestants.items():
        whole_batch = isinstance(one.policy, ArrayPolicy) and not (metrics or one.policy.privileged)
        size = _BATCH if whole_batch else _SMALL_BATCH
        whole = {**arguments, **one.arguments}
        parts += [(name, (one.policy, seeds[k : k + size], whole, metrics)) for k in range(0, len(seeds), size)]
    cuts = len(contestants) * len(seeds)
    with contextlib.ExitStack() as stack:
        own = processes or (os.cpu_count() if cuts >= _FEWEST else 1)
        if pool is None and own != 1:
            pool = stack.enter_context(workers(own))
        bar = stack.enter_context(tqdm(total=cuts, desc=description, unit="cut"))
        if pool is None:
            return [{"policy": name, **row} for name, part in parts for row in _rows(*part, bar.update)]
        futures = {}
        for place in sorted(range(len(parts)), key=lambda place: not isinstance(parts[place][1][0], PrivilegedPolicy)):
            with _without_ctrl_c():  # planners first: they take longest
                futures[pool.submit(_rows, *parts[place][1])] = place
        for future in as_completed(futures):
            bar.update(len(future.result()))
    done = {place: future.result() for future, place in futures.items()}
    return [{"policy": name, **row} for place, (name, _) in enumerate(parts) for row in done[place]]


def contestant(name: str) -> Contestant:
    """Return the baseline, script of another task or shipped policy of that name, or that of a folder or class.

    Its arguments have "task" if it is not for gentle cutting. A folder is that of a policy or of a training run; a
    class is ``MODULE:CLASS``.

    Raises
    ------
    ValueError
        If there is none; the message names the nearest.
    """
    if name in BASELINES:
        return Contestant(BASELINES[name]())
    for one in TASKS.values():
        if name in one.scripts:
            return Contestant(one.scripts[name](), {"task": one.name})
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
