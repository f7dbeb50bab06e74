"""Driver "serial" of a force sensor: a load cell along the cut, on the board of ``assets/firmware``."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from cutenv._base.parameter import check_parameters
from cutenv._base.validation import in_range
from cutenv.rig.config.setting import setting
from cutenv.rig.config.settings import RigSettings, SensorSettings
from cutenv.rig.devices.clock import Clock
from cutenv.rig.devices.driver_registry import Mounting, rig_driver
from cutenv.rig.devices.drivers import ForceListener
from cutenv.rig.devices.reading_stream import ReadingMean, ReadingStream
from cutenv.rig.devices.samples import ForceSample
from cutenv.rig.devices.serial.board import SerialBoard
from cutenv.rig.devices.serial.board_lines import ForceReport, Report
from cutenv.rig.devices.serial.stepper_settings import on_pseudo_terminal
from cutenv.rig.errors import RigError

_RATE_ERROR = 0.15  # [1] assumed: the HX711 has a clock of its own, which its data sheet does not bound
_FIRST_READING = 2.0  # [s] within which the first one must arrive


@dataclass(frozen=True, kw_only=True)
class LoadCellOptions:
    """Options of a load cell on a board."""

    port: str = setting(
        "", "1", "Serial port of the board; the same as the stepper's if both are on one.",
        example='"/dev/serial/by-id/usb-..."',
    )  # fmt: skip
    baud: int = setting(500_000, "1", "Baud rate, that of the sketch; boards with USB of their own ignore it.")
    counts_per_N: float = setting(
        0.0, "1", "Counts of the converter for one newton, as 'cutenv rig weigh' measures them with weights.",
        example="52000.0",
    )  # fmt: skip
    delay: float = setting(
        0.050, "ms", "Time until a force is in the readings: the settling time in the converter's data sheet. HX711: "
        "50 ms at 80 readings a second, 400 ms at 10; ADS1220 at 330: 3 ms.", 0.0, 1.0,
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("baud", self.baud, 9600, 4_000_000, "baud", "That of the sketch is 500000.")
        in_range("counts_per_N", abs(self.counts_per_N), 1.0, 1e8, "1/N", "Measure it: 'cutenv rig weigh'.")


def _check(rig: RigSettings, role: str) -> None:
    for name, axis in rig.cross_axes.items():
        raise ValueError(
            f'{name}.force_axis = "{axis.force_axis}" is an axis of the sensor, and a load cell '
            f'({role}.driver = "serial") measures the force along the cut alone. Take a sensor of three axes or more, '
            f"or leave [{name}] out."
        )


@rig_driver(options=LoadCellOptions, check=_check, emulated=on_pseudo_terminal)
class LoadCell:
    """Load cell on an HX711, ADS1220 or NAU7802, on a board with the sketch of assets/firmware.

    It measures the force along the cut alone; the other components read 0.

    Parameters
    ----------
    mounting : Mounting
        Place on the rig; the board is shared with a stepper at the same port.
    """

    def __init__(self, mounting: Mounting) -> None:
        settings: SensorSettings = mounting.settings
        options: LoadCellOptions = mounting.options
        self.rate = settings.rate
        self.axes, self.rate_error = settings.cut_axis, _RATE_ERROR
        self._number = "xyz".index(settings.cut_axis)
        self._clock: Clock = mounting.clock
        self._newtons = 1.0 / options.counts_per_N
        self._board = mounting.share(
            ("board", options.port), lambda: SerialBoard(options.port, options.baud, mounting.clock)
        )
        self._listener: ForceListener | None = None
        self._changed = threading.Condition()
        self._taring = threading.Lock()
        self._stream = ReadingStream(self.rate)
        self._mean: ReadingMean | None = None
        self._zero = 0.0  # [counts]
        self._received = self._lost = 0
        self._broken: str | None = None
        self._converter = ""

    def open(self, listener: ForceListener) -> None:
        """Connect, ask the board for its converter and rate, and wait for the first reading.

        Raises
        ------
        RigError
            If it is open already, the board is missing, or no reading comes.
        """
        if self._listener is not None:
            raise RigError("The load cell is open already: close it first.")
        self._listener = listener
        self._stream, self._zero, self._broken = ReadingStream(self.rate), 0.0, None
        self._received = self._lost = 0
        try:
            identity = self._board.join(self)
            self._converter, self.rate = identity.converter, float(identity.rate)
            self._clock.wait_for(lambda: self._received > 0 or self._broken is not None, _FIRST_READING, self._changed)
            if not self._received:
                raise RigError(
                    f"No reading came from the load cell at {self._board.port} within {_FIRST_READING:g} s, though the "
                    f"board answers. Are the wires between board and {self._converter} right, and has it power?"
                )
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Stop listening; never raises, and may be called twice."""
        if self._listener is not None:
            self._listener = None
            self._board.leave(self)

    def tare(self, samples: int = 200) -> tuple[float, float, float]:
        """Take the mean of the next ``samples`` readings as zero, while nothing touches the blade.

        Returns
        -------
        tuple of 3 float
            Force subtracted from now on [N], relative to the converter's own zero.

        Raises
        ------
        RigError
            If it is not open, or readings stop, report an error, or vary by more than 0.1 N; the zero is unchanged.
        """
        self._zero = self.mean_counts(samples)
        return self._vector(self._zero * self._newtons)

    def mean_counts(self, samples: int) -> float:
        """Return the mean of the next ``samples`` readings, less no zero [counts]; raises like :meth:`tare`."""
        mean = ReadingMean(samples)
        if self._listener is None:
            raise RigError("The load cell is not open.")
        with self._taring:
            self._mean = mean
            try:
                return mean.awaited(self.rate, self._newtons, _meaning)[self._number]
            finally:
                self._mean = None

    def about(self) -> dict[str, float | str]:
        """Return what the board says of its converter, and the counts of readings."""
        return {
            "port": self._board.port,
            "converter": self._converter,
            "rate_Hz": self.rate,
            "counts_per_N": 1.0 / self._newtons,
            "received_readings": self._received,
            "lost_readings": self._lost,
        }

    # Reports of the board; called by its reader

    def told(self, report: Report, time: float) -> None:
        """Take a reading; other reports are not for a sensor."""
        listener = self._listener
        if not isinstance(report, ForceReport) or listener is None:
            return
        lost = self._stream.place(report.sequence, time)
        if lost == ReadingStream.OLD:
            return
        if lost == ReadingStream.STRANGE:
            return listener.garbled(f"reading {report.sequence} does not follow {self._stream.last}: a restart?", time)
        self._received += 1
        self._lost += lost
        counts = [0, 0, 0, 0, 0, 0]
        counts[self._number] = report.counts
        six = (counts[0], counts[1], counts[2], 0, 0, 0)
        force = self._vector((report.counts - self._zero) * self._newtons)
        sample = ForceSample(time, force, six, report.status, report.sequence, lost)
        if (mean := self._mean) is not None:
            mean.add(sample)
        listener.force(sample)
        if self._received == 1:
            with self._changed:
                self._changed.notify_all()

    def garbled(self, why: str, time: float) -> None:
        """Pass on the news of a damaged line."""
        if self._listener is not None:
            self._listener.garbled(why, time)

    def lost(self, why: str, time: float) -> None:
        """Note that the board is gone: the lack of readings is noticed, and an axis on it reports it."""
        with self._changed:
            self._broken = why
            self._changed.notify_all()

    def _vector(self, force: float) -> tuple[float, float, float]:
        vector = [0.0, 0.0, 0.0]
        vector[self._number] = force
        return vector[0], vector[1], vector[2]


def _meaning(status: int) -> str:
    return "a force at the end of the converter's range" if status == 1 else f"status {status}"


def sensor_delay(rig: RigSettings) -> float:
    """Return the time until a force is in the readings of a rig's sensor [s]; 0 if its driver states none."""
    return float(getattr(rig.sensor.options, "delay", 0.0))
