"""Interface to a rig's safety for all that is not safety itself: procedures, policies, people who watch."""

from __future__ import annotations

from typing import Protocol

from cutenv.rig.config.settings import RigSettings, SafetyLimits
from cutenv.rig.devices.drivers import ForceSample, MotionSample, Phase
from cutenv.rig.safety.stop_causes import Cause, StopReport


class Oversight(Protocol):
    """Safety of a rig, in this process or in the spine's; see :class:`cutenv.rig.safety.supervisor.Supervisor`."""

    limited: int
    """Number of commands that were reduced to a limit since :meth:`release`."""
    settings: RigSettings
    """Settings of the rig, with the limits that are in force."""
    limits: SafetyLimits
    """Limits that are in force."""

    @property
    def phase(self) -> Phase:
        """State of the rig, which decides whether it may move."""
        ...

    @property
    def report(self) -> StopReport | None:
        """Report of the last stop; None before the first. It is completed when the blade is at rest."""
        ...

    def drive(self, speed: float, angle: float, hold: float, **across: float) -> float:
        """Send a command that is valid for ``hold`` [s], with speeds in m/s; return the angle to turn to [rad]."""
        ...

    def turn(self, rate: float) -> None:
        """Send a turning speed [rad/s] to the angle's axis, if the rig is released."""
        ...

    def trip(self, cause: Cause, detail: str) -> None:
        """Stop the blade of a released rig, from any thread; return once the quick stops are on their way."""
        ...

    def await_quick_stops(self) -> None:
        """Wait until the quick stops of a stop under way are sent."""
        ...

    def release(self, *, returning: bool = False) -> None:
        """Allow commands; raises RigError if a signal is missing or beyond its limits."""
        ...

    def lock(self) -> None:
        """Command zero speed on every axis, and refuse motion until the next release."""
        ...

    def lower(self, limits: SafetyLimits) -> None:
        """Adopt each limit that is stricter than the present one."""
        ...

    def reset(self, agreed: bool) -> None:
        """Clear what is :attr:`latched`, if the operator has ``agreed``."""
        ...

    @property
    def latched(self) -> str | None:
        """Reason for which a reset has to precede any motion, or None."""
        ...

    @property
    def newest_force(self) -> ForceSample | None:
        """Last force reading; None before the first."""
        ...

    @property
    def blade(self) -> MotionSample | None:
        """Last sample of the blade's axis; None before the first."""
        ...

    def axis(self, name: str) -> MotionSample | None:
        """Return the last sample of an axis; None before the first."""
        ...

    @property
    def beyond(self) -> str | None:
        """Position of a blade beyond an end of its travel, as a text; None if it is inside."""
        ...

    @property
    def pressed(self) -> str | None:
        """Vertical force of a blade that presses on the tissue beyond its limit, as a text; None if it is within."""
        ...

    @property
    def relieving(self) -> bool:
        """True while a blade that presses on the tissue is raised, and nothing else may move."""
        ...

    @property
    def standing(self) -> bool:
        """True if the blade is at rest, as far as its samples show."""
        ...
