"""Sessions by a fake clock and a scripted hand."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cutenv.people.play.devices import ScriptedDevice, simple_hand
from cutenv.people.play.haptics import Stylus, VirtualCoupling
from cutenv.people.play.play_session import Session, SessionPlan

COUPLING = VirtualCoupling()
TARGET = 0.07
DATE = datetime(2026, 3, 1, 14, 5, tzinfo=UTC)


def session(folder: Path | None = None, **changes: Any) -> Session:
    """A session on a liver of 7 cm, with a simple hand."""
    person = {"operator": "P07"} | {name: changes.pop(name) for name in ("operator", "handle") if name in changes}
    plan = {"specimen_class": "liver", "seed": 6, "target_length": TARGET, "countdown": 1.0} | changes
    return Session(simple_hand(TARGET), SessionPlan(**plan), folder=folder, now=lambda: DATE, **person)


def run(played: Session, *, until: str = "ended", frame: float = 1.0 / 60.0, clock: float = 0.0) -> float:
    """Advance a picture at a time until a phase; the clock then."""
    for _ in range(round(60.0 / frame)):
        if played.phase == until:
            return clock
        played.advance(clock)
        clock += frame
    raise AssertionError(f"still {played.phase!r} after a minute")


def begun(folder: Path | None = None, **changes: Any) -> tuple[Session, float]:
    """A session as :func:`session` makes it, where cutting has just begun, and the clock."""
    played = session(folder, **changes)
    played.begin()
    return played, run(played, until="cutting")


def whole(folder: Path | None = None, **changes: Any) -> Session:
    """A session as :func:`session` makes it, after its first cut."""
    played = session(folder, **changes)
    played.begin()
    run(played)
    return played


class Pushing(ScriptedDevice):
    """A scripted hand on a device that pushes, and that has to be opened."""

    coupling = COUPLING

    def __init__(self) -> None:
        super().__init__(simple_hand(TARGET)._script)
        self.forces: list[float] = []
        self.held: frozenset[str] = frozenset()
        self.is_open = False

    def open(self) -> None:
        super().open()
        self.is_open = True

    def push(self, force: float) -> None:
        self.forces.append(force)

    def read(self) -> Stylus:
        if not self.is_open:
            raise OSError("the device is not open")
        return super().read()._replace(buttons=self.held)

    def close(self) -> None:
        self.is_open = False
