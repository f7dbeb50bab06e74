"""Memory that a rig's spine and the policy's program share: rings of numbered records, without a lock.

Nobody waits for anybody here. Whoever writes takes the next number and overwrites the oldest record; whoever reads
looks for the number that comes next. Each record carries its number and a checksum of both, so that one that is half
written, or half overwritten, is not there yet: it is never taken for a record, in whatever order a processor writes.
"""

from __future__ import annotations

import itertools
import mmap
import os
import struct
import tempfile
import zlib
from collections.abc import Sequence

from cutenv.rig.devices.drivers import DriveState, ForceSample, MotionSample
from cutenv.rig.spine import Receiver

_HEAD = struct.Struct("<QII")  # number, checksum, length


def ring_size(record: int, count: int) -> int:
    """Return the length of a ring of ``count`` records of at most ``record`` bytes [bytes]."""
    return (record + _HEAD.size) * count


class Ring:
    """Ring of records in shared memory, for one process that writes and one that reads.

    Several threads may write; of those that read, only one at a time.

    Parameters
    ----------
    memory : mmap or bytearray
        Memory, zero at first.
    start : int
        Place of the ring in it [bytes].
    record : int
        Greatest length of a record [bytes].
    count : int
        Number of records that it holds.

    Attributes
    ----------
    lost : int
        Number of records that were overwritten, or destroyed, before they were read.
    """

    def __init__(self, memory: mmap.mmap | bytearray, start: int, record: int, count: int) -> None:
        self._memory, self._start, self._record, self._count = memory, start, record + _HEAD.size, count
        self._numbers = itertools.count(1)  # next() is one step for all threads
        self._expected, self._far = 1, max(count // 256, 8)
        self.lost = 0

    def put(self, record: bytes) -> None:
        """Write a record over the oldest one; raises ValueError if it is too long."""
        if len(record) > self._record - _HEAD.size:
            raise ValueError(f"a record of {len(record)} bytes is too long: {self._record - _HEAD.size} at most.")
        number = next(self._numbers)
        at = self._start + number % self._count * self._record
        whole = _HEAD.pack(number, zlib.crc32(record, number & 0xFFFFFFFF), len(record)) + record
        self._memory[at : at + len(whole)] = whole

    def take(self) -> bytes | None:
        """Return the next record, or None while there is none.

        A reader who is a whole ring behind goes on with what has overwritten the record, one whose record was destroyed
        with the next; both count what they have missed.
        """
        while (found := self._at(self._expected)) is None:
            if self._at(self._expected + self._far) is None:
                return None
            self.lost += 1  # who has written so much later has written this one, too
            self._expected += 1
        number, record = found
        self.lost += number - self._expected
        self._expected = number + 1
        return record

    def _at(self, wanted: int) -> tuple[int, bytes] | None:
        """Return number and content of the record that stands where ``wanted`` should, if it is that or a later one."""
        at = self._start + wanted % self._count * self._record
        number, checksum, length = _HEAD.unpack_from(self._memory, at)
        if number < wanted or length > self._record - _HEAD.size:
            return None
        record = bytes(self._memory[at + _HEAD.size : at + _HEAD.size + length])
        return (number, record) if zlib.crc32(record, number & 0xFFFFFFFF) == checksum else None


_SAMPLE = struct.Struct("<BB6xQQqd6d6q")  # kind, axis, status or state, sequence, lost, time, six values, six counts
_FORCE, _MOTION, _ALIVE, _GARBLED = range(4)
_STATES = tuple(DriveState)
_NONE = (0.0,) * 6
_NO_COUNTS = (0,) * 6


class SampleWriter:
    """Receiver that writes what drivers have reported into a ring.

    Parameters
    ----------
    ring : Ring
        Ring, of records as long as :attr:`RECORD`.
    axes : sequence of str
        Names of the axes, in the order in which the reader knows them.
    """

    RECORD = _SAMPLE.size

    def __init__(self, ring: Ring, axes: Sequence[str]) -> None:
        self._ring, self._axes = ring, {name: number for number, name in enumerate(axes)}

    def force(self, sample: ForceSample) -> None:
        """Write a reading of the force sensor."""
        values, counts = (*sample.force, *sample.torque), sample.counts
        self._ring.put(
            _SAMPLE.pack(_FORCE, 0, sample.status, sample.sequence, sample.lost, sample.time, *values, *counts)
        )

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Write a sample of an axis."""
        values = (sample.position, sample.speed, sample.torque, 0.0, 0.0, 0.0)
        state = _STATES.index(sample.state)
        self._ring.put(_SAMPLE.pack(_MOTION, self._axes[axis], state, 0, 0, sample.time, *values, *_NO_COUNTS))

    def alive(self, axis: str, time: float) -> None:
        """Write a drive's heartbeat, which arrived at ``time`` [s]."""
        self._ring.put(_SAMPLE.pack(_ALIVE, self._axes[axis], 0, 0, 0, time, *_NONE, *_NO_COUNTS))

    def garbled(self, why: str, time: float) -> None:
        """Write that a packet was not a valid reading."""
        self._ring.put(_SAMPLE.pack(_GARBLED, 0, 0, 0, 0, time, *_NONE, *_NO_COUNTS))


def deliver(record: bytes, axes: Sequence[str], receiver: Receiver) -> None:
    """Give a receiver what a :class:`SampleWriter` has written."""
    kind, axis, status, sequence, lost, time, *numbers = _SAMPLE.unpack(record)
    x, y, z, a, b, c, *counts = numbers
    if kind == _FORCE:
        receiver.force(ForceSample(time, (x, y, z), tuple(counts), status, sequence, lost, (a, b, c)))
    elif kind == _MOTION:
        receiver.motion(axes[axis], MotionSample(time, x, y, z, _STATES[status]))
    elif kind == _ALIVE:
        receiver.alive(axes[axis], time)
    else:
        receiver.garbled("not a reading", time)


class Link:
    """Shared memory of one rig, without a name: nothing of it is left when both processes have ended.

    Parameters
    ----------
    file : int, optional
        Descriptor of the memory that the other process has made; by default it is made.

    Attributes
    ----------
    samples : Ring
        What drivers have reported, from the spine: more than ten seconds of it.
    states : Ring
        State of the rig as JSON, from the spine, whenever it has changed.
    stops : Ring
        Stops that the program asks for, as JSON.
    """

    def __init__(self, file: int | None = None) -> None:
        shapes = ((SampleWriter.RECORD, 16384), (2048, 64), (1024, 16))
        sizes = [ring_size(*shape) for shape in shapes]
        self.file = _memory_file(sum(sizes)) if file is None else file
        memory = mmap.mmap(self.file, sum(sizes))
        starts = itertools.accumulate(sizes, initial=0)
        self.samples, self.states, self.stops = (
            Ring(memory, start, *shape) for start, shape in zip(starts, shapes, strict=False)
        )

    def close(self) -> None:
        """Close the descriptor; what was shared can still be read."""
        os.close(self.file)


def _memory_file(length: int) -> int:
    if hasattr(os, "memfd_create"):
        file = os.memfd_create("cutenv-rig")
    else:
        with tempfile.TemporaryFile() as unnamed:
            file = os.dup(unnamed.fileno())
    os.truncate(file, length)
    return file


COMMAND = struct.Struct("<c7xqq6d")
"""Command: its mark, number, the parent of the program, time, speed or rate, angle, hold, height, side [SI]."""
GO, TURN, DONE = b"D", b"T", b"O"
"""Marks of a message's first byte; a call is pickled, and begins otherwise."""
REPLY = struct.Struct("<c7xqd")
"""Reply to a command: :data:`DONE`, its number, the angle to turn to [rad]."""
