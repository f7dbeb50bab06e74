"""Options of the learners that learn from all trials so far: SAC, TQC and CrossQ."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from cutenv.learning.arguments import QUICKLY, BadArguments, TrialArguments, actor_critic_inputs
from cutenv.learning.options import option

_ENTROPY_WEIGHT = re.compile(r"(auto_)?\d*\.?\d+(e-?\d+)?")


@dataclass(frozen=True, kw_only=True)
class OffPolicyArguments(TrialArguments):
    """Options that SAC, TQC and CrossQ share."""

    quick: ClassVar[Mapping[str, Any]] = {"timesteps": 30_000, "demonstrations": 50_000, **QUICKLY}

    timesteps: int = 100_000
    environments: int = 100
    batch_size: int = 256
    learning_rate: float = 3e-4
    averaging: float = 0.05
    critic_first: float = 0.5
    train_freq: int = option(10, "number of decisions of each environment between updates", (1, 10**6))
    gradient_steps: int = option(100, "number of gradient steps of an update", (1, 10**6))
    buffer_size: int = option(1_000_000, "number of decisions that are kept, demonstrations included", (1, 10**9))
    n_steps: int = option(10, "number of decisions whose rewards are summed before the critic's value", (1, 1000))
    critic_hidden: int = option(128, "number of units in each layer of the critics", (1, 4096))
    ent_coef: str = option("auto_0.001", "weight of the entropy: a number, or auto_ and the number to begin with")
    target_entropy: float = option(-4.0, "entropy of the two actions that an automatic weight keeps", (-100.0, 2.0))

    def __post_init__(self) -> None:
        super().__post_init__()
        if not _ENTROPY_WEIGHT.fullmatch(self.ent_coef):
            raise BadArguments(f"--ent-coef {self.ent_coef!r} is neither a number nor auto_NUMBER; give 0.001, say")
        if self.buffer_size < self.demonstrations:
            raise BadArguments(
                f"--buffer-size {self.buffer_size} does not hold the {self.demonstrations} demonstrations; "
                "give more, or fewer --demonstrations"
            )

    @property
    def sizes(self) -> dict[str, int]:
        """Input sizes of actor and critic: keyword arguments of :mod:`cutenv.learning.asymmetric_actors`."""
        return actor_critic_inputs(self.learned_task, self.history, self.critic)


@dataclass(frozen=True, kw_only=True)
class SACArguments(OffPolicyArguments):
    """Options of SAC."""

    tau: float = option(0.02, "share of the critic that its target takes over at every gradient step", (1e-9, 1.0))


@dataclass(frozen=True, kw_only=True)
class TQCArguments(SACArguments):
    """Options of TQC."""

    top_quantiles_to_drop_per_net: int = option(2, "number of highest quantiles that each critic leaves out", (0, 24))


@dataclass(frozen=True, kw_only=True)
class CrossQArguments(OffPolicyArguments):
    """Options of CrossQ."""

    policy_delay: int = option(3, "number of gradient steps of the critic for one of the actor", (1, 10**6))
