"""Interfaces to the hardware.

Axis, sensor, their samples in SI and radians, listeners, and the latch they share.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from enum import Enum, StrEnum
from types import MappingProxyType
from typing import NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cutenv.rig.errors import RigError


class Phase(StrEnum):
    """State of a rig, which decides whether it may move."""

    UNREADY = "unready"  # locked: drives may be switched on and off at zero speed
    READY = "ready"  # released: commands go to the drives
    STOPPED = "stopped"  # stopped: only quick stops go to the drives, until the operator agrees to a reset
    RESETTING = "resetting"  # being reset: the operator has agreed, and the drives are brought to rest without power


class Event(Enum):
    """Event that can change the phase."""

    STOP = "a quick stop from any source"
    AGREE = "the operator agrees to a reset"
    CLEARED = "every drive is at rest without power"
    FAILED = "a drive cannot be cleared"
    RELEASE = "every signal is present and within its limits"
    LOCK = "the blade is at rest and has to stay so"


NEXT: Mapping[tuple[Phase, Event], Phase] = MappingProxyType(
    {
        (Phase.UNREADY, Event.STOP): Phase.STOPPED,
        (Phase.READY, Event.STOP): Phase.STOPPED,
        (Phase.RESETTING, Event.STOP): Phase.STOPPED,  # a new stop: the operator agreed to end the earlier one
        (Phase.STOPPED, Event.AGREE): Phase.RESETTING,
        (Phase.UNREADY, Event.AGREE): Phase.RESETTING,  # a drive has stopped by itself
        (Phase.RESETTING, Event.CLEARED): Phase.UNREADY,
        (Phase.RESETTING, Event.FAILED): Phase.STOPPED,
        (Phase.UNREADY, Event.RELEASE): Phase.READY,
        (Phase.READY, Event.LOCK): Phase.UNREADY,
    }
)
"""Next phase for each pair of phase and event; every other event changes nothing."""


WATCHFUL = 0.020
"""Time since the rig was last judged, after which nothing is sent that lets a drive move or stay alive [s]."""


class Latch:
    """Phase of one rig, when it was last judged, and from which axes the heartbeat is withheld.

    May be read and changed from any thread.

    An axis without a supervisor has its own; a supervisor shares one with all its axes.

    Attributes
    ----------
    judged : float or None
        Time at which the supervisor last judged the rig [s]; None where no supervisor does.
    withheld : frozenset of str
        Axes that ignored their quick stops, and get no heartbeat before the operator agrees to a reset.
    """

    def __init__(self) -> None:
        self._phase = Phase.UNREADY
        self.judged: float | None = None
        self.withheld: frozenset[str] = frozenset()
        self._changing = threading.Lock()

    @property
    def phase(self) -> Phase:
        """Present phase."""
        return self._phase

    @property
    def closed(self) -> bool:
        """True while nothing may be sent that could give a drive power or speed."""
        return self._phase in (Phase.STOPPED, Phase.RESETTING)

    def allows_heartbeat(self, axis: str, now: float) -> bool:
        """Return whether an axis may get a heartbeat at ``now`` [s].

        It may if none is withheld from it, and the rig was judged within :data:`WATCHFUL`.  A rig without a supervisor
        need not be judged.
        """
        judged = self.judged
        return axis not in self.withheld and (judged is None or now - judged <= WATCHFUL)

    def withhold(self, axis: str) -> None:
        """Stop, and withhold the heartbeat from an axis, so that its own watchdog stops it."""
        with self._changing:
            self._happens(Event.STOP)
            self.withheld |= {axis}

    def restore(self, axis: str) -> None:
        """Give an axis that is opened again its heartbeat."""
        with self._changing:
            self.withheld -= {axis}

    def happens(self, event: Event) -> bool:
        """Change the phase as :data:`NEXT` defines; return whether it has an entry for this event."""
        with self._changing:
            return self._happens(event)

    def _happens(self, event: Event) -> bool:
        after = NEXT.get((self._phase, event))
        self._phase = after or self._phase
        if after is Phase.RESETTING:
            self.withheld = frozenset()
        return after is not None

    @contextmanager
    def resetting(self) -> Iterator[None]:
        """Enter the resetting phase for the block, which clears the drives.

        The rig is locked at its end.

        Raises
        ------
        RigError
            If another stop happened meanwhile; the rig is then stopped, as after any error in the block.
        """
        self.happens(Event.AGREE)
        try:
            yield
        except BaseException:
            self.happens(Event.FAILED)
            raise
        if not self.happens(Event.CLEARED):
            raise RigError("the rig was stopped again during the reset; look for the cause, and reset it again.")


class DriveState(Enum):
    """State of a CiA 402 drive, as in its statusword."""

    NOT_READY = "not ready to switch on"
    DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    REACTING = "fault reaction active"
    FAULT = "fault"


class MotionSample(NamedTuple):
    """State of one axis at one instant.

    Attributes
    ----------
    time : float
        Arrival on the clock [s].
    position, speed : float
        Position from the clamp [m] and speed [m/s] of the blade along the cut; of the angle axis [rad], [rad/s]; of the
        height axis [m], [m/s], upwards; of that to the side, to the left.
    torque : float
        Torque of the motor over its rated torque [1].
    state : DriveState
        State of the drive.
    """

    time: float
    position: float
    speed: float
    torque: float
    state: DriveState


class ForceSample(NamedTuple):
    """Reading of the six-axis sensor.

    Attributes
    ----------
    time : float
        Arrival on the clock [s].
    force : tuple of 3 float
        Force in the sensor's axes, after tare [N].
    counts : tuple of 6 int
        Forces and torques as the sensor sent them.
    status : int
        Status of the sensor; 0 is healthy.
    sequence : int
        Number of the packet, counted by the sensor modulo 2**32.
    lost : int
        Number of packets missing since the last sample.
    torque : tuple of 3 float
        Torque in the sensor's axes, after tare [N m].
    """

    time: float
    force: tuple[float, float, float]
    counts: tuple[int, int, int, int, int, int]
    status: int
    sequence: int
    lost: int
    torque: tuple[float, float, float] = (0.0, 0.0, 0.0)


_Sample = TypeVar("_Sample", ForceSample, MotionSample)


def newest_since(samples: deque[_Sample], moment: float) -> list[_Sample]:
    """Return the samples from the last one before ``moment`` [s] to the newest."""
    kept: list[_Sample] = []
    for sample in reversed(samples.copy()):  # a thread may add to it meanwhile
        kept.append(sample)
        if sample.time < moment:
            break
    return kept[::-1]


def interpolated(
    time: NDArray[np.float64], samples: list[MotionSample]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return position and speed at times [s]: linear between samples, at constant speed after the last one."""
    if not samples:
        return np.zeros_like(time), np.zeros_like(time)
    times = np.array([sample.time for sample in samples])
    speed = np.interp(time, times, [sample.speed for sample in samples])
    position = np.interp(time, times, [sample.position for sample in samples])
    return position + samples[-1].speed * np.maximum(time - times[-1], 0.0), speed


