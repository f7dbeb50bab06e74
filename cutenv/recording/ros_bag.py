"""Bags of ROS 1 and ROS 2, and other MCAP, as tables: every number of every message is a column."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.recording.bag_messages import messages
from cutenv.recording.joined_series import Series, joined
from cutenv.recording.named_columns import NamedColumns, bare_name
from cutenv.recording.schema import RecordError

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
    """Signal that a topic holds pictures or clouds of points: its few numbers are their sizes."""


@dataclass
class _Topic:
    """Messages of a topic: their times [ns], and the numbers in them by header, with the messages that hold them."""

    stamps: list[int] = field(default_factory=list)
    received: list[int] = field(default_factory=list)
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
        """Yield columns that the same messages hold; those of two publishers on one topic are apart."""
        seconds = 1e-9 * np.array([stamp - origin for stamp in times], dtype=np.float64)
        alike: dict[tuple[int, ...], list[str]] = {}
        for name, (places, _) in self.columns.items():
            alike.setdefault(tuple(places), []).append(name)
        for together, names in alike.items():
            values = np.column_stack([self.columns[name][1] for name in names])
            yield Series(source=topic, headers=tuple(names), times=seconds[list(together)], values=values)


def bag_table(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read a bag: of ROS 2 (``.mcap``, ``.db3`` or its folder), of ROS 1 (``.bag``), or MCAP of JSON or Protobuf.

    Parameters
    ----------
    path : path
        Path of the file or folder.
    names : collection of str
        Columns that are needed, such as ``/ft/wrench.wrench.force.x``, that of the force first: the rows are the
        messages of its topic, from where to where all the needed topics have messages. Without it, the rows are those
        of the topic with a force that has the most messages.

    Raises
    ------
    RecordError
        If it is no bag, a damaged one, or holds no numbers.
    ModuleNotFoundError
        If a library is not installed; names the pip command.
    """
    if not path.is_dir():
        path.open("rb").close()  # a missing file is a missing file
    topics: dict[str, _Topic] = {}
    notes: list[str] = []
    try:
        for topic, received, content in messages(path, notes):
            found = topics.setdefault(topic, _Topic())
            if not found.trouble:
                _add(found, received, content, topic)
    except ModuleNotFoundError:
        raise
    except Exception as error:  # the libraries raise errors of any kind for a damaged file
        raise RecordError(
            path, f"it is no bag of ROS, or a damaged one ({_reason(error)}). Take the file again."
        ) from None
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
        found.trouble = f"a message of it is not read ({_reason(error)})"


def _reason(error: Exception) -> str:
    return str(error).partition("\n")[0] or type(error).__name__


def _times(topics: Mapping[str, _Topic], notes: list[str]) -> dict[str, list[int]]:
    """Return the times of topics [ns]: of their headers, or of the log where those are of several clocks or coarse."""
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
    """Return the time that a message itself holds [ns]; 0 if it holds none."""
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
