"""CANopen network that a rig's axes share, on its CAN bus.

Listeners by frame number, SYNC, and this computer's heartbeat. The bus is opened by python-can with the arguments of
its interface, or by a client of socketcand.
"""

from __future__ import annotations

import logging
import re
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from importlib import import_module
from typing import Any, Protocol

from cutenv._base.validation import in_range, one_of
from cutenv.rig.config.settings import Bus
from cutenv.rig.devices.canopen.objects import HEARTBEAT_FRAME, NMT_FRAME, NMT_OPERATIONAL, SYNC_FRAME
from cutenv.rig.devices.loop import AT_ONCE, READ_EVERY, Clock, Repeating
from cutenv.rig.devices.protocols import Latch
from cutenv.rig.errors import RigError

PATIENCE = 2.0  # time allowed for a gateway to accept the connection, and for each answer [s]
_MAX_CHARACTERS = 200  # characters of a message
_IDENTIFIER = r"([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})"
# More than 8 bytes are not a frame of CANopen; its listener ignores them.
_FRAME = re.compile(rf"< frame {_IDENTIFIER} \d+\.\d+ ((?:[0-9A-Fa-f]{{2}} ?){{0,64}}) ?>\Z")
_ERROR = re.compile(rf"< error {_IDENTIFIER} \d+\.\d+ >\Z")


class GatewayError(OSError):
    """Error for a gateway that cannot be used."""


class Socketcand:
    """One CAN bus behind a gateway.

    Raise GatewayError if the gateway does not greet, open the bus and switch to raw frames, within :data:`PATIENCE` for
    each.
    """

    def __init__(self, settings: Bus) -> None:
        from can import Message

        self._message: Any = Message
        self._where = f"{settings.host}:{settings.port}"
        self._text = b""
        self._frames: deque[Any] = deque()
        try:
            self._socket = socket.create_connection((settings.host, settings.port), timeout=PATIENCE)
        except OSError as error:
            raise GatewayError(f"no CAN gateway at {self._where}: {error}") from error
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._expect("hi", "")
            self._expect("ok", f"< open {settings.channel} >")
            self._expect("ok", "< rawmode >")
        except BaseException:
            self._socket.close()
            raise

    def recv(self, timeout: float | None) -> Any:
        """Return the next frame as python-can's ``Message``.

        It is None if there is none within ``timeout`` [s].

        Text that is not a message of socketcand, and messages of other kinds, are ignored. Raise GatewayError if the
        gateway has gone, or sends an invalid frame.
        """
        if not self._frames and self._readable(timeout):
            for message in self._more():
                self._take(message)
        return self._frames.popleft() if self._frames else None

    def send(self, message: Any, timeout: float | None = None) -> None:
        """Put a frame on the bus within ``timeout`` [s]; raise GatewayError."""
        number = f"{message.arbitration_id:08X}" if message.is_extended_id else f"{message.arbitration_id:03X}"
        data = "".join(f" {byte:02X}" for byte in message.data)
        self._put(f"< send {number} {len(message.data)}{data} >", timeout)

    def shutdown(self) -> None:
        """Leave the bus."""
        self._socket.close()

    def _put(self, text: str, timeout: float | None) -> None:
        try:
            self._socket.settimeout(timeout)
            self._socket.sendall(text.encode("ascii", errors="replace"))
        except TimeoutError:
            raise GatewayError(f"the CAN gateway at {self._where} takes no more frames: is it hanging?") from None
        except OSError as error:
            raise GatewayError(f"the CAN gateway at {self._where} has gone: {error}") from error

    def _expect(self, answer: str, question: str) -> None:
        """Send a question; wait for the answer, in any pieces."""
        if question:
            self._put(question, PATIENCE)
        deadline = time.monotonic() + PATIENCE
        asked = f"answer to {question!r}" if question else "greeting"
        while True:
            if (text := self._text.lstrip()) and not text.startswith(b"<"):
                raise GatewayError(f"what answers at {self._where} is not a socketcand gateway: it sends {text[:40]!r}")
            if messages := self._messages():
                break
            left = deadline - time.monotonic()
            if left <= 0.0 or not self._readable(left):
                raise GatewayError(
                    f"the CAN gateway at {self._where} is connected to and silent: no {asked} within {PATIENCE:g} s"
                )
            self._text += self._bytes()
        if messages[0].strip("<> ") != answer:
            raise GatewayError(f"the CAN gateway at {self._where} gives {messages[0]!r} as {asked}, not '< {answer} >'")
        for message in messages[1:]:  # frames that came with the last answer
            self._take(message)

    def _readable(self, timeout: float | None) -> bool:
        try:
            return bool(select.select([self._socket], [], [], timeout)[0])
        except (OSError, ValueError) as error:  # closed meanwhile
            raise GatewayError(f"the CAN gateway at {self._where} cannot be read: {error}") from error

    def _bytes(self) -> bytes:
        try:
            received = self._socket.recv(4096)
            if hasattr(socket, "TCP_QUICKACK"):  # else the gateway's next small packet waits 40 ms for this answer
                self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
        except OSError as error:
            raise GatewayError(f"the CAN gateway at {self._where} has gone: {error}") from error
        if not received:
            raise GatewayError(f"the CAN gateway at {self._where} has hung up")
        return received

    def _more(self) -> list[str]:
        self._text += self._bytes()
        return self._messages()

    def _messages(self) -> list[str]:
        """Return complete messages received so far; keep the rest."""
        messages = []
        while (end := self._text.find(b">")) >= 0:
            start = self._text.rfind(b"<", 0, end)
            if start >= 0:
                messages.append(self._text[start : end + 1].decode("ascii", errors="backslashreplace"))
            self._text = self._text[end + 1 :]
        if len(self._text) > _MAX_CHARACTERS:
            start = self._text.rfind(b"<")
            self._text = self._text[start:] if 0 <= len(self._text) - start <= _MAX_CHARACTERS and start >= 0 else b""
        return messages

    def _take(self, message: str) -> None:
        """Store a frame, or an error frame, for :meth:`recv`."""
        if found := _FRAME.match(message):
            number, data = found[1], bytes.fromhex(found[2])
            extended = len(number) == 8
            self._frames.append(
                self._message(arbitration_id=int(number, 16), data=data, is_extended_id=extended, check=False)
            )
        elif found := _ERROR.match(message):
            self._frames.append(
                self._message(arbitration_id=int(found[1], 16) & 0x1FFFFFFF, is_error_frame=True, check=False)
            )
        elif message.startswith(("< frame", "< error")):
            raise GatewayError(f"the CAN gateway at {self._where} sends an invalid frame: {message!r}")


