"""Bags of ROS 1 and ROS 2 as tables: every number of every message a column, brought to the times of one topic."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.imports import optional_import
from cutenv.recording.mapped_columns import STAMP
from cutenv.recording.named_columns import NamedColumns, bare_name
from cutenv.recording.schema import RecordError

BAGS = (".mcap", ".bag", ".db3")
"""Suffixes of bags: MCAP, ROS 1, and ROS 2 in SQLite."""
_LONGEST_ARRAY = 16  # a longer one is a picture or a cloud of points, not a few sensors or joints
_UNITS = {  # of REP 103, by message and field
    ("geometry_msgs/msg/Wrench", "force"): "N",
    ("geometry_msgs/msg/Twist", "linear"): "m/s",
    ("geometry_msgs/msg/Pose", "position"): "m",
    ("geometry_msgs/msg/PointStamped", "point"): "m",
    ("geometry_msgs/msg/Transform", "translation"): "m",
}


class _PictureFound(Exception):
    """Signal that a topic holds pictures or clouds of points: its few numbers are their sizes."""


@dataclass
class _Topic:
    """Messages of a topic: their times [ns], and the numbers in them by header."""

    stamps: list[int] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)
    headers: tuple[str, ...] = ()


def bag_table(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read a bag: an ``.mcap`` or ``.db3`` file of ROS 2, also one out of a bag's folder, or a ``.bag`` of ROS 1.

    Parameters
    ----------
    path : path
        Path of the file.
    names : collection of str
        Columns that are needed, such as ``/ft/wrench.wrench.force.x``, that of the force first: the rows are the
        messages of its topic, from where to where all the needed topics have messages. Without it, the rows are those
        of the topic with a force that has the most messages.

    Raises
    ------
    RecordError
        If it is no bag, a damaged one, or holds no numbers.
    ModuleNotFoundError
        If rosbags is not installed; names the pip command.
    """
    reading = optional_import("rosbags.highlevel", "rosbags", "A bag of ROS", extra="ros")
    typesys = optional_import("rosbags.typesys", "rosbags", "A bag of ROS", extra="ros")
    path.open("rb").close()  # a missing file is a missing file
    topics: dict[str, _Topic] = {}
    try:
        # Definitions are in the bag, except in those of ROS 2 before 2023.
        store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        with reading.AnyReader([path], default_typestore=store) as reader:
            for connection in reader.connections:
                _collect(reader, connection, topics)
    except Exception as error:  # the library raises errors of any kind for a damaged file
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise RecordError(path, f"it is no bag of ROS, or a damaged one ({reason}). Take the file again.") from None
    if not topics:
        raise RecordError(path, "none of its topics holds numbers of a sensor. Record the force's topic, too.")
    return _joined(path, topics, names)


def _collect(reader: Any, connection: Any, topics: dict[str, _Topic]) -> None:
    """Add the numbers in a connection's messages to its topic; nothing for messages without a few numbers."""
    found = topics.get(connection.topic, _Topic())
    for _, received, content in reader.messages([connection]):
        message = reader.deserialize(content, connection.msgtype)
        try:
            leaves = dict(_numbers_in(message))
        except _PictureFound:
            return
        headers = tuple(f"{connection.topic}{name}" for name in leaves)
        if not headers or (found.headers and headers != found.headers):
            if found.headers:
                raise ValueError(f"the messages of {connection.topic} hold different numbers")
            return
        found.headers = headers
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        measured = 0 if stamp is None else stamp.sec * 1_000_000_000 + stamp.nanosec
        found.stamps.append(measured or received)  # a stamp of 0 was never filled in
        found.rows.append(list(leaves.values()))
    if found.rows:
        topics[connection.topic] = found


def _numbers_in(message: Any, path: str = "", unit: str = "") -> Iterator[tuple[str, float]]:
    """Yield header and value of the numbers in a message; joints by their names, short arrays by their places."""
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
            yield f"{path}.{name}", float(value)
    elif isinstance(message, np.ndarray):
        if len(message) > _LONGEST_ARRAY:
            raise _PictureFound
        if message.dtype.kind in "fiu":
            yield from ((f"{path}.{k}", float(value)) for k, value in enumerate(message))
    elif isinstance(message, int | float) and not isinstance(message, bool):
        yield (f"{path} [{unit}]" if unit else path), float(message)


def _joined(path: Path, topics: dict[str, _Topic], names: Collection[str]) -> NamedColumns:
    topic_of = {bare_name(header): topic for topic, found in topics.items() for header in found.headers}
    needed = list(dict.fromkeys(topic_of[name] for name in map(bare_name, names) if name in topic_of))
    forces = [topic for topic, found in topics.items() if any(header.endswith("[N]") for header in found.headers)]
    base = needed[0] if needed else max(forces or topics, key=lambda topic: len(topics[topic].stamps))
    origin = min(topics[base].stamps)
    times, values = {}, {}
    for topic, found in topics.items():
        seconds = 1e-9 * np.array([stamp - origin for stamp in found.stamps], dtype=np.float64)
        order = np.argsort(seconds, kind="stable")
        times[topic], values[topic] = seconds[order], np.array(found.rows, dtype=np.float64)[order]
    rows, used = times[base], needed or [base]
    first, last = max(times[topic][0] for topic in used), min(times[topic][-1] for topic in used)
    kept: NDArray[np.intp] = np.flatnonzero((rows >= first) & (rows <= last))
    if len(kept) < 2:
        listed = ", ".join(f"{topic} from {times[topic][0]:.3f} s to {times[topic][-1]:.3f} s" for topic in used)
        raise RecordError(path, f"its topics have no two readings at the same time: {listed}. Map topics that do.")
    columns = [rows[kept]]
    for topic in topics:
        whole = values[topic].T
        columns += [one[kept] if topic == base else np.interp(rows[kept], times[topic], one) for one in whole]
    headers = (f"{STAMP} [s]", *(header for found in topics.values() for header in found.headers))
    return NamedColumns.of(
        path, list(zip(headers, columns, strict=True)), about=f"readings of {base}", row_name="reading", lines=kept + 1
    )
