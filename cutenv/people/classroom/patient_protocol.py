"""Limits on idle connections to a class's server, by address and time."""

from __future__ import annotations

import asyncio
import ipaddress
from collections import defaultdict
from typing import Any, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

HEADER_WITHIN = 10.0
"""Time that the header of a request may take [s]."""
MOST_SILENT = 128
"""Connections of one address that have sent no header; beyond, the one that has waited longest is closed.  A class
behind one address may connect at once, before any of its headers is read."""
MOST_CONNECTIONS = 250
"""Connections of one address; beyond, new ones are closed."""


class PatientProtocol(H11Protocol):
    """HTTP/1.1 of uvicorn that closes slow or too numerous connections.

    A header must come in time, and an address has only so many connections.
    """

    _of_address: ClassVar[defaultdict[str, dict[PatientProtocol, None]]] = defaultdict(dict)  # in order

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._address = ""
        self._impatience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection, and make room for it."""
        super().connection_made(transport)
        self._address = _network(self.client[0] if self.client else "")
        others = self._of_address[self._address]
        silent = [each for each in others if each._impatience is not None]
        if len(silent) >= MOST_SILENT:
            silent[0]._drop()
        others[self] = None
        if len(others) > MOST_CONNECTIONS:
            self._drop()
        else:
            self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        self._forget()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read data; a partial header is waited for."""
        super().data_received(data)
        if self.conn.their_state is not h11.IDLE:
            self._answer()
        elif self._impatience is None:
            self._wait()

    def _drop(self) -> None:
        """Close a connection, which stops counting at once."""
        self._forget()
        self.connections.discard(self)
        self.transport.close()

    def _forget(self) -> None:
        self._answer()
        others = self._of_address[self._address]
        others.pop(self, None)
        if not others:
            del self._of_address[self._address]

    def _wait(self) -> None:
        self._impatience = self.loop.call_later(HEADER_WITHIN, self._drop)

    def _answer(self) -> None:
        if self._impatience is not None:
            self._impatience.cancel()
            self._impatience = None


def _network(address: str) -> str:
    """Return the address, or of IPv6 the /64 network of a household."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    return str(ipaddress.ip_network((found, 64), strict=False)) if found.version == 6 else str(found)
