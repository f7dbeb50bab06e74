"""Sequential comparison of two policies on a rig, by pairs.

Every cut is kept at once, and the rest can follow any day. The two cuts of a pair are made in a random order, from a
seed that is kept. An emulated rig lays the same for both. A lab cuts side by side in one liver (``apart``):
the coin then says which policy gets which place, and where the cuts have a measured opening, what the twins of the two
places foretell corrects the difference.

A measured opening is the same feed at the start of every cut. Which policy takes over after it is drawn by a coin and
has no part in it. What a twin that is fitted to the opening alone foretells is therefore as independent of the coin as
the tissue is: it can serve as a covariate of a randomised comparison (:mod:`cutenv.records.scoring.study.sequential`),
whether the twin is right or wrong.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices
from cutenv._base.output import atomic_write
from cutenv._base.validation import in_range
from cutenv.agents.policy import ConstantFeed, Policy
from cutenv.agents.policy.interface import POSITION_COLUMN, ArrayPolicy, as_array_policy, choose, in_si
from cutenv.agents.sim_to_real.measures import ComparedCut
from cutenv.agents.sim_to_real.paired_experiment import DRAWS, cut_again, cut_once
from cutenv.agents.sim_to_real.specimen_twin import fit_twin
from cutenv.display.report.decision_page import ComparedOutcome, DecisionReport
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.records.scoring.study.sequential import (
    RETURN_FLOOR,
    RETURN_TOP,
    SequentialQuestion,
    corrected,
    sequential_decisions,
)
from cutenv.rig.errors import RigError
from cutenv.sim.tissue.description import measured_liver
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.trace import Trace
from cutenv.task.reward import STOPPED

OPENING_SPEED = 0.0127  # speed of the opening [m/s]: half of the fastest measured
_MIN_TARGET, _MAX_TARGET = 0.020, 0.050
"""Range of its length [m]: below, little is told of the tissue; above, little is left to the policy."""


class OpenedPolicy(ArrayPolicy):
    """A policy that takes over from a constant feed, and looks on until then.

    It does so where the blade is at ``length`` [m]; the opening's angle is in radians.
    """

    def __init__(self, policy: Policy, length: float, angle: float) -> None:
        self._policy = as_array_policy(policy)
        self._feed = ConstantFeed(speed=OPENING_SPEED, angle=angle)
        self._length = in_range("length", length, _MIN_TARGET, _MAX_TARGET, "m", "Give 25 mm.")

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Begin the opening of ``len(rngs)`` cuts."""
        self._opening = np.ones(len(rngs), bool)
        self._policy.begin(rngs)
        self._feed.begin(rngs)

    def forget(self, cuts: Indices) -> None:
        """Begin the opening of those cuts again."""
        self._opening[cuts] = True
        self._policy.forget(cuts)
        self._feed.forget(cuts)

    def act(self, observations: Array32) -> Array32:
        """Return the feed's action before each handover, then the policy's."""
        self._opening &= in_si(observations)[:, POSITION_COLUMN] < self._length
        return choose(self._opening, self._feed.act(observations), self._policy.act(observations))


def opening_of(trace: Trace, length: float) -> Trace:
    """Return the record before the blade first reaches ``length`` [m].

    Raises ValueError if it never comes there: the cut ended in its opening.
    """
    (position,) = trace.require("position", by="opening_of")
    if not bool((position >= length).any()):
        raise ValueError(f"the blade went {1e3 * float(position.max()):.1f} mm of an opening of {1e3 * length:g} mm.")
    return trace.select(slice(0, int(np.argmax(position >= length))))


def specimens_like(
    env: GentleCutEnv, opening: Trace, *, depth: Array, seed: int, episode: int, draws: int
) -> list[Specimen]:
    """Return specimens like an opening's twin, with varied tissue beyond.

    ``depth``, (301,), is that along the cut, as measured beforehand [m]; seed and episode are the key of what the twin
    does not know.

    Raises ValueError if the opening is too short for a twin.
    """
    sensor = env.constants.sensor
    twin = fit_twin(
        opening, env.tissue.tissue or measured_liver(), law=env.constants.law, force_delay=sensor.force_delay, share=1.0
    )
    rng = np.random.default_rng([seed, episode])
    return [twin.drawn(rng, depth) for _ in range(draws)]


