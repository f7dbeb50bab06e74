"""CANopen network that a rig's axes share: listeners by frame number, SYNC, and this computer's heartbeat."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

from cutenv._base.validation import in_range
from cutenv.rig.config.settings import Bus
from cutenv.rig.devices.canopen.bus import open_bus
from cutenv.rig.devices.canopen.objects import HEARTBEAT_FRAME, NMT_FRAME, NMT_OPERATIONAL, SYNC_FRAME
from cutenv.rig.devices.drivers import Latch
from cutenv.rig.devices.host import Clock, Repeating
from cutenv.rig.errors import RigError

_log = logging.getLogger(__name__)

DRIVE_PATIENCE = 0.100
"""Time without this computer's heartbeat after which a drive stops by itself [s]."""
_SEND_LIMIT = 0.02  # [s] for the bus to accept a frame
_READ_LIMIT = 0.1  # [s] after which the reader checks whether it has to end
_LISTENED = 0.15  # [s] before the first frame is sent: three heartbeats of another program like this one
_FORGIVEN = 1.0  # [s] after which one answer to SYNC that was lost no longer counts
_SDO_REQUESTS = range(0x601, 0x680)
_BUS_OFF = 0x40  # in the number of an error frame, as Linux and socketcand give it

Handler = Callable[[bytes, float], None]


class Member(Protocol):
    """Member of a network: one axis, which is informed when the network breaks."""

    latch: Latch
    """Latch of the rig, which knows when it was last judged."""

    def lost(self, why: str, time: float) -> None:
        """Take the report that nothing can be sent or read any more, since ``time`` [s]."""
        ...

    def overheard(self, number: int, data: bytes, time: float) -> None:
        """Take a frame without a listener: not sent by us, and perhaps not by a drive."""
        ...


