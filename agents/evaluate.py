"""Compare policies on the same held-out specimens: every score of every cut, means and paired differences.

    python agents/evaluate.py "probe and creep" runs/NAME/policy     these two, on 200 test specimens of mixed
    python agents/evaluate.py all --specimens 500 --out runs/all     every baseline; CSV files into a folder
    python agents/evaluate.py --list                                 names of the baselines

A policy is a baseline's name, a shipped one's (ppo-free), or the folder of a trained one (policy.safetensors and
card.json).
"""

from __future__ import annotations

import argparse
import csv
import math
import multiprocessing
import os
import threading
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from tqdm import tqdm

import cutenv  # registers the environment
from cutenv.atomic import replacing
from cutenv.policy import BASELINES, SHIPPED, Policy, SeesTruth, trained
from cutenv.tissue.specimen import CLASSES

ENVIRONMENT = "cutenv/GentleCut-v0"
assert ENVIRONMENT in gymnasium.registry, cutenv.__name__

TRAINING_SEEDS = range(0, 1_000_000)
VALIDATION_SEEDS = range(1_000_000, 2_000_000)
TEST_SEEDS = range(2_000_000, 3_000_000)
"""Seeds of environments; a specimen is keyed by seed and episode, so disjoint seeds are disjoint specimens."""

SHOWN = ("return", "success", "tip_error_mm", "peak_force_N", "largest_jump_mm", "time_s")
_CHUNK = 10  # cuts that a process is given at once


@dataclass(frozen=True)
class Contestant:
    """A policy and the environment arguments that it needs (its decision rate, say)."""

    policy: Policy
    arguments: Mapping[str, Any] = field(default_factory=dict)


def run_cut(env: gymnasium.Env[Any, Any], policy: Policy, seed: int) -> tuple[dict[str, Any], np.ndarray]:
    """One episode: its scores, and every reading at 1 kHz (hidden tip included), shape (n,)."""
    observation, _ = env.reset(seed=seed)
    policy.reset(np.random.default_rng(seed))
    cutting = env.unwrapped.cutting  # type: ignore[attr-defined]
    if isinstance(policy, SeesTruth):
        policy.look_into(cutting)
    parts = []
    ended = False
    while not ended:
        observation, _, ended, _, info = env.step(policy(observation))
        parts.append(cutting.readings.copy())
    readings = np.concatenate(parts)
    truth, terms = info["truth"], cutting.reward_totals
    scores = {
        "seed": seed,
        "specimen_class": truth["specimen_class"],
        "target_length_mm": 1e3 * truth["target_length_m"],
        "return": math.fsum(terms.values()),
        "success": float(info["is_success"]),
        "end": info["end"],
        "tip_error_mm": 1e3 * abs(truth["tip_m"] - truth["target_length_m"]),
        "overshoot_mm": 1e3 * max(truth["tip_m"] - truth["target_length_m"], 0.0),
        "time_s": float(readings["time"][-1]),
        "peak_force_N": float(readings["true_force"].max()),
        "mean_force_N": float(readings["true_force"].mean()),
        "uncontrolled_share": truth["uncontrolled_m"] / max(truth["tip_m"], 1e-9),
        "largest_jump_mm": 1e3 * float(readings["jump"].max()),
        "runs": truth["units"],
        **{f"reward_{name}": value for name, value in terms.items()},
    }
    return scores, readings


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for work for ever."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _cuts(contestant: Contestant, arguments: Mapping[str, Any], seeds: Sequence[int]) -> list[dict[str, Any]]:
    env = gymnasium.make(ENVIRONMENT, **{**arguments, **contestant.arguments})
    rows = [run_cut(env, contestant.policy, seed)[0] for seed in seeds]
    env.close()
    return rows