class MotionListener(Protocol):
    """Receiver of an axis's reports.

    Called from the loop, or from a driver's thread, and must never wait.
    """

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Take a sample of position, speed and state that has arrived."""
        ...

    def alive(self, axis: str, time: float) -> None:
        """Take the drive's heartbeat, which arrived at ``time`` [s]."""
        ...

    def emergency(self, axis: str, code: int, meaning: str, time: float) -> None:
        """Take an error that the drive reported (CiA 402 code, such as 0x8611) at ``time`` [s]."""
        ...

    def foreign(self, axis: str, what: str, time: float) -> None:
        """Take the report that another master commands the drive: ``what`` was seen on the bus at ``time`` [s]."""
        ...

    def broken(self, axis: str, why: str, time: float) -> None:
        """Take the report that the drive cannot be reached (bus off, connection lost) since ``time`` [s]."""
        ...


class ForceListener(Protocol):
    """Receiver of a sensor's readings.

    Called from the loop, or from the driver's thread, for every packet; must never wait.
    """

    def force(self, sample: ForceSample) -> None:
        """Take a reading that has arrived, in order of its sequence."""
        ...

    def garbled(self, why: str, time: float) -> None:
        """Take the report of a packet that is not a valid reading, at ``time`` [s]."""
        ...


class Observer(Protocol):
    """Receiver of the same reports as the supervisor.

    Called from the loop, or from a driver's thread, and must never wait.
    """

    def force(self, sample: ForceSample) -> None:
        """Take a reading that has arrived."""
        ...

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Take a sample of an axis that has arrived."""
        ...

    def alive(self, axis: str, time: float) -> None:
        """Take a drive's heartbeat, which arrived at ``time`` [s]."""
        ...


