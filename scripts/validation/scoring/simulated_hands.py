"""Simulated people: they see the tip late, tremble, and move a hand that a spring joins to the blade.

Policies of ``GentleCutEnv(**DRIVEN)``, the drive of ``cutenv play``, at 50 decisions a second.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices
from cutenv.agents.policy.interface import DISTANCE_COLUMN, POSITION_COLUMN, ArrayPolicy, in_si, to_actions
from cutenv.agents.policy.tip_estimate import TipEstimate
from cutenv.people.play.hand_model import PLAYED_HAND
from cutenv.records.scoring.points import DEADLINE

_EVERY = 0.02  # [s] between decisions
DRIVEN: Mapping[str, Any] = {
    "drive": "hand", "control_hz": round(1.0 / _EVERY), "deadline_s": DEADLINE, **dataclasses.asdict(PLAYED_HAND)
}  # fmt: skip
"""Arguments of the environment whose episodes are cuts of a person, as in ``cutenv play``, decided every 20 ms."""
_TREMBLES_AT = 0.08  # [s] over which a tremor forgets
_LONGEST_LOOK = 50  # decisions that a late look may be behind
_BACK = 0.025  # [m] by which a hand draws back at the end, and rests

Span = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Skill:
    """Ranges from which a person's habits are drawn for each cut."""

    feed: Span  # speed of the hand on the way [m/s]
    creep: Span = (0.003, 0.005)  # speed near the target [m/s]
    back: Span = (0.008, 0.015)  # speed on the way back [m/s]
    lean: Span = (50.0, 70.0)  # angle of the blade on the way [deg]
    upright_from: Span = (0.012, 0.020)  # distance of the tip to the target from which on the blade is upright [m]
    slow_from: Span = (0.010, 0.020)  # that from which on the hand slows down [m]
    aim: Span = (-0.002, 0.002)  # place at which the tip is to end, beyond the target [m]
    reaction: Span = (0.15, 0.25)  # time after which the tip is seen [s]
    tremor: float = 0.0005  # standard deviation of the hand's speed [m/s]
    stroke: Span = (1.0, 1.0)  # duration of a stroke forward [s]
    pause: Span = (0.0, 0.0)  # duration of what follows it [s]; without one the hand goes steadily
    pause_speed: Span = (0.0, 0.0)  # [m/s]
    gives_up: Span = (9.0, 9.0)  # share of the way at which the cut is left


SKILLS: Mapping[str, Skill] = {  # people by name, from good to bad
    "careful hand": Skill(
        feed=(0.004, 0.007), creep=(0.0015, 0.003), lean=(45.0, 52.0), slow_from=(0.015, 0.025), aim=(-0.001, 0.001),
        reaction=(0.12, 0.20), tremor=0.0003,
    ),
    "steady hand": Skill(feed=(0.007, 0.012), lean=(45.0, 60.0)),
    "brisk hand": Skill(feed=(0.013, 0.020), creep=(0.004, 0.008), lean=(45.0, 70.0), slow_from=(0.006, 0.014)),
    "hurried hand": Skill(
        feed=(0.020, 0.0254), creep=(0.008, 0.016), lean=(70.0, 90.0), slow_from=(0.003, 0.008), back=(0.015, 0.0254),
        reaction=(0.2, 0.3),
    ),
    "upright hand": Skill(feed=(0.005, 0.012), lean=(85.0, 90.0)),
    "halting hand": Skill(feed=(0.012, 0.022), lean=(55.0, 90.0), stroke=(0.3, 0.8), pause=(0.3, 0.9)),
    "sawing hand": Skill(
        feed=(0.012, 0.022), lean=(50.0, 80.0), stroke=(0.6, 1.2), pause=(0.2, 0.5), pause_speed=(-0.014, -0.008)
    ),
    "trembling hand": Skill(feed=(0.006, 0.012), lean=(50.0, 80.0), tremor=0.006),
    "late hand": Skill(feed=(0.010, 0.018), lean=(50.0, 80.0), reaction=(0.4, 0.8), slow_from=(0.002, 0.006)),
    "timid hand": Skill(feed=(0.004, 0.009), aim=(-0.014, -0.002)),
    "hand that gives up": Skill(feed=(0.006, 0.014), lean=(50.0, 90.0), gives_up=(0.3, 0.8)),
}  # fmt: skip


class SimulatedHand(ArrayPolicy):
    """People of one skill, each with habits of their own."""

    def __init__(self, skill: Skill) -> None:
        self.skill = skill
        self._estimate = TipEstimate()

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Draw the habits of ``len(rngs)`` people."""
        self._rngs = list(rngs)
        count = len(rngs)
        self._habits = {field.name: np.zeros(count) for field in dataclasses.fields(Skill) if field.name != "tremor"}
        self._seen = np.zeros((_LONGEST_LOOK, count))
        self._trembling, self._time = np.zeros(count), np.zeros(count)
        self._leaving, self._farthest = np.zeros(count, bool), np.zeros(count)
        self._estimate.begin(count)
        self.forget(np.arange(count))

    def forget(self, cuts: Indices) -> None:
        """Draw the habits of those people again."""
        for n in cuts:
            for name, values in self._habits.items():
                values[n] = self._rngs[n].uniform(*getattr(self.skill, name))
        self._seen[:, cuts], self._trembling[cuts], self._time[cuts] = 0.0, 0.0, 0.0
        self._leaving[cuts], self._farthest[cuts] = False, 0.0
        self._estimate.forget(cuts)

    def act(self, observations: Array32) -> Array32:
        """Return the action of every person."""
        own, seen = self._habits, in_si(observations)
        self._seen = np.roll(self._seen, 1, axis=0)
        self._seen[0] = self._estimate.estimates(seen)["tip"]
        late = np.minimum(np.rint(own["reaction"] / _EVERY).astype(int), _LONGEST_LOOK - 1)
        tip = self._seen[late, np.arange(len(late))]
        blade = seen[:, POSITION_COLUMN]
        self._farthest = np.maximum(self._farthest, blade)
        target = blade + seen[:, DISTANCE_COLUMN]
        left = target + own["aim"] - tip
        self._leaving |= (left <= 0.0) | (tip >= own["gives_up"] * target)
        slowed = np.clip(left / own["slow_from"], own["creep"] / own["feed"], 1.0)
        forward = own["feed"] * slowed
        pausing = self._time % (own["stroke"] + own["pause"]) >= own["stroke"]
        back = np.where(blade > np.maximum(self._farthest - _BACK, 0.0), -own["back"], 0.0)
        speed = np.where(self._leaving, back, np.where(pausing, own["pause_speed"], forward))
        upright = self._leaving | (left < own["upright_from"])
        self._time += _EVERY
        trembling = np.where(self._leaving & (back == 0.0), 0.0, self._tremor())  # a hand may rest
        return to_actions(speed + trembling, np.radians(np.where(upright, 90.0, own["lean"])))

    def _tremor(self) -> Array:
        kept = math.exp(-_EVERY / _TREMBLES_AT)
        drawn = np.array([rng.standard_normal() for rng in self._rngs])
        self._trembling = kept * self._trembling + math.sqrt(1.0 - kept * kept) * self.skill.tremor * drawn
        return self._trembling
