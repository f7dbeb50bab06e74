"""Interfaces to the hardware: an axis that moves, a sensor that measures, and the listeners that they report to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from cutenv.rig.devices.samples import ForceSample, MotionSample

if TYPE_CHECKING:
    from cutenv.rig.devices.latch import Latch


class MotionListener(Protocol):
    """Receiver of an axis's reports; called from the driver's threads, and must never wait."""

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
    """Receiver of a sensor's readings; called from the driver's thread for every packet, and must never wait."""

    def force(self, sample: ForceSample) -> None:
        """Take a reading that has arrived, in order of its sequence."""
        ...

    def garbled(self, why: str, time: float) -> None:
        """Take the report of a packet that is not a valid reading, at ``time`` [s]."""
        ...


class Observer(Protocol):
    """Receiver of the same reports as the supervisor; called in the drivers' threads, and must never wait."""

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
    """One axis under velocity control: the carriage of the blade, its angle, height, or place to the side.

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
        """Return the data that the open drive reports about itself; a number's name ends with its unit.

        Of an axis across the cut "homed" is among them: "yes", or "no".
        """
        ...

    def close(self) -> None:
        """Leave the axis at rest without power, and leave the bus; never raises, and may be called twice."""
        ...


@runtime_checkable
class ZeroedByHand(Protocol):
    """Axis without a reference of its own: a person puts it at the clamp, and says so, whenever it had no power."""

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