class MotionDriver(Protocol):
    """One axis under velocity control.

    The carriage of the blade, its angle, height, or place to the side.

    SI and radians; the driver knows gear, lead and encoder. Every method raises :class:`RigError` if the axis does not
    answer in time.
    """

    name: str
    """Name of the axis, "blade", "angle", "height" or "side"."""
    latch: Latch
    """Latch of the rig: while it is closed, nothing is sent that could give the drive power or speed."""

    def open(self, listener: MotionListener) -> None:
        """Connect, check the drive's identity, write and verify the set-up; samples then arrive, nothing moves."""
        ...

    def enable(self) -> None:
        """Switch the power on, at zero speed. Clears no fault: see :meth:`clear`."""
        ...

    def command(self, speed: float) -> None:
        """Put a target speed [m/s or rad/s] on the bus, without waiting for an answer."""
        ...

    def quick_stop(self, *, for_good: bool = False) -> None:
        """Put a quick stop on the bus and close the latch: at once, from any thread, without waiting.

        After one with ``for_good`` the drive takes no command before it is at rest, and then has no power.
        """
        ...

    def withhold_heartbeat(self, why: str) -> None:
        """Stop our heartbeat, so that a drive that ignores commands is stopped by its own heartbeat watchdog."""
        ...

    def disable(self) -> None:
        """Switch off the power of an axis at rest."""
        ...

    def clear(self) -> None:
        """Leave quick stop or fault for rest without power, within the latch's reset."""
        ...

    def limits(self) -> dict[str, float]:
        """Return the drive's own "low", "high" (software limits), "speed", "acceleration" and "quick_stop"."""
        ...

    def about(self) -> dict[str, float | str]:
        """Return the data that the open drive reports about itself.

        A number's name ends with its unit.

        Of an axis across the cut "homed" is among them: "yes", or "no".
        """
        ...

    def close(self) -> None:
        """Leave the axis at rest without power, and leave the bus; never raises, and may be called twice."""
        ...


@runtime_checkable
class ZeroedByHand(Protocol):
    """Axis without a reference of its own.

    A person puts it at the clamp, and says so, whenever it had no power.
    """

    def set_zero(self) -> None:
        """Take the present position, without power, as zero."""
        ...


class ForceDriver(Protocol):
    """Force sensor that streams readings."""

    rate: float
    """Rate of the readings [Hz]."""
    rate_error: float
    """Greatest relative error of that rate [1]: 0.001 of a quartz; a converter with a clock of its own may have 0.1."""
    axes: str
    """Axes of force that it measures, "xyz" or some of them; the others read 0 and are not watched for life."""

    def open(self, listener: ForceListener) -> None:
        """Connect, read scales and units from the sensor itself, and start streaming."""
        ...

    def tare(self, samples: int = 200) -> tuple[float, float, float]:
        """Take the mean of so many readings as zero; return the total subtracted since the start [N]."""
        ...

    def about(self) -> dict[str, float | str]:
        """Return the data that the open sensor reports about itself; a number's name ends with its unit."""
        ...

    def close(self) -> None:
        """Stop streaming; never raises, and may be called twice."""
        ...
