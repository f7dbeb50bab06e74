"""Hand that takes over from an agent, for :class:`cutenv.envs.SharedControl`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cutenv.people.play.haptics import HapticDevice
from cutenv.task.observation import SPEED_SCALE, to_action

_BUTTON = "next"  # the first button of a grip
LEASH = 0.010
"""Distance by which the hand may be ahead of the blade that follows it [m]."""
_SOON = 2.0  # decisions in which the blade is brought to where the hand is


class InterveningHand:
    """Person's action while the first button is held.

    Call it once a decision.

    When the button goes down, the hand is where the blade is, wherever the device stands: the person moves it from
    there. Speed and angle follow the hand. One that gets ahead of the blade by more than :data:`LEASH`, because the
    device jumps, reads what is no place, or is moved faster than any blade, is followed no more: the blade stands until
    the button is pressed anew. The device pushes nothing: a force that is new only with every decision would not be
    passive.

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
        self._lost = False  # it got away since the button went down
        self._grabbed: float | None = None  # place of the blade less that of the hand when the button went down [m]

    def __call__(self) -> NDArray[np.float32] | None:
        """Return the action toward the hand, None while released."""
        stylus, blade = self._device.read(), self._blade()
        if _BUTTON not in stylus.buttons:
            self._grabbed = None
            return None
        if self._grabbed is None:
            self._grabbed, self._lost = blade - stylus.position, False
        ahead = self._grabbed + stylus.position - blade
        self._lost |= not abs(ahead) <= LEASH
        speed = 0.0 if self._lost else self._gain * ahead
        return to_action(min(max(speed, -SPEED_SCALE), SPEED_SCALE), stylus.angle)
