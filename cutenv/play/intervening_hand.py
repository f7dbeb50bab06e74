"""Hand on a device that takes over from an agent while its button is held, for :class:`cutenv.envs.SharedControl`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cutenv.play.haptics import HapticDevice
from cutenv.task.observation import SPEED_SCALE, to_action

_BUTTON = "next"  # the first button of a grip
FASTEST_HAND = 0.5
"""Speed beyond which it is not a hand that moves the device, but a fault [m/s]."""
_SOON = 2.0  # decisions in which the blade is brought to where the hand is


class InterveningHand:
    """Person's action while the first button is held; call it once a decision.

    When the button goes down, the hand is where the blade is, wherever the device stands: the person moves it from
    there. Speed and angle follow the hand. A device that jumps farther than any hand moves in one decision, or reads what
    is no place, is not followed: the blade stands until the button is pressed anew. The device pushes nothing: a force that is new only with every decision
    would not be passive.

    Parameters
    ----------
    device : HapticDevice
        Device, open.
    blade : callable
        Returns the present position of the blade [m].
    control_hz : int
        Decisions a second.
    """

    def __init__(self, device: HapticDevice, blade: Callable[[], float], *, control_hz: int) -> None:
        self._device, self._blade = device, blade
        self._gain = control_hz / _SOON
        self._leap = FASTEST_HAND / control_hz
        self._last = 0.0  # [m] place of the hand at the decision before
        self._lost = False  # it has jumped since the button went down
        self._grabbed: float | None = None  # place of the blade less that of the hand when the button went down [m]

    def __call__(self) -> NDArray[np.float32] | None:
        """Return the action that brings the blade after the hand, None while the button is up."""
        stylus, blade = self._device.read(), self._blade()
        if _BUTTON not in stylus.buttons:
            self._grabbed = None
            return None
        if self._grabbed is None:
            self._grabbed, self._lost = blade - stylus.position, False
        elif not abs(stylus.position - self._last) <= self._leap:
            self._lost = True
        self._last = stylus.position
        if self._lost:
            return to_action(0.0, stylus.angle)
        speed = self._gain * (self._grabbed + stylus.position - blade)
        return to_action(min(max(speed, -SPEED_SCALE), SPEED_SCALE), stylus.angle)