INTERFACES = ("socketcan", "pcan", "kvaser", "slcan", "socketcand", "virtual")
"""Interfaces that are known to work, in python-can's names."""
_CURES = {
    "socketcan": "Bring the interface up: ip link set {channel} up type can bitrate {bitrate}.",
    "pcan": "Is the adapter plugged in, is PCAN-Basic installed, is the channel right (PCAN_USBBUS1)?",
    "kvaser": "Is the adapter plugged in, is Kvaser's CANlib installed, is the channel right (0, 1, ...)?",
    "slcan": "Is the adapter plugged in, is the serial port right, may you open it?",
    "socketcand": "Is it (or `cutenv rig emulate`) running, are host, port and channel right?",
    "virtual": "A virtual bus lives within one process.",
}


def open_bus(settings: Bus) -> Any:
    """Open the bus.

    Return python-can's object, or for a socketcand gateway one with the same methods. Raise RigError if it cannot be
    opened; the message says what to check; ValueError if the interface is not among :data:`INTERFACES`;
    ModuleNotFoundError if python-can, or pyserial for slcan, is not installed.
    """
    one_of("interface", settings.interface, INTERFACES)
    import can

    if settings.interface == "slcan":
        import_module("serial")  # python-can would hide which module is missing
    if settings.interface == "socketcand":
        try:
            return Socketcand(settings)
        except GatewayError as error:
            raise RigError(f"{error}. {_CURES['socketcand']}") from error
    try:
        return can.Bus(interface=settings.interface, ignore_config=True, **bus_arguments(settings))
    except (can.CanError, OSError, ValueError, TypeError, NameError, AttributeError) as error:
        # NameError and AttributeError come from python-can if an adapter's library is not installed.
        cure = _CURES[settings.interface].format(channel=settings.channel, bitrate=settings.bitrate)
        raise RigError(
            f"no CAN bus at interface {settings.interface!r}, channel {settings.channel!r}: {error}. {cure}"
        ) from error


