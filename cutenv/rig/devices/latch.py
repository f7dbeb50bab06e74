"""State machine that a rig's supervisor and its axes share: the states, and the events that change them."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from enum import Enum, StrEnum
from types import MappingProxyType

from cutenv.rig.errors import RigError


class Phase(StrEnum):
    """State of a rig, which decides whether it may move."""

    UNREADY = "unready"
    """Locked: drives may be switched on and off at zero speed."""
    READY = "ready"
    """Released: commands go to the drives."""
    STOPPED = "stopped"
    """Stopped: only quick stops go to the drives, until the operator agrees to a reset."""
    RESETTING = "resetting"
    """Being reset: the operator has agreed, and the drives are brought to rest without power."""


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


class Latch:
    """Phase of one rig; may be read and changed from any thread.

    An axis without a supervisor has its own; a supervisor shares one with all its axes.
    """

    def __init__(self) -> None:
        self._phase = Phase.UNREADY
        self._changing = threading.Lock()

    @property
    def phase(self) -> Phase:
        """Present phase."""
        return self._phase

    @property
    def closed(self) -> bool:
        """True while nothing may be sent that could give a drive power or speed."""
        return self._phase in (Phase.STOPPED, Phase.RESETTING)

    def happens(self, event: Event) -> bool:
        """Change the phase as :data:`NEXT` defines; return whether it has an entry for this event."""
        with self._changing:
            after = NEXT.get((self._phase, event))
            self._phase = after or self._phase
            return after is not None

    @contextmanager
    def resetting(self) -> Iterator[None]:
        """Enter the resetting phase for the block, which clears the drives; the rig is locked at its end.

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
