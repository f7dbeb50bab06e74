"""Calibration of an analogue six-axis sensor.

Matrix from voltages to loads, cross-talk included, and converter.

A file, in TOML, holds what the sensor's maker or a bench of weights has found.
"""

from __future__ import annotations

import json
import socket
import struct
import threading
import tomllib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from cutenv._base import resources
from cutenv._base.arrays import Array
from cutenv._base.validation import check_parameters, in_range, one_of
from cutenv.rig.config.settings import RigSettings, setting
from cutenv.rig.devices.driver_bases import StreamedSensor
from cutenv.rig.devices.driver_registry import Mounting, rig_driver
from cutenv.rig.devices.loop import Attempt
from cutenv.rig.devices.reading_stream import LEAK, Zero
from cutenv.rig.errors import RigError

COMPONENTS_OF_LOAD = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")
"""Components of a load, in the order of the matrix's rows: [N], [N m]."""
SHIPPED_CALIBRATION = "jr3_85m35a_i40"
"""Name of the calibration that comes with cutenv; its resolution is measured, its cross-talk assumed."""
_KEYS = ("name", "serial", "date", "range_V", "bits", "force_N_per_V", "torque_N_m_per_V")
_WORST_CONDITION = 1e4  # of the matrix with rows scaled alike: six loads that voltages hardly tell apart


@dataclass(frozen=True, eq=False)
class AnalogueCalibration:
    """Sensor with six analogue channels, and the converter that reads them."""

    name: str  # kind and number of the sensor, and the day of its calibration
    serial: str
    date: str
    range: float  # greatest voltage of the converter, either way [V]
    bits: int  # bits of the converter over the whole range
    matrix: Array  # loads over voltages: rows are :data:`COMPONENTS_OF_LOAD` [N/V], [N m/V], columns the channels

    def __post_init__(self) -> None:
        in_range("range_V", self.range, 0.01, 100.0, "V", "Give the converter's greatest voltage.")
        in_range("bits", self.bits, 8, 24, "1", "Converters have 8 to 24 bits.")
        matrix = np.array(self.matrix, dtype=float)
        if matrix.shape != (6, 6) or not np.isfinite(matrix).all():
            raise ValueError(
                f"the matrix must be 3 rows of force_N_per_V and 3 of torque_N_m_per_V, each of 6 numbers; got an "
                f"array of shape {matrix.shape}."
            )
        largest = np.abs(matrix).max(axis=1, keepdims=True)
        if np.any(largest == 0.0) or np.linalg.cond(matrix / largest) > _WORST_CONDITION:
            raise ValueError(
                "the matrix is singular, or nearly: its six channels do not tell six loads apart. Copy it again, rows "
                "for loads and columns for channels."
            )
        object.__setattr__(self, "matrix", matrix)

    @classmethod
    def read(cls, path: str | Path) -> AnalogueCalibration:
        """Read a calibration's file, or the shipped one by its name.

        Raise FileNotFoundError if there is no such file; ValueError if it is no TOML, or a key is unknown, missing or
        not valid; names file and key.
        """
        file = resources.path(f"sensors/{SHIPPED_CALIBRATION}.toml") if str(path) == SHIPPED_CALIBRATION else Path(path)
        try:
            told = tomllib.loads(file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise FileNotFoundError(
                f"{path}: no such file. Give a calibration as TOML, see the page Wiring and configuration, or the "
                f"shipped {SHIPPED_CALIBRATION!r}."
            ) from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise ValueError(f"{path}: it is not TOML: {error}.") from None
        try:
            return cls._of(told)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path}: {error}") from None

    @classmethod
    def _of(cls, told: dict[str, Any]) -> AnalogueCalibration:
        for key in told:
            one_of("key", key, _KEYS)
        missing = [key for key in _KEYS if key not in told]
        if missing:
            raise ValueError(f"it lacks {', '.join(missing)}.")
        rows = [_rows(key, told[key]) for key in ("force_N_per_V", "torque_N_m_per_V")]
        texts = {key: told[key] for key in ("name", "serial", "date")}
        for key, text in texts.items():
            if not isinstance(text, str):
                raise ValueError(f"{key} must be a text in quotation marks, got {text!r}.")
        if type(told["bits"]) is not int:
            raise ValueError(f"bits must be a whole number, got {told['bits']!r}.")
        reach = in_range("range_V", told["range_V"], 0.01, 100.0, "V", "Give the converter's greatest voltage.")
        return cls(range=reach, bits=told["bits"], matrix=np.array(rows[0] + rows[1]), **texts)

    @property
    def count(self) -> float:
        """Voltage of one count [V]."""
        return 2.0 * self.range / float(2**self.bits)

    @property
    def resolution(self) -> Array:
        """Load of one count of the best channel, shape (6,) [N], [N m]."""
        found: Array = self.count * np.abs(self.matrix).max(axis=1)
        return found

    @property
    def full_scale(self) -> Array:
        """Greatest single-axis load within the converter, shape (6,) [N], [N m]."""
        found: Array = self.range / np.abs(np.linalg.inv(self.matrix)).max(axis=0)
        return found

    def loads(self, counts: Array) -> Array:
        """Return loads [N], [N m] from counts, shape (..., 6) both."""
        found: Array = (np.asarray(counts, dtype=float) * self.count) @ self.matrix.T
        return found

    def counts(self, loads: Array) -> Array:
        """Return whole counts under loads [N], [N m], shape (..., 6) both."""
        volts = np.asarray(loads, dtype=float) @ np.linalg.inv(self.matrix).T
        return self.counts_of_volts(volts)

    def counts_of_volts(self, volts: Array) -> Array:
        """Return counts of voltages [V], clipped, in the same shape."""
        most = 2 ** (self.bits - 1)
        found: Array = np.clip(np.rint(np.asarray(volts, dtype=float) / self.count), -most, most - 1)
        return found

    def saturated(self, counts: Array) -> Array:
        """Return which readings saturate, shape (n,), from counts, shape (n, 6)."""
        most = 2 ** (self.bits - 1)
        found: Array = ((counts <= -most) | (counts >= most - 1)).any(axis=-1)
        return found


