"""A CiA 402 slave that shares no line with the driver: numbers as the standard prints them, on canopen's SDO server."""

from __future__ import annotations

import itertools
import struct

import can
import canopen
from canopen.objectdictionary import ODArray, ODVariable, datatypes
from canopen.sdo.exceptions import SdoAbortedError

from cutenv.rig.devices.protocols import MotionSample

_CHANNELS = itertools.count()
U8, U16, U32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
I8, I16, I32 = datatypes.INTEGER8, datatypes.INTEGER16, datatypes.INTEGER32

OBJECTS = {
    (0x1000, None): (U32, 0x00020192),
    (0x1016, 1): (U32, 0),
    (0x1017, None): (U16, 0),
    (0x1018, 1): (U32, 0xFB),
    (0x1400, 1): (U32, 0x201),
    (0x1400, 2): (U8, 255),
    (0x1600, 0): (U8, 0),
    (0x1800, 1): (U32, 0x40000181),
    (0x1800, 2): (U8, 255),
    (0x1A00, 0): (U8, 0),
    (0x1801, 1): (U32, 0xC0000281),
    (0x1801, 2): (U8, 255),
    (0x1A01, 0): (U8, 0),
    **{(index, sub): (U32, 0) for index in (0x1600, 0x1A00, 0x1A01) for sub in (1, 2, 3)},
    (0x3001, 2): (U32, 5000),
    (0x3003, 1): (U32, 22),
    (0x3003, 2): (U32, 5),
    (0x3010, 1): (U32, 1024),
    (0x6007, None): (I16, 1),
    (0x6040, None): (U16, 0),
    (0x605A, None): (I16, 2),
    (0x605E, None): (I16, 2),
    (0x6060, None): (I8, 0),
    (0x6065, None): (U32, 2000),
    (0x607D, 1): (I32, -(2**31)),
    (0x607D, 2): (I32, 2**31 - 1),
    (0x607F, None): (U32, 50000),
    (0x6080, None): (U32, 50000),
    (0x6083, None): (U32, 10000),
    (0x6084, None): (U32, 10000),
    (0x6085, None): (U32, 10000),
    (0x60A9, None): (U32, 0x00B44700),
}
DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x08


def dictionary() -> canopen.ObjectDictionary:
    od = canopen.ObjectDictionary()
    for (index, sub), (kind, value) in OBJECTS.items():
        variable = ODVariable(f"{index:04X}:{sub}", index, sub or 0)
        variable.data_type, variable.default, variable.access_type = kind, value, "rw"
        if sub is None:
            od.add_object(variable)
        else:
            if index not in od:
                od.add_object(ODArray(f"{index:04X}", index))
            od[index].add_member(variable)
    return od


