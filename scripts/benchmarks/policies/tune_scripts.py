"""Tune the scripts of a task by an evolution strategy, as fairly as an agent is trained.

    python -m scripts.benchmarks.policies.tune_scripts excision      every script, 200 generations; writes runs/excision
    python -m scripts.benchmarks.policies.tune_scripts hand-excision those with a hand that yields

Every number of a script, and of the script along the cut under it, is searched for at once.  A generation draws so many
variants about a mean, lets all cut the same training specimens, which no other generation cuts, and moves the mean
toward the best quarter.  The mean of the last generations is kept if it beats what the script began with on validation
specimens.  So the return that is told for a script is of specimens that its tuning never met.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv.agents.learning.seeds import TRAINING_SEEDS, VALIDATION_SEEDS
from cutenv.agents.policy.path_policies import (
    BladeOnLine,
    LookAhead,
    OutsideTheBend,
    PathScript,
    SlowInBends,
    SteerByForce,
    with_numbers,
)
from cutenv.agents.policy.scripted import INCLINED, UPRIGHT
from cutenv.envs.vector import CutBatch
from cutenv.task.registry import TASKS
from scripts.tables import keep_json, kept_json

VARIANTS, BEST = 12, 3  # variants of a generation, and how many of them move the mean
SPECIMENS, JUDGED = 64, 1000  # specimens that each variant cuts, and that the result is judged on
_LAST = 20  # generations whose means are averaged
_FIRST_SPREAD, _LAST_SPREAD = 0.15, 0.02  # standard deviation of a number, over its range


@dataclass(frozen=True)
class Number:
    """One number of a script: where the search begins, and its range, in SI units."""

    start: float
    low: float
    high: float


ALONG = {  # numbers of the script along the cut, cutenv.agents.policy.path_policies.ALONG_NUMBERS
    "speed": Number(0.0165, 0.003, 0.0254),
    "angle": Number(INCLINED, INCLINED, UPRIGHT),
    "approach": Number(0.010, 0.002, 0.025),
    "stroke": Number(0.0025, 0.001, 0.012),
    "stroke_speed": Number(0.010, 0.002, 0.0254),
    "held": Number(1.3, 1.0, 3.0),
    "beyond": Number(0.003, -0.005, 0.02),
    "run_share": Number(0.7, 0.0, 1.5),
    "margin": Number(-0.0005, -0.015, 0.005),
    "retreat_speed": Number(0.012, 0.003, 0.0254),
}


@dataclass(frozen=True)
class Family:
    """Scripts that differ by their numbers."""

    kind: type[PathScript]
    numbers: Mapping[str, Number]  # its own numbers, besides those along the cut

    @property
    def all_numbers(self) -> dict[str, Number]:
        """All numbers that are searched for."""
        return {**ALONG, **self.numbers}


FAMILIES = {  # scripts that steer, by name
    "steer by force": Family(SteerByForce, {"gain": Number(1.5, 0.2, 5.0), "back": Number(0.02, 0.004, 0.08)}),
    "blade on the line": Family(BladeOnLine, {}),
    "look ahead": Family(LookAhead, {}),
    "slow in bends": Family(SlowInBends, {"bend": Number(40.0, 5.0, 200.0)}),
    "outside the bend": Family(OutsideTheBend, {"share": Number(1.0, -2.0, 4.0)}),
}


class Tuning:
    """Search for the numbers of one family on one task."""

    def __init__(self, task: str, family: Family, seed: int) -> None:
        self._family = family
        self._single = TASKS[task].single(specimen_class="mixed", control_hz=10)
        self._rng = np.random.default_rng(seed)
        numbers = family.all_numbers.values()
        self.low, self.high = (np.array([getattr(each, end) for each in numbers]) for end in ("low", "high"))
        self.mean = (np.array([each.start for each in numbers]) - self.low) / (self.high - self.low)
        self.start = self.mean.copy()

    def named(self, place: Array) -> dict[str, float]:
        """Return the numbers by name, from places in their ranges, 0 to 1, shape (m,)."""
        values = self.low + np.clip(place, 0.0, 1.0) * (self.high - self.low)
        return dict(zip(self._family.all_numbers, values.tolist(), strict=True))

    def scores(self, places: Sequence[Array], seeds: Sequence[int]) -> tuple[Array, Array]:
        """Return returns and successes, each of shape (variants, specimens), on specimens with these seeds."""
        count, each = len(places), len(seeds)
        batch = CutBatch(count * each, self._single)
        everyone = np.arange(count * each)
        batch.give_seeds(list(seeds) * count, everyone, np.random.default_rng(0))
        batch.begin(everyone)
        scripts = [with_numbers(self._family.kind, self.named(place)) for place in places]
        for script in scripts:
            script.begin([np.random.default_rng(0)] * each)
        returns, waiting = np.zeros(count * each), np.zeros(count * each, bool)
        successes = np.zeros(count * each, bool)
        while not waiting.all():
            parts = batch.observations.reshape(count, each, -1)
            actions = np.concatenate([script.act(seen) for script, seen in zip(scripts, parts, strict=True)])
            rewards, ends = batch.decide(actions, waiting)
            returns += rewards
            over = (ends != 0) & ~waiting
            successes[over] = batch.succeeded()[over]
            waiting |= over
        return returns.reshape(count, each), successes.reshape(count, each)

    def run(self, generations: int, told: Callable[[str], None]) -> dict[str, Any]:
        """Search; return the numbers, and what they and those of the start earn on validation specimens."""
        size, kept = len(self.mean), []
        spread = np.full(size, _FIRST_SPREAD)
        begun = time.perf_counter()
        for generation in range(generations):
            first = generation * SPECIMENS
            seeds = TRAINING_SEEDS[first : first + SPECIMENS]
            places = [self.mean, *(self.mean + spread * self._rng.standard_normal((VARIANTS - 1, size)))]
            values = self.scores(places, seeds)[0].mean(axis=1)
            best = np.clip([places[k] for k in np.argsort(-values)[:BEST]], 0.0, 1.0)
            self.mean = 0.5 * self.mean + 0.5 * best.mean(axis=0)
            # As wide as the best lie apart, but never wider than the share of the search that is left allows.
            share = generation / max(generations - 1, 1)
            most = _FIRST_SPREAD * (_LAST_SPREAD / _FIRST_SPREAD) ** share
            spread = np.clip(0.7 * spread + 0.3 * best.std(axis=0), _LAST_SPREAD, most)
            kept.append(self.mean)
            if generation % 20 == 19:
                told(f"generation {generation + 1}: best {values.max():.3f}, mean of the variants {values.mean():.3f}")
        found = np.mean(kept[-_LAST:], axis=0) if kept else self.mean
        returns, successes = self.scores([found, self.start], VALIDATION_SEEDS[:JUDGED])
        better = int(returns[0].mean() < returns[1].mean())
        return {
            "numbers": self.named((found, self.start)[better]),
            "generations": generations,
            "minutes": round((time.perf_counter() - begun) / 60.0, 1),
            "tuned": {"return": float(returns[0].mean()), "success": float(successes[0].mean())},
            "start": {"return": float(returns[1].mean()), "success": float(successes[1].mean())},
        }


def report(found: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what was found as a Markdown table."""
    lines = [
        "| script | generations | return before | tuned | success before | tuned |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name, one in found.items():
        (before, tuned), generations = (one["start"], one["tuned"]), one["generations"]
        lines.append(
            f"| {name} | {generations} | {before['return']:.3f} | {tuned['return']:.3f} "
            f"| {100 * before['success']:.1f} % | {100 * tuned['success']:.1f} % |"
        )
    cuts = f"{JUDGED} validation specimens; {VARIANTS} variants a generation, on {SPECIMENS} training specimens each."
    return "\n".join([*lines, "", cuts])


def file_of(task: str) -> Path:
    """Return the file with what was found for a task."""
    return Path("runs") / task / "tuned.json"


def kept_report(task: str) -> str:
    """Return the table of what was found for a task; SystemExit if there is none."""
    return report(kept_json(file_of(task), f"scripts.benchmarks.policies.tune_scripts {task}"))


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    along_lines = [name for name, task in TASKS.items() if task.places["task"] == TASKS["path"].places["task"]]
    parser.add_argument("task", choices=along_lines)
    parser.add_argument("--script", choices=list(FAMILIES), action="append", help="tune this one; default all")
    parser.add_argument("--generations", type=int, default=200, metavar="N", help="default 200")
    parser.add_argument("--seed", type=int, default=0, help="seed of the search")
    parser.add_argument("--print", action="store_true", help="print what was found before")
    arguments = parser.parse_args()
    if arguments.print:
        print(kept_report(arguments.task))
        return
    path = file_of(arguments.task)
    found = kept_json(path, "scripts.benchmarks.policies.tune_scripts") if path.is_file() else {}
    for name in arguments.script or FAMILIES:
        tuning = Tuning(arguments.task, FAMILIES[name], arguments.seed)
        found[name] = tuning.run(arguments.generations, lambda line, name=name: print(f"{name}, {line}", flush=True))
        keep_json(path, found)
    print(report(found))


if __name__ == "__main__":
    main()
