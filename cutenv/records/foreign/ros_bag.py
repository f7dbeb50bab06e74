"""Bags of ROS 1 and 2, and any MCAP, as tables.

Every number of every message is a column. A file is read up to where a killed recorder left it.
"""

from __future__ import annotations

import bz2
import functools
import json
import struct
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from cutenv._base.imports import optional_import
from cutenv.records.foreign.array_tables import Series, joined
from cutenv.records.foreign.named_columns import NamedColumns, bare_name
from cutenv.records.schema import RecordError, reason_of, refusing_damage

BAGS = (".mcap", ".bag", ".db3", ".active")
"""Suffixes of bags: MCAP, ROS 1, ROS 2 in SQLite, and a ROS 1 bag whose recorder was killed (``.bag.active``)."""
_FILES = (".mcap", ".db3")  # in the folder of a bag
_MAX_RECORD_BYTES = 1 << 31  # bytes of a record, so that a damaged length does not request all memory
_MAGIC, _MAGIC_1 = b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6  # operation codes of MCAP
_MESSAGE_1, _CHUNK_1, _CONNECTION_1 = 2, 5, 7  # those of ROS 1


class Message(NamedTuple):
    """One message: topic, log time [ns] and content function."""

    topic: str
    received: int
    content: Callable[[], Any]


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag's file or folder."""
    if path.is_dir():  # ROS 2 calls the first file after the folder, and writes the other at the end
        return any((path / name).is_file() for name in ("metadata.yaml", *(f"{path.name}_0{each}" for each in _FILES)))
    return path.suffix.lower() in BAGS


def messages(path: Path, notes: list[str]) -> Iterator[Message]:
    """Yield a bag's messages in file order; add peculiarities to `notes`."""
    if path.is_dir() and (files := sorted(each for each in path.iterdir() if each.suffix in _FILES)):
        for file in files:
            yield from messages(file, notes)
    elif path.suffix.lower() == ".mcap":
        yield from _in_mcap(path, notes)
    elif path.suffix.lower() in (".bag", ".active"):
        yield from _in_ros1(path, notes)
    else:
        reading = optional_import("rosbags.highlevel", "rosbags", "A bag of ROS", extra="ros")
        with reading.AnyReader([path], default_typestore=_store("ROS2_HUMBLE")) as reader:
            for connection, received, content in reader.messages():
                yield Message(
                    connection.topic, received, functools.partial(reader.deserialize, content, connection.msgtype)
                )


def _bound(function: Callable[..., Any], kind: str) -> Callable[[bytes], Any]:
    return lambda content: function(content, kind)


def _in_mcap(path: Path, notes: list[str]) -> Iterator[Message]:
    """Yield an MCAP file's messages by its specification, without index."""
    kinds = optional_import("mcap.records", "mcap", "MCAP", extra="ros")
    stream = optional_import("mcap.data_stream", "mcap", "MCAP", extra="ros")
    schemas: dict[int, Any] = {0: None}
    decoders: dict[int, tuple[str, Callable[[bytes], Any]]] = {}
    count, is_whole = 0, False
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise ValueError("it does not begin as MCAP does")
        for code, body in _chunks_opened(_mcap_records(file)):
            if code == _FOOTER:
                is_whole = True
            elif code == _SCHEMA:
                schema = kinds.Schema.read(stream.ReadDataStream(BytesIO(body)))
                schemas[schema.id] = schema
            elif code == _CHANNEL:
                channel = kinds.Channel.read(stream.ReadDataStream(BytesIO(body)))
                if channel.id not in decoders:
                    decoders[channel.id] = channel.topic, _decoder(channel.message_encoding, schemas[channel.schema_id])
            elif code == _MESSAGE:
                number, _, logged, published = struct.unpack_from("<HIQQ", body)
                topic, decode = decoders[number]
                count += 1
                yield Message(topic, logged or published, functools.partial(decode, body[22:]))
    if not is_whole:
        notes.append(f"{path.name}: the recorder was killed, or the file lost its end; {count} messages up to there")


