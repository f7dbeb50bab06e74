"""Emulated force sensors.

A Net F/T, and a board's analogue one.

The Net F/T answers RDT requests over UDP, shows its configuration over HTTP, and can have faults. The board converts
the loads' voltages and streams counts over TCP.
"""

from __future__ import annotations

import contextlib
import http.server
import json
import socket
import threading
from collections import deque
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.drivers.analogue_sensor import SCAN, AnalogueCalibration
from cutenv.rig.devices.driver_bases import Counts
from cutenv.rig.devices.loop import Clock, SystemClock
from cutenv.rig.devices.netft_sensor import (
    PacketError,
    RdtCommand,
    SensorPacket,
    SensorStatus,
    packet_bytes,
    parse_request,
)
from cutenv.rig.devices.reading_stream import SEQUENCES

Address: TypeAlias = tuple[str, int]
Loads: TypeAlias = tuple[float, float, float, float, float, float]

_POLL = 0.1  # [s] after which the thread checks whether it has to end
_CLIENTS = 8  # at most; the oldest is dropped
_HELD = 0.25  # share of the records that the next one overtakes, during reordering
_MAX_COUNT = 2**31 - 1
_FORCE_RANGE, _TORQUE_RANGE = 200.0, 10.0  # [N], [N m]: beyond, readings are clipped and the status reports it

_PAGE = """<?xml version="1.0" encoding="UTF-8"?>
<netft>
<prodname>Emulated Net F/T</prodname>
<runstat>0x{status:08X}</runstat>
<runrate>7000</runrate>
<cfgnam>emulated</cfgnam>
<scfgfu>N</scfgfu>
<scfgtu>Nm</scfgtu>
<cfgcpf>{force}</cfgcpf>
<cfgcpt>{torque}</cfgcpt>
<comrdte>Enabled</comrdte>
<comrdtrate>{rate}</comrdtrate>
</netft>
"""


@dataclass
class SensorFaults:
    """Faults of the sensor, effective at once."""

    frozen: bool = False  # True to keep the counts constant, whatever the load; records go on
    frozen_axis: int = -1  # index of the one force axis whose count stays constant (0, 1 or 2; -1: none)
    status: int = 0  # bits added to the status
    loss: float = 0.0  # share of the records that are lost, drawn at random
    reorder: bool = False  # True to let the next record overtake about every fourth one, drawn at random
    # delay added to every record [s]; their order is kept, and delayed records are sent at once when it falls
    latency: float = 0.0
    saturated: bool = False  # True to set the forces to the end of the range, with the corresponding status
    silent: bool = False  # True to send nothing, as if the cable were unplugged; the sequence goes on


@dataclass(frozen=True, kw_only=True)
class SensorPage:
    """Configuration that a sensor shows on its page."""

    counts_per_newton: int = 1_000_000
    counts_per_newton_metre: int = 1_000_000
    rate: float = 1000.0  # rate of the records [Hz]; the caller of :meth:`SensorServer.send` has to keep it

    def __post_init__(self) -> None:
        cure = "Choose fewer counts: a count has 32 bits."
        in_range("counts_per_newton", self.counts_per_newton, 1, _MAX_COUNT / _FORCE_RANGE, "1/N", cure)
        most = _MAX_COUNT / _TORQUE_RANGE
        in_range("counts_per_newton_metre", self.counts_per_newton_metre, 1, most, "1/(N m)", cure)