def bus_arguments(settings: Bus) -> dict[str, Any]:
    """Return the arguments of python-can's class for the interface."""
    if settings.interface == "socketcand":
        return {"channel": settings.channel, "host": settings.host, "port": settings.port}
    if settings.interface == "kvaser":
        if not settings.channel.isdecimal():
            raise ValueError(f"channel {settings.channel!r} is not one of Kvaser's, which are numbers: 0, 1, ...")
        return {"channel": int(settings.channel), "bitrate": settings.bitrate}
    if settings.interface == "slcan":  # which would wait a millisecond for every byte that is not there yet
        return {"channel": settings.channel, "bitrate": settings.bitrate, "timeout": 0.0}
    if settings.interface == "pcan":
        return {"channel": settings.channel, "bitrate": settings.bitrate}
    return {"channel": settings.channel}  # the bit rate of socketcan is set by the system, a virtual bus has none


_log = logging.getLogger(__name__)

DRIVE_PATIENCE = 0.100  # time without this computer's heartbeat after which a drive stops by itself [s]
_SEND_LIMIT = 0.02  # [s] for the bus to accept a frame
_LISTENED = 0.15  # [s] before the first frame is sent: three heartbeats of another program like this one
_FORGIVEN = 1.0  # [s] after which one answer to SYNC that has not come no longer counts
# answers to SYNC taken for lost, at most, until a reset: a bus that is later and later seems to lose them as well
TAKEN_FOR_LOST = 10
_SDO_REQUESTS = range(0x601, 0x680)
_BUS_OFF = 0x40  # in the number of an error frame, as Linux and socketcand give it

Handler = Callable[[bytes, float], None]


class Member(Protocol):
    """Member of a network.

    One axis, which is informed when the network breaks.
    """

    name: str  # name of the axis
    latch: Latch  # latch of the rig, which knows when it was last judged, and which heartbeats are withheld

    def lost(self, why: str, time: float) -> None:
        """Take the report of a lost bus since ``time`` [s]."""
        ...

    def overheard(self, number: int, data: bytes, time: float) -> None:
        """Take another's frame that has no listener, perhaps not a drive's."""
        ...