def _mcap_records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield every record's operation code and content, the last perhaps partial."""
    while len(head := file.read(9)) == 9:
        code, length = struct.unpack("<BQ", head)
        body = file.read(min(length, _MAX_RECORD_BYTES))
        if len(body) == length or code == _CHUNK:
            yield code, body
        if len(body) < length:
            return


def _chunks_opened(records: Iterator[tuple[int, bytes]]) -> Iterator[tuple[int, bytes]]:
    """Yield records with chunks unpacked; damaged ones as far as possible."""
    for code, body in records:
        if code != _CHUNK:
            yield code, body
            continue
        if len(body) < 32:  # not even its own lengths are there
            continue
        _, _, size, checksum, letters = struct.unpack_from("<QQQII", body)
        name = body[32 : 32 + letters].decode()
        (packed,) = struct.unpack_from("<Q", body, 32 + letters)
        content = _unpacked(name, body[40 + letters : 40 + letters + packed])
        if checksum and len(content) == size and zlib.crc32(content) != checksum:
            raise ValueError("a part of it has changed: its checksum is wrong")
        yield from _mcap_records(BytesIO(content))


def _unpacked(name: str, packed: bytes) -> bytes:
    """Return a compressed block's content as far as it goes."""
    if name in ("", "none"):
        return packed
    if name == "zstd":
        made: Any = optional_import("zstandard", "mcap", "MCAP", extra="ros").ZstdDecompressor().decompressobj()
    elif name == "lz4":
        made = optional_import("lz4.frame", "mcap", "MCAP", extra="ros").LZ4FrameDecompressor()
    elif name == "bz2":
        made = bz2.BZ2Decompressor()
    else:
        raise ValueError(f"its compression is {name!r}")
    unpacked: bytes = made.decompress(packed)
    return unpacked


def _in_ros1(path: Path, notes: list[str]) -> Iterator[Message]:
    """Yield a ROS 1 bag's messages by format 2.0, without index."""
    decoders: dict[int, tuple[str, Callable[[bytes], Any]]] = {}
    count = 0
    with path.open("rb") as file:
        if file.read(len(_MAGIC_1)) != _MAGIC_1:
            raise ValueError("it does not begin as a bag of ROS 1 does")
        head, _ = next(_ros1_records(file), ({}, b""))
        is_whole = 0 < int.from_bytes(head.get("index_pos", b""), "little") < path.stat().st_size
        for fields, body in _ros1_chunks_opened(_ros1_records(file)):
            code, number = fields["op"][0], int.from_bytes(fields.get("conn", b""), "little")
            if code == _CONNECTION_1 and number not in decoders:
                facts = _ros1_fields(body)
                store, kind = _defined(facts["type"].decode(), facts["message_definition"].decode())
                decoders[number] = fields["topic"].decode(), _bound(store.deserialize_ros1, kind)
            elif code == _MESSAGE_1:
                seconds, nanoseconds = struct.unpack("<II", fields["time"])
                topic, decode = decoders[number]
                count += 1
                yield Message(topic, seconds * 1_000_000_000 + nanoseconds, functools.partial(decode, body))
    if not is_whole:
        notes.append(f"{path.name}: the recorder was killed, so it has no index; {count} messages up to there")


def _ros1_records(file: BinaryIO) -> Iterator[tuple[dict[str, bytes], bytes]]:
    """Yield every record's header and content, the last perhaps partial."""
    while len(length := file.read(4)) == 4:
        (size,) = struct.unpack("<I", length)
        header, length = file.read(min(size, _MAX_RECORD_BYTES)), file.read(4)
        if len(header) < size or len(length) < 4:
            return
        (size,) = struct.unpack("<I", length)
        body, fields = file.read(min(size, _MAX_RECORD_BYTES)), _ros1_fields(header)
        if len(body) == size or fields.get("op") == bytes([_CHUNK_1]):
            yield fields, body
        if len(body) < size:
            return


