"""Emulated force sensors that stream frames, on pseudo-terminals: a Robotiq FT 300 and a Bota sensor."""

from __future__ import annotations

import random
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from cutenv.emulation.firmware import EmulatedLine

LOADS = (3.0, -1.0, 2.0, 0.1, -0.05, 0.2)


def crc16(data: bytes, polynomial: int, last: int) -> bytes:
    """A reflected CRC of 16 bits, by a way other than the drivers': bit by bit."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (polynomial if crc & 1 else 0)
    return struct.pack("<H", crc ^ last)


def modbus(data: bytes) -> bytes:
    """Data with the CRC of Modbus."""
    return data + crc16(data, 0xA001, 0)


class FramedDevice:
    """A sensor that answers and streams until it ends; its cable can be pulled, its line garble."""

    rate = 100.0

    def __init__(self) -> None:
        self.line = EmulatedLine()
        self.loads = list(LOADS)
        self.streaming = self.ended = False
        self.noise = 0.02
        self.damage: Any = lambda frame: frame
        self.sent = 0
        self._cable = threading.Lock()
        self._random = random.Random(1)

    def serve(self) -> None:
        due = time.monotonic()
        while not self.ended:
            with self._cable:
                heard = self.line.heard()
                if heard:
                    self.take(heard)
                while self.streaming and due <= time.monotonic():
                    due += 1.0 / self.rate
                    self.sent += 1
                    loads = [load + self._random.gauss(0.0, self.noise) for load in self.loads]
                    self.say(self.damage(self.frame(loads)))
            if not self.streaming:
                due = time.monotonic()
            time.sleep(0.0005)

    def unplug(self) -> None:
        """Pull the cable out."""
        with self._cable:
            self.line.unplug()

    def say(self, data: bytes) -> None:
        self.line._write(data)

    def take(self, heard: bytes) -> None:
        raise NotImplementedError

    def frame(self, loads: list[float]) -> bytes:
        raise NotImplementedError


class EmulatedRobotiq(FramedDevice):
    """An FT 300 as its manual has it: Modbus RTU until register 410 asks for the stream, jammed by 0xFF."""

    firmware = b"FTS\x02\x00\x01"

    def __init__(self) -> None:
        super().__init__()
        self.streaming = True  # one that another program left so

    def take(self, heard: bytes) -> None:
        if heard.startswith(b"\xff"):
            self.streaming = False
            heard = heard.lstrip(b"\xff")
        if self.streaming or not heard or modbus(heard[:-2]) != heard:
            return
        device, function, register = struct.unpack(">BBH", heard[:4])
        if (device, function, register) == (9, 3, 500):
            self.say(modbus(bytes((9, 3, 6)) + self.firmware))
        elif (device, function, register) == (9, 3, 510):
            self.say(modbus(bytes((9, 3, 8)) + b"FTS\x00" + struct.pack(">HH", 1234, 0)))
        elif heard[:-2] == bytes.fromhex("0910019a0001020200"):
            self.say(modbus(bytes.fromhex("0910019a0001")))
            self.streaming = True

    def frame(self, loads: list[float]) -> bytes:
        counts = [round(100 * load) for load in loads[:3]] + [round(1000 * load) for load in loads[3:]]
        return modbus(b"\x20\x4e" + struct.pack("<6h", *counts))


class EmulatedBota(FramedDevice):
    """A Bota sensor as its examples have it: it starts with a text, streams, and is set up by letters."""

    rate = 800.0

    def __init__(self, *, starts: float = 0.0) -> None:
        super().__init__()
        self.status, self.temperature, self.stamp = 0, 31.5, 2**32 - 100_000  # its time wraps after 80 readings
        self.set_up: list[bytes] = []
        self._deaf_until = time.monotonic() + starts

    def take(self, heard: bytes) -> None:
        if time.monotonic() < self._deaf_until:
            return
        letter = heard[:1]
        if letter == b"C":
            self.streaming = False
            self.say(b"App Init\r\n")
        elif self.streaming or letter not in b"cfR":
            return
        self.set_up.append(heard)
        self.say(b"r,0,%c,0\r\n" % letter[0])
        if letter == b"f":
            self.rate = 51_200 / int(heard.split(b",")[1])
        self.streaming = letter == b"R"

    def frame(self, loads: list[float]) -> bytes:
        self.stamp = (self.stamp + round(1e6 / self.rate)) % 2**32
        data = struct.pack("<H6fIf", self.status, *loads, self.stamp, self.temperature)
        return b"\xaa" + data + crc16(data, 0x8408, 0xFFFF)


@contextmanager
def serving(device: Any) -> Iterator[Any]:
    """Let a device serve in a thread."""
    thread = threading.Thread(target=device.serve, daemon=True)
    thread.start()
    try:
        yield device
    finally:
        device.ended = True
        thread.join()
        device.line.close()
