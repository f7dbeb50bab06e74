"""Driver "serial" of a force sensor: a load cell along the cut, on the board of ``assets/firmware``."""

from __future__ import annotations

from dataclasses import dataclass

from cutenv._base.validation import check_parameters, in_range
from cutenv.rig.config.setting import setting
from cutenv.rig.config.settings import RigSettings, SensorSettings
from cutenv.rig.devices.driver_bases import FIRST_READING, StreamedSensor
from cutenv.rig.devices.driver_registry import Mounting, rig_driver
from cutenv.rig.devices.reading_stream import Zero
from cutenv.rig.devices.serial.board import ForceReport, Report, SerialBoard
from cutenv.rig.devices.serial.stepper_axis import on_pseudo_terminal
from cutenv.rig.errors import RigError

_RATE_ERROR = 0.15  # [1] assumed: the HX711 has a clock of its own, which its data sheet does not bound


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
class LoadCell(StreamedSensor):
    """Load cell on an HX711, ADS1220 or NAU7802, on a board with the sketch of assets/firmware.

    It measures the force along the cut alone; the other components read 0.

    Parameters
    ----------
    mounting : Mounting
        Place on the rig; the board is shared with a stepper at the same port.
    """

    name = "load cell"

    def __init__(self, mounting: Mounting) -> None:
        settings: SensorSettings = mounting.settings
        options: LoadCellOptions = mounting.options
        self._number = "xyz".index(settings.cut_axis)
        self._newtons = 1.0 / options.counts_per_N
        self._board = mounting.share(
            ("board", options.port), lambda: SerialBoard(options.port, options.baud, mounting.clock)
        )
        self._converter = ""
        super().__init__(mounting.clock, settings.rate, rate_error=_RATE_ERROR, axes=settings.cut_axis)

    def _connect(self) -> None:
        identity = self._board.join(self)
        self._converter, self.rate = identity.converter, float(identity.rate)
        if not self._comes(FIRST_READING):
            raise RigError(
                f"No reading came from the load cell at {self._board.port} within {FIRST_READING:g} s, though the "
                f"board answers. Are the wires between board and {self._converter} right, and has it power?"
            )

    def _disconnect(self) -> None:
        self._board.leave(self)

    @property
    def _scales(self) -> Zero:
        return (self._newtons,) * 3 + (0.0,) * 3

    def _meaning(self, status: int) -> str:
        return "a force at the end of the converter's range" if status == 1 else f"status {status}"

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

    def watched(self, now: float) -> bool:
        """Return True: a sensor keeps nothing alive."""
        return True

    def told(self, report: Report, time: float) -> None:
        """Take a reading; other reports are not for a sensor."""
        if isinstance(report, ForceReport):
            counts = [0, 0, 0]
            counts[self._number] = report.counts
            self._take(report.sequence, time, (counts[0], counts[1], counts[2], 0, 0, 0), report.status)

    def _misplaced(self, number: int, now: float, *, late: bool) -> None:
        if not late:
            self.garbled(f"reading {number} does not follow {self._stream.last}: a restart?", now)

    def lost(self, why: str, time: float) -> None:
        """Note that the board is gone: the lack of readings is noticed, and an axis on it reports it."""
        self._note(why)


def sensor_delay(rig: RigSettings) -> float:
    """Return the time until a force is in the readings of a rig's sensor [s]; 0 if its driver states none."""
    return float(getattr(rig.sensor.options, "delay", 0.0))