def forecast(
    env: GentleCutEnv,
    policies: Sequence[Policy],
    specimens: Sequence[Specimen],
    *,
    depth: Array,
    target_length: float,
    seed: int,
    episode: int,
    value: Callable[[ComparedCut], Array],
) -> Array:
    """Return policies' mean results, (policies, n), with varied noise.

    The policies have the opening, the specimens are by :func:`specimens_like`, with lengths in metres; seed and episode
    are the key of the noise; ``value`` gives the outcomes of a cut, (n,).
    """
    key: dict[str, Any] = {"seed": seed, "episode": episode, "target_length": target_length, "depth": depth}

    def mean(policy: Policy) -> Array:
        cuts = [
            cut_once(env, policy, noise=draw + 1, specimen=specimen, **key) for draw, specimen in enumerate(specimens)
        ]
        found: Array = np.mean([value(cut) for cut in cuts], axis=0)
        return found

    return np.array([mean(policy) for policy in policies])


OUTCOMES = ("return", "success")  # outcomes of a cut, in the order of arrays
_CUTS, _STUDY = "cuts.jsonl", "study.json"


class KeptCuts:
    """Cuts of a comparison in a folder.

    A line of JSON for each, on the disk before the next begins.  ``study`` is what was asked, as JSON has it; who comes
    back to a folder must ask the same.

    Raises ValueError if the folder is that of another comparison; the message names what differs.
    """

    def __init__(self, folder: Path, study: Mapping[str, Any]) -> None:
        self._path, kept = folder / _CUTS, folder / _STUDY
        if kept.is_file():
            before = json.loads(kept.read_text(encoding="utf-8"))
            for name in dict.fromkeys([*before, *study]):
                if before.get(name) != study.get(name):
                    raise ValueError(
                        f"--out {folder} holds a comparison with {name} = {before.get(name)!r}, and {study.get(name)!r}"
                        " was asked for. Ask the same to go on, or give another folder."
                    )
        elif any(folder.iterdir()):
            raise FileExistsError(f"--out {folder} is there already and not empty; give another folder.")
        else:
            with atomic_write(kept) as part:
                part.write_text(json.dumps(study, indent=1) + "\n", encoding="utf-8")
        self.cuts: list[dict[str, Any]] = []  # cuts, and lines that tell of missing ones
        if self._path.is_file():
            whole = self._path.read_bytes()
            end = whole.rfind(b"\n") + 1  # what follows was being written when the power failed
            self.cuts = [json.loads(line) for line in whole[:end].splitlines()]
            os.truncate(self._path, end)

    def add(self, cut: Mapping[str, Any]) -> None:
        """Keep one cut."""
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(cut) + "\n")
            file.flush()
            os.fsync(file.fileno())
        self.cuts.append(dict(cut))

    def of(self, pair: int) -> dict[int, dict[str, Any]]:
        """Return the cuts of a pair by turn."""
        return {cut["turn"]: cut for cut in self.cuts if cut["pair"] == pair and "missing" not in cut}

    @property
    def missing(self) -> dict[int, str]:
        """Reasons for pairs that could not be completed."""
        return {cut["pair"]: cut["missing"] for cut in self.cuts if "missing" in cut}

    @property
    def open_pair(self) -> int | None:
        """Pair with only one cut so far, or None."""
        pairs = {cut["pair"] for cut in self.cuts} - {*self.missing}
        return next((pair for pair in sorted(pairs) if len(self.of(pair)) == 1), None)

    def whole(self) -> list[tuple[dict[str, Any], dict[str, Any]]]:
        """Return whole pairs in order: first policy's cut, second's."""
        pairs = sorted({cut["pair"] for cut in self.cuts} - {*self.missing})
        found = [sorted(self.of(pair).values(), key=lambda cut: int(cut["policy"])) for pair in pairs]
        return [(both[0], both[1]) for both in found if len(both) == 2]


