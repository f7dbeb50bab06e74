"""Driver "analogue" of a force sensor: six voltages, a board that converts them, and a matrix with cross-talk."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cutenv._base.parameter import check_parameters
from cutenv._base.validation import in_range, one_of
from cutenv.rig.config.setting import setting
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.analogue.boards import AnalogueBoard, EmulatedBoard, NidaqmxBoard, Scans
from cutenv.rig.devices.analogue.sensor_calibration_file import (
    COMPONENTS_OF_LOAD,
    SHIPPED_CALIBRATION,
    AnalogueCalibration,
)
from cutenv.rig.devices.clock import Clock
from cutenv.rig.devices.driver_registry import Mounting, rig_driver
from cutenv.rig.devices.drivers import ForceListener
from cutenv.rig.devices.reading_stream import ReadingMean, ReadingStream, Zero
from cutenv.rig.devices.samples import ForceSample
from cutenv.rig.errors import RigError

CHANNEL_AT_END = 1
"""Status of a reading with a channel at an end of the converter's range: its load is unknown."""
_NO_ZERO: Zero = (0.0,) * 6
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
class AnalogueSensor:
    """Six-axis sensor with analogue outputs, such as a JR3, on a board of National Instruments.

    Every reading goes through the calibration matrix, so that the six loads are free of cross-talk. A channel at an end
    of the converter's range gives a status, which stops the blade.

    Parameters
    ----------
    mounting : Mounting
        Place on the rig.
    board : AnalogueBoard, optional
        Another board than that of the options.

    Attributes
    ----------
    calibration : AnalogueCalibration
        Matrix and converter.
    """

    def __init__(self, mounting: Mounting, board: AnalogueBoard | None = None) -> None:
        options: AnalogueOptions = mounting.options
        self.rate: float = mounting.settings.rate
        self.rate_error, self.axes = 0.001, "xyz"
        self.calibration = AnalogueCalibration.read(options.calibration)
        self._options, self._clock = options, mounting.clock
        self._board = board or _board_of(options)
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._first = threading.Event()
        self._taring = threading.Lock()
        self._mean: ReadingMean | None = None
        self._zero = np.zeros(6)  # [counts]
        self._received = self._lost = self._saturated = 0
        self._broken = ""

    def open(self, listener: ForceListener) -> None:
        """Start sampling, and wait for the first reading.

        Raises
        ------
        RigError
            If it is open already, the board is missing, or no reading comes.
        """
        if self._thread is not None:
            raise RigError("The analogue sensor is open already: close it first.")
        self._zero = np.zeros(6)
        self._received = self._lost = self._saturated = 0
        self._broken = ""
        self._closing, self._first = threading.Event(), threading.Event()
        self._board.open(self.calibration, self.rate)
        self._thread = threading.Thread(
            target=self._receive, args=(listener, self._closing, self._clock), name="force sensor", daemon=True
        )
        self._thread.start()
        if not self._first.wait(3.0) or self._broken:
            why = self._broken or "no reading came"
            self.close()
            raise RigError(f"The analogue sensor does not read: {why}")

    def tare(self, samples: int = 200) -> tuple[float, float, float]:
        """Take the mean of the next ``samples`` readings as zero, of torques too, while nothing touches the blade.

        Returns
        -------
        tuple of 3 float
            Force subtracted from now on [N], relative to the sensor's own zero.

        Raises
        ------
        RigError
            If it is not open, or readings stop, report an error, or vary by more than 0.1 N; the zero is unchanged.
        """
        if self._thread is None:
            raise RigError("The analogue sensor is not open.")
        mean = ReadingMean(samples)
        coarsest = float(self.calibration.resolution[:3].max())
        with self._taring:
            self._mean = mean
            try:
                zero = mean.awaited(self.rate, coarsest, _meaning)
            finally:
                self._mean = None
        self._zero = np.array(zero)
        x, y, z = self.calibration.loads(self._zero)[:3].tolist()
        return x, y, z

    def about(self) -> dict[str, float | str]:
        """Return the calibration's name, what a count is worth, the range, and the counts of readings."""
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

    def close(self) -> None:
        """Stop sampling; never raises, and may be called twice."""
        thread, self._thread = self._thread, None
        self._closing.set()
        self._board.close()
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout=1.0)

    def _receive(self, listener: ForceListener, closing: threading.Event, clock: Clock) -> None:
        stream = ReadingStream(self.rate)
        while not closing.is_set():
            try:
                parts = self._board.read(self._options.block)
            except Exception as error:  # whatever a board's library raises: the lack of readings stops the blade
                if not closing.is_set():
                    self._broken = str(error)
                    self._first.set()
                    listener.garbled(str(error), clock.now())
                return
            now = clock.now()
            for part in parts:
                self._pass_on(part, now, stream, listener)
            self._first.set()

    def _pass_on(self, part: Scans, now: float, stream: ReadingStream, listener: ForceListener) -> None:
        loads = self.calibration.loads(part.counts - self._zero).tolist()
        ended = self.calibration.saturated(part.counts).tolist()
        for k, (counts, load) in enumerate(zip(part.counts.astype(int).tolist(), loads, strict=True)):
            lost = stream.place(part.number + k, now)
            if lost < 0:
                listener.garbled(f"reading {part.number + k} does not follow {stream.last}", now)
                continue
            self._received += 1
            self._lost += lost
            self._saturated += ended[k]
            status = CHANNEL_AT_END if ended[k] else 0
            sample = ForceSample(now, tuple(load[:3]), tuple(counts), status, part.number + k, lost, tuple(load[3:]))
            if (mean := self._mean) is not None:
                mean.add(sample)
            listener.force(sample)


def _board_of(options: AnalogueOptions) -> AnalogueBoard:
    if options.board == "emulated":
        return EmulatedBoard(options.host, options.port)
    return NidaqmxBoard(options.device, options.channels, differential=options.wires == "differential")


def _meaning(status: int) -> str:
    return "a channel at the end of the converter's range" if status == CHANNEL_AT_END else f"status {status}"
