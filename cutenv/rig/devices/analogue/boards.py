"""Boards that convert the six voltages of an analogue sensor: National Instruments', and the emulated rig's."""

from __future__ import annotations

import json
import socket
import struct
from typing import Any, NamedTuple, Protocol

import numpy as np

from cutenv._base.arrays import Array
from cutenv.rig.devices.analogue.sensor_calibration_file import AnalogueCalibration
from cutenv.rig.errors import RigError

SCAN = struct.Struct("<I6i")
"""One reading on the wire of the emulated board: its number, then six counts."""
SILENT_AFTER = 2.0
"""Time without a scan after which a board counts as silent [s]."""
_LONGEST_HEADER = 1000  # bytes


class Scans(NamedTuple):
    """Readings of all channels, in order.

    Attributes
    ----------
    number : int
        Number of the first one, counted by the board.
    counts : array, shape (n, 6)
        Counts of the converter; whole numbers.
    """

    number: int
    counts: Array


class AnalogueBoard(Protocol):
    """Board that samples six channels by a clock of its own.

    A board of another maker needs these three methods; see the page Add a driver.
    """

    def open(self, calibration: AnalogueCalibration, rate: float) -> None:
        """Connect, set range and rate [Hz], and start sampling; raises RigError."""
        ...

    def read(self, count: int) -> list[Scans]:
        """Wait for the next ``count`` readings and return them, in parts without a gap.

        Raises
        ------
        RigError
            If none comes within :data:`SILENT_AFTER`, or readings were lost because the computer was too slow.
        """
        ...

    def close(self) -> None:
        """Stop sampling; never raises, and may be called twice."""
        ...


class NidaqmxBoard:
    """Board of National Instruments, through NI-DAQmx and its Python package, ``nidaqmx``.

    Parameters
    ----------
    device : str
        Name of the board in NI MAX, "Dev1".
    channels : str
        Six channels, "ai0:5".
    differential : bool
        True for two wires a channel, False for one against the board's ground.
    """

    def __init__(self, device: str, channels: str, *, differential: bool) -> None:
        self._channels, self._differential = f"{device}/{channels}", differential
        self._task: Any = None
        self._reader: Any = None
        self._calibration: AnalogueCalibration
        self._number = 0

    def open(self, calibration: AnalogueCalibration, rate: float) -> None:
        """Make a continuous task, timed by the board, and start it."""
        import nidaqmx
        from nidaqmx.constants import AcquisitionType, TerminalConfiguration
        from nidaqmx.errors import DaqNotFoundError, DaqNotSupportedError
        from nidaqmx.stream_readers import AnalogMultiChannelReader

        wires = TerminalConfiguration.DIFF if self._differential else TerminalConfiguration.RSE
        self._calibration, self._number = calibration, 0
        try:
            self._task = nidaqmx.Task()
            self._task.ai_channels.add_ai_voltage_chan(
                self._channels, terminal_config=wires, min_val=-calibration.range, max_val=calibration.range
            )
            if (found := len(self._task.ai_channels)) != 6:
                raise RigError(f"sensor.options.channels names {found} channels, {self._channels}: six are needed.")
            self._task.timing.cfg_samp_clk_timing(
                rate, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=max(round(rate), 100)
            )
            self._reader = AnalogMultiChannelReader(self._task.in_stream)
            self._task.start()
        except (DaqNotFoundError, DaqNotSupportedError) as error:
            self.close()
            raise RigError(
                f"NI-DAQmx, the driver of National Instruments' boards, is not on this computer: {error}"
            ) from None
        except nidaqmx.DaqError as error:
            self.close()
            raise RigError(f"The board {self._channels} cannot be used: {error}") from None

    def read(self, count: int) -> list[Scans]:
        """Wait for the next readings; the board counts none as lost: it reports an overflow, and stops."""
        import nidaqmx

        volts = np.empty((6, count))
        try:
            self._reader.read_many_sample(volts, count, timeout=SILENT_AFTER)
        except nidaqmx.DaqError as error:
            raise RigError(f"The board {self._channels} has stopped: {error}") from None
        number, self._number = self._number, self._number + count
        return [Scans(number, self._calibration.counts_of_volts(volts.T))]

    def close(self) -> None:
        """Stop and clear the task."""
        task, self._task = self._task, None
        if task is not None:
            try:
                task.close()
            except Exception as error:  # a board that was pulled out; nothing samples then
                self.last_error = error


class EmulatedBoard:
    """Board of the emulated rig, in its process, over TCP.

    Parameters
    ----------
    host : str
        Address of the emulated rig.
    port : int
        Port of its board.
    """

    def __init__(self, host: str, port: int) -> None:
        self._address = (host, port)
        self._socket: socket.socket | None = None
        self._rest = b""

    def open(self, calibration: AnalogueCalibration, rate: float) -> None:
        """Connect, and check that it converts as the calibration says."""
        try:
            opened = self._socket = socket.create_connection(self._address, timeout=SILENT_AFTER)
            opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            header = b""
            while not header.endswith(b"\n") and len(header) < _LONGEST_HEADER:
                header += self._more(opened, 1)
        except OSError as error:
            self.close()
            raise RigError("The emulated board at {}:{} cannot be reached: {}.".format(*self._address, error)) from None
        told = json.loads(header)
        wanted = {"bits": calibration.bits, "range_V": calibration.range, "rate_Hz": rate}
        if told != wanted:
            self.close()
            raise RigError(f"The emulated board has {told}, and the file asks for {wanted}: correct the file.")

    def read(self, count: int) -> list[Scans]:
        """Wait for the next readings."""
        opened = self._socket
        if opened is None:
            raise RigError("The emulated board is not open.")
        try:
            rows = [SCAN.unpack(self._more(opened, SCAN.size)) for _ in range(count)]
        except OSError as error:
            raise RigError("The emulated board at {}:{} has stopped: {}.".format(*self._address, error)) from None
        parts: list[list[tuple[int, ...]]] = [[rows[0]]]
        for row in rows[1:]:
            if row[0] == parts[-1][-1][0] + 1:
                parts[-1].append(row)
            else:
                parts.append([row])
        return [Scans(part[0][0], np.array([row[1:] for row in part], dtype=float)) for part in parts]

    def close(self) -> None:
        """Disconnect."""
        opened, self._socket = self._socket, None
        if opened is not None:
            opened.close()

    def _more(self, opened: socket.socket, count: int) -> bytes:
        while len(self._rest) < count:
            read = opened.recv(4096)
            if not read:
                raise ConnectionError("the connection was closed")
            self._rest += read
        found, self._rest = self._rest[:count], self._rest[count:]
        return found