def evaluate(
    contestants: Mapping[str, Contestant],
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
    *,
    processes: int | None = None,
    description: str = "evaluating",
) -> list[dict[str, Any]]:
    """Scores of every contestant on every seed, one row a cut, in order; all meet the same specimens.

    ``arguments`` are keywords of the environment; ``processes`` run side by side, by default one per core.
    """
    chunks = [seeds[k : k + _CHUNK] for k in range(0, len(seeds), _CHUNK)]
    jobs = [(name, k) for name in contestants for k in range(len(chunks))]
    done: dict[tuple[str, int], list[dict[str, Any]]] = {}
    # Fresh processes: a fork of one that runs threads (torch, Numba) may hang.
    context = multiprocessing.get_context("spawn")
    with (
        tqdm(total=len(contestants) * len(seeds), desc=description, unit="cut") as bar,
        ProcessPoolExecutor(processes or os.cpu_count(), context, initializer=_end_with_parent) as pool,
    ):
        futures = {pool.submit(_cuts, contestants[name], arguments, chunks[k]): (name, k) for name, k in jobs}
        try:
            for future in as_completed(futures):
                name, k = futures[future]
                done[name, k] = [{"policy": name, **row} for row in future.result()]
                bar.update(len(chunks[k]))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [row for job in jobs for row in done[job]]


def mean_with_interval(values: Iterable[float]) -> dict[str, float]:
    """Mean and 95 % interval (normal, 1.96 standard errors) of independent values."""
    x = np.array(list(values), dtype=float)
    error = 1.96 * x.std(ddof=1) / math.sqrt(len(x)) if len(x) > 1 else math.nan
    return {
        "mean": float(x.mean()),
        "low_95": float(x.mean() - error),
        "high_95": float(x.mean() + error),
        "cuts": len(x),
    }


def by_policy(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """Rows of each policy, in order of appearance."""
    result: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        result.setdefault(row["policy"], []).append(row)
    return result


def summarise(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Mean and 95 % interval of every numeric score for each policy."""
    return [
        {"policy": policy, "score": score, **mean_with_interval(float(row[score]) for row in own)}
        for policy, own in by_policy(rows).items()
        for score in own[0]
        if score not in ("policy", "seed") and not isinstance(own[0][score], str)
    ]


def differences(
    rows: Iterable[Mapping[str, Any]], policy: str, scores: Sequence[str] = ("return", "success")
) -> list[dict[str, Any]]:
    """Paired differences of ``policy`` from every other on the same specimens, with 95 % intervals."""
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
    """The candidate with the highest mean return."""
    returns = {row["policy"]: row["mean"] for row in summary if row["score"] == "return"}
    return max((name for name in candidates if name in returns), key=returns.__getitem__)


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows to a CSV file, all at once: never half a file under the final name."""
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
    """The baseline or shipped policy of that name, or the one in that folder; an error names what there is."""
    if name in BASELINES:
        return Contestant(BASELINES[name]())
    if name in SHIPPED or Path(name).is_dir():
        policy = trained(name)
        return Contestant(policy, policy.environment_arguments)
    raise SystemExit(
        f"{name!r} is neither a baseline nor a folder nor shipped; baselines: all, {', '.join(BASELINES)}; "
        f"shipped: {', '.join(SHIPPED)}"
    )


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policies", nargs="*", metavar="POLICY", help="baseline, folder of a trained policy, or all")
    parser.add_argument("--list", action="store_true", help="print the names of the baselines")
    parser.add_argument("--specimen-class", choices=CLASSES, default="mixed", help="default mixed")
    parser.add_argument("--specimens", type=int, default=200, help="held-out specimens (default 200)")
    parser.add_argument("--validation", action="store_true", help="validation instead of test specimens")
    parser.add_argument(
        "--out", type=Path, metavar="FOLDER", help="write scores.csv, summary.csv and differences.csv here"
    )
    parser.add_argument("--processes", type=int, help="side by side; default one per core")
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
    rows = evaluate(
        chosen,
        seeds[: arguments.specimens],
        {"specimen_class": arguments.specimen_class},
        processes=arguments.processes,
    )
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
