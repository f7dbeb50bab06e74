"""Emulated board of an analogue sensor: it converts the loads' voltages and streams counts over TCP."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
from collections import deque
from typing import Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv.imitated.emulator.sensor_server import Loads, SensorFaults
from cutenv.rig.devices.host import SystemClock
from cutenv.rig_drivers.analogue.analogue_sensor import SCAN
from cutenv.rig_drivers.analogue.sensor_calibration_file import AnalogueCalibration

NOISE = 0.4
"""Standard deviation of each channel's noise, in counts; assumed."""
_DIGITAL = ("status", "loss", "reorder")  # faults of a sensor that sends packets
_NOISES = 4096
_RATE = 1000.0  # [Hz] of the readings; the caller of send has to keep it
_SEQUENCES = 1 << 32


class AnalogueFaults(SensorFaults):
    """Faults of analogue wires and a board: all of a sensor's but those of packets."""

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse a fault that wires cannot have."""
        if name in _DIGITAL and value:
            raise ValueError(f"{name}: an analogue sensor sends no packets, and has no status; take another fault.")
        super().__setattr__(name, value)


class BoardServer:
    """Emulated board on this computer, of one sensor; the newest client receives its stream.

    Parameters
    ----------
    calibration : AnalogueCalibration
        Sensor and converter.
    host : str
        Address to listen on.
    port : int
        TCP port; 0 takes a free one.

    Attributes
    ----------
    faults : AnalogueFaults
        Faults, which may be changed at any time.
    unsent : int
        Number of readings that the client was too slow to take.
    page : str
        Empty: a board shows no page.
    """

    page = ""

    def __init__(
        self,
        calibration: AnalogueCalibration,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
    ) -> None:
        self.faults = AnalogueFaults()
        self.unsent = 0
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
        """Convert one reading of forces [N] and torques [N m], and send it; called once for each reading."""
        faults = self.faults
        with self._lock:
            self._number = (self._number + 1) % _SEQUENCES
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
