"""Work of a rig's environment, the actions that it is given, neither of which may delay a stop, and its angle."""

from __future__ import annotations

import math
import reprlib
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.validation import in_range, one_of
from cutenv.rig.config.settings import RigSettings

_SAME_ANGLE = math.radians(0.5)


class Work:
    """Reset or step in progress: a signal handler that wants to close the rig in its midst has to wait for its end.

    A handler interrupts its thread anywhere, perhaps under a lock that closing needs.

    Parameters
    ----------
    leave : callable
        Closes the rig.
    """

    def __init__(self, leave: Callable[[], None]) -> None:
        self._leave = leave
        self._worker: int | None = None
        self._leaving = False

    @contextmanager
    def going_on(self) -> Iterator[None]:
        """Mark the block as work of this thread, and close the rig at its end if :meth:`postpones` was asked."""
        self._worker = threading.get_ident()
        try:
            yield
        finally:
            self._worker = None
            if self._leaving:
                self._leaving = False
                self._leave()

    def postpones(self) -> bool:
        """Return True if the rig cannot be closed here and now; it is then closed when the work ends."""
        if self._worker != threading.get_ident():
            return False
        self._leaving = True
        return True


def numbers(action: Any, count: int) -> NDArray[np.float64] | None:
    """Return the ``count`` numbers of an action; None for anything else that a policy may return."""
    try:
        command = np.array(action, np.float64)
    except Exception:  # the conversion of any object may raise anything, and the blade has to be stopped first
        return None
    return command if command.shape == (count,) and np.isfinite(command).all() else None


def action_text(action: Any) -> str:
    """Return an action in short, for a message."""
    try:
        return reprlib.repr(action)
    except Exception:  # the object's own method may raise anything
        return f"a {type(action).__name__}"


def blade_angle(settings: RigSettings, mode: str | None, fixed_deg: float | None) -> tuple[str, float | None]:
    """Return the mode of the blade's angle, "free" or "fixed", and the fixed angle [rad]; None where it is free.

    ``mode`` and ``fixed_deg`` [deg] are what a task asks for; None: as the rig has it.

    Raises
    ------
    ValueError
        If the rig cannot do it, or a value is not valid.
    """
    mode = settings.angle_mode if mode is None else one_of("angle_mode", mode, ("free", "fixed"))
    if mode == "free" and settings.angle_mode == "fixed":
        raise ValueError(
            f'angle_mode = "free", but the angle of rig {settings.name!r} is set by hand, at '
            f"{math.degrees(settings.fixed_angle):.0f} degrees. Use a policy that was trained with "
            'angle_mode="fixed" at that angle, or a rig with a second axis.'
        )
    fixed = settings.fixed_angle
    if fixed_deg is not None:
        in_range("fixed_angle_deg", fixed_deg, 45.0, 90.0, "deg", "Measured are 45 to 90 degrees.")
        fixed = math.radians(fixed_deg)
        if settings.angle_mode == "fixed" and abs(fixed - settings.fixed_angle) > _SAME_ANGLE:
            raise ValueError(
                f"fixed_angle_deg = {fixed_deg:g}, but the blade of rig {settings.name!r} is set to "
                f"{math.degrees(settings.fixed_angle):.1f} degrees. Turn it, and write that into its file."
            )
    return mode, fixed if mode == "fixed" else None
