"""Object dictionary of one drive, read and written by SDO through canopen's client."""

from __future__ import annotations

import logging
import struct
import threading
from typing import Any

from cutenv.rig.devices.canopen.network import CanNetwork
from cutenv.rig.devices.canopen.objects import SDO_REQUEST_FRAME, SDO_RESPONSE_FRAME, Entry
from cutenv.rig.errors import RigError

_ANSWER_LIMIT = 0.5  # [s]; a drive takes a millisecond, unless it writes to its memory


class Unanswered(RigError):
    """Error for a drive that has not answered in time, or not to the question."""


class SdoRefused(RigError):
    """Error for a drive that has answered with an abort code."""


class SdoChannel:
    """Values that a drive keeps by index and sub-index.

    Every method raises :class:`Unanswered` after half a second without an answer, :class:`SdoRefused` if the drive
    aborts, and :class:`RigError` if the bus is broken; the messages name axis, node and object.

    Parameters
    ----------
    network : CanNetwork
        Network that the axis has joined.
    node : int
        Number of the drive's node.
    name : str
        Name of the axis.
    """

    def __init__(self, network: CanNetwork, node: int, name: str) -> None:
        from canopen.objectdictionary import ObjectDictionary
        from canopen.sdo.client import SdoClient

        self._network, self._node, self._name = network, node, name
        self._one_at_a_time = threading.Lock()
        client_class: Any = SdoClient  # canopen's classes are typed in part
        dictionary_class: Any = ObjectDictionary
        client = client_class(SDO_REQUEST_FRAME + node, SDO_RESPONSE_FRAME + node, dictionary_class())
        client.RESPONSE_TIMEOUT = _ANSWER_LIMIT
        client.network = network
        self._client = client
        # canopen also logs as an error what it raises, and a first question is repeated.
        logging.getLogger("canopen.sdo.client").setLevel(logging.CRITICAL)
        network.listen(SDO_RESPONSE_FRAME + node, self._answer)

    def close(self) -> None:
        """Stop listening to answers."""
        self._network.ignore(SDO_RESPONSE_FRAME + self._node)

    def read(self, entry: Entry) -> int:
        """Return the value of an entry."""
        data: bytes = self._ask("read", entry, self._client.upload, entry.index, entry.sub)
        layout = struct.Struct(f"<{entry.kind}")
        if len(data) != layout.size:
            raise Unanswered(
                f"{self._where} answers {len(data)} bytes for {entry}, which has {layout.size}. Is it an EPOS4?"
            )
        value: int = layout.unpack(data)[0]
        return value

    def put(self, entry: Entry, value: int) -> None:
        """Write a value that cannot be read back, such as a controlword."""
        try:
            data = struct.pack(f"<{entry.kind}", value)
        except struct.error as error:
            raise RigError(f"{self._where}: {value} does not fit {entry}: {error}. Check the rig's file.") from error
        self._ask(f"take {value} as", entry, self._client.download, entry.index, entry.sub, data)

    def write(self, entry: Entry, value: int) -> None:
        """Write a value, and check that the drive keeps it."""
        self.put(entry, value)
        there = self.read(entry)
        if there != value:
            raise RigError(
                f"{self._where} keeps {there} (0x{there & 0xFFFFFFFF:X}) in {entry}, where {value}"
                f" (0x{value & 0xFFFFFFFF:X}) was written. Another program or the maker's tool may be connected:"
                " close it."
            )

    def _ask(self, verb: str, entry: Entry, question: Any, *arguments: Any) -> Any:
        from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

        with self._one_at_a_time:
            try:
                return question(*arguments)
            except SdoAbortedError as error:
                raise SdoRefused(f"{self._where} does not {verb} {entry}: {error}.") from error
            except SdoCommunicationError as error:
                raise Unanswered(f"{self._where} does not {verb} {entry}: {error}.") from error

    def _answer(self, data: bytes, time: float) -> None:
        if len(data) == 8:  # canopen would fail on a shorter one
            self._client.on_response(SDO_RESPONSE_FRAME + self._node, data, time)

    @property
    def _where(self) -> str:
        return f"{self._name}: node {self._node}"
