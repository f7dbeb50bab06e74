"""CAN bus over TCP.

A hub for clients of socketcand, such as python-can.

Messages are ASCII between angle brackets: the hub greets with ``< hi >``, the client sends ``< open NAME >`` and ``<
rawmode >``, and frames are then sent as ``< send ID LENGTH BYTES >`` and ``< frame ID TIME DATA >``, with numbers in
hex. An identifier of three digits is a standard one, of eight an extended one. See
https://github.com/linux-can/socketcand.
"""

from __future__ import annotations

import re
import selectors
import socket
import threading
import time
from collections.abc import Callable
from typing import NamedTuple

_MAX_CHARACTERS = 200  # characters of a message
_UNSENT = 1 << 18  # bytes that may wait for a slow client, some seconds of a full bus
_MAX_CLIENTS = 16  # clients
_SETTLING = 0.02  # [s] between rawmode and the first frame: the client reads its last "< ok >" alone
_OPEN = re.compile(r"open [\w.:-]{1,32}\Z")
_IDENTIFIER = re.compile(r"(?:[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\Z")
_BYTE = re.compile(r"[0-9A-Fa-f]{1,2}\Z")


class Frame(NamedTuple):
    """CAN frame."""

    identifier: int  # identifier of 11 bits, or 29 if ``extended``
    data: bytes  # data, 0 to 8 bytes
    extended: bool = False  # True for an identifier of 29 bits


class BadMessage(ValueError):
    """Error for client text that is no socketcand message."""


def parsed_send(content: str) -> Frame:
    """Parse ``send ID LENGTH BYTES`` into a frame; raise BadMessage if the text is anything else."""
    words = content.split()
    if len(words) < 3 or words[0] != "send" or not _IDENTIFIER.match(words[1]):
        raise BadMessage(f"{content!r} is not 'send ID LENGTH BYTES' with an ID of 3 or 8 hexadecimal digits")
    identifier, extended, data = int(words[1], 16), len(words[1]) == 8, words[3:]
    if not (words[2].isdecimal() and words[2].isascii() and int(words[2]) == len(data) <= 8):
        raise BadMessage(f"{content!r} has {len(data)} bytes; a frame has 0 to 8, and as many as LENGTH states")
    if not all(_BYTE.match(word) for word in data):
        raise BadMessage(f"{content!r} has bytes that are not hexadecimal")
    if identifier >= (1 << 29 if extended else 1 << 11):
        raise BadMessage(f"identifier {identifier:X} does not fit into {29 if extended else 11} bits")
    return Frame(identifier, bytes(int(word, 16) for word in data), extended)


def frame_text(frame: Frame, moment: float) -> bytes:
    """Return the message of ``frame`` at ``moment`` [s since 1970]."""
    identifier = f"{frame.identifier:08X}" if frame.extended else f"{frame.identifier:03X}"
    return f"< frame {identifier} {moment:.6f} {frame.data.hex().upper()} >".encode()


class _Client:
    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.received = ""
        self.unsent = b""
        self.opened = False
        self.listens_from: float | None = None  # None: not in raw mode

    def listens(self, now: float) -> bool:
        return self.listens_from is not None and now >= self.listens_from


class Hub:
    """Server of socketcand on a TCP port.

    It passes each client's frames to the others and to ``receive``. ``receive``: called with every :class:`Frame` of a
    client, from the hub's thread; frames that it sends by :meth:`send` go out at once; ``host``, ``port``: address to
    listen on; port 0 takes a free one.
    """

    def __init__(self, receive: Callable[[Frame], None], *, host: str = "127.0.0.1", port: int = 0) -> None:
        self._receive = receive
        self._lock = threading.RLock()
        self._clients: dict[socket.socket, _Client] = {}
        self._listener = socket.create_server((host, port))
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]  # port that it listens on
        self._wake, self._woken = socket.socketpair()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="CAN hub", daemon=True)
        self._thread.start()

    def send(self, frame: Frame) -> None:
        """Put a frame on the bus, from any thread, without waiting."""
        self._distribute(frame, None)

    @property
    def clients(self) -> int:
        """Number of connected clients."""
        with self._lock:
            return len(self._clients)

    def close(self) -> None:
        """Disconnect every client."""
        if self._closing:
            return
        self._closing = True
        self._wake.send(b"x")
        self._thread.join(timeout=2.0)
        with self._lock:
            for client in list(self._clients.values()):
                self._drop(client)
        self._selector.close()
        for connection in (self._listener, self._wake, self._woken):
            connection.close()

    def _run(self) -> None:
        while not self._closing:
            for key, events in self._selector.select():
                if key.fileobj is self._listener:
                    self._accept()
                elif key.fileobj is not self._woken:
                    client = self._clients.get(key.fileobj)  # type: ignore[call-overload]
                    if client is not None and events & selectors.EVENT_WRITE:
                        self._write(client, b"")
                    if client is not None and events & selectors.EVENT_READ:
                        self._read(client)

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return  # the client has gone again
        if len(self._clients) >= _MAX_CLIENTS:
            connection.close()
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = _Client(connection)
        with self._lock:
            self._clients[connection] = client
            self._selector.register(connection, selectors.EVENT_READ)
            self._write(client, b"< hi >")

    def _drop(self, client: _Client) -> None:
        if self._clients.pop(client.connection, None) is not None:
            self._selector.unregister(client.connection)
            client.connection.close()

    def _write(self, client: _Client, text: bytes) -> None:
        with self._lock:
            if client.connection not in self._clients:
                return
            waiting = bool(client.unsent)
            client.unsent += text
            try:
                if client.unsent:
                    client.unsent = client.unsent[client.connection.send(client.unsent) :]
            except BlockingIOError:
                pass
            except OSError:
                self._drop(client)
                return
            if len(client.unsent) > _UNSENT:
                self._drop(client)
            elif waiting != bool(client.unsent):
                events = selectors.EVENT_READ | (selectors.EVENT_WRITE if client.unsent else 0)
                self._selector.modify(client.connection, events)

    def _read(self, client: _Client) -> None:
        try:
            received = client.connection.recv(4096)
            client.received += received.decode("ascii")
            if hasattr(socket, "TCP_QUICKACK"):  # else the sender's second small packet waits 40 ms for this answer
                client.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
            if not received:
                raise ConnectionResetError
            while (end := client.received.find(">")) >= 0:
                message, client.received = client.received[: end + 1].strip(), client.received[end + 1 :]
                self._obey(client, message)
            if len(client.received) > _MAX_CHARACTERS:
                raise BadMessage("no end of a message")
        except BlockingIOError:
            return
        except (OSError, ValueError):  # gone, or sends garbage
            with self._lock:
                self._drop(client)

    def _obey(self, client: _Client, message: str) -> None:
        if not (message.startswith("< ") and message.endswith(" >")):
            raise BadMessage(message)
        content = message[2:-2].strip()
        if client.listens_from is not None:
            client.listens_from = 0.0
            frame = parsed_send(content)
            self._distribute(frame, client)
            self._receive(frame)
        elif content == "rawmode" and client.opened:
            with self._lock:
                self._write(client, b"< ok >")
                client.listens_from = time.monotonic() + _SETTLING
        elif _OPEN.match(content) and not client.opened:
            client.opened = True
            self._write(client, b"< ok >")
        else:
            raise BadMessage(message)

    def _distribute(self, frame: Frame, sender: _Client | None) -> None:
        now = time.monotonic()
        text = frame_text(frame, time.time())
        with self._lock:
            for client in list(self._clients.values()):
                if client is not sender and client.listens(now):
                    self._write(client, text)