def _ros1_chunks_opened(records: Iterator[tuple[dict[str, bytes], bytes]]) -> Iterator[tuple[dict[str, bytes], bytes]]:
    for fields, body in records:
        if fields["op"] == bytes([_CHUNK_1]):
            yield from _ros1_records(BytesIO(_unpacked(fields["compression"].decode(), body)))
        else:
            yield fields, body


def _ros1_fields(header: bytes) -> dict[str, bytes]:
    fields, place = {}, 0
    while place < len(header):
        (size,) = struct.unpack_from("<I", header, place)
        name, _, value = header[place + 4 : place + 4 + size].partition(b"=")
        fields[name.decode()] = value
        place += 4 + size
    return fields


def _decoder(encoding: str, schema: Any) -> Callable[[bytes], Any]:
    """Return the function that decodes an MCAP channel's messages."""
    if encoding == "json":
        return json.loads
    if encoding == "protobuf" and schema is not None:
        return _protobuf_reader(schema.name, schema.data)
    if encoding in ("cdr", "ros1") and schema is not None:
        if not schema.data:  # older than definitions in bags: it is one of ROS's own
            store, kind = _store("ROS2_HUMBLE"), schema.name
        else:
            store, kind = _defined(schema.name, schema.data.decode(), is_idl="idl" in schema.encoding)
        read: Callable[..., Any] = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
        return _bound(read, kind)

    def refused(content: bytes) -> Any:
        raise ValueError(f"messages in {encoding or 'an unnamed encoding'} are not read")

    return refused


def _store(name: str) -> Any:
    typesys = optional_import("rosbags.typesys", "rosbags", "A bag of ROS", extra="ros")
    return typesys.get_typestore(typesys.Stores[name])


def _defined(name: str, definition: str, *, is_idl: bool = False) -> tuple[Any, str]:
    """Return a type store with the defined type, and its name."""
    typesys = optional_import("rosbags.typesys", "rosbags", "A bag of ROS", extra="ros")
    kind = name if name.count("/") != 1 else name.replace("/", "/msg/")
    if is_idl:
        types: dict[str, Any] = {}
        for part in definition.split("=" * 80 + "\n"):
            text = part.partition("\n")[2] if part.startswith("IDL: ") else part
            types.update(typesys.get_types_from_idl(text) if text.strip() else {})
    else:
        types = typesys.get_types_from_msg(definition, kind)
    store = _store("EMPTY")
    store.register(types)
    return store, kind


def _protobuf_reader(name: str, definition: bytes) -> Callable[[bytes], Any]:
    """Return a message reader from MCAP's Protobuf file descriptors."""
    described = optional_import("google.protobuf.descriptor_pb2", "protobuf", "MCAP of Protobuf", extra="formats")
    pools = optional_import("google.protobuf.descriptor_pool", "protobuf", "MCAP of Protobuf", extra="formats")
    factory = optional_import("google.protobuf.message_factory", "protobuf", "MCAP of Protobuf", extra="formats")
    pool = pools.DescriptorPool()
    for each in described.FileDescriptorSet.FromString(definition).file:
        pool.Add(each)
    made = factory.GetMessageClass(pool.FindMessageTypeByName(name))
    return lambda content: _plain(made.FromString(content))


def _plain(message: Any) -> Any:
    """Return a Protobuf message as mapping, default values included."""
    if not hasattr(message, "DESCRIPTOR"):
        return message
    found = {}
    for each in message.DESCRIPTOR.fields:
        value = getattr(message, each.name)
        is_list = not isinstance(value, str | bytes) and not hasattr(value, "DESCRIPTOR") and hasattr(value, "__len__")
        found[each.name] = [_plain(one) for one in value] if is_list else _plain(value)
    return found


