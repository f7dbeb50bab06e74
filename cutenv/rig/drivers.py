"""The joints to hardware: an axis that moves, a sensor that feels, and who is told about it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from cutenv.rig.samples import ForceSample, MotionSample

if TYPE_CHECKING:
    from cutenv.rig.latch import Latch


class RigError(Exception):
    """The rig cannot do what is asked: not there, not what was expected, or not willing; the message says the cure."""


class MotionListener(Protocol):
    """Who is told what an axis does; called from the driver's threads, and never waits."""

    def motion(self, axis: str, sample: MotionSample) -> None:
        """A sample of position, speed and state has arrived."""
        ...

    def alive(self, axis: str, time: float) -> None:
        """The drive's heartbeat has arrived, at ``time`` [s]."""
        ...

    def emergency(self, axis: str, code: int, meaning: str, time: float) -> None:
        """The drive reports an error (CiA 402 code, such as 0x8611), at ``time`` [s]."""
        ...

    def foreign(self, axis: str, what: str, time: float) -> None:
        """Somebody else commands the drive: ``what`` was seen on the bus at ``time`` [s]."""
        ...

    def broken(self, axis: str, why: str, time: float) -> None:
        """The way to the drive is broken (bus off, connection lost), at ``time`` [s]."""
        ...


class ForceListener(Protocol):
    """Who is told what the sensor feels; called from the driver's thread for every packet, and never waits."""

    def force(self, sample: ForceSample) -> None:
        """A reading has arrived, in order of its sequence."""
        ...

    def garbled(self, why: str, time: float) -> None:
        """Something has arrived that is no reading, at ``time`` [s]."""
        ...


class Witness(Protocol):
    """Who is told along with the supervisor; in the drivers' threads, so it never waits."""

    def force(self, sample: ForceSample) -> None:
        """A reading has arrived."""
        ...

    def motion(self, axis: str, sample: MotionSample) -> None:
        """A sample of an axis has arrived."""
        ...

    def alive(self, axis: str, time: float) -> None:
        """A drive's heartbeat has arrived, at ``time`` [s]."""
        ...


class MotionDriver(Protocol):
    """One axis under velocity control: the carriage of the blade, or its angle.

    SI and radians; the driver knows gear, lead and encoder.  Every method raises :class:`RigError` where the axis does
    not answer in time.
    """

    name: str
    """"blade" or "angle"."""
    latch: Latch
    """Whether it may move: while it is closed, nothing is sent that could give the drive power or speed."""

    def open(self, listener: MotionListener) -> None:
        """Connect, check who answers, write the set-up and read it back; samples arrive from now on, nothing moves."""
        ...

    def enable(self) -> None:
        """Power on, at speed zero.  Clears no fault: see :meth:`clear`."""
        ...

    def command(self, speed: float) -> None:
        """Put a target speed [m/s or rad/s] on the bus; does not wait for an answer."""
        ...

    def quick_stop(self, *, for_good: bool = False) -> None:
        """Put a quick stop on the bus and close the latch: at once, from any thread, without waiting.

        After one ``for_good`` the drive takes no command before it rests, and has no power then.
        """
        ...

    def abandon(self, why: str) -> None:
        """End what the drive knows us to be alive by: it does not obey, and has to stop by its own watch."""
        ...

    def disable(self) -> None:
        """Take the power off a blade at rest."""
        ...

    def clear(self) -> None:
        """Leave quick stop or fault for a powerless rest, within the latch's reset."""
        ...

    def limits(self) -> dict[str, float]:
        """Read back from the drive: "low", "high" (software limits), "speed", "acceleration", "quick_stop"."""
        ...

    def about(self) -> dict[str, float | str]:
        """What the open drive tells of itself, by name; a number's name ends with its unit."""
        ...

    def close(self) -> None:
        """Leave the axis at rest without power, and the bus; never raises, and may be called twice."""
        ...


class ForceDriver(Protocol):
    """A force sensor that streams."""

    rate: float
    """Readings a second [Hz]."""

    def open(self, listener: ForceListener) -> None:
        """Connect, read scales and units from the sensor itself, start streaming."""
        ...

    def tare(self, samples: int = 200) -> tuple[float, float, float]:
        """Take the mean of so many readings as zero; return what was subtracted since the start [N]."""
        ...

    def about(self) -> dict[str, float | str]:
        """What the open sensor tells of itself, by name; a number's name ends with its unit."""
        ...

    def close(self) -> None:
        """Stop streaming; never raises, and may be called twice."""
        ...
