"""Records as MCAP, the container of ROS 2 bags.

Exact readings for us, standard messages for the tools of ROS.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv._base.imports import optional_import
from cutenv.records.schema import SCHEMA, as_names, check_schema, header_of, mapping_from_json, refusing_damage, to_json
from cutenv.records.table import CutTable, row_from_0
from cutenv.sim.trace import CHANNELS, COMPONENTS_OF_FORCE, PLACE, Reading, Trace

_FIELDS = (*Reading._fields, *CHANNELS)
"""Numbers of a ``cutenv_msgs/msg/Reading`` in their order; NaN for what a cut does not hold."""
_METADATA = "cutenv"  # name of the metadata record that holds everything but the readings
_LARGEST_RECORD, _LARGEST_CHUNK = 1 << 28, 1 << 26  # bytes, so that a damaged length does not request all memory
_BYTES_AS_CDR = b"\x00\x01\x00\x00"  # little endian, as rmw implementations of ROS 2 write it
_STAMP = [("seconds", "<i4"), ("nanoseconds", "<u4")]
_READING = np.dtype([("cdr", "V4"), *_STAMP, ("values", "<f8", len(_FIELDS))])

_TIME_DEFINITION = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_HEADER_DEFINITION = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
_SEPARATOR = "=" * 80 + "\n"
_UNITS = {
    "time": "s", "position": "m", "speed": "m/s", "angle": "rad", "depth": "m", "height": "m",
    **dict.fromkeys(PLACE, "m"),
}  # fmt: skip
_DEFINITIONS = {
    "cutenv_msgs/msg/Reading": "builtin_interfaces/Time stamp\n"
    + "".join(f"float64 {name}  # {_UNITS.get(name, 'N m' if 'torque' in name else 'N')}\n" for name in _FIELDS)
    + _SEPARATOR
    + _TIME_DEFINITION,
    "geometry_msgs/msg/WrenchStamped": _SEPARATOR.join(
        (
            "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n",
            "MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
            "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
            _HEADER_DEFINITION,
            _TIME_DEFINITION,
        )
    ),
    "sensor_msgs/msg/JointState": _SEPARATOR.join(
        (
            "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
            _HEADER_DEFINITION,
            _TIME_DEFINITION,
        )
    ),
}


_Messages = Iterator[tuple[int, bytes]]  # log time [ns] and content of each


def write(traces: Sequence[Trace], path: Path) -> None:
    """Write a new file whose whole content carries checksums.

    Each cut has a topic ``/cut_0/reading`` with every number as it is, and copies of it in standard messages for the
    tools of ROS: ``/cut_0/wrench`` (force and torque; x is the force along the cut, against forward motion, where the
    six components are not known) and ``/cut_0/blade`` (joints ``feed`` [m] and ``tilt`` [rad]). Only the readings are
    read again.
    """
    writer_of = optional_import("mcap.writer", "mcap", "MCAP", extra="ros")
    with path.open("wb") as file:
        writer = writer_of.Writer(file, enable_data_crcs=True)
        writer.start(profile="ros2", library="cutenv")
        noted = {"schema": SCHEMA, "cuts": str(len(traces))}
        schemas = {
            name: writer.register_schema(name=name, encoding="ros2msg", data=definition.encode())
            for name, definition in _DEFINITIONS.items()
        }
        for number, trace in enumerate(traces):
            facts = {"metadata": trace.metadata, "force_unit": trace.force_unit, "known": trace.known}
            noted[f"cut_{number}"] = to_json({**facts, "readings": len(trace)})
            stamps = _stamps(trace)
            topics = {"reading": ("cutenv_msgs/msg/Reading", _readings(trace, stamps))}
            if trace.force_unit == "N":
                topics["wrench"] = ("geometry_msgs/msg/WrenchStamped", _wrenches(trace, stamps))
            if trace.position is not None:
                topics["blade"] = ("sensor_msgs/msg/JointState", _joints(trace, stamps))
            for topic, (kind, messages) in topics.items():
                channel = writer.register_channel(
                    topic=f"/cut_{number}/{topic}",
                    message_encoding="cdr",
                    schema_id=schemas[kind],
                    metadata={"offered_qos_profiles": ""},
                )
                for sequence, (stamp, content) in enumerate(messages):
                    writer.add_message(channel, stamp, content, stamp, sequence)
        writer.add_metadata(_METADATA, noted)
        writer.finish()


def read(path: Path) -> list[CutTable]:
    """Read a file of :func:`write` as a table for each cut.

    Bags of other programs are read by :func:`cutenv.records.load_foreign`.
    """
    optional_import("mcap", "mcap", "MCAP", extra="ros")
    with refusing_damage(path, "MCAP file"):
        noted, contents = _content(path)
    if noted is None:
        raise ValueError("it is a bag of another program. Name its topics: --map time=stamp force=TOPIC.FIELD.")
    check_schema(noted.get("schema", ""))
    if noted.get("cuts") != str(len(noted) - 2):
        raise ValueError(f"it announces {noted.get('cuts')!r} cuts and describes {len(noted) - 2}. Take it again.")
    return [_table(number, noted, contents) for number in range(len(noted) - 2)]


def holds_cuts(path: Path) -> bool:
    """Return whether a file has :func:`write`'s metadata, False if damaged."""
    try:
        return _content(path, only_metadata=True)[0] is not None
    except Exception:
        return False


