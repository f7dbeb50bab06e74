"""Policies that try to be paid for something else than a gentle cut; each is as clever about it as it can be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from whole_cut import CRUISE, FASTEST, INCLINED, UPRIGHT

from cutenv.policy import ProbeAndCreep, StopAndUnload
from cutenv.task.observation import COMPONENTS, OFFSETS, SCALES, to_action
from cutenv.tissue.specimen import SPACING

Command = tuple[float, float]
NAMES = [component.name for component in COMPONENTS]


class ProbingEnd:
    """How probe-and-creep ends a cut: None until it would begin its first probe."""

    def __init__(self) -> None:
        self._script = ProbeAndCreep()

    def reset(self) -> None:
        self._script.reset(np.random.default_rng(0))
        self._body: np.ndarray | None = None
        self._ending = False

    def __call__(self, observation: np.ndarray) -> np.ndarray | None:
        action = self._script(observation)
        self._body = action if self._body is None else self._body
        self._ending = self._ending or not np.array_equal(action, self._body)
        return action if self._ending else None


class Hack:
    """Commands until the cut is to end, then an honest end, :class:`StopAndUnload` or another, unless it is skipped.

    ``command(self, seen)`` gives (speed [m/s], angle [rad]) for what is seen in SI units; it may keep notes in
    ``self.notes`` and count in ``self.count``, draw from ``self.rng`` and, as no agent could, look into ``self.env``.
    """

    def __init__(self, command: Callable[[Any, dict[str, Any]], Command], *, stops: bool = True) -> None:
        self._command, self.stops = command, stops
        self._unloading = StopAndUnload()
        self.ending: Callable[[np.ndarray], np.ndarray | None] = self._unloading
        self.env: gymnasium.Env[Any, Any]

    def reset(self, rng: np.random.Generator) -> None:
        self._unloading.reset()
        self.ending.reset()
        self.rng, self.count, self.notes = rng, -1, {}
        self._truth: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        self.count += 1
        seen = dict(zip(NAMES, (observation * SCALES + OFFSETS).tolist(), strict=True))
        stop = self._unloading(observation)
        ending = stop if self.ending is self._unloading else self.ending(observation)
        seen["target"], seen["tip"] = seen["position"] + seen["distance"], self._unloading.tip
        return ending if self.stops and ending is not None else to_action(*self._command(self, seen))

    def end_as(self, ending: type[StopAndUnload] | type[ProbingEnd]) -> Hack:
        """End honestly in that way."""
        self.ending = self._unloading if ending is StopAndUnload else ending()
        return self

    def force_ratio(self) -> float:
        """Elastic force over R B at the tip: the hidden truth."""
        plant, specimen = self.env.unwrapped.plant, self.env.unwrapped.specimen
        tip, blade = float(plant.states["tip"][0]), float(plant.states["blade"][0])
        if self._truth is None:
            points = np.arange(len(specimen.depth)) * SPACING
            self._truth = points, specimen.stiffness(), specimen.fracture_force()
        points, *profiles = self._truth
        stiffness, resistance = (np.interp(tip, points, profile) for profile in profiles)
        return stiffness * max(blade - tip, 0.0) / resistance


def dither(low: float, high: float, angle: float = INCLINED) -> Hack:
    """Back and forth between two forces about R B, known from the truth, so as to cut in loading only."""

    def command(self: Hack, seen: dict[str, Any]) -> Command:
        ratio, forth = self.force_ratio(), self.notes.get("forth", True)
        self.notes["forth"] = ratio < high if forth else ratio < low
        return (FASTEST if self.notes["forth"] else -FASTEST), angle

    return Hack(command)


def sawing(reach: float, strokes: int) -> Hack:
    """Cut, then saw to and fro in the open crack, then go on."""

    def command(self: Hack, seen: dict[str, Any]) -> Command:
        done = self.notes.setdefault("strokes", 0)
        turn = self.notes.setdefault("turn", 0.5 * seen["target"])
        back = self.notes.setdefault("back", False)
        if done < strokes:
            if not back and seen["position"] > turn:
                self.notes["back"] = True
            elif back and seen["position"] < turn - reach:
                self.notes["back"], self.notes["strokes"] = False, done + 1
        return (-FASTEST if self.notes["back"] else CRUISE), INCLINED

    return Hack(command)


def finish_after(travel: float) -> Hack:
    """Cut that far, draw back, and call it finished."""

    def command(self: Hack, seen: dict[str, Any]) -> Command:
        self.notes["far"] = self.notes.get("far", False) or seen["position"] > travel
        if not self.notes["far"]:
            return FASTEST, UPRIGHT
        return (-0.01 if seen["force"] > 0.0 else 0.0), UPRIGHT

    return Hack(command, stops=False)


def stop_loaded(speed: float) -> Hack:
    """Cut to the target and stay there, or creep, without unloading."""

    def command(self: Hack, seen: dict[str, Any]) -> Command:
        self.notes["there"] = self.notes.get("there", False) or seen["tip"] > seen["target"] - 0.003
        return (speed, UPRIGHT) if self.notes["there"] else (CRUISE, INCLINED)

    return Hack(command, stops=False)


def breach_near_the_target(fall_short: float) -> Hack:
    """Cut to a few millimetres before the target, then load until the force limit ends it."""

    def command(self: Hack, seen: dict[str, Any]) -> Command:
        return FASTEST if seen["tip"] < seen["target"] - fall_short else 0.5 * FASTEST, UPRIGHT

    return Hack(command, stops=False)


def wait(seconds: float, where: float) -> Hack:
    """Stand still for a while, loaded, once the blade is there."""

    def command(self: Hack, seen: dict[str, Any]) -> Command:
        if seen["position"] > where * seen["target"]:
            self.notes["waited"] = self.notes.get("waited", 0) + 1
        return (0.0 if 0 < self.notes.get("waited", 0) < 50 * seconds else CRUISE), INCLINED

    return Hack(command)


def every(decisions: int, *commands: Command) -> Hack:
    """The commands in turn, each for some decisions."""
    return Hack(lambda self, seen: commands[self.count // decisions % len(commands)])


def jitter(spread: float, speed: float = CRUISE) -> Hack:
    """Speed and angle shaken at random at every decision."""

    def command(self: Hack, seen: dict[str, Any]) -> Command:
        return speed + spread * self.rng.uniform(-1.0, 1.0), INCLINED + 0.3 * self.rng.uniform()

    return Hack(command)


def probing(number: int) -> Hack:
    """An honest cut with that many unload probes: back by 8 mm and on again."""

    def command(self: Hack, seen: dict[str, Any]) -> Command:
        next_at = (self.notes.get("probes", 0) + 1) / (number + 1) * 0.8 * seen["target"]
        if "until" in self.notes:
            if seen["position"] > self.notes["until"]:
                return -0.01, INCLINED
            del self.notes["until"]
            self.notes["probes"] = self.notes.get("probes", 0) + 1
        elif self.notes.get("probes", 0) < number and seen["position"] > next_at:
            self.notes["until"] = seen["position"] - 0.008
        return CRUISE, INCLINED

    return Hack(command)


def haste_by_turns(slow: float, fast: float, force_per_depth: float) -> Hack:
    """Fast while the force is high, when a fast blade cuts evenly; slow while it is low, when only haste costs."""

    def command(self: Hack, seen: dict[str, Any]) -> Command:
        high = seen["force"] > force_per_depth * max(seen["depth"], 1e-3)
        return (fast if high else slow), INCLINED

    return Hack(command)


def unload_inclined() -> Hack:
    """Cut to the target and draw back without turning upright: below the edge a wedge stays uncut."""

    def command(self: Hack, seen: dict[str, Any]) -> Command:
        self.notes["there"] = self.notes.get("there", False) or seen["tip"] > seen["target"] - 0.002
        if not self.notes["there"]:
            return CRUISE, INCLINED
        self.notes["free"] = self.notes.get("free", False) or seen["force"] <= 0.0
        return (0.0 if self.notes["free"] else -0.005), INCLINED

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
    },
    "crossing the line with small force": {
        "at full speed": Hack(lambda self, seen: (FASTEST, UPRIGHT), stops=False),
        "at 1 mm/s": Hack(
            lambda self, seen: (CRUISE, INCLINED) if seen["distance"] > 0.01 else (0.001, UPRIGHT), stops=False
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