class SensorServer:
    """Emulated Net F/T on this computer.

    Obeys start (with count), stop, reset of the latch, and bias.

    A real sensor serves one client; this one serves several at once, so that one can watch another. By default ``host``
    is reachable from this computer only; ``port``, ``page_port``: ports for UDP and HTTP; 0 takes free ones; ``clock``:
    for the latency.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        page_port: int = 0,
        *,
        configuration: SensorPage | None = None,
        clock: Clock | None = None,
    ) -> None:
        self.configuration = shows = configuration or SensorPage()
        self.faults = SensorFaults()  # faults, which may be changed at any time
        self.garbage = 0  # number of packets that were not requests, and were ignored
        self.unsent = 0  # number of records that the operating system did not accept
        self._scales = (shows.counts_per_newton,) * 3 + (shows.counts_per_newton_metre,) * 3
        ends = (_FORCE_RANGE,) * 3 + (_TORQUE_RANGE,) * 3
        self._most = tuple(int(end * scale) for end, scale in zip(ends, self._scales, strict=True))
        self.first_sequence = 1  # first sequence number of a stream, 1 by default
        self.generator = np.random.default_rng(0)  # source of chance for loss and reordering
        self._clock: Clock = SystemClock() if clock is None else clock
        self._lock = threading.Lock()
        self._streams: dict[Address, _Stream] = {}
        self._sampled = 0
        self._loaded: Counts = (0, 0, 0, 0, 0, 0)
        self._bias: Counts = (0, 0, 0, 0, 0, 0)
        self._shown: Counts = (0, 0, 0, 0, 0, 0)
        self._closed = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
            self._pages = _page_server(self, host, page_port)
        except OSError:
            self._socket.close()
            raise
        self._socket.settimeout(_POLL)
        self.host = host
        self.port: int = self._socket.getsockname()[1]
        self.page = f"http://{host}:{self._pages.server_address[1]}/netftapi2.xml"
        self._threads = [
            threading.Thread(target=self._answer, name="emulated sensor", daemon=True),
            threading.Thread(
                target=self._pages.serve_forever, args=(_POLL,), name="emulated sensor's page", daemon=True
            ),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def clients(self) -> int:
        """Number of clients that receive the stream."""
        with self._lock:
            return len(self._streams)

    def send(self, loads: Loads) -> None:
        """Send a reading's forces [N] and torques [N m] to clients."""
        faults = self.faults
        with self._lock:
            self._sampled = (self._sampled + 1) % SEQUENCES
            counts, status = self._read(loads)
            for address, stream in list(self._streams.items()):
                record = SensorPacket(stream.sequence, self._sampled, status, counts)
                stream.sequence = (stream.sequence + 1) % SEQUENCES
                if not (faults.silent or (faults.loss > 0.0 and self.generator.random() < faults.loss)):
                    self._way(stream, packet_bytes(record))
                self._deliver(address, stream)
                stream.left -= 1
                if stream.left == 0:
                    del self._streams[address]

    def send_bytes(self, packet: bytes) -> None:
        """Send any bytes to every client, unaffected by faults."""
        with self._lock:
            for address in self._streams:
                self._put(address, packet)

    def page_text(self) -> str:
        """Return the configuration page as XML."""
        return _PAGE.format(
            status=self.faults.status,
            force=self._scales[0],
            torque=self._scales[3],
            rate=round(self.configuration.rate),
        )

    def close(self) -> None:
        """Stop listening; may be called twice."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._pages.shutdown()
        self._pages.server_close()
        for thread in self._threads:
            thread.join(timeout=2.0)
        self._socket.close()

    def __enter__(self) -> SensorServer:
        """Return itself; it listens already."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Stop listening."""
        self.close()

    def _read(self, loads: Loads) -> tuple[Counts, int]:
        faults = self.faults
        wanted = [round(load * scale) for load, scale in zip(loads, self._scales, strict=True)]
        if faults.saturated:
            wanted[:3] = [most if count >= 0 else -most for count, most in zip(wanted[:3], self._most, strict=False)]
        loaded = [max(-most, min(count, most)) for count, most in zip(wanted, self._most, strict=True)]
        status = faults.status
        if faults.saturated or loaded != wanted:
            status |= SensorStatus.ERROR | SensorStatus.OUT_OF_RANGE | SensorStatus.GAGE_OUT_OF_RANGE
        if not faults.frozen:
            self._loaded = _six(loaded)
            shown = [max(-_MAX_COUNT, min(c - b, _MAX_COUNT)) for c, b in zip(loaded, self._bias, strict=True)]
            if faults.frozen_axis >= 0:
                shown[faults.frozen_axis] = self._shown[faults.frozen_axis]
            self._shown = _six(shown)
        return self._shown, status

    def _way(self, stream: _Stream, packet: bytes) -> None:
        now = self._clock.now()
        if stream.overtaken is not None:
            stream.on_way.extend([(now, packet), (now, stream.overtaken)])
            stream.overtaken = None
        elif self.faults.reorder and self.generator.random() < _HELD:
            stream.overtaken = packet
        else:
            stream.on_way.append((now, packet))

    def _deliver(self, address: Address, stream: _Stream) -> None:
        if self.faults.silent:
            stream.on_way.clear()
            return
        arrived = self._clock.now() - self.faults.latency
        while stream.on_way and stream.on_way[0][0] <= arrived:
            self._put(address, stream.on_way.popleft()[1])

    def _put(self, address: Address, packet: bytes) -> None:
        try:
            self._socket.sendto(packet, address)
        except OSError:  # UDP guarantees nothing: what cannot be sent is lost, and counted
            self.unsent += 1

    def _answer(self) -> None:
        while not self._closed.is_set():
            try:
                packet, address = self._socket.recvfrom(2048)
            except TimeoutError:
                continue
            except ConnectionError:  # some systems report here that a client has gone
                continue
            try:
                command, count = parse_request(packet)
            except PacketError:
                self.garbage += 1
                continue
            with self._lock:
                self._obey(command, count, address)

    def _obey(self, command: RdtCommand, count: int, address: Address) -> None:
        match command:
            case RdtCommand.START:
                self._streams.pop(address, None)
                while len(self._streams) >= _CLIENTS:
                    del self._streams[next(iter(self._streams))]
                self._streams[address] = _Stream(self.first_sequence, count if count else -1)
            case RdtCommand.STOP:
                self._streams.pop(address, None)
            case RdtCommand.RESET_LATCH:
                self.faults.status &= ~SensorStatus.MONITOR_CONDITION
            case RdtCommand.BIAS:
                self._bias = self._loaded


