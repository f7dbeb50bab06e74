"""Malformed messages for a class's server: random, but the same for the same seed."""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence
from typing import NamedTuple
from urllib.parse import urlsplit

import numpy as np

TEXTS = (  # texts of attacks, and of ordinary carelessness
    "", "x" * 3000, "\x00", "\r\nX: y", "²", "-1", "1e9", "NaN", "٣", "' OR 1=1 --", "<script>alert(1)</script>",
    "../../etc/passwd", "..\\..\\class.db", "%2e%2e%2f", "%00", "{{7*7}}", "=cmd|' /C calc'!A0",
    "\ud7ff\uffff", "🔪" * 50,
)  # fmt: skip
PATHS = (
    "/", "/cut", "/cuts", "/cuts/{}", "/cuts/{}/begun", "/leave", "/teacher", "/teacher/codes", "/teacher/delete",
    "/teacher/{}/records.zip", "/teacher/{}/{}", "/teacher/open/{}", "/rig", "/rig/readings", "/{}",
)  # fmt: skip
METHODS = ("GET", "POST", "PUT", "DELETE", "OPTIONS", "HEAD", "PATCH")
TYPES = (
    "application/x-www-form-urlencoded",
    "multipart/form-data; boundary=x",
    "multipart/form-data",
    "application/json",
)


class Message(NamedTuple):
    """One request: what an ordinary HTTP client can send."""

    method: str
    path: str
    content: bytes
    headers: dict[str, str]


def malformed_message(random: np.random.Generator, numbers: Sequence[str] = ()) -> Message:
    """Return a malformed request; some name one of the given cuts."""

    def text() -> str:
        return str(random.choice(TEXTS))

    def part() -> str:
        return str(random.choice(numbers)) if len(numbers) and random.random() < 0.5 else _quoted(text())

    path = str(random.choice(PATHS))
    while "{}" in path:
        path = path.replace("{}", part(), 1)
    kind = random.integers(5)
    if kind == 0:
        content = random.bytes(int(random.integers(4000)))
    elif kind == 1:
        content = random.normal(size=int(random.integers(600))).tobytes()
    elif kind == 2:
        content = np.full(2 * int(random.integers(100, 400)), random.choice([np.nan, np.inf, 1e300, 0.0])).tobytes()
    else:
        names = ("code", "consent", "token", "count", "again", "file")
        content = "&".join(f"{random.choice(names)}={_quoted(text())}" for _ in range(random.integers(1, 40))).encode()
    headers = {"Content-Type": str(random.choice(TYPES))}
    for name in ("X-Readings", "X-Stalled", "Last-Event-ID", "Cookie", "Origin", "X-Forwarded-For", "Accept-Language"):
        if random.random() < 0.3:
            prefix = f"{random.choice(['cutenv_person', 'cutenv_teacher'])}=" if name == "Cookie" else ""
            headers[name] = (
                prefix + text().encode("ascii", "ignore").decode().replace("\r\n", " ").replace("\x00", "").strip()
            )
    return Message(str(random.choice(METHODS)), path, content, headers)


def _quoted(text: str) -> str:
    return "".join(c if c.isalnum() and c.isascii() else "".join(f"%{b:02x}" for b in c.encode()) for c in text)


def malformed_bytes(random: np.random.Generator) -> bytes:
    """Return bytes that are no HTTP, or not quite."""
    made: Callable[[], bytes] = [
        lambda: random.bytes(int(random.integers(1, 3000))),
        lambda: b"GET / HTTP/1.1\r\n" + b"A: " + b"x" * int(random.integers(1, 100_000)) + b"\r\n",
        lambda: b"POST /cuts/x HTTP/1.1\r\nHost: x\r\nContent-Length: 99999999999999999999\r\n\r\n",
        lambda: b"POST /cuts/x HTTP/1.1\r\nHost: x\r\nContent-Length: \xb2\r\n\r\n",
        lambda: b"POST / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n" + random.bytes(200),
        lambda: b"GET /rig/readings HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n",
        lambda: b"\x16\x03\x01" + random.bytes(200),  # the beginning of TLS
        lambda: b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 1000\r\n\r\nhalf",
    ][random.integers(8)]
    return made()


def send_bytes(address: str, content: bytes) -> bytes:
    """Send bytes to a server, hang up, and return the beginning of its answer."""
    place = urlsplit(address)
    with socket.create_connection((place.hostname or "", place.port or 80), timeout=30.0) as line:
        line.settimeout(0.5)
        try:
            line.sendall(content)
            line.shutdown(socket.SHUT_WR)
            return line.recv(64)
        except OSError:  # the server has hung up, or waits for more
            return b""
