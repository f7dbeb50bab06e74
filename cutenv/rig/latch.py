"""The state machine that a rig's supervisor and its axes share: whether the rig may move, and what changes that."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from enum import Enum, StrEnum
from types import MappingProxyType

from cutenv.rig.drivers import RigError


class Phase(StrEnum):
    """Whether a rig may move."""

    UNREADY = "unready"
    """Locked: drives may be switched on and off at speed zero."""
    READY = "ready"
    """Commands go to the drives."""
    STOPPED = "stopped"
    """Nothing but quick stops goes to the drives, until the operator agrees to a reset."""
    RESETTING = "resetting"
    """The operator has agreed, and the drives are being brought to a powerless rest."""


class Event(Enum):
    """What changes it."""

    STOP = "a quick stop, by whomever"
    AGREE = "the operator agrees to a reset"
    CLEARED = "every drive rests without power"
    FAILED = "a drive does not"
    RELEASE = "everything is there and within limits"
    LOCK = "the blade rests, and is to stay"


NEXT: Mapping[tuple[Phase, Event], Phase] = MappingProxyType(
    {
        (Phase.UNREADY, Event.STOP): Phase.STOPPED,
        (Phase.READY, Event.STOP): Phase.STOPPED,
        (Phase.RESETTING, Event.STOP): Phase.STOPPED,  # another one: the operator has agreed to the end of the first
        (Phase.STOPPED, Event.AGREE): Phase.RESETTING,
        (Phase.UNREADY, Event.AGREE): Phase.RESETTING,  # a drive that has stopped by itself
        (Phase.RESETTING, Event.CLEARED): Phase.UNREADY,
        (Phase.RESETTING, Event.FAILED): Phase.STOPPED,
        (Phase.UNREADY, Event.RELEASE): Phase.READY,
        (Phase.READY, Event.LOCK): Phase.UNREADY,
    }
)
"""Every way from one phase to another; any other event leaves it as it is."""


class Latch:
    """The phase of one rig; may be asked and changed from any thread.

    An axis alone has one of its own; a supervisor gives all its axes the same.
    """

    def __init__(self) -> None:
        self._phase = Phase.UNREADY
        self._changing = threading.Lock()

    @property
    def phase(self) -> Phase:
        """Present one."""
        return self._phase

    @property
    def closed(self) -> bool:
        """Whether nothing that could give a drive power or speed may be sent."""
        return self._phase in (Phase.STOPPED, Phase.RESETTING)

    def happens(self, event: Event) -> bool:
        """Go where :data:`NEXT` says; whether that is another phase."""
        with self._changing:
            after = NEXT.get((self._phase, event))
            self._phase = after or self._phase
            return after is not None

    @contextmanager
    def resetting(self) -> Iterator[None]:
        """Within the block, after the operator has agreed, the drives are cleared; at its end the rig is unready.

        Raises
        ------
        RigError
            If another stop came meanwhile; the rig is stopped then, as after any error in the block.
        """
        self.happens(Event.AGREE)
        try:
            yield
        except BaseException:
            self.happens(Event.FAILED)
            raise
        if not self.happens(Event.CLEARED):
            raise RigError("stopped again while it was being reset; see why, and reset it once more.")
