"""Messages in bags of ROS and in MCAP files of any program, up to where a killed recorder left them."""

from __future__ import annotations

import bz2
import json
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from cutenv._base.imports import optional_import

BAGS = (".mcap", ".bag", ".db3", ".active")
"""Suffixes of bags: MCAP, ROS 1, ROS 2 in SQLite, and a ROS 1 bag whose recorder was killed (``.bag.active``)."""
_FILES = (".mcap", ".db3")  # in the folder of a bag
_LARGEST = 1 << 31  # bytes of a record, so that a damaged length does not request all memory
_MAGIC, _MAGIC_1 = b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6  # operation codes of MCAP
_MESSAGE_1, _CHUNK_1, _CONNECTION_1 = 2, 5, 7  # those of ROS 1


class Message(NamedTuple):
    """One message: its topic, when it was logged [ns], and a function that returns its content."""

    topic: str
    received: int
    content: Callable[[], Any]


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag by its suffix, or the folder of a ROS 2 bag."""
    if path.is_dir():  # ROS 2 calls the first file after the folder, and writes the other at the end
        return any((path / name).is_file() for name in ("metadata.yaml", *(f"{path.name}_0{each}" for each in _FILES)))
    return path.suffix.lower() in BAGS


def messages(path: Path, notes: list[str]) -> Iterator[Message]:
    """Yield the messages of a bag in the order of the file; add peculiarities to `notes`.

    Raises
    ------
    ModuleNotFoundError
        If a library is not installed; names the pip command.
    Exception
        Any, of a damaged file.
    """
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
                yield Message(connection.topic, received, _deferred(reader.deserialize, content, connection.msgtype))


def _bound(function: Callable[..., Any], kind: str) -> Callable[[bytes], Any]:
    return lambda content: function(content, kind)


def _deferred(function: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
    return lambda: function(*arguments)


def _in_mcap(path: Path, notes: list[str]) -> Iterator[Message]:
    """Yield those of an MCAP file, by its specification; an index is not needed."""
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
                yield Message(topic, logged or published, _deferred(decode, body[22:]))
    if not is_whole:
        notes.append(f"{path.name}: the recorder was killed, or the file lost its end; {count} messages up to there")


def _mcap_records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield operation code and content of every record; the last one as far as it goes."""
    while len(head := file.read(9)) == 9:
        code, length = struct.unpack("<BQ", head)
        body = file.read(min(length, _LARGEST))
        if len(body) == length or code == _CHUNK:
            yield code, body
        if len(body) < length:
            return


def _chunks_opened(records: Iterator[tuple[int, bytes]]) -> Iterator[tuple[int, bytes]]:
    """Yield records with the content of chunks in their place; of a chunk that lost its end what is left of it."""
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
    """Return the content of a compressed block, as far as it goes."""
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
    """Yield those of a bag of ROS 1, by its format 2.0; an index is not needed."""
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
                yield Message(topic, seconds * 1_000_000_000 + nanoseconds, _deferred(decode, body))
    if not is_whole:
        notes.append(f"{path.name}: the recorder was killed, so it has no index; {count} messages up to there")


def _ros1_records(file: BinaryIO) -> Iterator[tuple[dict[str, bytes], bytes]]:
    """Yield header and content of every record; the last one as far as it goes."""
    while len(length := file.read(4)) == 4:
        (size,) = struct.unpack("<I", length)
        header, length = file.read(min(size, _LARGEST)), file.read(4)
        if len(header) < size or len(length) < 4:
            return
        (size,) = struct.unpack("<I", length)
        body, fields = file.read(min(size, _LARGEST)), _ros1_fields(header)
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
    """Return the function that reads the messages of a channel of MCAP."""
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
    """Return a store of types with the defined one, and its full name."""
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
    """Return a reader of one type of message, of the file descriptors that MCAP keeps with it."""
    described = optional_import("google.protobuf.descriptor_pb2", "protobuf", "MCAP of Protobuf", extra="formats")
    pools = optional_import("google.protobuf.descriptor_pool", "protobuf", "MCAP of Protobuf", extra="formats")
    factory = optional_import("google.protobuf.message_factory", "protobuf", "MCAP of Protobuf", extra="formats")
    pool = pools.DescriptorPool()
    for each in described.FileDescriptorSet.FromString(definition).file:
        pool.Add(each)
    made = factory.GetMessageClass(pool.FindMessageTypeByName(name))
    return lambda content: _plain(made.FromString(content))


def _plain(message: Any) -> Any:
    """Return a message of Protobuf as a mapping, with the fields that have their default, too."""
    if not hasattr(message, "DESCRIPTOR"):
        return message
    found = {}
    for each in message.DESCRIPTOR.fields:
        value = getattr(message, each.name)
        is_list = not isinstance(value, str | bytes) and not hasattr(value, "DESCRIPTOR") and hasattr(value, "__len__")
        found[each.name] = [_plain(one) for one in value] if is_list else _plain(value)
    return found
