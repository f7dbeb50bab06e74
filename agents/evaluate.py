"""Compare policies on the same held-out specimens: every score of every cut, means and paired differences.

    python agents/evaluate.py "probe and creep" runs/NAME/policy     these two, on 200 test specimens of mixed
    python agents/evaluate.py all --specimens 500 --out runs/all     every baseline; CSV files into a folder
    python agents/evaluate.py --list                                 names of the baselines

A policy is a baseline's name, a shipped one's (ppo-free), or the folder of a trained one (policy.safetensors and
card.json).
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import math
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from finished_cut import FinishedCut
from side_by_side import cuts_side_by_side
from tqdm import tqdm

import cutenv  # registers the environment
from cutenv.atomic import replacing
from cutenv.cores import set_cores
from cutenv.policy import BASELINES, SHIPPED, Policy, SeesTruth, TrainedPolicy, named_policy
from cutenv.tissue.specimen import CLASSES

ENVIRONMENT = "cutenv/GentleCut-v1"
assert ENVIRONMENT in gymnasium.registry, cutenv.__name__

TRAINING_SEEDS = range(0, 1_000_000)
VALIDATION_SEEDS = range(1_000_000, 2_000_000)
TEST_SEEDS = range(2_000_000, 3_000_000)
"""Seeds of environments; a specimen is keyed by seed and episode, so disjoint seeds are disjoint specimens."""

SHOWN = ("return", "success", "tip_error_mm", "peak_force_N", "largest_jump_mm", "time_s")
_CHUNK = 10  # cuts that a process gets at once
_SIDE_BY_SIDE = 100  # the same for a trained policy, which makes them in a batch


@dataclass(frozen=True)
class Contestant:
    """A policy and the environment arguments that it needs (for example its decision rate)."""

    policy: Policy
    arguments: Mapping[str, Any] = field(default_factory=dict)


def finished_cut(env: gymnasium.Env[Any, Any], policy: Policy, seed: int) -> FinishedCut:
    """Run one episode."""
    observation, _ = env.reset(seed=seed)
    policy.reset(np.random.default_rng(seed))
    unwrapped: Any = env.unwrapped
    cutting = unwrapped.cutting
    if isinstance(policy, SeesTruth):
        policy.look_into(cutting)
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
    """Run one episode; return its scores, and every reading at 1 kHz (hidden tip included), shape (n,)."""
    cut = finished_cut(env, policy, seed)
    return cut.scores(), cut.readings


def _end_with_parent() -> None:
    """End this worker with its parent: otherwise it would wait for work for ever if the parent was killed."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _begin_worker() -> None:
    """Limit a worker to one core, since there are as many as cores; Ctrl-C is left to the parent, which ends them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_cores(1)
    _end_with_parent()


@contextlib.contextmanager
def workers(processes: int | None = None) -> Iterator[Executor]:
    """Yield processes for evaluation, by default one per core; pending work is dropped after an error."""
    # Fresh processes: a fork of one that runs threads (torch, Numba) may hang.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes or os.cpu_count(), context, initializer=_begin_worker) as pool:
        try:
            yield pool
        except BaseException:
            started = list(pool._processes.values())
            pool.shutdown(wait=False, cancel_futures=True)
            for process in started:  # in the middle of their cuts, for which nobody waits any more
                process.terminate()
            raise


@contextlib.contextmanager
def _without_ctrl_c() -> Iterator[None]:
    """Hold Ctrl-C back from this thread, and for good from the processes that it starts, from their first import on."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows, where workers hear it until they have begun
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
        return [_row(cut, metrics) for cut in cuts_side_by_side(contestant.policy, seeds, whole)]
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
    """Return the scores of every contestant on every seed, one row per cut, in order; all cut the same specimens.

    ``arguments`` are keyword arguments of the environment; ``processes`` run in parallel, by default one per core, or
    those of the ``pool`` from :func:`workers`.  With ``metrics`` the score card's are added.
    """
    with contextlib.ExitStack() as stack:
        pool = stack.enter_context(workers(processes)) if pool is None else pool
        bar = stack.enter_context(tqdm(total=len(contestants) * len(seeds), desc=description, unit="cut"))
        futures = {}
        for name, one in contestants.items():
            size = _SIDE_BY_SIDE if isinstance(one.policy, TrainedPolicy) else _CHUNK
            for k in range(0, len(seeds), size):
                with _without_ctrl_c():
                    futures[pool.submit(_rows, one, arguments, seeds[k : k + size], metrics)] = name
        for future in as_completed(futures):
            bar.update(len(future.result()))
    return [{"policy": name, **row} for future, name in futures.items() for row in future.result()]


def mean_with_interval(values: Iterable[float]) -> dict[str, float]:
    """Return mean and 95 % interval (normal, 1.96 standard errors) of independent values."""
    x = np.array(list(values), dtype=float)
    error = 1.96 * x.std(ddof=1) / math.sqrt(len(x)) if len(x) > 1 else math.nan
    return {
        "mean": float(x.mean()),
        "low_95": float(x.mean() - error),
        "high_95": float(x.mean() + error),
        "cuts": len(x),
    }


