"""CAN bus of a rig, opened by python-can with the arguments of its interface, or by a client of socketcand.

python-can's own client waits for the gateway's answers for ever, and rejects a message that TCP has split. See
:mod:`cutenv.imitated.emulator.hub` for the protocol.
"""

from __future__ import annotations

import re
import select
import socket
import time
from collections import deque
from importlib import import_module
from typing import Any

from cutenv._base.validation import one_of
from cutenv.rig.config.settings import Bus
from cutenv.rig.errors import RigError

PATIENCE = 2.0
"""Time allowed for a gateway to accept the connection, and for each answer [s]."""
_LONGEST = 200  # characters of a message
_IDENTIFIER = r"([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})"
# More than 8 bytes are not a frame of CANopen; its listener ignores them.
_FRAME = re.compile(rf"< frame {_IDENTIFIER} \d+\.\d+ ((?:[0-9A-Fa-f]{{2}} ?){{0,64}}) ?>\Z")
_ERROR = re.compile(rf"< error {_IDENTIFIER} \d+\.\d+ >\Z")


class GatewayError(OSError):
    """Error for a gateway that is missing, is not one, does not answer, or has gone; the message says which."""


class Socketcand:
    """One CAN bus behind a gateway.

    Parameters
    ----------
    settings : Bus
        Host, port and channel.

    Raises
    ------
    GatewayError
        If the gateway does not greet, open the bus and switch to raw frames, within :data:`PATIENCE` for each.
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
        """Return the next frame as python-can's ``Message``; None if there is none within ``timeout`` [s].

        Text that is not a message of socketcand, and messages of other kinds, are ignored.

        Raises
        ------
        GatewayError
            If the gateway has gone, or sends an invalid frame.
        """
        if not self._frames and self._readable(timeout):
            for message in self._more():
                self._take(message)
        return self._frames.popleft() if self._frames else None

    def send(self, message: Any, timeout: float | None = None) -> None:
        """Put a frame on the bus.

        Raises
        ------
        GatewayError
            If the gateway does not accept it within ``timeout`` [s].
        """
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
        """Send a question, and wait for the answer in however many pieces it comes."""
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
        """Return the complete messages received so far; the rest is kept for later."""
        messages = []
        while (end := self._text.find(b">")) >= 0:
            start = self._text.rfind(b"<", 0, end)
            if start >= 0:
                messages.append(self._text[start : end + 1].decode("ascii", errors="backslashreplace"))
            self._text = self._text[end + 1 :]
        if len(self._text) > _LONGEST:
            start = self._text.rfind(b"<")
            self._text = self._text[start:] if 0 <= len(self._text) - start <= _LONGEST and start >= 0 else b""
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
    """Open the bus; return python-can's object, or for a socketcand gateway one with the same methods.

    Raises
    ------
    RigError
        If it cannot be opened; the message says what to check.
    ValueError
        If the interface is not among :data:`INTERFACES`.
    ModuleNotFoundError
        If python-can, or pyserial for slcan, is not installed.
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
    """Return the arguments of python-can's class for the interface.

    Raises
    ------
    ValueError
        If the channel is not valid for the interface.
    """
    if settings.interface == "socketcand":
        return {"channel": settings.channel, "host": settings.host, "port": settings.port}
    if settings.interface == "kvaser":
        if not settings.channel.isdecimal():
            raise ValueError(f"channel {settings.channel!r} is not one of Kvaser's, which are numbers: 0, 1, ...")
        return {"channel": int(settings.channel), "bitrate": settings.bitrate}
    if settings.interface in ("pcan", "slcan"):
        return {"channel": settings.channel, "bitrate": settings.bitrate}
    return {"channel": settings.channel}  # the bit rate of socketcan is set by the system, a virtual bus has none
