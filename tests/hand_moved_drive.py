"""An emulated drive whose time is moved by hand, and whose frames are written byte by byte: no CANopen library."""

from __future__ import annotations

import struct

from cutenv.emulation.can_hub import Frame
from cutenv.emulation.canopen_rig import BLADE
from cutenv.emulation.emulated_axis import EmulatedAxis
from cutenv.emulation.emulated_drive import Node
from cutenv.emulation.mechanics import Mechanics

SYNC, MASTER_HEARTBEAT = 0x080, 0x77F
MILLI_RPM_PER_M_S = 4.4 / 0.002 * 60_000  # of the blade's gear and screw
INCREMENT = 0.002 / 4.4 / 4096  # [m]
_FIRST_BYTE = {1: 0x2F, 2: 0x2B, 4: 0x23}  # of an expedited download


class HandMovedDrive:
    """Node 1 with the blade's axis; ``frames`` holds what it has put on the bus."""

    def __init__(self, mechanics: Mechanics | None = None) -> None:
        self.frames: list[Frame] = []
        self.happened: list[str] = []
        self.now = 1000.0
        self.load = 0.0
        self.axis = EmulatedAxis("blade", BLADE, mechanics or Mechanics(), position=0.0, margin=0.003)
        self.node = Node(self.axis, self.frames.append, lambda what, **_: self.happened.append(what))

    def put(self, identifier: int, data: bytes) -> None:
        self.node.receive(Frame(identifier, data), self.now)

    def wait(self, seconds: float, *, heartbeats: bool = True) -> None:
        for tick in range(round(1000 * seconds)):
            self.now += 0.001
            if heartbeats and tick % 30 == 0:
                self.put(MASTER_HEARTBEAT, b"\x05")
            self.node.tick(self.now)
            self.axis.turn(self.load)

    def sent(self, identifier: int) -> list[bytes]:
        return [frame.data for frame in self.frames if frame.identifier == identifier]

    def asked(self, request: bytes) -> bytes:
        before = len(self.frames)
        self.put(0x601, request)
        assert [frame.identifier for frame in self.frames[before:]] == [0x581]
        return self.frames[-1].data

    def write(self, index: int, sub: int, form: str, value: int) -> bytes:
        data = struct.pack(f"<{form}", value)
        return self.asked(struct.pack("<BHB", _FIRST_BYTE[len(data)], index, sub) + data.ljust(4, b"\0"))

    def wrote(self, index: int, sub: int, form: str, value: int) -> None:
        assert self.write(index, sub, form, value) == struct.pack("<BHB4x", 0x60, index, sub)

    def read(self, index: int, sub: int = 0) -> int:
        answer = self.asked(struct.pack("<BHB4x", 0x40, index, sub))
        assert answer[0] & 0xE3 == 0x43, answer.hex(" ")
        return int.from_bytes(answer[4 : 8 - (answer[0] >> 2 & 3)], "little", signed=index in (0x6064, 0x606C, 0x60F4))

    def command(self, controlword: int, speed: float = 0.0) -> None:
        """RPDO1 as :meth:`set_up` maps it: controlword, target velocity, mode."""
        self.put(0x201, struct.pack("<Hib", controlword, round(speed * MILLI_RPM_PER_M_S), 3))

    def status(self) -> int:
        """Of a SYNC's TPDO1, masked as CiA 402 does."""
        self.put(SYNC, b"")
        return struct.unpack_from("<H", self.sent(0x181)[-1])[0] & 0x6F

    def position(self) -> float:
        """Of a SYNC's TPDO2 [m]."""
        self.put(SYNC, b"")
        return struct.unpack_from("<i", self.sent(0x281)[-1])[0] * INCREMENT

    def map(self, settings: int, mapping: int, number: int, kind: int, objects: tuple[int, ...]) -> None:
        self.wrote(settings, 1, "I", 0x80000000 | number)
        self.wrote(settings, 2, "B", kind)
        self.wrote(mapping, 0, "B", 0)
        for sub, mapped in enumerate(objects, start=1):
            self.wrote(mapping, sub, "I", mapped)
        self.wrote(mapping, 0, "B", len(objects))
        self.wrote(settings, 1, "I", number)

    def set_up(self) -> HandMovedDrive:
        """As a master of the rig does, up to OPERATIONAL."""
        self.wait(0.002)
        self.map(0x1400, 0x1600, 0x201, 255, (0x60400010, 0x60FF0020, 0x60600008))
        self.map(0x1800, 0x1A00, 0x181, 1, (0x60410010, 0x606C0020, 0x60610008))
        self.map(0x1801, 0x1A01, 0x281, 1, (0x60640020, 0x60770010))
        self.wrote(0x1016, 1, "I", 0x007F0064)
        self.wrote(0x1017, 0, "H", 50)
        self.wrote(0x6007, 0, "h", 3)
        self.wrote(0x605A, 0, "h", 6)
        self.wrote(0x60A9, 0, "I", 0xFDB44700)
        self.wrote(0x6065, 0, "I", round(0.002 / INCREMENT))
        self.wrote(0x607D, 1, "i", round(-0.002 / INCREMENT))
        self.wrote(0x607D, 2, "i", round(0.149 / INCREMENT))
        self.wrote(0x607F, 0, "I", round(0.0381 * MILLI_RPM_PER_M_S))
        for index, acceleration in ((0x6083, 0.1), (0x6084, 0.1), (0x6085, 1.0)):
            self.wrote(index, 0, "I", round(acceleration * MILLI_RPM_PER_M_S / 1000))
        self.put(0x000, b"\x01\x01")
        return self

    def enabled(self) -> HandMovedDrive:
        self.set_up()
        for controlword in (0x06, 0x07, 0x0F):
            self.command(controlword)
            self.wait(0.002)
        assert self.status() == 0x27
        return self

    def moving(self, speed: float = 0.0254) -> HandMovedDrive:
        self.enabled()
        self.command(0x0F, speed)
        self.wait(0.6)
        return self