class CanNetwork:
    """One CAN bus with this computer as its master; opened by the first axis that joins, closed by the last to leave.

    Before anything is sent it listens for another master, whose drives it would disturb; if there is one, it stays
    silent.

    It breaks, once, at the first frame that cannot be sent, read or handled, or when the bus goes off. From then on
    neither SYNC nor heartbeat is sent, so that the drives stop by themselves; other frames are still attempted.

    Parameters
    ----------
    settings : Bus
        Interface, periods, node of this computer.
    clock : Clock
        Paces SYNC and heartbeat, and dates what arrives.

    Raises
    ------
    ValueError
        If two heartbeats do not fit into :data:`DRIVE_PATIENCE`.
    """

    def __init__(self, settings: Bus, clock: Clock) -> None:
        in_range(
            "bus.heartbeat", settings.heartbeat, 0.0, DRIVE_PATIENCE / 2, "s",
            "A drive stops after 0.1 s without; two must fit into it, for one may be late.",
        )  # fmt: skip
        self.settings = settings
        self.broken: str | None = None
        """Reason why nothing gets through, None while all is well."""
        self._clock = clock
        self._members: list[Member] = []
        self._handlers: dict[int, Handler] = {}
        self._joining = threading.Lock()
        self._sending = threading.Lock()
        self._breaking = threading.Lock()
        self._bus: Any = None
        self._message: Any = None
        self._reader: threading.Thread | None = None
        self._ending = threading.Event()
        self._repeating: list[Repeating] = []
        self._silent = False
        self._syncs = 0
        self._answers: dict[int, int] = {}
        self._usual: dict[int, tuple[int, int]] = {}  # answers that are always under way, and the SYNC it is since

    def __str__(self) -> str:
        return f"{self.settings.interface} {self.settings.channel}"

    def join(self, member: Member) -> None:
        """Add a member; the first opens the bus.

        Raises
        ------
        RigError
            If the bus cannot be opened or is broken, or another master is on it.
        """
        with self._joining:
            if not self._members:
                self._open()
            if self.broken is not None:
                raise RigError(f"the CAN bus ({self}) is broken: {self.broken}. Close its axes, and open them again.")
            self._members.append(member)

    def leave(self, member: Member) -> None:
        """Remove a member; the last closes the bus. Never raises, and may be called twice."""
        with self._joining:
            if member in self._members:
                self._members.remove(member)
                if not self._members:
                    self._close()

    def listen(self, number: int, handler: Handler) -> None:
        """Call ``handler(data, time)`` from the reader's thread for every frame with that number."""
        self._handlers[number] = handler

    def ignore(self, number: int) -> None:
        """Stop listening to frames with that number."""
        self._handlers.pop(number, None)

    def send_message(self, can_id: int, data: bytes) -> None:
        """Put a frame on the bus, from any thread, waiting only for its place in the queue.

        The name is the one that canopen's SDO client calls.

        Raises
        ------
        RigError
            If the bus does not accept it, which breaks the network.
        """
        bus = self._bus
        if bus is None:
            raise RigError(f"the CAN bus ({self}) is not open.")
        message = self._message(arbitration_id=can_id, data=data, is_extended_id=False)
        if not self._sending.acquire(timeout=_SEND_LIMIT):
            raise self._break("it takes no more frames (is the gateway hanging?)")
        try:
            bus.send(message, timeout=_SEND_LIMIT)
        except Exception as error:  # python-can's interfaces raise what their libraries do
            raise self._break(f"frame 0x{can_id:03X} could not be sent: {_brief(error)}") from error
        finally:
            self._sending.release()

    def answered(self, node: int) -> None:
        """Count an answer of a node to SYNC."""
        self._answers[node] = self._answers.get(node, 0) + 1

    def unanswered(self, node: int) -> int:
        """Return how many SYNCs since the first answer a node has not answered yet; they are forgiven one a second.

        They are under way where the bus delivers later and later, which the time of their arrival does not show.
        """
        answers = self._answers.get(node, 0)
        behind = self._syncs - answers
        usual, since = self._usual.get(node, (behind, self._syncs))
        if answers <= 1 or behind < usual:
            usual, since = behind, self._syncs
        elif self._syncs - since >= round(_FORGIVEN / self.settings.sync):
            usual, since = usual + 1, self._syncs
        self._usual[node] = usual, since
        return behind - usual

    def settle(self, node: int) -> None:
        """Take the SYNCs that a node has not answered by now as usual, as at its opening: after a reset, at rest."""
        self._usual[node] = self._syncs - self._answers.get(node, 0), self._syncs

    def manage(self, command: int, node: int) -> None:
        """Send a network management command to a node.

        Raises
        ------
        RigError
            If the bus does not accept it.
        """
        self.send_message(NMT_FRAME, bytes((command, node)))

    def withhold_heartbeat(self) -> None:
        """Stop sending heartbeats: the watchdog of every drive then stops it."""
        self._silent = True

    def resume_heartbeat(self) -> None:
        """Send heartbeats again."""
        self._silent = False

    def _open(self) -> None:
        bus = open_bus(self.settings)
        try:
            self._refuse_another_master(bus)
        except BaseException:
            bus.shutdown()
            raise
        self._bus = bus
        import can

        self._message = can.Message
        self.broken, self._silent = None, False
        self._ending = threading.Event()
        self._reader = threading.Thread(
            target=self._read, args=(self._bus, self._ending), name="cutenv CAN reader", daemon=True
        )
        self._reader.start()
        self._repeating = [
            self._clock.every(self.settings.sync, lambda now: self._sync(), "cutenv SYNC"),
            self._clock.every(self.settings.heartbeat, lambda now: self._beat(), "cutenv heartbeat"),
        ]

    def _refuse_another_master(self, bus: Any) -> None:
        """Listen, before anything is sent, and raise RigError if another master commands the drives of this bus."""
        ours = HEARTBEAT_FRAME + self.settings.node
        ends = time.monotonic() + _LISTENED
        while (left := ends - time.monotonic()) > 0.0:
            try:
                message = bus.recv(left)
            except Exception as error:  # python-can's interfaces raise what their libraries do
                raise RigError(f"the CAN bus ({self}) cannot be read: {_brief(error)}.") from error
            if message is None or message.is_error_frame or message.is_extended_id or message.is_remote_frame:
                continue
            number = message.arbitration_id
            if number == ours:
                what = f"a heartbeat as node {self.settings.node}, which this computer is to be"
            elif number in (SYNC_FRAME, NMT_FRAME):
                what = "SYNC" if number == SYNC_FRAME else "commands of network management"
            elif number in _SDO_REQUESTS:
                what = f"questions to node {number - _SDO_REQUESTS.start + 1}"
            else:
                continue
            raise RigError(
                f"another master is on the CAN bus ({self}): it sends {what}. Does another program use this rig? End "
                "it first. Nothing was sent to the drives."
            )

    def _close(self) -> None:
        for repeating in self._repeating:
            repeating.stop()
        self._ending.set()
        if self._reader is not None and self._reader is not threading.current_thread():
            self._reader.join(timeout=1.0)
        bus, self._bus = self._bus, None
        try:
            bus.shutdown()
        except Exception:  # whatever the interface's library raises: leave the bus anyway
            _log.warning("the CAN bus (%s) was not closed in order", self, exc_info=True)

    def _sync(self) -> None:
        self._syncs += 1
        self._repeat(SYNC_FRAME, b"")

    def _beat(self) -> None:
        if not self._silent and all(member.latch.watched(self._clock.now()) for member in tuple(self._members)):
            self._repeat(HEARTBEAT_FRAME + self.settings.node, bytes((NMT_OPERATIONAL,)))

    def _repeat(self, number: int, data: bytes) -> None:
        if self.broken is None:
            try:
                self.send_message(number, data)
            except RigError as error:  # the break itself informs the members
                _log.warning("%s", error)

    def _read(self, bus: Any, ending: threading.Event) -> None:
        while not ending.is_set():
            try:
                message = bus.recv(_READ_LIMIT)
            except Exception as error:  # python-can's interfaces raise what their libraries do
                if not ending.is_set():
                    self._break(f"nothing can be read any more: {_brief(error)}")
                return
            if message is None:
                if self.broken is not None:
                    ending.wait(_READ_LIMIT)  # a closed connection reads as nothing, immediately and for ever
            elif message.is_error_frame:
                if message.arbitration_id & _BUS_OFF:
                    self._break("the adapter went bus-off: check wiring, termination and bit rate")
            elif not (message.is_remote_frame or message.is_extended_id):
                self._handle(message.arbitration_id, bytes(message.data))

    def _handle(self, number: int, data: bytes) -> None:
        handler = self._handlers.get(number)
        try:
            if handler is not None:
                handler(data, self._clock.now())
                return
            for member in tuple(self._members):
                member.overheard(number, data, self._clock.now())
        except Exception as error:  # the reader must go on, for the other axis and to see the blade stop
            _log.exception("frame 0x%03X could not be handled", number)
            self._break(f"frame 0x{number:03X} could not be handled: {error!r}")

    def _break(self, why: str) -> RigError:
        """Inform the members once that the network is broken; return the error for the caller to raise."""
        with self._breaking:
            first, self.broken = self.broken is None, self.broken or why
        if first:
            # From a separate thread: the sender may hold the very lock that a member needs to stop the blade.
            threading.Thread(
                target=self._tell, args=(why, self._clock.now()), name="cutenv CAN broken", daemon=True
            ).start()
        return RigError(f"the CAN bus ({self}) is broken: {why}.")

    def _tell(self, why: str, time: float) -> None:
        for member in tuple(self._members):
            member.lost(why, time)


def _brief(error: Exception) -> str:
    """Return the error's own text, without the traceback that some of python-can's interfaces add."""
    return str(error).partition("Traceback")[0].strip() or repr(error)