class MadeUpDrive:
    """Node 1 on a virtual bus of its own; attributes make it misbehave."""

    def __init__(self, *, values: dict[tuple[int, int], int] | None = None, status: int = DISABLED) -> None:
        self.channel = f"made-up-{next(_CHANNELS)}"
        self.status, self.velocity, self.position, self.mode, self.target = status, 0, 0, 0, 0
        self.refused: dict[tuple[int, int], int] = {}  # abort code
        self.kept: dict[tuple[int, int], int] = {}  # objects that read so whatever was written
        self.silent_on: set[tuple[int, int]] = set()  # SDO requests that are never answered
        self.mute = self.fault_stays = False
        self.never = -1  # a status that it does not reach
        self.controlwords: list[int] = []
        self._network = canopen.Network(can.Bus(interface="virtual", channel=self.channel))
        self._network.NOTIFIER_CYCLE = 0.02
        self._network.connect()
        self.node = canopen.LocalNode(1, dictionary())
        self._network.add_node(self.node)
        for (index, sub), value in (values or {}).items():
            self.node.set_data(index, sub, value.to_bytes(4, "little"))
        self.node.add_write_callback(self._written)
        self.node.add_read_callback(lambda index, subindex, od: self.kept.get((index, subindex)))
        answer = self.node.sdo.on_request
        self._network.unsubscribe(0x601)
        self._network.subscribe(0x601, lambda number, data, at: self._asked(answer, number, data, at))
        self._network.subscribe(0x080, self._sync)
        self._network.subscribe(0x201, self._commanded)
        self._seen = can.Bus(interface="virtual", channel=self.channel)

    def close(self) -> None:
        self.node.nmt.stop_heartbeat()
        self._network.disconnect()
        self._seen.shutdown()

    def frames(self) -> list[tuple[int, bytes]]:
        """All on the bus since the last call, of both sides."""
        seen = []
        while (message := self._seen.recv(0)) is not None:
            seen.append((message.arbitration_id, bytes(message.data)))
        return seen

    def send(self, number: int, data: bytes) -> None:
        self._network.send_message(number, data)

    def value(self, index: int, sub: int, *, signed: bool = False) -> int:
        return int.from_bytes(self.node.get_data(index, sub), "little", signed=signed)

    def die(self) -> None:
        self.mute = True
        self.node.nmt.stop_heartbeat()

    def fail(self, code: int) -> None:
        """Into fault, with an emergency."""
        self.status, self.velocity = FAULT, 0
        self.send(0x081, struct.pack("<HB5x", code, 0x20))

    def _asked(self, answer, number: int, data: bytearray, at: float) -> None:
        place = struct.unpack_from("<HB", data, 1)
        if not self.mute and place not in self.silent_on:
            answer(number, data, at)

    def _written(self, index: int, subindex: int, od: ODVariable, data: bytes) -> None:
        if (index, subindex) in self.refused:
            raise SdoAbortedError(self.refused[index, subindex])
        if index == 0x6040:
            self._control(struct.unpack("<H", data)[0])

    def _sync(self, number: int, data: bytearray, at: float) -> None:
        if self.mute or self.node.nmt.state != "OPERATIONAL":
            return
        self.position += round(self.velocity / 1000 / 60 * 0.005 * 4096)
        self.send(0x181, struct.pack("<HiB", self.status | 0x0610, self.velocity, self.mode))
        self.send(0x281, struct.pack("<ih", self.position, 125))
        if self.status == QUICK_STOP:
            self.velocity = int(self.velocity / 2)

    def _commanded(self, number: int, data: bytearray, at: float) -> None:
        if self.mute or self.node.nmt.state != "OPERATIONAL":
            return
        word, self.target, self.mode = struct.unpack("<Hib", data)
        self._control(word)

    def _control(self, word: int) -> None:
        last = self.controlwords[-1] if self.controlwords else 0
        self.controlwords.append(word)
        status = self.status
        if status == FAULT:
            if word & 0x80 and not last & 0x80 and not self.fault_stays:
                status = DISABLED
        elif not word & 0x02:
            status = DISABLED
        elif not word & 0x04:
            status = QUICK_STOP if status in (ENABLED, QUICK_STOP) else DISABLED
        elif word & 0x0F == 0x06:
            status = READY
        elif word & 0x0F == 0x07 and status == READY:
            status = SWITCHED_ON
        elif word & 0x0F == 0x0F and status in (SWITCHED_ON, ENABLED, QUICK_STOP):
            status = ENABLED  # out of quick stop too: the standard's optional transition 16
        if status != self.never:
            self.status = status
        if self.status == ENABLED:
            self.velocity = self.target
        elif self.status != QUICK_STOP:
            self.velocity = 0


class Ear:
    """A listener that notes everything."""

    def __init__(self) -> None:
        self.samples: list[MotionSample] = []
        self.heartbeats: list[float] = []
        self.emergencies: list[tuple[str, int, str]] = []
        self.breaks: list[tuple[str, str]] = []
        self.intrusions: list[str] = []

    def motion(self, axis: str, sample: MotionSample) -> None:
        self.samples.append(sample)

    def alive(self, axis: str, time: float) -> None:
        self.heartbeats.append(time)

    def emergency(self, axis: str, code: int, meaning: str, time: float) -> None:
        self.emergencies.append((axis, code, meaning))

    def foreign(self, axis: str, what: str, time: float) -> None:
        self.intrusions.append(what)

    def broken(self, axis: str, why: str, time: float) -> None:
        self.breaks.append((axis, why))
