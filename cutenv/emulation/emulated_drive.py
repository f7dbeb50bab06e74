"""Emulated drive on the bus: NMT, heartbeats, SDO, PDOs, emergencies."""

from __future__ import annotations

import contextlib
import logging
import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from canopen import SdoAbortedError
from canopen.sdo.server import SdoServer

from cutenv.emulation.can_hub import Frame
from cutenv.emulation.emulated_axis import (
    FAULT_RESET_BIT,
    POWERED,
    Abort,
    DriveCommand,
    EmulatedAxis,
    ObjectDictionary,
    after,
    command,
    epos4,
)
from cutenv.rig.devices.canopen.objects import ENABLE_OPERATION, PDO_UNUSED, Entry
from cutenv.rig.devices.protocols import DriveState

_IDENTIFIER = 0x7FF
_SYNCHRONOUS = 240  # greatest transmission type that depends on SYNC
Write = tuple[int, int, bytes]  # index, sub-index and new value of an object that a received frame writes


def _parts(mapped: int) -> tuple[int, int, int]:
    """Return index, sub-index and bits of a mapped object."""
    return mapped >> 16, mapped >> 8 & 0xFF, mapped & 0xFF


def check_mapping(dictionary: ObjectDictionary, entry: Entry, value: int) -> None:
    """Raise SdoAbortedError for CiA 301 violations in 1400, 1600, 1800, 1A00 or successors."""
    settings = entry.index & ~0x200
    sends = settings >= 0x1800
    valid = not dictionary[settings, 1] & PDO_UNUSED
    if entry.index == settings:
        if entry.sub == 1 and valid and not value & PDO_UNUSED and value != dictionary[settings, 1]:
            raise SdoAbortedError(Abort.DEVICE_STATE)
        return
    if valid or (entry.sub > 0 and dictionary[entry.index, 0] > 0):
        raise SdoAbortedError(Abort.DEVICE_STATE)  # first the COB-ID must be made invalid and the number of objects 0
    if entry.sub > 0:
        _check_mapped(dictionary, value, "T" if sends else "R")
        return
    bits = 0
    for sub in range(1, value + 1):
        _check_mapped(dictionary, dictionary[entry.index, sub], "T" if sends else "R")
        bits += dictionary[entry.index, sub] & 0xFF
    if bits > 64:
        raise SdoAbortedError(Abort.PDO_LENGTH)


def _check_mapped(dictionary: ObjectDictionary, mapped: int, way: str) -> None:
    if mapped == 0:
        return
    index, sub, bits = _parts(mapped)
    found = dictionary.entry(index, sub)
    if way not in found.mappable or bits != found.bits:
        raise SdoAbortedError(Abort.NOT_MAPPABLE)


@dataclass
class _Pdo:
    settings: int
    mapping: int
    syncs: int = 0  # since the last transmission
    pending: bytes | None = None  # received data, for use at the next SYNC
    last: bytes = b""
    last_sent: float = -1.0

    def cob(self, dictionary: ObjectDictionary) -> int | None:
        """Return the identifier; None if the PDO is not in use."""
        cob = dictionary[self.settings, 1]
        return None if cob & PDO_UNUSED else cob & _IDENTIFIER

    def places(self, dictionary: ObjectDictionary) -> list[tuple[int, int, int]]:
        return [_parts(dictionary[self.mapping, sub]) for sub in range(1, dictionary[self.mapping, 0] + 1)]


