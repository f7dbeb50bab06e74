"""Readings and markers of cuts, sent to the Lab Streaming Layer while the cuts go on; nothing ever comes back.

Two streams are made. ``SOURCE readings`` (type Force) has a sample each millisecond: force [N], position [m], speed
[m/s], angle [rad], depth [m], in double precision. ``SOURCE markers`` (type Markers) has ``begin NAME`` and ``end
CAUSE``.

liblsl finds streams by multicast, which is kept on this machine unless another scope is asked for. Its data sockets,
however, accept connections at every interface of the machine, whatever the scope: a firewall closes them.
"""

from __future__ import annotations

import queue
import socket
import threading
import time
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv.recording.columns import unit_of
from cutenv.recording.lsl_library import lsl
from cutenv.trace import Reading

STREAMED = Reading._fields[1:]
"""Channels of the stream of readings."""
_RATE = 1000.0  # readings a second
_LONGEST_WAIT = 2.0  # [s] for what is still to be sent when the outlet is closed


class LslOutlet:
    """Listener to the cuts of one source, a rig or a person who plays, that streams them.

    A thread of its own talks to liblsl: the caller puts readings into a queue and never waits.

    Parameters
    ----------
    source : str
        Name in front of the streams' names, such as "cutenv rig".
    scope : {"machine", "link", "site"}
        Reach of the streams.
    about : dict of str to str, optional
        Facts for readers, kept in the description of the stream of readings.

    Raises
    ------
    ValueError, ModuleNotFoundError, OSError
        As :func:`cutenv.recording.lsl_library.lsl`.
    """

    def __init__(self, source: str, *, scope: str = "machine", about: dict[str, str] | None = None) -> None:
        pylsl = lsl(scope)
        host = socket.gethostname()
        readings = pylsl.StreamInfo(
            f"{source} readings", "Force", len(STREAMED), _RATE, "double64", f"{source} readings on {host}"
        )
        channels = readings.desc().append_child("channels")
        for name in STREAMED:
            channel = channels.append_child("channel")
            channel.append_child_value("label", name)
            channel.append_child_value("unit", unit_of(name).sign)
            channel.append_child_value("type", "Force" if name == "force" else "Motion")
        for name, value in (about or {}).items():
            readings.desc().append_child_value(name, value)
        markers = pylsl.StreamInfo(f"{source} markers", "Markers", 1, 0.0, "string", f"{source} markers on {host}")
        self._readings, self._markers = pylsl.StreamOutlet(readings), pylsl.StreamOutlet(markers)
        self._ahead = pylsl.local_clock() - time.monotonic()
        self._waiting: queue.SimpleQueue[tuple[Array, Any] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._send, name="cutenv lsl", daemon=True)
        self._thread.start()

    def began(self, name: str) -> None:
        """Mark the beginning of a cut."""
        self._mark(f"begin {name}")

    def readings(self, readings: StructArray, depth: Array, origin: float) -> None:
        """Send readings.

        Parameters
        ----------
        readings : Records
            :data:`cutenv.cutting.dtypes.READING`, shape (n,).
        depth : ndarray of shape (n,)
            Depth of cut at each of them [m].
        origin : float
            When their time was zero, by ``time.monotonic()`` [s].
        """
        rows = np.column_stack([*(readings[name] for name in STREAMED[:-1]), depth])
        self._waiting.put((origin + readings["time"], rows))

    def ended(self, cause: str) -> None:
        """Mark the end of a cut and its cause."""
        self._mark(f"end {cause}")

    def close(self) -> None:
        """Send what is waiting, and end the streams; further calls do nothing."""
        self._waiting.put(None)
        self._thread.join(_LONGEST_WAIT)

    def _mark(self, text: str) -> None:
        self._waiting.put((np.array([time.monotonic()]), text))

    def _send(self) -> None:
        while (item := self._waiting.get()) is not None:
            times, content = item
            stamps = (times + self._ahead).tolist()
            if isinstance(content, str):
                self._markers.push_sample([content], stamps[0])
            else:
                self._readings.push_chunk(content.tolist(), stamps)
        del self._readings, self._markers  # which tells liblsl that the streams are over