_LONGEST_ARRAY = 16  # a longer one is a picture or a cloud of points, not a few sensors or joints
_UNITS = {  # of REP 103, by message and field
    ("geometry_msgs/msg/Wrench", "force"): "N",
    ("geometry_msgs/msg/Wrench", "torque"): "N m",
    ("geometry_msgs/msg/Twist", "linear"): "m/s",
    ("geometry_msgs/msg/Pose", "position"): "m",
    ("geometry_msgs/msg/PointStamped", "point"): "m",
    ("geometry_msgs/msg/Transform", "translation"): "m",
}
_TIMES_INSIDE = ("header", "timestamp", "stamp")  # fields of messages that hold the time of the reading
_CLOCKS_APART = 1e9  # [ns] between the clocks of two topics, beyond which they are not the same clock
_FEW_REPEATED = 0.1  # share of repeated stamps up to which they are a slip, and not a clock that is too coarse


class _PictureFound(Exception):
    """Signal for a topic of pictures, whose few numbers are sizes."""


@dataclass
class _Topic:
    """Messages of a topic."""

    stamps: list[int] = field(default_factory=list)  # [ns]
    received: list[int] = field(default_factory=list)
    # messages that hold them, and numbers, by header
    columns: dict[str, tuple[list[int], list[float]]] = field(default_factory=dict)
    trouble: str = ""

    def add(self, received: int, message: Any, topic: str) -> None:
        """Add the numbers in a message."""
        leaves = dict(_numbers_in(message))
        for name, value in leaves.items():
            places, values = self.columns.setdefault(f"{topic}{name}", ([], []))
            places.append(len(self.stamps))
            values.append(value)
        self.stamps.append(_stamp_of(message) or received)  # a stamp of 0 was never filled in
        self.received.append(received)

    def series(self, topic: str, times: list[int], origin: int) -> Iterator[Series]:
        """Yield columns of the same messages, separately for each publisher."""
        seconds = 1e-9 * np.array([stamp - origin for stamp in times], dtype=np.float64)
        alike: dict[tuple[int, ...], list[str]] = {}
        for name, (places, _) in self.columns.items():
            alike.setdefault(tuple(places), []).append(name)
        for together, names in alike.items():
            values = np.column_stack([self.columns[name][1] for name in names])
            yield Series(source=topic, headers=tuple(names), times=seconds[list(together)], values=values)