def _rows(key: str, told: Any) -> list[list[float]]:
    whole = isinstance(told, list) and len(told) == 3 and all(isinstance(row, list) and len(row) == 6 for row in told)
    if not whole:
        raise ValueError(f"{key} must be three rows of six numbers, one for each channel.")
    return [
        [in_range(f"{key}[{i}][{j}]", number, -1e6, 1e6, "1/V", "Give a number.") for j, number in enumerate(row)]
        for i, row in enumerate(told)
    ]


SCAN = struct.Struct("<I6i")  # one reading on the wire of the emulated board: its number, then six counts
SILENT_AFTER = 2.0  # time without a scan after which a board counts as silent [s]
_LONGEST_HEADER = 1000  # bytes


class Scans(NamedTuple):
    """Readings of all channels, in order."""

    number: int  # number of the first one, counted by the board
    counts: Array  # counts of the converter; whole numbers


class AnalogueBoard(Protocol):
    """Board that samples six channels by a clock of its own.

    A board of another maker needs these three methods; see the page Add a driver.
    """

    def open(self, calibration: AnalogueCalibration, rate: float) -> None:
        """Connect, set range and rate [Hz], and start sampling; raises RigError."""
        ...

    def read(self, count: int) -> list[Scans]:
        """Return the next ``count`` readings, in parts without gaps.

        Raise RigError if none comes within :data:`SILENT_AFTER`, or readings were lost because the computer was too
        slow.
        """
        ...

    def close(self) -> None:
        """Stop sampling; never raises, and may be called twice."""
        ...