def by_policy(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """Return the rows of each policy, in order of appearance."""
    result: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        result.setdefault(row["policy"], []).append(row)
    return result


def summarise(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return mean and 95 % interval of every numeric score for each policy."""
    return [
        {"policy": policy, "score": score, **mean_with_interval(float(row[score]) for row in own)}
        for policy, own in by_policy(rows).items()
        for score in own[0]
        if score not in ("policy", "seed") and not isinstance(own[0][score], str)
    ]


def differences(
    rows: Iterable[Mapping[str, Any]], policy: str, scores: Sequence[str] = ("return", "success")
) -> list[dict[str, Any]]:
    """Return paired differences of ``policy`` from every other on the same specimens, with 95 % intervals."""
    each = by_policy(rows)
    own = {row["seed"]: row for row in each[policy]}
    return [
        {
            "policy": policy,
            "baseline": other,
            "score": score,
            **mean_with_interval(float(own[row["seed"]][score]) - float(row[score]) for row in theirs),
        }
        for other, theirs in each.items()
        if other != policy
        for score in scores
    ]


def best_script(summary: Iterable[Mapping[str, Any]], candidates: Iterable[str]) -> str:
    """Return the candidate with the highest mean return."""
    returns = {row["policy"]: row["mean"] for row in summary if row["score"] == "return"}
    return max((name for name in candidates if name in returns), key=returns.__getitem__)


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows to a CSV file atomically: never half a file under the final name."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    with replacing(path) as part, part.open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=names, restval="")
        writer.writeheader()
        writer.writerows(rows)


def print_table(summary: Sequence[Mapping[str, Any]], scores: Sequence[str] = SHOWN) -> None:
    """Print the chosen scores of each policy with their intervals, the best return first."""
    values = {(row["policy"], row["score"]): row for row in summary}
    policies = sorted({row["policy"] for row in summary}, key=lambda name: -values[name, "return"]["mean"])
    width = max(len(name) for name in policies) + 2
    print("".ljust(width) + "".join(score.rjust(24) for score in scores))
    for policy in policies:
        cells = [values[policy, score] for score in scores]
        shown = [f"{cell['mean']:.3f} [{cell['low_95']:.3f}, {cell['high_95']:.3f}]" for cell in cells]
        print(policy.ljust(width) + "".join(text.rjust(24) for text in shown))


def print_differences(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print paired differences of return and success."""
    values = {(row["baseline"], row["score"]): row for row in rows}
    print(f"\n{rows[0]['policy']} minus each other on the same specimens, mean [95 % interval]\n")
    for baseline in dict.fromkeys(row["baseline"] for row in rows):
        cells = [values[baseline, score] for score in ("return", "success")]
        shown = "".join(
            f"{cell['mean']:+.3f} [{cell['low_95']:+.3f}, {cell['high_95']:+.3f}]".rjust(28) for cell in cells
        )
        print(baseline.ljust(30) + shown)


def contestant(name: str) -> Contestant:
    """Return the baseline or shipped policy of that name, or the one in that folder; raise with a list otherwise."""
    if name in BASELINES:
        return Contestant(BASELINES[name]())
    if name in SHIPPED or Path(name).is_dir():
        policy = named_policy(name)
        return Contestant(policy, policy.environment_arguments)
    raise SystemExit(
        f"{name!r} is neither a baseline nor a folder nor shipped; baselines: all, {', '.join(BASELINES)}; "
        f"shipped: {', '.join(SHIPPED)}"
    )


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policies", nargs="*", metavar="POLICY", help="baseline, folder of a trained policy, or all")
    parser.add_argument("--list", action="store_true", help="print the names of the baselines")
    parser.add_argument("--specimen-class", choices=CLASSES, default="mixed", help="class; default mixed")
    parser.add_argument("--specimens", type=int, default=200, metavar="N", help="held-out specimens; default 200")
    parser.add_argument("--validation", action="store_true", help="take validation specimens instead of test specimens")
    parser.add_argument(
        "--out", type=Path, metavar="FOLDER", help="write scores.csv, summary.csv and differences.csv here"
    )
    parser.add_argument("--processes", type=int, metavar="N", help="number of processes; default one per core")
    arguments = parser.parse_args()
    if arguments.list or not arguments.policies:
        print("\n".join(BASELINES))
        return
    seeds = VALIDATION_SEEDS if arguments.validation else TEST_SEEDS
    if not 2 <= arguments.specimens <= len(seeds):
        raise SystemExit(f"--specimens {arguments.specimens} is outside 2 to {len(seeds)}")
    names = [name for given in arguments.policies for name in (BASELINES if given == "all" else [given])]
    chosen = {name: contestant(name) for name in dict.fromkeys(names)}
    if arguments.out:
        arguments.out.mkdir(parents=True, exist_ok=True)
    try:
        rows = evaluate(
            chosen,
            seeds[: arguments.specimens],
            {"specimen_class": arguments.specimen_class},
            processes=arguments.processes,
        )
    except KeyboardInterrupt:
        print("\nevaluate: interrupted; nothing was written", file=sys.stderr)
        raise SystemExit(130) from None
    summary, paired = summarise(rows), differences(rows, next(iter(chosen)))
    if arguments.out:
        write_csv(arguments.out / "scores.csv", rows)
        write_csv(arguments.out / "summary.csv", summary)
        if paired:
            write_csv(arguments.out / "differences.csv", paired)
    print(f"\n{arguments.specimens} held-out specimens of class {arguments.specimen_class}, mean [95 % interval]\n")
    print_table(summary)
    if paired and len(chosen) <= 12:
        print_differences(paired)


if __name__ == "__main__":
    main()
