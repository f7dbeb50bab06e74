"""Protocol of the published benchmark: who takes part, on which specimens, with how much training.

Results of one version can be put beside each other; a change of any number here is a new version.
"""

from __future__ import annotations

import dataclasses
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutenv.atomic import replacing
from cutenv.learning.seeds import ENVIRONMENT, TEST_SEEDS, VALIDATION_SEEDS
from cutenv.policy import BOUND, IDLE, SCRIPTS
from cutenv.tissue.specimen import CLASSES

BEST_FEED = "best constant feed"
"""The constant feed that did best on validation specimens: of the 28, it alone takes part."""
REFERENCE = "PPO"
"""The agent that ablations are compared with."""


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """The numbers of the comparison.

    Attributes
    ----------
    version : str
        Of the protocol.
    environment : str
        Its id.
    training_class : str
        Of the specimens that agents are trained and that the headline is judged on.
    classes : tuple of str
        Classes of held-out specimens.
    training_seeds : tuple of int
        One training run for each; they have no specimens in common.
    training_minutes : float
        Of wall clock on one core for every training run, demonstrations among them; the clock does not stop those.
    demonstrations : int
        Decisions of a script that every agent is taught first.
    specimens : int
        Held-out ones of each class.
    first_specimen : int
        The first of them in ``TEST_SEEDS``: those before are what every run prints and what the reward was tried on.
    feed_specimens : int
        Validation specimens on which the best constant feed is chosen.
    sweep_specimens : int
        Held-out ones for every constant that is swept.
    resamples : int
        Of the bootstrap.
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
        """Of the held-out specimens of each class."""
        return TEST_SEEDS[self.first_specimen : self.first_specimen + self.specimens]


QUICK = Protocol(
    version="quick", classes=("mixed", "liver"), training_seeds=(0, 1), training_minutes=0.3, demonstrations=20_000,
    specimens=40,    feed_specimens=10, sweep_specimens=10, resamples=400,
)  # fmt: skip
"""A trial of the whole machinery, not a result."""


@dataclass(frozen=True)
class Entry:
    """A learned agent that takes part."""

    name: str
    learner: str
    """For ``cutenv train --learner``."""
    arguments: tuple[str, ...] = ()
    change: str = ""
    """What an ablation changes in :data:`REFERENCE`; empty for an agent in its own right."""


_FIXED = ("--angle-mode", "fixed")
_BY_CLOCK = ("--timesteps", "1000000000")  # no limit but the clock
_ENTRIES = (
    Entry(REFERENCE, "ppo", _BY_CLOCK),
    Entry("PPO, fixed angle", "ppo", (*_BY_CLOCK, *_FIXED), "the blade stays upright"),
    Entry("recurrent PPO", "recurrent-ppo", _BY_CLOCK),
    Entry("recurrent PPO, fixed angle", "recurrent-ppo", (*_BY_CLOCK, *_FIXED)),
    Entry("behaviour cloning", "bc"),
    Entry("behaviour cloning, fixed angle", "bc", _FIXED),
    Entry("PPO without force", "ppo", (*_BY_CLOCK, "--force", "unfelt"), "the force is not felt"),
    Entry("PPO with history", "ppo", (*_BY_CLOCK, "--history", "6"), "the six past decisions are seen besides"),
    Entry(
        "PPO, critic without truth", "ppo", (*_BY_CLOCK, "--critic", "features"), "the critic does not see the truth"
    ),
)
ENTRIES = {entry.name: entry for entry in _ENTRIES}
"""Every learned agent by name."""
SCRIPTED = (BEST_FEED, *SCRIPTS, BOUND, *IDLE)
"""Everything else: scripts, both planners, random and nothing."""


def slug(name: str) -> str:
    """A name as part of a file's."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")


def keep_protocol(folder: Path, protocol: Protocol) -> None:
    """Write the protocol beside its results; SystemExit where those of another are."""
    path, content = folder / "protocol.json", content_of(protocol)
    if path.is_file() and json.loads(path.read_text()) != content:
        raise SystemExit(f"{folder} holds results of another protocol (see {path}); give another --out.")
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(path) as part:
        part.write_text(json.dumps(content, indent=1) + "\n")


def kept_protocol(folder: Path) -> Protocol:
    """The protocol of results; SystemExit where there are none."""
    path = folder / "protocol.json"
    if not path.is_file():
        raise SystemExit(
            f"{folder} holds no protocol.json; run scripts/benchmark_agents.py first, or give its --out folder."
        )
    content: dict[str, Any] = json.loads(path.read_text())
    content.pop("entries")
    return Protocol(**{name: tuple(value) if isinstance(value, list) else value for name, value in content.items()})


def content_of(protocol: Protocol) -> dict[str, Any]:
    """What protocol.json holds: the numbers, and with which arguments every agent is trained."""
    entries = {entry.name: [f"{entry.learner.replace('-', '_')}.py", *entry.arguments] for entry in _ENTRIES}
    content: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(protocol) | {"entries": entries}))
    return content