def _content(path: Path, *, only_metadata: bool = False) -> tuple[dict[str, str] | None, dict[str, list[bytes]]]:
    """Return our metadata or None, and reading messages by topic."""
    from mcap import records
    from mcap.stream_reader import StreamReader, breakup_chunk

    noted = None
    topics: dict[int, str] = {}
    contents: dict[str, list[bytes]] = {}
    with path.open("rb") as file:
        reader = StreamReader(
            file, emit_chunks=True, validate_crcs=not only_metadata, record_size_limit=_LARGEST_RECORD
        )
        for record in reader.records:
            if isinstance(record, records.Metadata) and record.name == _METADATA:
                noted = record.metadata
            if only_metadata or not isinstance(record, records.Chunk):
                continue
            if record.uncompressed_size > _LARGEST_CHUNK:
                raise ValueError(f"a part of it announces {record.uncompressed_size} bytes")
            for inner in breakup_chunk(record, validate_crc=True):
                if isinstance(inner, records.Channel):
                    topics[inner.id] = inner.topic
                elif isinstance(inner, records.Message):
                    contents.setdefault(topics[inner.channel_id], []).append(inner.data)
    return noted, contents


def _table(number: int, noted: Mapping[str, str], contents: Mapping[str, list[bytes]]) -> CutTable:
    """Return one cut as a table."""
    name = f"cut_{number}"
    facts = mapping_from_json(name, noted.get(name, ""))
    messages = contents.get(f"/{name}/reading", [])
    if facts.get("readings") != len(messages):
        raise ValueError(
            f"{name} announces {facts.get('readings')!r} readings and holds {len(messages)}. Take it again."
        )
    if any(len(message) != _READING.itemsize for message in messages):
        raise ValueError(f"{name} has readings of another length than {_READING.itemsize} bytes. Save it again.")
    values: Array = np.frombuffer(b"".join(messages), _READING)["values"].astype(np.float64)
    known = as_names(f"known of {name}", facts.get("known"))
    unknown = [field for field in known if field not in _FIELDS]
    if unknown:
        raise ValueError(f"{name} is said to hold {unknown[0]!r}, which is no quantity of a cut. Save it again.")
    columns = [np.ascontiguousarray(values[:, _FIELDS.index(field)]) for field in known]
    return CutTable.of(
        [header_of(field, str(facts.get("force_unit"))) for field in known],
        columns,
        name=f"{name}: ",
        place=row_from_0,
        native=True,
        shared=mapping_from_json("metadata", to_json(facts.get("metadata"))),
    )


def _stamps(trace: Trace) -> list[int]:
    """Return readings' times [ns] since 1970, or the cut's start."""
    try:
        start = datetime.fromisoformat(str(trace.metadata.get("date"))).timestamp()
    except (ValueError, OverflowError, OSError):
        start = 0.0
    origin = round(max(start, 0.0) * 1e9)
    passed = np.clip((trace.time - trace.time[0]) * 1e9, 0.0, 2.0**62)  # a time may be anything in a record
    return [origin + int(nanoseconds) for nanoseconds in passed.round().tolist()]


def _parts_of(stamp: int) -> tuple[int, int]:
    """Return ROS's 32-bit seconds and nanoseconds, until 2038."""
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    return min(seconds, 2**31 - 1), nanoseconds


def _readings(trace: Trace, stamps: list[int]) -> _Messages:
    rows: NDArray[Any] = np.zeros(len(trace), _READING)
    rows["cdr"] = np.void(_BYTES_AS_CDR)
    rows["values"] = np.nan
    for name in trace.known:
        rows["values"][:, _FIELDS.index(name)] = getattr(trace, name)
    for stamp, row in zip(stamps, rows, strict=True):
        row["seconds"], row["nanoseconds"] = _parts_of(stamp)
        yield stamp, row.tobytes()


def _wrenches(trace: Trace, stamps: list[int]) -> _Messages:
    if trace.wrench is not None:
        frame, values = b"sensor\0", trace.wrench
    else:
        frame, values = b"cut\0", np.zeros((len(trace), len(COMPONENTS_OF_FORCE)))
        values[:, 0] = trace.force
        values[:, 2] = 0.0 if trace.vertical_force is None else trace.vertical_force
    layout = struct.Struct(f"<4siII{len(frame)}s{-(12 + len(frame)) % 8}x6d")
    for stamp, row in zip(stamps, values.tolist(), strict=True):
        yield stamp, layout.pack(_BYTES_AS_CDR, *_parts_of(stamp), len(frame), frame, *row)


def _joints(trace: Trace, stamps: list[int]) -> _Messages:
    """Yield joint states: feed along the cut, and known blade tilt."""
    assert trace.position is not None
    joints = {b"feed\0": (trace.position, trace.blade_speed if trace.speed is None else trace.speed)}
    if trace.angle is not None:
        joints[b"tilt\0"] = (trace.angle, np.gradient(trace.angle, trace.time))
    count = len(joints)
    fixed = struct.pack("<I1s3xI", 1, b"\0", count) + b"".join(struct.pack("<I5s3x", 5, name) for name in joints)
    stamp_layout = struct.Struct("<4siI")
    # Doubles stand at multiples of 8, counted from behind the four bytes of the encoding.
    body = struct.Struct(f"<I{-(8 + len(fixed) + 4) % 8}x{count}dI4x{count}dI")
    where, fast = (np.column_stack(values).tolist() for values in zip(*joints.values(), strict=True))
    for stamp, places, speeds in zip(stamps, where, fast, strict=True):
        head = stamp_layout.pack(_BYTES_AS_CDR, *_parts_of(stamp))
        yield stamp, head + fixed + body.pack(count, *places, count, *speeds, 0)
