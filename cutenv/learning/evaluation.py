"""Evaluation of policies on the same specimens: every score of every cut."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from multiprocessing.pool import Pool
from pathlib import Path
from typing import Any

from tqdm import tqdm

from cutenv.learning.batched_rollout import batched_rollout
from cutenv.learning.finished_cut import FinishedCut
from cutenv.policy import BASELINES, SHIPPED, ArrayPolicy, Policy, named_policy

_BATCH, _SMALL_BATCH = 200, 100  # cuts simulated together; fewer where all readings are kept, or a policy is copied


@dataclass(frozen=True)
class Contestant:
    """A policy and the keyword arguments of the environment that it needs, such as its decision rate."""

    policy: Policy
    arguments: Mapping[str, Any] = field(default_factory=dict)


def _prepare_worker() -> None:
    """End this worker when its parent is killed; otherwise it would wait for work for ever."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextlib.contextmanager
def workers(processes: int) -> Iterator[Pool]:
    """Start processes that compute metrics; an error, or Ctrl-C, ends them at once."""
    # Fresh processes: a fork of one that runs threads (torch, Numba) may hang.  They inherit that Ctrl-C is ignored.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        pool = multiprocessing.get_context("spawn").Pool(processes, _prepare_worker)
    finally:
        signal.signal(signal.SIGINT, before)
    with pool:
        yield pool


def evaluate(
    contestants: Mapping[str, Contestant],
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
    *,
    description: str = "evaluating",
    metrics: bool = False,
    pool: Pool | None = None,
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
    description : str
        Text before the progress bar.
    metrics : bool
        Whether to add every metric of the score card.
    pool : Pool, optional
        Processes of :func:`workers` that compute the metrics.
    """
    rows: list[dict[str, Any]] = []
    with tqdm(total=len(contestants) * len(seeds), desc=description, unit="cut") as bar:
        for name, one in contestants.items():
            several = isinstance(one.policy, ArrayPolicy) and not metrics
            size = _BATCH if several else _SMALL_BATCH
            for k in range(0, len(seeds), size):
                cuts = batched_rollout(
                    one.policy, seeds[k : k + size], {**arguments, **one.arguments}, readings=metrics,
                    finished=bar.update,
                )  # fmt: skip
                rows += [{"policy": name, **cut.scores()} for cut in cuts]
                if metrics:
                    computed = map(FinishedCut.metrics, cuts) if pool is None else pool.map(FinishedCut.metrics, cuts)
                    for row, values in zip(rows[-len(cuts) :], computed, strict=True):
                        row |= values
    return rows


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