class _Stream:
    def __init__(self, sequence: int, left: int) -> None:
        self.sequence = sequence
        self.left = left  # below zero: endless
        self.on_way: deque[tuple[float, bytes]] = deque()  # with time of sending [s]
        self.overtaken: bytes | None = None


def _six(counts: list[int]) -> Counts:
    first, second, third, fourth, fifth, sixth = counts
    return first, second, third, fourth, fifth, sixth


def _page_server(sensor: SensorServer, host: str, port: int) -> http.server.ThreadingHTTPServer:
    class Page(http.server.BaseHTTPRequestHandler):
        timeout = 2.0  # [s]: a silent client holds no thread

        def do_GET(self) -> None:
            if self.path.partition("?")[0] != "/netftapi2.xml":
                self.send_error(404)
                return
            text = sensor.page_text().encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/xml")
            self.send_header("Content-Length", str(len(text)))
            self.end_headers()
            self.wfile.write(text)

        def log_message(self, format: str, *args: Any) -> None:
            """Do not log requests for the page."""

    server = http.server.ThreadingHTTPServer((host, port), Page)
    server.daemon_threads = True
    return server


NOISE = 0.4  # standard deviation of each channel's noise, in counts; assumed
_DIGITAL = ("status", "loss", "reorder")  # faults of a sensor that sends packets
_NOISES = 4096
_RATE = 1000.0  # [Hz] of the readings; the caller of send has to keep it


class AnalogueFaults(SensorFaults):
    """Faults of analogue wires and a board.

    All of a sensor's but those of packets.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse a fault that wires cannot have."""
        if name in _DIGITAL and value:
            raise ValueError(f"{name}: an analogue sensor sends no packets, and has no status; take another fault.")
        super().__setattr__(name, value)


class BoardServer:
    """Emulated board on this computer, of one sensor.

    The newest client receives its stream. ``port``: TCP port; 0 takes a free one.
    """

    page = ""

    def __init__(
        self,
        calibration: AnalogueCalibration,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
    ) -> None:
        self.faults = AnalogueFaults()  # faults, which may be changed at any time
        self.unsent = 0  # number of readings that the client was too slow to take
        self.calibration = calibration
        self._header = json.dumps({"bits": calibration.bits, "range_V": calibration.range, "rate_Hz": _RATE}) + "\n"
        self._volts_per_load = np.linalg.inv(calibration.matrix)
        self._noise = NOISE * calibration.count * np.random.default_rng(0).standard_normal((_NOISES, 6))
        self._clock = SystemClock()
        self._lock = threading.Lock()
        self._client: socket.socket | None = None
        self._number = 0
        self._frozen = np.zeros(6)
        self._late: deque[tuple[float, bytes]] = deque()
        self._closed = threading.Event()
        self._listening = socket.create_server((host, port))
        self.host = host
        self.port: int = self._listening.getsockname()[1]
        self._thread = threading.Thread(target=self._accept, name="emulated board", daemon=True)
        self._thread.start()

    @property
    def clients(self) -> int:
        """Number of clients that receive the stream, 0 or 1."""
        return int(self._client is not None)

    def send(self, loads: Loads) -> None:
        """Convert and send a reading's forces [N] and torques [N m]."""
        faults = self.faults
        with self._lock:
            self._number = (self._number + 1) % SEQUENCES
            if faults.silent:
                self._late.clear()
                return
            counts = self._converted(np.array(loads)).astype(int).tolist()
            now = self._clock.now()
            self._late.append((now + faults.latency, SCAN.pack(self._number, *counts)))
            while self._late and (self._late[0][0] <= now or faults.latency == 0.0):
                self._put(self._late.popleft()[1])

    def close(self) -> None:
        """Stop listening; may be called twice."""
        if self._closed.is_set():
            return
        self._closed.set()
        with contextlib.suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)  # wakes the thread that accepts
        self._listening.close()
        self._thread.join(timeout=2.0)
        with self._lock:
            self._drop()

    def _converted(self, loads: Array) -> Array:
        faults = self.faults
        volts = self._volts_per_load @ loads + self._noise[self._number % _NOISES]
        if faults.saturated:
            volts[:] = np.where(volts < 0.0, -2.0, 2.0) * self.calibration.range
        counts = self.calibration.counts_of_volts(volts)
        if faults.frozen:
            return self._frozen
        if faults.frozen_axis >= 0:
            counts[faults.frozen_axis] = self._frozen[faults.frozen_axis]
        self._frozen = counts
        return counts

    def _put(self, scan: bytes) -> None:
        if self._client is None:
            return
        try:
            if self._client.send(scan) != len(scan):
                self._drop()  # part of a reading: the rest would never fit
        except BlockingIOError:
            self.unsent += 1
        except OSError:
            self._drop()

    def _drop(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def _accept(self) -> None:
        while not self._closed.is_set():
            try:
                client, _ = self._listening.accept()
            except OSError:
                return
            with self._lock:
                self._drop()
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with contextlib.suppress(OSError):
                    client.sendall(self._header.encode())
                    client.setblocking(False)
                    self._client = client
