"""Policies that try to be paid for something else than a gentle cut; each is as clever about it as it can be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from whole_cut import CRUISE, FASTEST, INCLINED, UPRIGHT

from cutenv.agents.policy import Policy, ProbeAndCreep, StopAndUnload
from cutenv.agents.policy.interface import ArrayPolicy, as_array_policy, choose, in_si, to_actions
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.vector import CutBatch
from cutenv.sim.tissue.specimen import SPACING
from cutenv.task.declare import Cuts
from cutenv.task.observation import COMPONENTS

Command = tuple[Any, Any]
NAMES = [component.name for component in COMPONENTS]


class ProbingEnd:
    """How probe-and-creep ends cuts: each ending begins with its first probe."""

    def __init__(self) -> None:
        self._script = ProbeAndCreep()

    def begin(self, count: int) -> None:
        self._script.begin([np.random.default_rng(0)] * count)
        self._body: np.ndarray | None = None
        self._begun = np.zeros(count, bool)

    def endings(self, observations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        actions = self._script.act(observations)
        self._body = actions if self._body is None else self._body
        self._begun |= np.any(actions != self._body, axis=1)
        return self._begun, actions


class Hack(ArrayPolicy):
    """Commands until a cut is to end, then an honest end, :class:`StopAndUnload` or another, unless it is skipped.

    ``command(self, seen)`` gives (speed [m/s], angle [rad]), each a number or an array of shape (n,), for what is seen
    of n cuts in SI units, arrays of shape (n,) by name.  It may keep notes of each cut (:meth:`note`), count decisions
    in ``self.count``, draw from ``self.rngs`` and, as no agent could, look into ``self.cuts``.
    """

    cuts: Cuts

    def __init__(self, command: Callable[[Any, dict[str, np.ndarray]], Command], *, stops: bool = True) -> None:
        self._command, self.stops = command, stops
        self._unloading = StopAndUnload()
        self._probing: ProbingEnd | None = None

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        self._unloading.begin(len(rngs))
        if self._probing is not None:
            self._probing.begin(len(rngs))
        self.rngs, self.count, self._notes = rngs, -1, {}

    def forget(self, cuts: np.ndarray) -> None:
        raise NotImplementedError("a hack begins all its cuts together")

    def act(self, observations: np.ndarray) -> np.ndarray:
        self.count += 1
        values = in_si(observations)
        seen = dict(zip(NAMES, values.T, strict=True))
        ending, endings = self._unloading.endings(values)
        if self._probing is not None:
            ending, endings = self._probing.endings(observations)
        seen["target"], seen["tip"] = seen["position"] + seen["distance"], self._unloading.tip
        speed, angle = self._command(self, seen)
        actions = to_actions(np.broadcast_to(speed, len(values)), angle)
        return choose(ending & self.stops, endings, actions)

    def note(self, name: str, default: Any) -> np.ndarray:
        """The notes of that name, one for each cut, to be changed in place."""
        return self._notes.setdefault(name, np.full(len(self.rngs), default))

    def end_as(self, ending: type[StopAndUnload] | type[ProbingEnd]) -> Hack:
        """End honestly in that way."""
        self._probing = ProbingEnd() if ending is ProbingEnd else None
        return self

    def force_ratio(self) -> np.ndarray:
        """Elastic force over R B at the tip: the hidden truth."""
        tip, blade = self.cuts.states["tip"], self.cuts.states["blade"]
        points = np.arange(self.cuts.profiles["depth"].shape[1]) * SPACING
        stiffness, resistance = (
            np.array([np.interp(x, points, y) for x, y in zip(tip, self.cuts.profiles[name], strict=True)])
            for name in ("stiffness", "toughness")
        )
        return stiffness * np.maximum(blade - tip, 0.0) / resistance


class Ended(NamedTuple):
    """Cuts that have ended, one for each seed: return, success, how far the tip is from the target [m], and the end."""

    returns: np.ndarray
    success: np.ndarray
    tip_error: np.ndarray
    ends: np.ndarray


def cut_all(policy: Policy | ArrayPolicy, seeds: Sequence[int], **keywords: Any) -> Ended:
    """Cut the specimens of the seeds, all in one batch."""
    count, environment = len(seeds), GentleCutEnv(**keywords)
    batch, many = CutBatch(count, environment), as_array_policy(policy)
    batch.give_seeds(list(seeds), np.arange(count), np.random.default_rng())
    batch.begin(np.arange(count))
    many.begin([np.random.default_rng(seed) for seed in seeds])
    if isinstance(many, Hack):
        many.cuts = batch.cuts
    returns, ends = np.zeros(count), np.zeros(count, int)
    while not ends.all():
        rewards, ended = batch.decide(many.act(batch.observations), ends != 0)
        returns += np.where(ends == 0, rewards, 0.0)
        ends += ended
    tip, target = batch.cuts.states["tip"], batch.cuts.tasks["target"]
    return Ended(returns, batch.succeeded(), np.abs(tip - target), np.array(batch.end_names)[ends])


def dither(low: float, high: float, angle: float = INCLINED) -> Hack:
    """Back and forth between two forces about R B, known from the truth, so as to cut in loading only."""

    def command(self: Hack, seen: dict[str, np.ndarray]) -> Command:
        ratio, forth = self.force_ratio(), self.note("forth", True)
        forth[:] = np.where(forth, ratio < high, ratio < low)
        return np.where(forth, FASTEST, -FASTEST), angle

    return Hack(command)


def sawing(reach: float, strokes: int) -> Hack:
    """Cut, then saw to and fro in the open crack, then go on."""

    def command(self: Hack, seen: dict[str, np.ndarray]) -> Command:
        done, turn, back = self.note("strokes", 0), 0.5 * seen["target"], self.note("back", False)
        arrived = back & (seen["position"] < turn - reach)
        leave = ~back & (seen["position"] > turn) & (done < strokes)
        done += arrived
        back ^= arrived | leave
        return np.where(back, -FASTEST, CRUISE), INCLINED

    return Hack(command)


def finish_after(travel: float) -> Hack:
    """Cut that far, draw back, and rest there."""

    def command(self: Hack, seen: dict[str, np.ndarray]) -> Command:
        far = self.note("far", False)
        far |= seen["position"] > travel
        return np.where(far, np.where(seen["force"] > 0.0, -0.01, 0.0), FASTEST), UPRIGHT

    return Hack(command, stops=False)


def back_out(short: float) -> Hack:
    """Cut until the blade is that far before the target, then draw back fast and without rest."""

    def command(self: Hack, seen: dict[str, np.ndarray]) -> Command:
        there = self.note("there", False)
        there |= seen["distance"] < short
        return np.where(there, -FASTEST, CRUISE), UPRIGHT

    return Hack(command, stops=False)


def stop_loaded(speed: float) -> Hack:
    """Cut to the target and stay there, or creep, without unloading."""

    def command(self: Hack, seen: dict[str, np.ndarray]) -> Command:
        there = self.note("there", False)
        there |= seen["tip"] > seen["target"] - 0.003
        return np.where(there, speed, CRUISE), np.where(there, UPRIGHT, INCLINED)

    return Hack(command, stops=False)


def breach_near_the_target(fall_short: float) -> Hack:
    """Cut to a few millimetres before the target, then load until the force limit ends it."""

    def command(self: Hack, seen: dict[str, np.ndarray]) -> Command:
        return np.where(seen["tip"] < seen["target"] - fall_short, FASTEST, 0.5 * FASTEST), UPRIGHT

    return Hack(command, stops=False)


def wait(seconds: float, where: float) -> Hack:
    """Stand still for a while, loaded, once the blade is there."""

    def command(self: Hack, seen: dict[str, np.ndarray]) -> Command:
        waited = self.note("waited", 0)
        waited += seen["position"] > where * seen["target"]
        return np.where((waited > 0) & (waited < 50 * seconds), 0.0, CRUISE), INCLINED

    return Hack(command)


def every(decisions: int, *commands: Command) -> Hack:
    """The commands in turn, each for some decisions."""
    return Hack(lambda self, seen: commands[self.count // decisions % len(commands)])


def jitter(spread: float, speed: float = CRUISE) -> Hack:
    """Speed and angle shaken at random at every decision."""

    def command(self: Hack, seen: dict[str, np.ndarray]) -> Command:
        shaken = np.array([rng.uniform(-1.0, 1.0, 2) for rng in self.rngs])
        return speed + spread * shaken[:, 0], INCLINED + 0.15 * (1.0 + shaken[:, 1])

    return Hack(command)


def probing(number: int) -> Hack:
    """An honest cut with that many unload probes: back by 8 mm and on again."""

    def command(self: Hack, seen: dict[str, np.ndarray]) -> Command:
        made, until = self.note("probes", 0), self.note("until", np.inf)
        back = seen["position"] > until
        made += np.isfinite(until) & ~back
        until[~back] = np.inf
        begins = ~back & (made < number) & (seen["position"] > (made + 1) / (number + 1) * 0.8 * seen["target"])
        until[begins] = seen["position"][begins] - 0.008
        return np.where(back, -0.01, CRUISE), INCLINED

    return Hack(command)


def haste_by_turns(slow: float, fast: float, force_per_depth: float) -> Hack:
    """Fast while the force is high, when a fast blade cuts evenly; slow while it is low, when only haste costs."""

    def command(self: Hack, seen: dict[str, np.ndarray]) -> Command:
        high = seen["force"] > force_per_depth * np.maximum(seen["depth"], 1e-3)
        return np.where(high, fast, slow), INCLINED

    return Hack(command)


def unload_inclined() -> Hack:
    """Cut to the target and draw back without turning upright: below the edge a wedge stays uncut."""

    def command(self: Hack, seen: dict[str, np.ndarray]) -> Command:
        there, free = self.note("there", False), self.note("free", False)
        there |= seen["tip"] > seen["target"] - 0.002
        free |= there & (seen["force"] <= 0.0)
        return np.where(free, 0.0, np.where(there, -0.005, CRUISE)), INCLINED

    return Hack(command, stops=False)


HACKS: dict[str, dict[str, Hack]] = {
    "hovering": {
        "at the clamp": Hack(lambda self, seen: (0.0, UPRIGHT), stops=False),
        "to and fro in a short crack": Hack(
            lambda self, seen: ((FASTEST if self.count // 30 % 2 == 0 else -FASTEST), UPRIGHT), stops=False
        ),
    },
    "shallow or hardly cutting": {
        "10 mm and out": finish_after(0.0105),
        "half of it and out": finish_after(0.04),
        "all of it, but for the wedge": unload_inclined(),
        "to 9 mm before the target and out": back_out(0.009),
    },
    "crossing the line with small force": {
        "at full speed": Hack(lambda self, seen: (FASTEST, UPRIGHT), stops=False),
        "at 1 mm/s": Hack(
            lambda self, seen: (
                np.where(seen["distance"] > 0.01, CRUISE, 0.001),
                np.where(seen["distance"] > 0.01, INCLINED, UPRIGHT),
            ),
            stops=False,
        ),
    },
    "ending early": {
        "by force near the target": breach_near_the_target(0.003),
        "by a low limit of force": Hack(lambda self, seen: (0.005, UPRIGHT), stops=False),
    },
    "leaving the tissue loaded": {
        "at rest": stop_loaded(0.0),
        "creeping back": stop_loaded(-0.0001),
        "creeping on": stop_loaded(0.0004),
    },
    "sawing in the old crack": {"one stroke": sawing(0.03, 1), "ten strokes": sawing(0.02, 10)},
    "force dither": {
        "5 % about R B": dither(0.95, 1.05),
        "5 % about 0.9 R B": dither(0.855, 0.945),
        "5 % upright": dither(0.95, 1.05, UPRIGHT),
    },
    "pumping speed": {
        "every decision": every(1, (FASTEST, INCLINED), (0.0, INCLINED)),
        "every fifth of a second": every(10, (FASTEST, INCLINED), (0.0, INCLINED)),
        "every second": every(50, (CRUISE, INCLINED), (0.002, INCLINED)),
        "every second, fast": every(50, (FASTEST, INCLINED), (CRUISE, INCLINED)),
    },
    "idling": {"5 s at the start": wait(5.0, 0.0), "8 s in the middle": wait(8.0, 0.5)},
    "jitter": {"small": jitter(0.005), "large": jitter(0.0254)},
    "turning back and forth": {
        "every tenth of a second": every(5, (CRUISE, INCLINED), (CRUISE, UPRIGHT)),
        "every second": every(50, (CRUISE, UPRIGHT), (CRUISE, INCLINED)),
    },
    "leaving the measured speed range": {
        "below": Hack(lambda self, seen: (0.0009, INCLINED)),
        "in and out": every(25, (CRUISE, INCLINED), (0.0009, INCLINED)),
    },
    "haste by turns": {
        "at any force": haste_by_turns(0.0127, 0.0254, 100.0),
        "at half the force": haste_by_turns(0.010, 0.0254, 200.0),
        "at high force": haste_by_turns(0.0064, 0.019, 300.0),
    },
}

KEYWORDS: dict[str, dict[str, float]] = {
    "by a low limit of force": {"force_limit_per_depth": 200.0},
    "5 % about R B": {"control_hz": 100},
}
"""Of the environment in which a hack is tried, if it needs others than the honest cut."""