class CanNetwork:
    """One CAN bus with this computer as its master.

    Opened by the first axis that joins, closed by the last to leave.

    Before anything is sent it listens for another master, whose drives it would disturb; if there is one, it stays
    silent.

    It breaks, once, at the first frame that cannot be sent, read or handled, or when the bus goes off. From then on
    neither SYNC nor heartbeat is sent, so that the drives stop by themselves; other frames are still attempted.
    ``clock`` paces SYNC and heartbeat, and dates what arrives. Raise ValueError if two heartbeats do not fit into
    :data:`DRIVE_PATIENCE`.
    """

    def __init__(self, settings: Bus, clock: Clock) -> None:
        in_range(
            "bus.heartbeat", settings.heartbeat, 0.0, DRIVE_PATIENCE / 2, "s",
            "A drive stops after 0.1 s without; two must fit into it, for one may be late.",
        )  # fmt: skip
        self.settings = settings
        self.broken: str | None = None  # reason why nothing gets through, None while all is well
        self._clock = clock
        self._members: list[Member] = []
        self._handlers: dict[int, Handler] = {}
        self._joining = threading.Lock()
        self._sending = threading.Lock()
        self._bus: Any = None
        self._message: Any = None
        self._repeating: list[Repeating] = []
        self._syncs = 0
        self._answers: dict[int, int] = {}
        self._usual: dict[int, tuple[int, int, int]] = {}  # answers always under way, since which SYNC; taken for lost

    def __str__(self) -> str:
        return f"{self.settings.interface} {self.settings.channel}"

    def join(self, member: Member) -> None:
        """Add a member; the first opens the bus."""
        with self._joining:
            if not self._members:
                self._open()
            if self.broken is not None:
                raise RigError(f"the CAN bus ({self}) is broken: {self.broken}. Close its axes, and open them again.")
            self._members.append(member)

    def leave(self, member: Member) -> None:
        """Remove a member; the last closes the bus. Never raises, may be repeated."""
        with self._joining:
            if member in self._members:
                self._members.remove(member)
                if not self._members:
                    self._close()

    def listen(self, number: int, handler: Handler) -> None:
        """Call ``handler(data, time)`` from the loop for matching frames."""
        self._handlers[number] = handler

    def ignore(self, number: int) -> None:
        """Stop listening to frames with that number."""
        self._handlers.pop(number, None)

    def send_message(self, can_id: int, data: bytes) -> None:
        """Put a frame on the bus, from any thread.

        It waits only for its place in the queue. The name is the one that canopen's SDO client calls. Raise RigError if
        the bus does not accept it, which breaks the network.
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
        """Return a node's unanswered SYNCs since its first answer.

        They are under way where the bus delivers later and later, which the time of their arrival does not show. One
        a second is taken for lost, :data:`TAKEN_FOR_LOST` at most until the next reset.
        """
        answers = self._answers.get(node, 0)
        behind = self._syncs - answers
        usual, since, lost = self._usual.get(node, (behind, self._syncs, 0))
        if answers <= 1 or behind < usual:
            usual, since, lost = behind, self._syncs, max(lost - max(usual - behind, 0), 0)
        elif lost < TAKEN_FOR_LOST and self._syncs - since >= round(_FORGIVEN / self.settings.sync):
            usual, since, lost = usual + 1, self._syncs, lost + 1
        self._usual[node] = usual, since, lost
        return behind - usual

    def settle(self, node: int) -> None:
        """Take a node's unanswered SYNCs as usual, after a reset at rest."""
        self._usual[node] = self._syncs - self._answers.get(node, 0), self._syncs, 0

    def manage(self, command: int, node: int) -> None:
        """Send a network management command to a node."""
        self.send_message(NMT_FRAME, bytes((command, node)))

    def _open(self) -> None:
        bus = open_bus(self.settings)
        try:
            self._refuse_another_master(bus)
        except BaseException:
            bus.shutdown()
            raise
        import can

        self._use(bus, can.Message)

    def _use(self, bus: Any, message: Any) -> None:
        """Read an open bus and send on it from now on; ``message`` makes a frame."""
        self._bus, self._message, self.broken = bus, message, None
        self._syncs = 0
        self._answers.clear()
        self._usual.clear()
        self._repeating = [
            self._clock.every(READ_EVERY, lambda now: self._read(bus), "cutenv CAN"),
            self._clock.every(self.settings.sync, lambda now: self._sync(), "cutenv SYNC"),
            self._clock.every(self.settings.heartbeat, lambda now: self._beat(), "cutenv heartbeat"),
        ]

    def _refuse_another_master(self, bus: Any) -> None:
        """Listen before sending; raise RigError if another master commands drives."""
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
        bus, self._bus = self._bus, None
        try:
            bus.shutdown()
        except Exception:  # whatever the interface's library raises: leave the bus anyway
            _log.warning("the CAN bus (%s) was not closed in order", self, exc_info=True)

    def _sync(self) -> None:
        self._syncs += 1
        self._repeat(SYNC_FRAME, b"")

    def _beat(self) -> None:
        now = self._clock.now()
        if all(member.latch.allows_heartbeat(member.name, now) for member in tuple(self._members)):  # SYNC goes on
            self._repeat(HEARTBEAT_FRAME + self.settings.node, bytes((NMT_OPERATIONAL,)))

    def _repeat(self, number: int, data: bytes) -> None:
        if self.broken is None:
            try:
                self.send_message(number, data)
            except RigError as error:  # the break itself informs the members
                _log.warning("%s", error)

    def _read(self, bus: Any) -> None:
        """Handle the frames that have arrived; inform the members of a break, of which they take the first report."""
        if self.broken is not None:
            for member in tuple(self._members):
                member.lost(self.broken, self._clock.now())
        for _ in range(AT_ONCE):
            try:
                message = bus.recv(0.0)
            except Exception as error:  # python-can's interfaces raise what their libraries do
                self._break(f"nothing can be read any more: {_brief(error)}")
                return
            if message is None:
                return
            if message.is_error_frame:
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
        except Exception as error:  # the others have to be handled, for the other axis and to see the blade stop
            _log.exception("frame 0x%03X could not be handled", number)
            self._break(f"frame 0x{number:03X} could not be handled: {error!r}")

    def _break(self, why: str) -> RigError:
        """Note that the network is broken; return the error.

        The loop informs the members: the sender may hold the very lock that one of them needs to stop the blade.
        """
        self.broken = self.broken or why
        return RigError(f"the CAN bus ({self}) is broken: {why}.")


def _brief(error: Exception) -> str:
    """Return an error's own text, without any added traceback."""
    return str(error).partition("Traceback")[0].strip() or repr(error)
