"""Options of the learners that learn without trial: behaviour cloning and implicit Q-learning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from cutenv.learning.arguments import QUICKLY, BadArguments, LearnerArguments
from cutenv.learning.options import flag_of, option
from cutenv.policy import SCRIPTS


@dataclass(frozen=True, kw_only=True)
class BCArguments(LearnerArguments):
    """Options of behaviour cloning."""

    quick: ClassVar[Mapping[str, Any]] = {"demonstrations": 50_000, "epochs": 20, **QUICKLY}

    dataset: str = option(
        "", "id of a Minari data set to imitate, not a script; it sets decision rate and angle mode", metavar="ID"
    )
    demonstrations: int = option(400_000, "number of decisions of the script", (1, 10**9))
    epochs: int = option(60, "number of passes over the demonstrations", (1, 10**6))
    batch_size: int = option(1024, "number of decisions in a gradient step", (1, 10**9))
    learning_rate: float = option(2e-3, "learning rate at the start; falls along half a cosine to zero", (1e-9, 1.0))

    @classmethod
    def completed(cls, chosen: Mapping[str, Any], *, quick: bool = False) -> dict[str, Any]:
        """Return the options chosen for a new run, with what a data set determines.

        Raises
        ------
        BadArguments
            If there is no such data set, or an option contradicts it.
        """
        if not chosen.get("dataset"):
            return {**(cls.quick if quick else {}), **chosen}
        for name in ("demonstrations", "script", "demonstration_noise"):
            if name in chosen:
                raise BadArguments(f"{flag_of(name)} belongs to a script; leave it out with --dataset.")
        from cutenv.learning.minari_datasets import environment_of, opened

        try:
            dataset = opened(chosen["dataset"])
            implied = environment_of(dataset)
        except ValueError as error:
            raise BadArguments(f"--dataset: {error}") from None
        for name, value in implied.items():
            if chosen.get(name, value) != value:
                raise BadArguments(
                    f"{flag_of(name)} {chosen[name]} contradicts data set {dataset.id!r}, whose decisions "
                    f"were made with {value}; leave it out."
                )
        decisions = int(dataset.total_steps)
        told = {**implied, "script": "", "demonstration_noise": 0.0, "demonstrations": decisions}
        return {**(cls.quick if quick else {}), **chosen, **told}

    @property
    def teacher(self) -> str:
        """Name of what is imitated, for a sentence."""
        return f"data set {self.dataset!r}" if self.dataset else repr(self.script)


@dataclass(frozen=True, kw_only=True)
class IQLArguments(BCArguments):
    """Options of implicit Q-learning."""

    quick: ClassVar[Mapping[str, Any]] = {**BCArguments.quick, "epochs": 10}

    other_script: str = option("probe and creep", "script that makes half of the demonstrations", tuple(SCRIPTS))
    epochs: int = 40
    learning_rate: float = 1e-3
    gamma: float = option(1.0, "discount per decision", (0.0, 1.0))
    tau: float = option(0.005, "share of the critic that its target takes over at every gradient step", (1e-9, 1.0))
    expectile: float = option(0.7, "expectile of the actions' values that counts as a state's value", (0.5, 0.999))
    temperature: float = option(
        10.0, "exponent per unit of return with which better actions weigh more; 0: imitation", (0.0, 1e6)
    )

    @classmethod
    def completed(cls, chosen: Mapping[str, Any], *, quick: bool = False) -> dict[str, Any]:
        """Return the options chosen for a new run, with what a data set determines; see :class:`BCArguments`."""
        if not chosen.get("dataset"):
            return {**(cls.quick if quick else {}), **chosen}
        if "other_script" in chosen:
            raise BadArguments("--other-script belongs to a script; leave it out with --dataset.")
        return super().completed(chosen, quick=quick) | {"other_script": ""}

    @property
    def teacher(self) -> str:
        """Name of what is imitated, for a sentence."""
        return super().teacher if self.dataset else f"{self.script!r} and {self.other_script!r}"
