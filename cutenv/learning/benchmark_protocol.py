"""Protocol of the published benchmark: specimens and statistics by which every policy is compared.

Results of one version are comparable; a change of any number here is a new version.
"""

from __future__ import annotations

from dataclasses import dataclass

from cutenv.learning.seeds import ENVIRONMENT, TEST_SEEDS, VALIDATION_SEEDS
from cutenv.policy import SCRIPTS
from cutenv.tissue.specimen import CLASSES


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
    script : str
        Script from which differences are taken: the best of all by its mean return.
    most_seeds : int
        Largest number of training runs of one agent.
    training : tuple of str
        Options of ``cutenv train`` for every agent, before its own.
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

    version: str = "3"
    environment: str = ENVIRONMENT
    training_class: str = "mixed"
    classes: tuple[str, ...] = tuple(reversed(CLASSES))
    script: str = "return stroke"
    most_seeds: int = 10
    training: tuple[str, ...] = ()
    specimens: int = 1000
    first_specimen: int = 10_000
    feed_specimens: int = 200
    sweep_specimens: int = 200
    resamples: int = 2000

    def __post_init__(self) -> None:
        assert self.training_class in self.classes
        assert self.script in SCRIPTS
        assert 1 <= self.most_seeds
        assert 2 <= self.sweep_specimens <= self.specimens <= len(TEST_SEEDS) - self.first_specimen
        assert 2 <= self.feed_specimens <= len(VALIDATION_SEEDS)

    @property
    def test_seeds(self) -> range:
        """Seeds of the held-out specimens of each class."""
        return TEST_SEEDS[self.first_specimen : self.first_specimen + self.specimens]


QUICK = Protocol(
    version="quick", classes=("mixed", "liver"), most_seeds=2, specimens=40, feed_specimens=10, sweep_specimens=10,
    training=("--demonstrations", "20000", "--minutes", "0.3"), resamples=400,
)  # fmt: skip
"""Protocol of a test of the whole program; it gives no result."""
