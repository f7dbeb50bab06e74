"""Scene of the attacks on a rig: a blade that cuts on an emulated rig, and the outcome as the emulator reports it."""

from __future__ import annotations

import dataclasses
import os
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cutenv.emulation.process import RunningEmulator, start
from cutenv.rig.errors import RigError
from cutenv.rig.safety.stop_causes import Cause
from scripts.validation.rig.attacked_drivers import ORDERS, Orders
from scripts.validation.rig.cutting_rig import SPEED, CuttingRig

FARTHEST = 0.005  # distance within which an attack that must stop the blade has to stop it [m]
_OF_STALLS = (Cause.FORCE_STALE, Cause.FORCE_LATE, Cause.MOTION_STALE, Cause.OVERRUN, Cause.HEARTBEAT, Cause.EXCEPTION)
_STANDS = 2e-4  # [m/s]
_AFTER = 0.4  # [s] of cutting before the attack
_WATCHED = 1.2  # [s] of observation after it
_LOOKED = 0.4  # [s] between the two last observations

Attack = Callable[["Scene"], None]
Found = tuple[list[str], list[str]]  # defects that a trial of its own has found, and other observations


def named(name: str, about: str, attack: Attack) -> Attack:
    """Give an attack its name, and its description as docstring."""
    attack.__name__, attack.__doc__ = name, about
    return attack


@dataclass(kw_only=True)
class Outcome:
    """Outcome of an attack; SI units."""

    cause: str | None = None  # of the stop; None: the cut went on
    way: float | None = None  # from the attack to rest or end; None: unknown
    moves: bool = False  # in the end, though it was stopped or nothing commands it
    refused: bool = True  # commands are, after a stop
    before: bool = False  # a busy machine had stopped it: this is no trial
    stalls: int = 0  # of this machine meanwhile
    notes: list[str] = field(default_factory=list)  # those that are wrong begin with "!"

    @property
    def safe(self) -> bool:
        """True if nothing moves that was stopped, and nothing else is wrong."""
        return not self.moves and self.refused and not any(note.startswith("!") for note in self.notes)

    @property
    def stops(self) -> bool:
        """True if it was stopped, within the allowed distance."""
        return self.safe and self.cause is not None and (self.way is None or abs(self.way) < FARTHEST)

    @property
    def goes_on(self) -> bool:
        """True if the cut went on."""
        return self.safe and self.cause is None

    @property
    def disturbed(self) -> bool:
        """True if a machine that stalls has stopped it, as far as can be seen: then it is not known what would be."""
        return self.before or (self.stalls > 0 and self.cause in _OF_STALLS)


class Scene:
    """An emulated rig on which a blade cuts, its spine in a process of its own; recreated after each attack.

    In ``orders`` an attack writes how the drivers misbehave; ``notes`` are observations of the present attack.
    """

    def __init__(self) -> None:
        self._emulator: RunningEmulator | None = None
        self._rig: CuttingRig | None = None
        self.notes: list[str] = []
        self._at: dict[str, Any] = {}
        self._folder = tempfile.TemporaryDirectory()
        file = Path(self._folder.name) / "orders"
        self.orders = Orders(file)
        os.environ[ORDERS] = str(file)  # for the spine

    @property
    def emulator(self) -> RunningEmulator:
        """The process of the emulated rig."""
        self._emulator = self._emulator or start()
        return self._emulator

    @property
    def rig(self) -> CuttingRig:
        """The rig that cuts on it."""
        if self._rig is None:
            settings = self.emulator.settings
            blade = dataclasses.replace(settings.blade, driver="scripts.validation.rig.attacked_drivers:attacked_axis")
            sensor = dataclasses.replace(
                settings.sensor, driver="scripts.validation.rig.attacked_drivers:attacked_sensor"
            )
            settings = dataclasses.replace(settings, blade=blade, sensor=sensor)
            self._rig = CuttingRig(settings, self.emulator.control)
        return self._rig

    def note(self, text: str) -> None:
        """Store an observation; with "!" in front if it is wrong."""
        self.notes.append(text)

    def attacked(self, attack: Attack, seed: int) -> Outcome:
        """Cut, attack from another thread, and return the outcome."""
        self.notes = []
        rig, outcome = self.rig, Outcome(notes=self.notes)
        begun: list[float] = []
        rig.begin(seed)
        stalls = len(rig.host.stalls)

        def run() -> None:
            self.mark()
            begun.append(rig.clock.now())
            try:
                attack(self)
            except Exception as error:  # an attack that raises is not an attack
                self.note(f"! the attack itself: {type(error).__name__}: {error}")

        timer = threading.Timer(_AFTER, run)
        timer.start()
        report = rig.cut(_AFTER + _WATCHED)
        timer.join(10.0)
        outcome.before = report is not None and bool(begun) and report.detected < begun[0]
        outcome.cause = None if report is None else report.cause.value
        outcome.stalls = len(rig.host.stalls) - stalls
        if report is not None:
            self.note(str(report))
            outcome.refused = rig.refuses()
        else:
            rig.plant.halt()
        self._look(outcome)
        return outcome

    def mark(self) -> None:
        """Count the way of the blade from here."""
        self._at = self._truth()

    def _look(self, outcome: Outcome) -> None:
        time.sleep(0.2)
        first = self._truth()
        time.sleep(_LOOKED)
        last = self._truth()
        if not last:
            self.note("the emulator is gone: the drive's own watch is all that is left, as of hardware without power")
            return
        if self._at:
            outcome.way = last["position_m"] - self._at["position_m"]
        went = abs(last["position_m"] - first["position_m"]) / _LOOKED if first else 0.0
        outcome.moves = went > _STANDS
        if outcome.moves:
            self.note(f"! it moves at {1e3 * went:.1f} mm/s, commanded were {1e3 * SPEED:g}")

    def _truth(self) -> dict[str, Any]:
        try:
            return self.emulator.control.truth()
        except (OSError, RigError):
            return {}

    def renew(self, *, whole: bool = False) -> None:
        """Close the rig, and the emulator too if it is unusable, so that they are recreated."""
        self.orders.give("")
        rig, self._rig = self._rig, None
        if rig is not None:
            rig.close()
        if self._emulator is not None:
            try:
                self._emulator.control.clear()
            except (OSError, RigError):
                whole = True
        if whole and self._emulator is not None:
            self._emulator.close()
            self._emulator = None

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, *error: Any) -> None:
        self.renew(whole=True)
        self._folder.cleanup()
