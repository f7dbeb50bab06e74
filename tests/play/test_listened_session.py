"""A listener is told all of a person's cuts while they go on: each reading once, in order, with its stamp."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from played import run, session

from cutenv.play.listened_session import ListenedSession
from cutenv.play.play_session import Session


class Heard:
    def __init__(self) -> None:
        self.told: list[str] = []
        self.parts: list[tuple[Any, Any, float]] = []

    def began(self, name: str) -> None:
        self.told.append(f"begin {name}")

    def readings(self, readings: Any, depth: Any, origin: float) -> None:
        self.parts.append((readings, depth, origin))

    def ended(self, cause: str) -> None:
        self.told.append(f"end {cause}")


def listened(clock: list[float]) -> tuple[Session, Heard]:
    played, heard = session(cuts=1), Heard()
    played.after_advance = ListenedSession(played, heard, clock=lambda: clock[0])
    return played, heard


def test_every_reading_of_a_cut_is_told_once_and_its_end() -> None:
    clock = [0.0]
    played, heard = listened(clock)
    played.begin()
    while played.phase != "ended":
        clock[0] += 1 / 60
        played.advance(clock[0])
    told = np.concatenate([part for part, _, _ in heard.parts])
    assert np.array_equal(told, played.cut.readings)
    assert all(len(part) == len(depth) for part, depth, _ in heard.parts)
    assert len({origin for _, _, origin in heard.parts}) == 1
    assert heard.parts[-1][2] + told["time"][-1] == pytest.approx(clock[0], abs=0.02)
    assert heard.told == ["begin liver seed 6 number 0", "end finished"]


def test_a_stall_moves_the_stamps_and_a_closed_session_ends_its_cut() -> None:
    clock = [0.0]
    played, heard = listened(clock)
    played.begin()
    run(played, until="cutting")
    for step in (1.1, 1.2, 4.0, 4.1):  # the third lost more than two seconds
        clock[0] = step
        played.advance(step)
    played.close()
    assert heard.told[-1] == "end given up"
    first, last = heard.parts[0], heard.parts[-1]
    assert last[2] - first[2] > 2.0
    assert last[2] + last[0]["time"][-1] == pytest.approx(4.1, abs=0.11)