@dataclass(frozen=True, kw_only=True, eq=False)
class RigComparison:
    """Comparison of two policies on a rig until decided."""

    rig: RigCutEnv  # environments; see :func:`cutenv.agents.sim_to_real.paired_experiment.simulator_like`
    simulator: GentleCutEnv
    policies: tuple[Policy, Policy]  # the first and the second
    names: tuple[str, str]
    question: SequentialQuestion  # what is asked of the difference of returns, each clipped between 0 and 1
    seed: int = 0  # seed of specimens, lengths and the order of the policies
    apart: bool = False  # whether a pair's cuts are side by side, in two places; else in the same drawn specimen
    opening: float | None = None  # length of the measured opening [m]; None: there is none
    draws: int = DRAWS  # simulated cuts of each twin by each policy
    between: list[str] = field(default_factory=list)  # notes on cuts that were repeated

    def __post_init__(self) -> None:
        if self.opening is not None:
            if not self.apart:
                raise ValueError(
                    "--opening is for cuts side by side in a liver, whose places differ; in the same drawn specimen "
                    "nothing differs. Give --unknown, or leave it out."
                )
            if self.rig.needs_axis:
                raise ValueError("--opening needs twins, which tasks with a third axis lack. Leave it out.")
            opened = tuple(OpenedPolicy(one, self.opening, self.rig.start_angle) for one in self.policies)
            object.__setattr__(self, "policies", opened)

    def outcomes(self, cut: ComparedCut) -> Array:
        """Return the clipped return, and success."""
        return np.array([np.clip(cut.value, RETURN_FLOOR, RETURN_TOP), float(cut.success)])

    def order(self, pair: int) -> tuple[int, int]:
        """Return which policy cuts first and which second."""
        first = int(np.random.default_rng([self.seed, pair]).integers(2))
        return first, 1 - first

    def length(self, pair: int) -> float:
        """Return the length of both cuts of a pair [m]."""
        tissue = self.rig.tissue.tissue or measured_liver()
        return self.rig.target_length or self.rig.options.drawn_length(tissue, self.seed, pair)

    def episode(self, pair: int, turn: int) -> int:
        """Return the number of the specimen that is laid."""
        return 2 * pair + turn if self.apart else pair

    def run(self, kept: KeptCuts, progress: Callable[[int], object] = lambda pairs: None) -> None:
        """Cut until it is decided, or ``question.most`` pairs are made.

        Goes on where the kept cuts end.

        Raises RigError if the rig cannot go on; every cut so far is kept.
        """
        pair = 0
        while len(whole := kept.whole()) < self.question.most:
            found, room = self.differences(kept)
            if whole and sequential_decisions(found[0], self.question, room[0])[-1]:
                return
            while pair in kept.missing or len(kept.of(pair)) == 2:
                pair += 1
            order = self.order(pair)
            for turn in sorted({0, 1} - {*kept.of(pair)}):
                kept.add({"pair": pair, "turn": turn, "policy": order[turn], **self._cut(pair, turn, order[turn])})
            progress(1)

    def _cut(self, pair: int, turn: int, policy: int) -> dict[str, Any]:
        episode, length = self.episode(pair, turn), self.length(pair)
        cut = cut_again(
            self.rig, self.policies[policy], self.between, seed=self.seed, episode=episode, target_length=length
        )
        if cut is None:
            why = self.between[-1].rstrip(".")
            raise RigError(f"{why}. The cuts so far are kept; give the same command again to go on.")
        value, success = self.outcomes(cut)
        return {
            "specimen": episode,
            "day": date.today().isoformat(),
            "target_length_mm": 1e3 * length,
            "end": cut.end,
            "stopped": cut.end == STOPPED,
            "return": cut.value,
            "clipped": float(value),
            "success": float(success),
            "foretold": self._foretold(cut, episode, length),
        }

    def _foretold(self, cut: ComparedCut, episode: int, length: float) -> list[float] | None:
        """Return the twin's mean forecast of either policy, or None."""
        if self.opening is None:
            return None
        key: dict[str, Any] = {"depth": np.array(self.rig.cutting.plant.depth), "seed": self.seed, "episode": episode}
        try:
            opening = opening_of(cut.trace, self.opening)
            specimens = specimens_like(self.simulator, opening, draws=self.draws, **key)
        except ValueError as error:
            self.between.append(f"specimen {episode + 1} has no twin: {error}")
            return None
        found = forecast(self.simulator, self.policies, specimens, target_length=length, value=self.outcomes, **key)
        return [float(each) for each in found.mean(axis=0)]

    def differences(self, kept: KeptCuts, *, correct: bool = True) -> tuple[Array, Array]:
        """Return pairs' differences of return and success, and room, (2, n)."""
        pairs = kept.whole()
        raw = np.array([[a["clipped"] - b["clipped"], a["success"] - b["success"]] for a, b in pairs]).reshape(-1, 2).T
        if self.opening is None or not correct:
            return raw, np.zeros_like(raw)
        covariates = [
            np.zeros(2) if None in (a["foretold"], b["foretold"]) else np.subtract(a["foretold"], b["foretold"])
            for a, b in pairs
        ]
        return corrected(raw, np.array(covariates).reshape(-1, 2).T)

    def report(self, kept: KeptCuts) -> DecisionReport:
        """Return the report of the kept cuts."""
        (found, room), (raw, _) = self.differences(kept), self.differences(kept, correct=False)
        pairs, notes = kept.whole(), list(self.between)
        notes.append(f"a return below {RETURN_FLOOR:g} counts as {RETURN_FLOOR:g}")
        stopped = [sum(pair[k]["stopped"] for pair in pairs) for k in (0, 1)]
        notes.append(
            f"stops for safety, which count with their return and as no success: {stopped[0]} by {self.names[0]}, "
            f"{stopped[1]} by {self.names[1]}"
        )
        days = sorted({cut["day"] for pair in pairs for cut in pair})
        if len(days) > 1:
            means = [(day, [k for k, pair in enumerate(pairs) if pair[0]["day"] == day]) for day in days]
            notes.append(
                "difference of return by day: "
                + ", ".join(f"{day} {raw[0, which].mean():+.3f} ({len(which)} pairs)" for day, which in means if which)
            )
        notes += [f"pair {pair + 1} is missing: {reason}" for pair, reason in kept.missing.items()]
        if (still := kept.open_pair) is not None:
            notes.append(f"pair {still + 1} has one cut alone, which does not count yet")
        if self.opening is not None and len(pairs) > 1 and raw[0].var() > 0.0:
            notes.append(
                f"both policies take over after an opening of {1e3 * self.opening:g} mm; the twins of its records "
                f"remove {100.0 * (1.0 - found[0].var() / raw[0].var()):.0f} % of the variance of the return's "
                "difference"
            )
        return DecisionReport(
            first=self.names[0],
            second=self.names[1],
            outcomes=[
                ComparedOutcome(name=name, differences=found[k], question=self.question, room=room[k])
                for k, name in enumerate(OUTCOMES)
            ],
            rows=[self._row(a, b, found[:, n]) for n, (a, b) in enumerate(pairs)],
            notes=notes,
        )

    def _row(self, first: Mapping[str, Any], second: Mapping[str, Any], counted: Array) -> dict[str, Any]:
        row: dict[str, Any] = {"pair": first["pair"] + 1, "policy_first": self.names[int(first["turn"] > 0)]}
        for side, cut in (("first", first), ("second", second)):
            row |= {f"{side}_{name}": cut[name] for name in ("day", "specimen", "end", "return", "success")}
            row |= {f"{side}_foretold": None if cut["foretold"] is None else cut["foretold"][0]}
        return row | {f"{name}_difference": float(counted[k]) for k, name in enumerate(OUTCOMES)}

    def pilot(self, pairs: int, progress: Callable[[int], object] = lambda pairs: None) -> Array:
        """Return simulated pairs' differences, (2, n), without the twins' correction."""
        found = []
        for pair in range(pairs):
            key: dict[str, Any] = {"seed": self.seed, "target_length": self.length(pair)}
            order = self.order(pair)
            cuts = [
                self.outcomes(
                    cut_once(
                        self.simulator, self.policies[order[turn]], episode=self.episode(pair, turn), noise=turn, **key
                    )
                )
                for turn in (0, 1)
            ]
            found.append(cuts[order.index(0)] - cuts[order.index(1)])
            progress(1)
        return np.array(found).T


def two_names(names: Sequence[str]) -> tuple[str, str]:
    """Return the names of two policies.

    Raises ValueError if there are not two, or they are the same.
    """
    if len(names) != 2 or names[0] == names[1]:
        given = ", ".join(map(repr, names)) or "none"
        raise ValueError(f"POLICY OTHER: {given} given. Give two different policies to compare.")
    return names[0], names[1]
