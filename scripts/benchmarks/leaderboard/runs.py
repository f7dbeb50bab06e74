"""Runs of a benchmark: training of every agent, cuts of held-out specimens, sweeps of constants, kept on disk."""

from __future__ import annotations

import datetime
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from cutenv._base.resources import git
from cutenv.agents.learning.benchmark import SCRATCH, Protocol, returns_after, training_kind
from cutenv.agents.learning.evaluation import Contestant, contestant, evaluate
from cutenv.agents.learning.run_folder import checkpoint_of, marked
from cutenv.agents.learning.seeds import VALIDATION_SEEDS
from cutenv.agents.learning.statistics import best_script, read_rows, rows_of, summarise, write_csv
from cutenv.agents.policy import BASELINES, CONSTANT_FEEDS, NULL_POLICIES, ORACLE
from cutenv.commands.train import LEARNERS, training_options
from scripts.benchmarks.leaderboard.aggregate import disagreements, read_summary
from scripts.benchmarks.leaderboard.kept_cuts import file_of, write_run
from scripts.benchmarks.leaderboard.protocol import BEST_FEED, ENTRIES, SCRIPTED, Entry, slug
from scripts.benchmarks.leaderboard.robustness import settings

SWEPT = ("PPO", "PPO (random rigs)", "recurrent PPO", "return stroke", "probe and creep", BEST_FEED)
OFFLINE = tuple(LEARNERS[name][0] for name in ("bc", "iql"))  # names of agents that learn from demonstrations alone
AUTHOR = "cutenv"  # author of all that is not submitted
_CORE_SECONDS = {ORACLE: 0.15}  # time of one cut, on the machine of docs/results/speed.md [core s]; for the others:
_CORE_SECONDS_ELSE = 0.004
_TRAINING_S = {"ppo": 240.0, "recurrent-ppo": 900.0, "bc": 150.0}
"""Time of a training with the defaults of its learner [core s]; for the others:"""
_TRAINING_S_ELSE = 900.0
_FREE = ("name", "specimens", "checkpoint_seconds", "tensorboard")  # options that do not change what is learned


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

    Participants are all, or ``only`` some; ``runs`` holds the training runs, of which each agent makes the first
    ``seeds``.
    """

    def __init__(
        self,
        folder: Path,
        protocol: Protocol,
        only: Sequence[str],
        processes: int,
        runs: Path | None = None,
        seeds: int | None = None,
    ) -> None:
        self.folder, self.protocol, self.processes = folder, protocol, processes
        self.runs = folder / "runs" if runs is None else runs
        self._first = slice(seeds)
        self.names = [name for name in (*ENTRIES, *SCRIPTED) if not only or name in only]

    def parts(self) -> list[Part]:
        """Return all participants."""
        return [Part(name, seed) for name in self.names for seed in self._seeds(name)]

    def _seeds(self, name: str) -> Sequence[int | None]:
        return ENTRIES[name].training_seeds(self.protocol)[self._first] if name in ENTRIES else (None,)

    def run_of(self, part: Part) -> Path:
        """Return the folder of a training run."""
        return self.runs / part.slug

    def uncut(self) -> list[Part]:
        """Return the participants that remain to be evaluated."""
        return [part for part in self.parts() if not file_of(self.folder, part.contestant, part.seed).is_file()]

    def untrained(self) -> list[Part]:
        """Return the runs that remain to be trained: those whose cuts are kept need no training."""
        return [part for part in self.uncut() if part.seed is not None and not self.is_trained(part)]

    def is_trained(self, part: Part) -> bool:
        """Return True if a run is finished, with the options of the protocol; SystemExit if with others."""
        facts = self.run_of(part) / "run.json"
        if not facts.is_file():
            return False
        content = json.loads(facts.read_text())
        if "training_minutes" not in content or not (facts.parent / "policy" / "card.json").is_file():
            return False
        assert part.seed is not None
        entry = ENTRIES[part.contestant]
        options = training_options(entry.learner, self.training_arguments(entry, part))
        wanted = json.loads(json.dumps(asdict(options)))
        used = {field.name: field.default for field in fields(options)} | content["arguments"]  # some came later
        for name, value in wanted.items():
            if name not in _FREE and used[name] != value:
                raise SystemExit(
                    f"{facts.parent} was trained with {name} {used[name]!r}; the protocol wants "
                    f"{value!r}. Move it elsewhere."
                )
        return bool(content["agent"] == LEARNERS[entry.learner][0])

    def swept(self) -> list[Part]:
        """Return the participants that are evaluated with other constants, and whose policy is here."""
        return [
            part for part in self.parts() if part.contestant in SWEPT and (part.seed is None or self.is_trained(part))
        ]

    def unswept(self) -> list[Any]:
        """Return the remaining settings, each with its file."""
        files = ((setting, self.folder / "sweeps" / f"{setting.name}.csv") for setting in settings())
        wanted = {part.label for part in self.swept()}
        return [(setting, path) for setting, path in files if wanted - {row["policy"] for row in rows_of(path)}]

    def plan(self) -> float:
        """Print the remaining work; return its estimated duration [s]."""
        p = self.protocol
        untrained, uncut = self.untrained(), self.uncut()
        quick = 20.0 if p.training else None  # short trainings, most of it to load and to compile
        training = sum(
            quick or _TRAINING_S.get(ENTRIES[part.contestant].learner, _TRAINING_S_ELSE) for part in untrained
        )
        cuts = p.specimens * len(p.classes)
        cutting = sum(_CORE_SECONDS.get(part.contestant, _CORE_SECONDS_ELSE) for part in uncut) * cuts
        to_sweep = [part for part in self.parts() if part.contestant in SWEPT]
        sweeping = len(self.unswept()) * len(to_sweep) * p.sweep_specimens * _CORE_SECONDS_ELSE
        feeds = 0 if self.feeds.is_file() or not uncut else len(CONSTANT_FEEDS) * p.feed_specimens
        stages = {
            f"train {len(untrained)} agents": training / self.processes,
            f"choose the best of {len(CONSTANT_FEEDS)} constant feeds": feeds * _CORE_SECONDS_ELSE / self.processes,
            f"cut {len(uncut) * cuts} specimens": cutting / self.processes,
            f"sweep {len(self.unswept())} settings of constants": sweeping / self.processes,
            "statistics": 6.0 * len(self.names) * p.resamples / 2000,
        }
        print(f"protocol {p.version}, {self.processes} processes; remaining work and its duration:")
        for name, seconds in stages.items():
            print(f"  {name:45s} {seconds / 60.0:6.1f} min")
        total = sum(stages.values())
        print(f"  {'together':45s} {total / 60.0:6.1f} min", flush=True)
        return total

    def train(self) -> Iterator[Part]:
        """Train the remaining agents, on one core each; yield each when it is done."""
        left = self.untrained()
        with ThreadPoolExecutor(self.processes) as pool:
            for number, part in enumerate(pool.map(self._train, left), 1):
                print(f"trained {part.label} ({number} of {len(left)})", flush=True)
                yield part

    def _train(self, part: Part) -> Part:
        entry, run = ENTRIES[part.contestant], self.run_of(part)
        self.runs.mkdir(parents=True, exist_ok=True)
        if run.exists() and checkpoint_of(run) is None:
            shutil.rmtree(run)  # interrupted before the first checkpoint
        command = ["--resume", str(Path("runs") / part.slug)] if run.exists() else self.training_arguments(entry, part)
        with (self.runs / f"{part.slug}.log").open("a") as log:
            done = subprocess.run(
                [sys.executable, "-m", "cutenv", "train", "--learner", entry.learner, *command],
                cwd=self.runs.parent, stdout=log, stderr=log, check=False,
                env=os.environ | {"CUTENV_CORES": "1", "OMP_NUM_THREADS": "1"},
            )  # fmt: skip
        if done.returncode or not self.is_trained(part):
            raise SystemExit(f"training {part.label} failed; see {log.name}.")
        return part

    def training_arguments(self, entry: Entry, part: Part) -> list[str]:
        """Return the options of ``cutenv train`` for a new run."""
        own = ["--name", part.slug, "--seed", str(part.seed), "--specimens", "0"]
        return [*own, "--specimen-class", self.protocol.training_class, *self.protocol.training, *entry.arguments]

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

    def cut(self, parts: Sequence[Part], pool: Executor) -> None:
        """Evaluate participants on every class of specimens."""
        p = self.protocol
        for part in parts:
            rows = {
                kind: evaluate(
                    {part.label: self.entrant(part, pool)}, p.test_seeds, {"specimen_class": kind}, pool=pool,
                    description=f"{part.label}, {kind}",
                )
                for kind in p.classes
            }  # fmt: skip
            write_run(self.folder, self.facts(part), rows, p.training_class)

    def facts(self, part: Part) -> dict[str, Any]:
        """Return what is told of a participant beside its cuts."""
        own: dict[str, Any] = {"contestant": part.contestant, "training_seed": part.seed, "author": AUTHOR}
        own["date"] = datetime.date.fromtimestamp(time.time()).isoformat()
        if part.seed is None:
            changed = bool(git("status", "--porcelain", "--untracked-files=no"))
            return own | {"code": _short({"commit": git("rev-parse", "HEAD"), "uncommitted_changes": changed})}
        run = json.loads((self.run_of(part) / "run.json").read_text())
        curve = read_rows(self.run_of(part) / "learning_curve.csv")
        tried = 0.0 if run["agent"] in OFFLINE or not curve else curve[-1]["decisions"]
        return own | {
            "code": _short(run),
            "training_minutes": run["training_minutes"],
            "training_decisions": run["arguments"]["demonstrations"] + tried,
            "returns_after_cuts": returns_after(curve),
            "kept_its_start": run["agent"] not in OFFLINE and self._kept_its_start(part, run["arguments"]),
        }

    def _kept_its_start(self, part: Part, options: Mapping[str, Any]) -> bool:
        """Return True if validation kept an actor that had not yet begun to learn by trial, as Progress lets it."""
        card = json.loads((self.run_of(part) / "policy" / "card.json").read_text())
        held = 0.0 if training_kind(options) == SCRATCH else options["critic_first"] * options["timesteps"]
        return bool(card["training"]["decisions"] <= held)

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


def _short(facts: dict[str, Any]) -> str:
    """Return the commit of a run in few letters, with a mark if there were uncommitted changes."""
    commit, mark, _ = marked(facts).partition("+")
    return f"{commit[:9]}{mark and '+changes'}"


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
