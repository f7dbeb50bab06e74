"""Who takes part in the published benchmark, and with how much training; its specimens are those of the package."""

from __future__ import annotations

import dataclasses
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutenv._base.output import atomic_write
from cutenv.agents.learning.benchmark import Protocol, training_kind
from cutenv.agents.policy import NULL_POLICIES, ORACLE, SCRIPTS
from cutenv.commands.train import training_options

BEST_FEED = "best constant feed"
"""Name of the constant feed that is best on validation specimens: the only one of the 28 that takes part."""
REFERENCE = "PPO"  # name of the agent that ablations are compared with
FEWEST_SEEDS = 5  # number of training runs below which a row is marked


@dataclass(frozen=True)
class Entry:
    """A learned agent that takes part, trained with the defaults of ``cutenv train``."""

    name: str
    learner: str  # value of 'cutenv train --learner'
    arguments: tuple[str, ...] = ()
    change: str = ""  # change of an ablation from REFERENCE; empty for other agents
    seeds: int = FEWEST_SEEDS  # number of training runs

    def training_seeds(self, protocol: Protocol) -> range:
        """Return the seeds of the training runs; they have no specimens in common."""
        return range(min(self.seeds, protocol.most_seeds))

    @property
    def kind(self) -> str:
        """Kind of the agent, by the options with which every run of it is trained."""
        return training_kind(dataclasses.asdict(training_options(self.learner, self.arguments)))


_ENTRIES = (
    Entry(REFERENCE, "ppo", seeds=10),
    Entry("recurrent PPO", "recurrent-ppo"),
    Entry("behaviour cloning", "bc"),
    Entry("SAC", "sac"),
    Entry("TQC", "tqc"),
    Entry("CrossQ", "crossq"),
    Entry("IQL", "iql"),
    Entry("PPO (fixed angle)", "ppo", ("--angle-mode", "fixed"), "the blade stays upright"),
    Entry("PPO without force", "ppo", ("--force", "unfelt"), "the force is not felt"),
    Entry("PPO (random rigs)", "ppo", ("--rigs", "20"), "drive, sensor and error of depth are drawn at random"),
    Entry("PPO (critic without truth)", "ppo", ("--critic", "features"), "the critic does not see the truth"),
)
ENTRIES = {entry.name: entry for entry in _ENTRIES}  # all learned agents by name
SCRIPTED = (BEST_FEED, *SCRIPTS, ORACLE, *NULL_POLICIES)
"""Names of all others: scripts, both planners, random and nothing."""


def slug(name: str) -> str:
    """Return a name as part of a file name."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")


def keep_protocol(folder: Path, protocol: Protocol) -> None:
    """Write the protocol beside its results; SystemExit if there are results of another."""
    path, content = folder / "protocol.json", content_of(protocol)
    if path.is_file() and json.loads(path.read_text()) != content:
        raise SystemExit(f"{folder} contains results of another protocol (see {path}); give another --out.")
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as part:
        part.write_text(json.dumps(content, indent=1) + "\n")


def kept_protocol(folder: Path) -> Protocol:
    """Return the protocol of results; SystemExit if there are none."""
    path = folder / "protocol.json"
    if not path.is_file():
        raise SystemExit(
            f"{folder} contains no protocol.json; run scripts/benchmarks/leaderboard/benchmark_agents.py "
            "first, or give its --out folder."
        )
    content: dict[str, Any] = json.loads(path.read_text())
    return Protocol(**{name: tuple(value) if isinstance(value, list) else value for name, value in content.items()})


def content_of(protocol: Protocol) -> dict[str, Any]:
    """Return the content of protocol.json."""
    return json.loads(json.dumps(dataclasses.asdict(protocol)))
