"""Runs of a benchmark: training of every agent, cuts of held-out specimens, sweeps of constants, kept on disk."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmark.aggregate import disagreements, read_summary
from benchmark.protocol import BEST_FEED, ENTRIES, SCRIPTED, Entry, Protocol, slug
from benchmark.robustness import settings
from cutenv.learning.checkpoint import checkpoint_of
from cutenv.learning.evaluation import Contestant, contestant, evaluate
from cutenv.learning.result_tables import rows_of, write_csv
from cutenv.learning.seeds import VALIDATION_SEEDS
from cutenv.learning.statistics import best_script, summarise
from cutenv.policy import BASELINES, CONSTANT_FEEDS, NULL_POLICIES, ORACLE

SWEPT = ("PPO", "recurrent PPO", "behaviour cloning", "probe and creep", BEST_FEED)
_CORE_SECONDS = {ORACLE: 0.15}
"""Time of one cut with its score card, on the machine of docs/results/speed.md [core s]; for the others:"""
_CORE_SECONDS_ELSE = 0.006
_CLONING_S, _STARTING_S = 90.0, 20.0  # time of behaviour cloning; time of any run besides training: imports, export


@dataclass(frozen=True)
class Part:
    """One participant: a script, or an agent with one training seed."""

    contestant: str
    seed: int | None

    @property
    def label(self) -> str:
        """Name and training seed, for printing."""
        return self.contestant if self.seed is None else f"{self.contestant}, seed {self.seed}"

    @property
    def slug(self) -> str:
        """Name and training seed as part of a file name."""
        return slug(self.contestant) + ("" if self.seed is None else f"-seed{self.seed}")


class Benchmark:
    """State of a comparison in a folder: finished and remaining parts.

    Parameters
    ----------
    folder : Path
        Folder of all files.
    protocol : Protocol
        Definition of the comparison.
    only : sequence of str
        Names of the participants; empty: all.
    processes : int
        Number of processes for training and evaluation.
    """

    def __init__(self, folder: Path, protocol: Protocol, only: Sequence[str], processes: int) -> None:
        self.folder, self.protocol, self.processes = folder, protocol, processes
        self.names = [name for name in (*ENTRIES, *SCRIPTED) if not only or name in only]

    def parts(self) -> list[Part]:
        """Return all participants."""
        seeds = self.protocol.training_seeds
        return [Part(name, seed) for name in self.names for seed in (seeds if name in ENTRIES else (None,))]

    def run_of(self, part: Part) -> Path:
        """Return the folder of a training run."""
        return self.folder / "runs" / part.slug

    def cuts_of(self, part: Part, specimen_class: str) -> Path:
        """Return the file of a participant's cuts."""
        return self.folder / "cuts" / f"{part.slug}--{specimen_class}.csv"

    def untrained(self) -> list[Part]:
        """Return the runs that remain to be trained."""
        return [part for part in self.parts() if part.seed is not None and not is_trained(self.run_of(part))]

    def uncut(self) -> list[tuple[Part, str]]:
        """Return the participants that remain to be evaluated, with the class of specimens."""
        classes = self.protocol.classes
        return [(part, name) for part in self.parts() for name in classes if not self.cuts_of(part, name).is_file()]

    def swept(self) -> list[Part]:
        """Return the participants that are evaluated with other constants."""
        return [part for part in self.parts() if part.contestant in SWEPT]

    def unswept(self) -> list[Any]:
        """Return the remaining settings, each with its file."""
        files = ((setting, self.folder / "sweeps" / f"{setting.name}.csv") for setting in settings())
        wanted = {part.label for part in self.swept()}
        return [(setting, path) for setting, path in files if wanted - {row["policy"] for row in rows_of(path)}]

    def plan(self) -> float:
        """Print the remaining work; return its estimated duration [s]."""
        p = self.protocol
        training = sum(
            _STARTING_S + (min(_CLONING_S, 60.0 * p.training_minutes) if part.contestant.startswith("behaviour")
                           else 60.0 * p.training_minutes)
            for part in self.untrained()
        )  # fmt: skip
        cutting = sum(_CORE_SECONDS.get(part.contestant, _CORE_SECONDS_ELSE) for part, _ in self.uncut()) * p.specimens
        sweeping = len(self.unswept()) * len(self.swept()) * p.sweep_specimens * 0.6 * _CORE_SECONDS_ELSE
        feeds = 0 if self.feeds.is_file() or not self.uncut() else len(CONSTANT_FEEDS) * p.feed_specimens
        statistics = sum(20.0 if name in ENTRIES else 4.0 for name in self.names) * p.resamples / 2000
        stages = {
            f"train {len(self.untrained())} agents": training / self.processes,
            f"choose the best of {len(CONSTANT_FEEDS)} constant feeds": feeds * _CORE_SECONDS_ELSE / self.processes,
            f"cut {len(self.uncut()) * p.specimens} specimens": cutting / self.processes,
            f"sweep {len(self.unswept())} settings of constants": sweeping / self.processes,
            "statistics": statistics,
        }
        print(f"protocol {p.version}, {self.processes} processes; remaining work and its duration:")
        for name, seconds in stages.items():
            print(f"  {name:45s} {seconds / 60.0:6.1f} min")
        total = sum(stages.values())
        print(f"  {'together':45s} {total / 60.0:6.1f} min", flush=True)
        return total

    def train(self) -> None:
        """Train the remaining agents, on one core each."""
        left = self.untrained()
        with ThreadPoolExecutor(self.processes) as pool:
            for number, part in enumerate(pool.map(self._train, left), 1):
                print(f"trained {part.label} ({number} of {len(left)})", flush=True)

    def _train(self, part: Part) -> Part:
        entry, run = ENTRIES[part.contestant], self.run_of(part)
        (self.folder / "runs").mkdir(parents=True, exist_ok=True)
        if run.exists() and checkpoint_of(run) is None:
            shutil.rmtree(run)  # interrupted before the first checkpoint
        command = ["--resume", str(Path("runs") / part.slug)] if run.exists() else self.training_arguments(entry, part)
        with (self.folder / "runs" / f"{part.slug}.log").open("a") as log:
            done = subprocess.run(
                [sys.executable, "-m", "cutenv", "train", "--learner", entry.learner, *command],
                cwd=self.folder, stdout=log, stderr=log, check=False,
                env=os.environ | {"CUTENV_CORES": "1", "OMP_NUM_THREADS": "1"},
            )  # fmt: skip
        if done.returncode or not is_trained(run):
            raise SystemExit(f"training {part.label} failed; see {log.name}.")
        return part

    def training_arguments(self, entry: Entry, part: Part) -> list[str]:
        """Return the options of ``cutenv train`` for a new run."""
        p = self.protocol
        own = ["--name", part.slug, "--seed", str(part.seed), "--minutes", str(p.training_minutes), "--specimens", "0"]
        shown = ["--demonstrations", str(p.demonstrations)]
        return [*own, *shown, "--specimen-class", p.training_class, *entry.arguments]

    @property
    def feeds(self) -> Path:
        """File of the constant feeds on validation specimens."""
        return self.folder / "feeds.csv"

    def best_feed(self, pool: Executor) -> str:
        """Return the name of the best constant feed on validation specimens."""
        if not self.feeds.is_file():
            seeds, shared = VALIDATION_SEEDS[: self.protocol.feed_specimens], {"specimen_class": "mixed"}
            grid = {name: Contestant(BASELINES[name]()) for name in CONSTANT_FEEDS}
            write_csv(self.feeds, summarise(evaluate(grid, seeds, shared, pool=pool, description="constant feeds")))
        rows = [row | {"mean": float(row["mean"])} for row in rows_of(self.feeds)]
        return best_script(rows, CONSTANT_FEEDS)

    def entrant(self, part: Part, pool: Executor) -> Contestant:
        """Return the policy of a participant, and the environment that it needs."""
        if part.seed is not None:
            return contestant(str(self.run_of(part) / "policy"))
        if part.contestant == BEST_FEED:
            return contestant(self.best_feed(pool))
        one = contestant(part.contestant)
        return Contestant(one.policy, {"control_hz": 10}) if part.contestant in NULL_POLICIES else one

    def cut(self, pool: Executor) -> None:
        """Evaluate the remaining participants."""
        (self.folder / "cuts").mkdir(parents=True, exist_ok=True)
        for part, specimen_class in self.uncut():
            rows = evaluate(
                {part.label: self.entrant(part, pool)}, self.protocol.test_seeds, {"specimen_class": specimen_class},
                pool=pool, metrics=True, description=f"{part.label}, {specimen_class}",
            )  # fmt: skip
            write_csv(self.cuts_of(part, specimen_class), rows)

    def sweep(self, pool: Executor) -> None:
        """Evaluate the remaining participants with other constants."""
        (self.folder / "sweeps").mkdir(parents=True, exist_ok=True)
        seeds = self.protocol.test_seeds[: self.protocol.sweep_specimens]
        for setting, path in self.unswept():
            known = rows_of(path)
            parts = [part for part in self.swept() if part.label not in {row["policy"] for row in known}]
            shared = {"specimen_class": self.protocol.training_class, **setting.arguments(path.parent)}
            several = {part.label: self.entrant(part, pool) for part in parts}
            rows = evaluate(several, seeds, shared, pool=pool, description=setting.name)
            write_csv(path, [*known, *rows])


def is_trained(run: Path) -> bool:
    """Return True if a run is finished: only then is its training time known."""
    facts = run / "run.json"
    return (
        (run / "policy" / "card.json").is_file()
        and facts.is_file()
        and "training_minutes" in json.loads(facts.read_text())
    )


def differs(published: Path, folder: Path) -> int:
    """Print the numbers that differ from another summary.csv beyond both intervals; return 1 if there are any."""
    theirs, ours = (path.parent / "protocol.json" for path in (published, folder / "summary.csv"))
    for path in (theirs, ours):
        if not path.is_file():
            raise SystemExit(f"{path} is missing; it defines the comparison.")
    if json.loads(theirs.read_text()) != json.loads(ours.read_text()):
        raise SystemExit(f"{theirs} and {ours} are two protocols; compare results of one protocol.")
    apart, count = disagreements(read_summary(published), read_summary(folder / "summary.csv"))
    print("\n".join(apart))
    print(f"{len(apart)} of {count} numbers that both have differ beyond both intervals")
    return 1 if apart else 0
