"""Motions of a rig's blade outside a cut.

They lead to a place, up and down, to the side, and back the way that it came.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

from cutenv._base.arrays import StructArray
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.loop import Clock, Owner
from cutenv.rig.errors import RigError
from cutenv.rig.safety.oversight import Oversight
from cutenv.rig.safety.stop_causes import Cause, RigStopped, StopReport

RAISE_SPEED = 0.005  # speed at which the blade is moved across the cut outside of it [m/s]
SLOW_TURN = math.radians(10.0)  # rate of turn outside a cut [rad/s]
AIMED = math.radians(0.05)  # error below which the hinge is not moved [rad]
SLICE = 0.02  # time of waiting outside a cut, at a time [s]
# validity of a command outside a cut [s]: a busy computer may be late, at 5 mm/s by a quarter of a millimetre
VALID = 0.05
_ARRIVED = 2e-5  # [m] distance at which the blade has arrived
_NEAR = 3e-4  # [m] distance at which it has passed a place on its way back


class Travel(ABC):
    """Part of a rig that moves its blade outside a cut."""

    settings: RigSettings  # as of :class:`~cutenv.rig.plant.RigPlant`
    clock: Clock
    supervisor: Oversight
    owner: Owner
    _turns: bool  # an axis turns the blade
    _way: list[tuple[float, float]]  # [m] places of the blade since the clamp, some apart

    @abstractmethod
    def _wait(self, moment: float, angle: float, *, fastest: float) -> None:
        """Wait until ``moment`` [s] or stop, turning to ``angle`` [rad] within ``fastest`` [rad/s]."""

    @abstractmethod
    def _come_to_rest(self, report: StopReport) -> StructArray:
        """Wait for rest; return the cut's readings until then."""

    def travel(self, position: float, *, speed: float, angle: float | None = None) -> None:
        """Move to ``position`` [m] within ``speed`` [m/s], outside a cut.

        It turns slowly to ``angle`` [rad]. The blade turns only on arrival, because on its way it may still be in
        tissue. Raise RigError, RigStopped if the rig is not released, or the blade was stopped or does not arrive in
        time.
        """
        held = self._angle_now()
        wanted = held if angle is None else angle
        turning = 0.0 if not self._turns else abs(wanted - held) / SLOW_TURN
        deadline = self.clock.now() + 3.0 * (abs(position - self.position) / speed + turning) + 5.0
        arrived = False
        while not (arrived and self._turned(wanted)):
            left = position - self.position
            arrived |= abs(left) <= _ARRIVED
            if self.clock.now() > deadline:
                where = f"{1e3 * self.position:.2f} mm and {math.degrees(self._angle_now()):.1f} degrees"
                to = f"{1e3 * position:g} mm and {math.degrees(wanted):.1f} degrees"
                raise RigError(f"the blade stands at {where} and does not reach {to}.")
            rate = math.copysign(min(speed, 4.0 * abs(left)), left) if abs(left) > _ARRIVED else 0.0
            turned = self._drive(rate, wanted if arrived else held, hold=VALID)
            self._wait(self.clock.now() + SLICE, turned, fastest=SLOW_TURN)
            self._raise_if_stopped()
        self._drive(0.0, wanted, hold=VALID)
        self._wait(self.clock.now() + SLICE, wanted, fastest=SLOW_TURN)

    def raise_to(self, height: float, *, speed: float = RAISE_SPEED) -> None:
        """Move the blade vertically to ``height`` [m], see :meth:`carry`."""
        self.settings.require_height_axis(by="raise_to")
        self.carry("height", height, speed=speed)

    def carry(self, axis: str, place: float, *, speed: float = RAISE_SPEED) -> None:
        """Move a cross axis to ``place`` [m] outside cuts.

        It moves at no more than ``speed`` [m/s]. Raise RigError, RigStopped if the rig is not released, or the blade
        was stopped or does not arrive in time. A blade that cannot be raised, or not moved to the side, is a fault: it
        is stopped.
        """
        fault = Cause.STUCK if axis != "height" else Cause.NOT_RAISED if place > self.height else None
        self._carry({axis: place}, speed=speed, fault=fault)

    def retrace(self, *, speed: float) -> None:
        """Move the blade back along its way to the clamp's middle.

        The way is that since the last cut began. A rig without an axis to the side does nothing.  See :meth:`carry` for
        errors.
        """
        if self.settings.side is None:
            return
        raised = self.settings.height is not None and self.height > 0.0  # out of the cut
        while self._way and not raised:
            x, y = self._way[-1]
            self._carry({"blade": x, "side": y}, speed=speed, fault=Cause.STUCK, passing=True)
            self._way.pop()
        self._way = []
        self._carry({"blade": min(self.position, 0.0), "side": 0.0}, speed=speed, fault=Cause.STUCK)

    def _carry(self, to: dict[str, float], *, speed: float, fault: Cause | None, passing: bool = False) -> None:
        """Move straight axes together to places [m], each within ``speed`` [m/s].

        The blade rests there, unless it is only ``passing``. One that does not arrive in time is stopped with the cause
        ``fault``, if there is one.
        """
        held, within = self._angle_now(), _NEAR if passing else _ARRIVED

        def left() -> dict[str, float]:
            return {name: place - self.place(name) for name, place in to.items()}

        deadline = self.clock.now() + 3.0 * max(map(abs, left().values())) / speed + 5.0
        while (farthest := max(map(abs, (off := left()).values()))) > within:
            if self.clock.now() > deadline:
                stands = ", ".join(
                    f"the blade stands at a {name} of {1e3 * self.place(name):.2f} mm, and not at {1e3 * place:g} mm"
                    for name, place in to.items()
                ).replace("a side", "a place to the left")
                if fault is not None:
                    self.supervisor.trip(fault, stands)
                    self._raise_if_stopped()
                raise RigError(f"{stands}.")
            fast = (speed if passing else min(speed, 4.0 * farthest)) / farthest
            speeds = {name: fast * way for name, way in off.items()}
            self._drive(speeds.pop("blade", 0.0), held, hold=VALID, **speeds)
            self._wait(self.clock.now() + SLICE, held, fastest=SLOW_TURN)
            self._raise_if_stopped()
        if not passing:
            self._drive(0.0, held, hold=VALID)
            self._wait(self.clock.now() + SLICE, held, fastest=SLOW_TURN)

    def place(self, name: str) -> float:
        """Return an axis's last position [m] or [rad]; RigError before any sample."""
        sample = self.supervisor.axis(name)
        if sample is None:
            raise RigError(f"the {name} axis has reported no position: open the rig first, if it has one.")
        return sample.position

    @property
    def height(self) -> float:
        """Last height of the blade's lower end [m]; RigError before any sample."""
        return self.place("height")

    @property
    def position(self) -> float:
        """Last position of the blade [m]; RigError before any sample."""
        return self.place("blade")

    def _turned(self, wanted: float) -> bool:
        return not self._turns or abs(wanted - self._angle_now()) < 4 * AIMED

    def _angle_now(self) -> float:
        sample = self.supervisor.axis("angle")
        return self.settings.fixed_angle if sample is None else sample.position

    def _drive(self, speed: float, angle: float, *, hold: float, **across: float) -> float:
        """Send a command; raise :class:`RigStopped` if a thread has stopped the blade."""
        self.owner.check()
        try:
            return self.supervisor.drive(speed, angle, hold, **across)
        except RigError:
            self._raise_if_stopped()
            raise

    def _raise_if_stopped(self) -> None:
        if self.supervisor.phase == "stopped" and self.supervisor.report is not None:
            self.supervisor.await_quick_stops()
            raise RigStopped(self.supervisor.report, self._come_to_rest(self.supervisor.report))
