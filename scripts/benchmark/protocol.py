"""Protocol of the published benchmark: who takes part, on which specimens, with how much training.

Results of one version are comparable; a change of any number here is a new version.
"""

from __future__ import annotations

import dataclasses
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutenv._base.atomic_file import atomic_write
from cutenv.learning.seeds import ENVIRONMENT, TEST_SEEDS, VALIDATION_SEEDS
from cutenv.policy import NULL_POLICIES, ORACLE, SCRIPTS
from cutenv.tissue.specimen import CLASSES

BEST_FEED = "best constant feed"
"""Name of the constant feed that is best on validation specimens: the only one of the 28 that takes part."""
REFERENCE = "PPO"
"""Name of the agent that ablations are compared with."""


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """The numbers of the comparison.

    Attributes
    ----------
    version : str
        Version of the protocol.
    environment : str
        Id of the environment.
    training_class : str
        Class of the specimens on which agents are trained and the headline is evaluated.
    classes : tuple of str
        Classes of held-out specimens.
    training_seeds : tuple of int
        Seeds of the training runs, one each; they have no specimens in common.
    training_minutes : float
        Wall-clock time on one core for every training run, demonstrations included; these are not cut short.
    demonstrations : int
        Number of decisions of a script for pre-training every agent.
    specimens : int
        Number of held-out specimens of each class.
    first_specimen : int
        Index of the first of them in ``TEST_SEEDS``; earlier ones serve for the reports of runs and the design of the
        reward.
    feed_specimens : int
        Number of validation specimens on which the best constant feed is chosen.
    sweep_specimens : int
        Number of held-out specimens for every constant that is swept.
    resamples : int
        Number of bootstrap resamples.
    """

    version: str = "2"
    environment: str = ENVIRONMENT
    training_class: str = "mixed"
    classes: tuple[str, ...] = tuple(reversed(CLASSES))
    training_seeds: tuple[int, ...] = (0, 1, 2)
    training_minutes: float = 4.5
    demonstrations: int = 200_000
    specimens: int = 1000
    first_specimen: int = 10_000
    feed_specimens: int = 200
    sweep_specimens: int = 200
    resamples: int = 2000

    def __post_init__(self) -> None:
        assert self.training_class in self.classes
        assert len(set(self.training_seeds)) == len(self.training_seeds)
        assert 2 <= self.sweep_specimens <= self.specimens <= len(TEST_SEEDS) - self.first_specimen
        assert 2 <= self.feed_specimens <= len(VALIDATION_SEEDS)

    @property
    def test_seeds(self) -> range:
        """Seeds of the held-out specimens of each class."""
        return TEST_SEEDS[self.first_specimen : self.first_specimen + self.specimens]


QUICK = Protocol(
    version="quick", classes=("mixed", "liver"), training_seeds=(0, 1), training_minutes=0.3, demonstrations=20_000,
    specimens=40, feed_specimens=10, sweep_specimens=10, resamples=400,
)  # fmt: skip
"""Protocol of a test of the whole program; it gives no result."""


@dataclass(frozen=True)
class Entry:
    """A learned agent that takes part."""

    name: str
    learner: str
    """Value of ``cutenv train --learner``."""
    arguments: tuple[str, ...] = ()
    change: str = ""
    """Change of an ablation from :data:`REFERENCE`; empty for other agents."""


_FIXED = ("--angle-mode", "fixed")
_BY_CLOCK = ("--timesteps", "1000000000")  # no limit but the clock
_ENTRIES = (
    Entry(REFERENCE, "ppo", _BY_CLOCK),
    Entry("PPO (fixed angle)", "ppo", (*_BY_CLOCK, *_FIXED), "the blade stays upright"),
    Entry("recurrent PPO", "recurrent-ppo", _BY_CLOCK),
    Entry("recurrent PPO (fixed angle)", "recurrent-ppo", (*_BY_CLOCK, *_FIXED)),
    Entry("behaviour cloning", "bc"),
    Entry("behaviour cloning (fixed angle)", "bc", _FIXED),
    Entry("PPO without force", "ppo", (*_BY_CLOCK, "--force", "unfelt"), "the force is not felt"),
    Entry("PPO with history", "ppo", (*_BY_CLOCK, "--history", "6"), "the six past decisions are seen besides"),
    Entry(
        "PPO (critic without truth)", "ppo", (*_BY_CLOCK, "--critic", "features"), "the critic does not see the truth"
    ),
)
ENTRIES = {entry.name: entry for entry in _ENTRIES}
"""All learned agents by name."""
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
            f"{folder} contains no protocol.json; run scripts/benchmark_agents.py first, or give its --out folder."
        )
    content: dict[str, Any] = json.loads(path.read_text())
    content.pop("entries")
    return Protocol(**{name: tuple(value) if isinstance(value, list) else value for name, value in content.items()})


def content_of(protocol: Protocol) -> dict[str, Any]:
    """Return the content of protocol.json: the numbers, and the arguments with which every agent is trained."""
    entries = {entry.name: [f"{entry.learner.replace('-', '_')}.py", *entry.arguments] for entry in _ENTRIES}
    content: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(protocol) | {"entries": entries}))
    return content