class ProcessData:
    """All PDOs of a node."""

    def __init__(self, dictionary: ObjectDictionary) -> None:
        self._dictionary = dictionary
        self._received = [_Pdo(0x1400 + i, 0x1600 + i) for i in range(4)]
        self._sent = [_Pdo(0x1800 + i, 0x1A00 + i) for i in range(4)]

    def received(self, identifier: int, data: bytes) -> list[Write]:
        """Return a frame's writes; keep a synchronous RPDO's for :meth:`synchronised`."""
        writes: list[Write] = []
        for pdo in self._received:
            if pdo.cob(self._dictionary) != identifier:
                continue
            if self._dictionary[pdo.settings, 2] <= _SYNCHRONOUS:
                pdo.pending = data
            else:
                writes += self._unpacked(pdo, data)
        return writes

    def synchronised(self) -> list[Write]:
        """Return the writes that have waited for this SYNC."""
        writes: list[Write] = []
        for pdo in self._received:
            if pdo.pending is not None:
                writes += self._unpacked(pdo, pdo.pending)
                pdo.pending = None
        return writes

    def due_at_sync(self) -> list[tuple[int, bytes]]:
        """Return frames to send at a SYNC: identifier, data."""
        frames = []
        for pdo in self._sent:
            cob, kind = pdo.cob(self._dictionary), self._dictionary[pdo.settings, 2]
            if cob is None or kind > _SYNCHRONOUS:
                continue
            pdo.syncs += 1
            data = self._packed(pdo)
            if pdo.syncs >= kind if kind else data != pdo.last:
                pdo.syncs, pdo.last = 0, data
                frames.append((cob, data))
        return frames

    @property
    def sends_by_event(self) -> bool:
        """True if changes or event timers send frames."""
        dictionary = self._dictionary
        return any(dictionary[pdo.settings, 2] > _SYNCHRONOUS and pdo.cob(dictionary) is not None for pdo in self._sent)

    def due_by_event(self, now: float) -> list[tuple[int, bytes]]:
        """Return frames of changes or event timers: identifier, data."""
        frames = []
        for pdo in self._sent:
            cob = pdo.cob(self._dictionary)
            if cob is None or self._dictionary[pdo.settings, 2] <= _SYNCHRONOUS:
                continue
            since = now - pdo.last_sent
            if since < 1e-4 * self._dictionary[pdo.settings, 3]:
                continue
            data, timer = self._packed(pdo), 1e-3 * self._dictionary[pdo.settings, 5]
            if data != pdo.last or 0.0 < timer <= since:
                pdo.last, pdo.last_sent = data, now
                frames.append((cob, data))
        return frames

    def _packed(self, pdo: _Pdo) -> bytes:
        dictionary = self._dictionary
        return b"".join(dictionary.get_data(index, sub) for index, sub, bits in pdo.places(dictionary) if bits)

    def _unpacked(self, pdo: _Pdo, data: bytes) -> list[Write]:
        places = pdo.places(self._dictionary)
        if len(data) < sum(bits for *_, bits in places) // 8:
            return []  # a frame that is too short is not used at all (CiA 301)
        writes: list[Write] = []
        at = 0
        for index, sub, bits in places:
            if bits:
                writes.append((index, sub, data[at : at + bits // 8]))
                at += bits // 8
        return writes


_SAVE = 0x65766173  # "save", backwards
_REACTION_ENDS = 1.0  # [s] after which a fault reaction ends even if the axis still moves
logging.getLogger("canopen.sdo.server").setLevel(logging.CRITICAL)  # it logs as an error what it answers
Happened = Callable[..., None]  # callback ``happened(what, axis=..., **details)`` for events that a test may ask for


class Nmt(IntEnum):
    """State of a node on the network, as in its heartbeat."""

    BOOTING = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class Emergency(IntEnum):
    """Error codes that the node sends."""

    NONE = 0x0000
    HEARTBEAT = 0x8130
    FOLLOWING = 0x8611
    SOFTWARE_LIMIT = 0x8A82
    OVER_CURRENT = 0x2310
    SAFE_TORQUE_OFF = 0x8A88


_REGISTER = {0x2: 0x02, 0x3: 0x04, 0x4: 0x08, 0x81: 0x10, 0x82: 0x10, 0x86: 0x20, 0x8A: 0x20}


def error_register(code: int) -> int:
    """Return an emergency code's error register (1001): generic and group bit."""
    return 0x01 | _REGISTER.get(code >> 8, _REGISTER.get(code >> 12, 0x80)) if code else 0


class Node:
    """Emulated drive on the bus.

    ``send``: puts a :class:`~cutenv.emulation.can_hub.Frame` on the bus; ``happened``: called for quick stops,
    emergencies and lost heartbeats. ``heartbeat_lost``, ``bus_off``, ``doubles``, ``deaf``: faults: no heartbeats; no
    frames in or out; every frame comes and goes twice; quick stops are not obeyed.
    """

    def __init__(self, axis: EmulatedAxis, send: Callable[[Frame], None], happened: Happened) -> None:
        self.axis = axis
        self.number = axis.settings.node
        self.heartbeat_lost = self.bus_off = self.doubles = self.deaf = False
        self.failure = 0  # fault: an emergency code that keeps the drive in fault; 0: none
        self._put = send
        self._happened = happened
        self.dictionary = ObjectDictionary(epos4(self.number), self._written)
        axis.commission(self.dictionary)
        self.dictionary.keep()
        self._powered = True
        self._boot(0.0)

    def _boot(self, now: float) -> None:
        self.dictionary.restore()
        server: Any = SdoServer  # canopen's classes are typed in part
        self._sdo = server(0x600 + self.number, 0x580 + self.number, self.dictionary)
        self._sdo.network = self
        self._sdo._index = self._sdo._subindex = 0  # without them it cannot refuse a transfer that was never begun
        self._pdo = ProcessData(self.dictionary)
        self.state = DriveState.DISABLED
        self._then: DriveState | None = None  # state after the present ramp
        self._controlword = 0
        self._since = now  # start of the present state [s]
        self._now = self._ticked = now
        self._master: float | None = None  # time of its last heartbeat [s]
        self._beat = now
        self.nmt = Nmt.BOOTING
        self.axis.release()

    def power(self, on: bool, now: float) -> None:
        """Switch the supply off (silent, without torque), or on afresh."""
        if on and not self._powered:
            self._boot(now)
        elif not on:
            self.axis.release()
        self._powered = on

    # Frames from the bus.

    def receive(self, frame: Frame, now: float) -> None:
        """Take a frame from the bus."""
        for _ in range(1 + self.doubles):
            self._take(frame, now)

    def _take(self, frame: Frame, now: float) -> None:
        if not self._powered or self.bus_off or frame.extended or self.nmt is Nmt.BOOTING:
            return
        self._now = now
        identifier, data = frame.identifier, frame.data
        if identifier == 0x000:
            self._network_command(data)
        elif identifier == self.dictionary[0x1005]:
            if self.nmt is Nmt.OPERATIONAL:
                self._write_all(self._pdo.synchronised())
                self._tell(ahead=now - self._ticked)
                for cob, sent in self._pdo.due_at_sync():
                    self.send_message(cob, sent)
        elif identifier == 0x600 + self.number:
            if self.nmt is not Nmt.STOPPED and len(data) == 8:
                self._tell()
                self._sdo.on_request(identifier, self._sized(data), now)
        elif identifier == 0x700 + (self.dictionary[0x1016, 1] >> 16 & 0x7F) and len(data) == 1:
            if self.dictionary[0x1016, 1] & 0xFFFF:
                self._master = now
                if self.dictionary[0x603F] == Emergency.HEARTBEAT and self.state is not DriveState.FAULT:
                    self._clear()
        elif self.nmt is Nmt.OPERATIONAL:
            self._write_all(self._pdo.received(identifier, data))

    def _sized(self, request: bytes) -> bytes:
        """Add its object's size to an expedited download, else taken as four bytes."""
        entry = self.dictionary.entries.get(struct.unpack_from("<HB", request, 1))
        if entry is None or request[0] & 0xE3 != 0x22:
            return request
        return bytes([0x23 | 4 - entry.bits // 8 << 2]) + request[1:]

    def _network_command(self, data: bytes) -> None:
        if len(data) != 2 or data[1] not in (0, self.number):
            return
        before = self.nmt
        match data[0]:
            case 0x01:
                self.nmt = Nmt.OPERATIONAL
            case 0x02:
                self.nmt = Nmt.STOPPED
            case 0x80:
                self.nmt = Nmt.PRE_OPERATIONAL
            case 0x81 | 0x82:
                self._boot(self._now)
                return
        if before is Nmt.OPERATIONAL and self.nmt is not Nmt.OPERATIONAL and self.state in POWERED:
            self._connection_lost()

    def _write_all(self, writes: list[Write]) -> None:
        for write in sorted(writes, key=lambda write: write[0] == 0x6040):  # targets before the command
            # A PDO has no answer: the standard lets the device ignore a value that it cannot take.
            with contextlib.suppress(SdoAbortedError):
                self.dictionary.set_data(*write)

    def _written(self, entry: Entry, value: int) -> None:
        if entry.index == 0x6040:
            self._control(value)
        elif 0x1400 <= entry.index < 0x1C00:
            check_mapping(self.dictionary, entry, value)
        elif entry.index == 0x1010:
            if value != _SAVE:
                raise SdoAbortedError(Abort.VALUE)
            self.dictionary.keep()
        elif entry.index == 0x1016:
            self._master = None
        elif entry.index == 0x60A9 and self.state in POWERED:
            raise SdoAbortedError(Abort.DEVICE_STATE)

    def _control(self, controlword: int) -> None:
        before, self._controlword = self._controlword, controlword
        if command(controlword) is DriveCommand.QUICK_STOP and command(before) is not DriveCommand.QUICK_STOP:
            self._happened("quick stop received", axis=self.axis.name)
        if self.deaf and command(controlword) is DriveCommand.QUICK_STOP:
            return
        if self.state is DriveState.FAULT and self.failure:
            return  # the fault's cause is still there
        if controlword & FAULT_RESET_BIT and not before & FAULT_RESET_BIT and self.dictionary[0x1001]:
            self._clear()
        option = self.dictionary[0x605A]
        new = after(self.state, controlword, before, quick_stop_option=option)
        if self.state is DriveState.ENABLED and new is not DriveState.ENABLED:
            slowly = {DriveState.SWITCHED_ON: self.dictionary[0x605C], DriveState.READY: self.dictionary[0x605B]}
            if slowly.get(new):
                self._then = new
                return
        self._then = None
        self._enter(new)
        self.axis.controlled(self.dictionary, self.state, controlword, before)

    # The drive's own actions.

    def tick(self, now: float) -> None:
        """Run the drive's tasks for a millisecond, before the motor."""
        self._now = self._ticked = now
        if not self._powered:
            return
        if self.nmt is Nmt.BOOTING:
            self.send_message(0x700 + self.number, b"\x00")
            self.nmt = Nmt.PRE_OPERATIONAL
        self._watch_master(now)
        self._finish_ramps(now)
        self.axis.drive(self.dictionary, self.state, self._controlword, stopping=self._then is not None)
        self._monitor()
        beat = 1e-3 * self.dictionary[0x1017]
        if beat and now - self._beat >= beat:
            self._beat = now if now - self._beat > 2 * beat else self._beat + beat
            if not self.heartbeat_lost:
                self.send_message(0x700 + self.number, bytes([self.nmt]))
        if self.nmt is Nmt.OPERATIONAL and self._pdo.sends_by_event:
            self._tell()
            for cob, data in self._pdo.due_by_event(now):
                self.send_message(cob, data)

    def _tell(self, ahead: float = 0.0) -> None:
        """Set the state's objects, which takes a while, before reads."""
        self.axis.tell(self.dictionary, self.state, self.nmt is Nmt.OPERATIONAL, ahead=ahead)

    def _watch_master(self, now: float) -> None:
        allowed = 1e-3 * (self.dictionary[0x1016, 1] & 0xFFFF)
        if self._master is not None and allowed and now - self._master > allowed:
            self._master = None
            self._happened("heartbeat of the master lost", axis=self.axis.name)
            self._emergency(Emergency.HEARTBEAT)
            self._connection_lost()

    def _connection_lost(self) -> None:
        match self.dictionary[0x6007]:
            case 1:
                self._fault()
            case 2 if self.state in POWERED:
                self._enter(DriveState.DISABLED)
            case 3 if self.state is DriveState.ENABLED:
                self._enter(DriveState.QUICK_STOP)

    def _finish_ramps(self, now: float) -> None:
        rests = self.axis.rests()
        if self._then is not None and rests:
            self._enter(self._then)
        elif self.state is DriveState.QUICK_STOP and rests and self.dictionary[0x605A] < 5:
            self._enter(DriveState.DISABLED)
        elif self.state is DriveState.REACTING and (rests or now - self._since > _REACTION_ENDS):
            self._enter(DriveState.FAULT)

    def _monitor(self) -> None:
        if self.failure and self.state is not DriveState.FAULT:
            self._emergency(self.failure)
            self._fault(at_once=True)
        elif self.state in (DriveState.ENABLED, DriveState.QUICK_STOP):
            if self.axis.lags_too_far(self.dictionary):
                self._emergency(Emergency.FOLLOWING)
                self._fault()
            elif self.state is DriveState.ENABLED and self.axis.leaves_travel(self.dictionary):
                self._emergency(Emergency.SOFTWARE_LIMIT)
                self._fault()

    def _fault(self, *, at_once: bool = False) -> None:
        if self.state is DriveState.FAULT:
            return
        reacts = self.state in POWERED and not at_once and self.dictionary[0x605E] > 0
        self._enter(DriveState.REACTING if reacts else DriveState.FAULT)

    def _enter(self, state: DriveState) -> None:
        if state is self.state:
            return
        self.state, self._since, self._then = state, self._now, None
        self.axis.drive(self.dictionary, state, self._controlword, stopping=False)

    def _emergency(self, code: int) -> None:
        dictionary = self.dictionary
        dictionary[0x1001] |= error_register(code)
        dictionary[0x603F] = code
        for sub in range(5, 1, -1):
            dictionary[0x1003, sub] = dictionary[0x1003, sub - 1]
        dictionary[0x1003, 1] = code
        dictionary[0x1003] = min(dictionary[0x1003] + 1, 5)
        self._happened("emergency sent", axis=self.axis.name, code=code)
        self._send_emergency(code)

    def _clear(self) -> None:
        self.dictionary[0x1001] = 0
        self.dictionary[0x603F] = 0
        self._send_emergency(Emergency.NONE)

    def _send_emergency(self, code: int) -> None:
        if self.nmt in (Nmt.OPERATIONAL, Nmt.PRE_OPERATIONAL):
            self.send_message(0x80 + self.number, struct.pack("<HB5x", code, self.dictionary[0x1001]))

    def send_message(self, identifier: int, data: bytes) -> None:
        """Put a frame on the bus, unless faulty; named for canopen's SDO server."""
        if self._powered and not self.bus_off:
            for _ in range(1 + self.doubles):
                self._put(Frame(identifier, bytes(data)))

    def command(self, speed: float) -> Frame:
        """Return the RPDO1 frame enabling at ``speed`` [m/s or rad/s]."""
        velocity = self.axis.units(self.dictionary, speed)
        return Frame(0x200 + self.number, struct.pack("<Hib", ENABLE_OPERATION, velocity, self.dictionary[0x6060]))

    def about(self) -> dict[str, Any]:
        """Return the drive's state for the control port."""
        return {"axis": self.axis.name, "node": self.number, "state": self.state.value, "nmt": self.nmt.name.lower()}