class NidaqmxBoard:
    """Board of National Instruments, through NI-DAQmx and its Python package, ``nidaqmx``.

    ``device``: name of the board in NI MAX, "Dev1"; ``channels``: six channels, "ai0:5"; ``differential``: True for two
    wires a channel, False for one against the board's ground.
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
        """Wait for the next readings; none are lost, but an overflow stops sampling."""
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
            with suppress(Exception):  # a board that was pulled out; nothing samples then
                task.close()


class EmulatedBoard:
    """Board of the emulated rig, in its process, over TCP."""

    def __init__(self, host: str, port: int) -> None:
        self._address = (host, port)
        self._socket: socket.socket | None = None
        self._rest = b""

    def open(self, calibration: AnalogueCalibration, rate: float) -> None:
        """Connect, and check that it converts as the calibration says."""
        self._rest = b""
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


CHANNEL_AT_END = 1  # status of a reading with a channel at an end of the converter's range: its load is unknown
_OPENS_WITHIN = 3.0  # [s] for a board to convert the first reading
_ENDS_WITHIN = 1.0  # [s] for a read that is under way
_HERE = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True, kw_only=True)
class AnalogueOptions:
    """Options of an analogue sensor."""

    calibration: str = setting(
        "", "1", "File with the sensor's matrix, or the name of the shipped one, whose cross-talk is assumed: "
        "that is for emulated rigs.", example='"my_sensor.toml"',
    )  # fmt: skip
    board: Literal["nidaqmx", "emulated"] = setting("nidaqmx", "1", "Board that converts: NI's, or the emulator's.")
    device: str = setting("Dev1", "1", "Name of the board in NI MAX.")
    channels: str = setting("ai0:5", "1", "Its six channels, in the order of the matrix's columns.")
    wires: Literal["differential", "single-ended"] = setting("differential", "1", "Two wires a channel, or one.")
    block: int = setting(2, "1", "Readings fetched at a time; so many milliseconds they come late at 1 kHz.")
    host: str = setting("127.0.0.1", "1", "Address of an emulated board.")
    port: int = setting(0, "1", "Port of an emulated board.")

    def __post_init__(self) -> None:
        check_parameters(self)
        one_of("board", self.board, ("nidaqmx", "emulated"))
        one_of("wires", self.wires, ("differential", "single-ended"))
        in_range("block", self.block, 1, 50, "1", "At 1 kHz, 2 to 5 are usual.")
        in_range("port", self.port, 0, 65535, "1", "'cutenv rig emulate --sensor analogue' prints it.")
        if not self.calibration:
            raise ValueError("calibration is empty: give the file with the sensor's matrix.")


def _emulated(rig: RigSettings, role: str) -> bool:
    options: AnalogueOptions = rig.sensor.options
    return options.board == "emulated" and options.host in _HERE


def _check(rig: RigSettings, role: str) -> None:
    options: AnalogueOptions = rig.sensor.options
    calibration = AnalogueCalibration.read(options.calibration)
    if options.board != "emulated" and options.calibration == SHIPPED_CALIBRATION:
        raise ValueError(
            f"sensor.options.calibration = {SHIPPED_CALIBRATION!r} has an assumed cross-talk, for emulated rigs. "
            "Copy it, and write the matrix of this sensor's own certificate into it."
        )
    reach = calibration.full_scale[:3].min()
    if rig.limits.force > reach:
        raise ValueError(
            f"limits.force_N = {rig.limits.force:g} is beyond what the sensor reads on its weakest axis, {reach:.4g} "
            "N: a force above that is not seen. Lower the limit."
        )


@rig_driver(options=AnalogueOptions, check=_check, emulated=_emulated)
class AnalogueSensor(StreamedSensor):
    """Six-axis analogue sensor, such as a JR3, on a National Instruments board.

    Every reading goes through the calibration matrix, so that the six loads are free of cross-talk. A channel at an end
    of the converter's range gives a status, which stops the blade. ``board`` is another one than that of the options.
    """

    name = "analogue sensor"

    def __init__(self, mounting: Mounting, board: AnalogueBoard | None = None) -> None:
        options: AnalogueOptions = mounting.options
        self.calibration = AnalogueCalibration.read(options.calibration)  # matrix and converter
        self._options = options
        self._board = board or _board_of(options)
        self._closing = threading.Event()
        self._reader: Attempt | None = None
        super().__init__(mounting.clock, mounting.settings.rate, rate_error=LEAK)

    def _connect(self) -> None:
        self._board.open(self.calibration, self.rate)
        closing = self._closing = threading.Event()
        self._reader = Attempt(lambda: self._receive(closing), self.name)  # apart: a board's library waits for scans
        if not self._comes(_OPENS_WITHIN) or self._broken:
            raise RigError(f"The analogue sensor does not read: {self._broken or 'no reading came'}")

    def _disconnect(self) -> None:
        self._closing.set()
        self._board.close()
        if self._reader is not None:
            self._reader.ends(_ENDS_WITHIN)

    def _begin_again(self) -> None:
        super()._begin_again()
        self._saturated = 0

    @property
    def _scales(self) -> Zero:
        return _six(self.calibration.resolution)

    def _loads(self, counts: Zero) -> Zero:
        return _six(self.calibration.loads(np.array(counts)))

    def _meaning(self, status: int) -> str:
        return "a channel at the end of the converter's range" if status == CHANNEL_AT_END else f"status {status}"

    def about(self) -> dict[str, float | str]:
        """Return calibration name, count values, range, and counts of readings."""
        told: dict[str, float | str] = {
            "calibration": self.calibration.name,
            "serial": self.calibration.serial,
            "board": self._options.board,
            "bits": self.calibration.bits,
            "rate_Hz": self.rate,
        }
        for number, axis in enumerate(COMPONENTS_OF_LOAD):
            unit = "N" if number < 3 else "Nm"
            told[f"{axis}_resolution_{unit}"] = float(self.calibration.resolution[number])
            told[f"{axis}_range_{unit}"] = float(self.calibration.full_scale[number])
        told |= {"received_readings": self._received, "lost_readings": self._lost}
        return told | {"saturated_readings": self._saturated}

    def _receive(self, closing: threading.Event) -> None:
        while not closing.is_set():
            try:
                parts = self._board.read(self._options.block)
            except Exception as error:  # whatever a board's library raises: the lack of readings stops the blade
                if not closing.is_set():
                    self.garbled(str(error), self._clock.now())
                    self._note(str(error))
                return
            now = self._clock.now()
            for part in parts:
                self._pass_on(part, now)

    def _pass_on(self, part: Scans, now: float) -> None:
        loads = self.calibration.loads(part.counts - np.array(self._zero)).tolist()
        ended = self.calibration.saturated(part.counts).tolist()
        for k, (counts, load) in enumerate(zip(part.counts.astype(int).tolist(), loads, strict=True)):
            if self._take(part.number + k, now, tuple(counts), CHANNEL_AT_END if ended[k] else 0, tuple(load)):
                self._saturated += ended[k]


def _board_of(options: AnalogueOptions) -> AnalogueBoard:
    if options.board == "emulated":
        return EmulatedBoard(options.host, options.port)
    return NidaqmxBoard(options.device, options.channels, differential=options.wires == "differential")


def _six(values: Array) -> Zero:
    fx, fy, fz, tx, ty, tz = values.tolist()
    return fx, fy, fz, tx, ty, tz
