"""Haptic devices of Force Dimension (omega, delta, sigma, Falcon) by ``forcedimension_core``.

That package calls the vendor's library, libdrd of the Force Dimension SDK 3.16 or later, which you install yourself;
``FDSDK`` names its folder. It needs a Python below 3.13. Positions are in metres, forces in newtons; x points towards
the person, y to the right, z upwards: hence the axes ``y,x,z``.
"""

from __future__ import annotations

import contextlib
from typing import Any

from cutenv.people.play.haptics import VirtualCoupling
from cutenv.people.play.polled_handle import HandleAxes, HandleSample, checked_sample

FORCE_DIMENSION_AXES = HandleAxes(along="y", lean="x", up="z")
"""Axes of a device that stands in front of a person."""
FORCE_DIMENSION_COUPLING = VirtualCoupling(
    stiffness=150.0, damping=0.1, device_damping=0.5, device_mass=0.2, period=0.005
)
"""Coupling for a force that a program in Python holds for 5 ms at most.

The device's damping is assumed: measure it.
"""
_BUTTONS = ("next", "repeat")


class ForceDimensionLink:
    """Link to the first device of the SDK, for :class:`cutenv.people.play.polled_handle.PolledHandle`."""

    def __init__(self) -> None:
        self._dhd: Any = None

    def open(self) -> None:
        """Open the device and its force; OSError says what is missing."""
        try:
            from forcedimension_core import dhd
        except ModuleNotFoundError as error:
            if error.name != "forcedimension_core":
                raise
            raise OSError(
                "forcedimension_core, which wants a Python below 3.13, is not installed: "
                "pip install 'cutenv[force-dimension]'"
            ) from None
        except ImportError:
            raise OSError(
                "libdrd of the Force Dimension SDK is not found. Install the SDK, 3.16 or later, and set FDSDK to its "
                "folder."
            ) from None
        if dhd.open() < 0:
            raise OSError(f"no device of Force Dimension: {_reason(dhd)}. Connect it, and close other programs.")
        self._dhd = dhd
        if dhd.enableForce(True) < 0:
            reason = _reason(dhd)
            self.close()
            raise OSError(f"the device gives no force: {reason}. Calibrate it, and press its force button.")

    def exchange(self, force: tuple[float, float, float]) -> HandleSample:
        """Set a force [N] and read the position [m]; see :class:`cutenv.people.play.polled_handle.HandleLink`."""
        dhd, place = self._dhd, [0.0, 0.0, 0.0]
        if dhd.setForce(force) < 0 or dhd.getPosition(place) < 0:
            raise ValueError(f"the device did not answer: {_reason(dhd)}.")
        mask = dhd.getButtonMask()
        held = frozenset(name for bit, name in enumerate(_BUTTONS) if mask & 1 << bit)
        return checked_sample((place[0], place[1], place[2]), held)

    def close(self) -> None:
        """Zero the force and close the device; further calls do nothing."""
        dhd, self._dhd = self._dhd, None
        if dhd is not None:
            with contextlib.suppress(Exception):  # a device that is gone must not keep the session from its end
                dhd.setForce((0.0, 0.0, 0.0))
            dhd.close()


def _reason(dhd: Any) -> str:
    return str(dhd.errorGetLastStr())