def bag_table(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read a bag of ROS 1 or 2, or MCAP.

    Suffixes are ``.bag`` for ROS 1, and ``.mcap`` and ``.db3`` for ROS 2, or its folder. MCAP may hold JSON or
    Protobuf. `names` are columns that are needed, such as ``/ft/wrench.wrench.force.x``, as for
    :func:`cutenv.records.foreign.array_tables.joined`: the series are the topics.
    """
    if not path.is_dir():
        path.open("rb").close()  # a missing file is a missing file
    topics: dict[str, _Topic] = {}
    notes: list[str] = []
    with refusing_damage(path, "bag of ROS"):
        for topic, received, content in messages(path, notes):
            found = topics.setdefault(topic, _Topic())
            if not found.trouble:
                _add(found, received, content, topic)
    sound = {topic: found for topic, found in topics.items() if found.columns and not found.trouble}
    notes += [f"{topic} is left out: {found.trouble}" for topic, found in topics.items() if found.trouble.strip("-")]
    if not sound:
        told = f" ({'; '.join(notes)})" if notes else ""
        raise RecordError(path, f"none of its topics holds numbers of a sensor{told}. Record the force's topic, too.")
    needed = {*map(bare_name, names)}
    wanted = {topic: found for topic, found in sound.items() if needed & {*map(bare_name, found.columns)}}
    times = _times(wanted or sound, notes)
    origin = min(min(times.get(topic, found.stamps)) for topic, found in sound.items())
    every = [
        each for topic, found in sound.items() for each in found.series(topic, times.get(topic, found.stamps), origin)
    ]
    if len(every) == 1 and np.ptp(every[0].times) == 0.0:  # a writer that leaves the time of its log out
        pairs = list(zip(every[0].headers, every[0].values.T, strict=True))
        notes.append("its messages were not logged with times")
        return NamedColumns.of(
            path, pairs, about=f"readings of {every[0].source}", row_name="reading", notes=tuple(notes)
        )
    return joined(path, every, names, notes)


def _add(found: _Topic, received: int, content: Any, topic: str) -> None:
    try:
        found.add(received, content(), topic)
    except ModuleNotFoundError:
        raise
    except _PictureFound:
        found.trouble = "-"
    except Exception as error:
        found.trouble = f"a message of it is not read ({reason_of(error)})"


def _times(topics: Mapping[str, _Topic], notes: list[str]) -> dict[str, list[int]]:
    """Return topics' times [ns], from headers or, if unsuitable, the log.

    Header times of several clocks, and coarse ones, are unsuitable.
    """
    offsets = [float(np.median(np.subtract(found.stamps, found.received))) for found in topics.values()]
    if max(offsets) - min(offsets) > _CLOCKS_APART:
        notes.append("the stamps in the headers are of different clocks; the times of the log are taken")
        return {topic: found.received for topic, found in topics.items()}
    times = {}
    for topic, found in topics.items():
        stamped, logged = len({*found.stamps}), len({*found.received})
        is_coarse = stamped < (1.0 - _FEW_REPEATED) * len(found.stamps) and logged > stamped
        if is_coarse:
            notes.append(f"{topic}: {len(found.stamps) - stamped} stamps repeat; the times of the log are taken")
        times[topic] = found.received if is_coarse else found.stamps
    return times


def _stamp_of(message: Any) -> int:
    """Return a message's own time stamp [ns], 0 without one."""
    for name in _TIMES_INSIDE:
        inside = _field(message, name)
        stamp = _field(inside, "stamp") if name == "header" else inside
        whole = next((value for key in ("sec", "secs", "seconds") if (value := _field(stamp, key)) is not None), None)
        if isinstance(whole, int):
            parts = (_field(stamp, key) for key in ("nanosec", "nsec", "nsecs", "nanos"))
            return whole * 1_000_000_000 + int(next((part for part in parts if part is not None), 0))
    return 0


def _field(message: Any, name: str) -> Any:
    return message.get(name) if isinstance(message, dict) else getattr(message, name, None)


def _numbers_in(message: Any, path: str = "", unit: str = "") -> Iterator[tuple[str, float]]:
    """Yield header and value of a message's numbers.

    Joints go by their names, short arrays by places.
    """
    kind = getattr(message, "__msgtype__", "")
    if kind in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time"):
        return
    if kind:
        joints = list(message.name) if kind == "sensor_msgs/msg/JointState" else []
        for name in message.__dataclass_fields__:
            if name != "__msgtype__":
                value = getattr(message, name)
                if joints and isinstance(value, np.ndarray) and len(value) == len(joints):
                    value = dict(zip(joints, value.tolist(), strict=True))
                yield from _numbers_in(value, f"{path}.{name}", _UNITS.get((kind, name), unit))
    elif isinstance(message, dict):
        for name, value in message.items():
            if not (path == "" and name in _TIMES_INSIDE and _stamp_of(message)):
                yield from _numbers_in(value, f"{path}.{name}", unit)
    elif isinstance(message, np.ndarray | list | tuple):
        if len(message) > _LONGEST_ARRAY:
            raise _PictureFound
        for k, value in enumerate(message.tolist() if isinstance(message, np.ndarray) else message):
            yield from _numbers_in(value, f"{path}.{k}", unit)
    elif isinstance(message, bytes):
        raise _PictureFound
    elif isinstance(message, int | float) and not isinstance(message, bool):
        yield (f"{path} [{unit}]" if unit else path), float(message)
