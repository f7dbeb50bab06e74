"""A rig that cuts on an emulated one for trials, made ready after every stop; and a watch for the host's stalls."""

from __future__ import annotations

import math
from typing import Any

from cutenv.emulation.control_port import EmulatorControl
from cutenv.envs.rig_source import EmulatedSpecimens
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.loop import SystemClock
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import AutomaticOperator
from cutenv.rig.operation.preflight import SETTLE, return_inside
from cutenv.rig.operation.session import RigSession, SpecimenKey
from cutenv.rig.plant import rig_plant
from cutenv.rig.safety.stop_causes import RigStopped, StopReport
from cutenv.sim.tissue.specimen import Specimen

SPEED = 0.015  # speed of the cuts [m/s]
PERIOD = 0.020  # control period, from command to command [s]
SLOW = ("serial", "grbl")  # drivers of the blade on a slow rig
SLOW_SPEED, SLOW_PERIOD = 0.0045, 0.100  # the same of such a rig
STALL = 0.005  # lateness of a thread that should run every 2 ms, above which the host counts as stalled [s]
WATCHED = 0.002  # period of that thread [s]
UPRIGHT = math.pi / 2  # angle of the blade [rad]
LATCHED_FOR = 0.5  # time for which commands are tried after a stop [s]
_BACK = 0.02  # speed back to the clamp [m/s]
_ATTEMPTS = 5  # at beginning a cut
_FAR = 0.09  # [m], position from which the cut continues in another specimen


def pace_of(settings: RigSettings) -> tuple[float, float]:
    """Return speed [m/s] and control period [s] of the cuts on a rig."""
    return (SLOW_SPEED, SLOW_PERIOD) if settings.blade.driver in SLOW else (SPEED, PERIOD)


class HostWatch:
    """Records when a thread of this process that should run every 2 ms was late: the machine was busy elsewhere."""

    def __init__(self, clock: Any) -> None:
        self.stalls: list[tuple[float, float]] = []
        """Time at which it ran again, and lateness [s]."""
        self._last = clock.now()
        self._turns = clock.every(WATCHED, self._note, "host watch")

    def _note(self, now: float) -> None:
        late, self._last = now - self._last - WATCHED, now
        if late > STALL:
            self.stalls.append((now, late))

    def stop(self) -> None:
        """Stop watching."""
        self._turns.stop()


class CuttingRig:
    """A rig that cuts in an emulated one's specimens, made ready again after every stop."""

    def __init__(self, settings: RigSettings, control: EmulatorControl) -> None:
        self.settings, self._supply = settings, EmulatedSpecimens(control)
        self.speed, self.period = pace_of(settings)
        Specimen.drawn(0, 0)  # compiles: a drive would miss this process's heartbeat
        self._open()

    def _open(self) -> None:
        plant = rig_plant(self.settings)
        self.session = RigSession(plant, AutomaticOperator(self.settings), self._supply)
        self.plant = self.session.plant
        self.clock = self.plant.clock
        self.session.open()
        self.host = HostWatch(SystemClock())  # not in the loop that it watches
        self._laid = False

    def close(self) -> None:
        """Disconnect from the emulated rig."""
        self.host.stop()
        self.session.close()

    def reopen(self) -> None:
        """Connect anew, to a drive that has lost its set-up, or after the session's end."""
        self.close()
        self._open()

    def begin(self, seed: int, *, specimen_class: str = "liver") -> None:
        """Reset and make ready to cut; at first, and at the end of a specimen, mount another at the clamp and tare.

        A busy host may stop the blade on its way: then it tries again.
        """
        for attempt in range(_ATTEMPTS):
            try:
                return self._begin(seed, specimen_class)
            except RigError:
                if attempt == _ATTEMPTS - 1:
                    raise
                self.plant.halt()

    def _begin(self, seed: int, specimen_class: str) -> None:
        plant, clock = self.plant, self.clock
        specimen = Specimen.drawn(seed, 0, specimen_class=specimen_class)
        plant.supervisor.reset(agreed=True)
        plant.power()
        clock.sleep_until(clock.now() + SETTLE)
        if plant.supervisor.beyond is not None:
            return_inside(plant)
        self.session.start()
        if not self._laid or plant.position > _FAR:
            plant.travel(0.0, speed=_BACK, angle=UPRIGHT)
            plant.supervisor.lock()
            plant.depth = specimen.depth
            self._supply.mount(SpecimenKey(seed=seed, episode=0, specimen=specimen))
            clock.sleep_until(clock.now() + SETTLE)
            plant.tare()
            self._laid = True
            self.session.start()
        plant.begin()

    def cut(self, seconds: float) -> StopReport | None:
        """Cut for ``seconds``; return the report of a stop on the way."""
        try:
            for _ in range(round(seconds / self.period)):  # by its own pace, whatever the clock says
                self.plant.advance(self.speed, UPRIGHT, round(1e3 * self.period))
        except RigStopped as stop:
            return stop.report
        return None

    def refuses(self) -> bool:
        """Return True if commands are refused, for half a second."""
        for _ in range(5):
            try:
                self.plant.supervisor.drive(self.speed, UPRIGHT, self.period)
            except RigError:
                self.clock.sleep_until(self.clock.now() + LATCHED_FOR / 5)
                continue
            return False
        return True
