"""Time to draw a cut for the eye, compared with copying the finished picture; 60 pictures a second are wanted."""

from __future__ import annotations

from collections.abc import Callable

import gymnasium
import numpy as np

from cutenv.people.play.devices import HandMotion, ScriptedDevice
from cutenv.people.play.picture import PlayPicture
from cutenv.people.play.play_session import Session, SessionPlan
from scripts.benchmarks.speed.measured import Measured, Number, at_most, fastest

FRAME = 1.0 / 60.0
_HALFWAY = 200
_ROUNDS = 30


def _environment() -> Callable[[], object]:
    env = gymnasium.make("cutenv/GentleCut-v1", render_mode="rgb_array")
    env.reset(seed=3)
    for _ in range(_HALFWAY):
        env.step(np.array([0.3, 0.0], np.float32))
    return env.render


def _play_window() -> Callable[[], object]:
    played = Session(
        ScriptedDevice(lambda seconds: HandMotion(0.006 * seconds, 1.57)), SessionPlan(countdown=0.0, practice=True)
    )
    played.begin()
    for k in range(_HALFWAY):
        played.advance(k * FRAME)
    picture = PlayPicture()
    frames = iter(range(_HALFWAY, 10 * _HALFWAY))

    def draw() -> object:
        played.advance(next(frames) * FRAME)
        return picture.draw(played.sight())

    return draw


def picture_times() -> dict[str, float]:
    """Measure the best time of a picture of each kind, and of copying one [s]."""
    render = _environment()
    return fastest({"render": render, "play": _play_window(), "copy": np.asarray(render()).copy}, _ROUNDS)


def measure() -> Measured:
    """Measure the times, and compare them with the time between two pictures."""
    seconds = picture_times()
    copy = seconds.pop("copy")
    lines = ["a picture of half a cut"]
    numbers = {}
    for what, time in seconds.items():
        numbers[what] = Number(1e3 * time, "ms")
        told = f"{what}: {1e3 * time:.1f} ms, {time / copy:.0f} times a copy of the picture"
        lines.append(at_most(told, time, FRAME, "16.7 ms"))
    return Measured(numbers, lines)
