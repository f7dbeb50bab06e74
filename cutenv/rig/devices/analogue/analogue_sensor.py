"""Driver "analogue" of a force sensor: six voltages, a board that converts them, and a matrix with cross-talk."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cutenv._base.arrays import Array
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
from cutenv.rig.devices.driver_registry import Mounting, rig_driver
from cutenv.rig.devices.reading_stream import Zero
from cutenv.rig.devices.sample_clock import LEAK
from cutenv.rig.devices.streamed_sensor import StreamedSensor
from cutenv.rig.errors import RigError

CHANNEL_AT_END = 1
"""Status of a reading with a channel at an end of the converter's range: its load is unknown."""
_OPENS_WITHIN = 3.0  # [s] for a board to convert the first reading
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

    name = "analogue sensor"

    def __init__(self, mounting: Mounting, board: AnalogueBoard | None = None) -> None:
        options: AnalogueOptions = mounting.options
        self.calibration = AnalogueCalibration.read(options.calibration)
        self._options = options
        self._board = board or _board_of(options)
        super().__init__(mounting.clock, mounting.settings.rate, rate_error=LEAK)

    def _connect(self) -> None:
        self._board.open(self.calibration, self.rate)
        self._start(self._receive)
        if not self._comes(_OPENS_WITHIN) or self._broken:
            raise RigError(f"The analogue sensor does not read: {self._broken or 'no reading came'}")

    def _disconnect(self) -> None:
        self._closing.set()
        self._board.close()
        self._stop()

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
