"""Driver "serial".

A stepper and a load cell on one board.

The stepper is moved by step and direction, the load cell measures along the cut; the board's sketch is in
``assets/firmware``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from cutenv._base.validation import check_parameters, in_range
from cutenv.rig.config.settings import Axis, RigSettings, SensorSettings, setting
from cutenv.rig.devices.driver_bases import FIRST_READING, AxisDriver, StreamedSensor
from cutenv.rig.devices.driver_registry import Mounting, rig_driver
from cutenv.rig.devices.protocols import DriveState, MotionListener, MotionSample
from cutenv.rig.devices.reading_stream import SampleClock, Zero
from cutenv.rig.devices.serial.board import (
    BOARD_PATIENCE,
    BoardFlag,
    BoardState,
    ForceReport,
    MotionReport,
    Report,
    SerialBoard,
    StepperSetup,
)
from cutenv.rig.devices.serial.ports import is_pseudo_terminal
from cutenv.rig.errors import RigError

FASTEST_STEPS = 20_000  # steps a second that the sketch takes at most; that of an 8-bit board may make fewer
_LEAST_ACCELERATION = 1000  # [steps/s2] of the sketch, which counts in milliseconds


@dataclass(frozen=True, kw_only=True)
class StepperOptions:
    """Options of a stepper on a board."""

    port: str = setting(
        "", "1", "Serial port of the board; a name below /dev/serial/by-id stays the same.",
        example='"/dev/serial/by-id/usb-..."',
    )  # fmt: skip
    baud: int = setting(500_000, "1", "Baud rate, that of the sketch; boards with USB of their own ignore it.")
    steps: int = setting(
        3200,
        "1",
        "Steps for one turn of the screw: 200 times the microsteps set on the motor's driver.",
        example="3200",
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("baud", self.baud, 9600, 4_000_000, "baud", "That of the sketch is 500000.")
        in_range("steps", self.steps, 20, 51_200, "1", "A motor of 1.8 degrees with 16 microsteps makes 3200.")


class StepRates:
    """Conversion between metres and steps.

    ``steps`` are those for one turn of the screw.
    """

    def __init__(self, axis: Axis, steps: int) -> None:
        self.per_metre = axis.direction * steps / axis.lead

    def steps(self, length: float) -> int:
        """Return a length, speed or acceleration [m...] in whole steps."""
        return round(length * self.per_metre)

    def metres(self, steps: float) -> float:
        """Return steps as a length, speed or acceleration [m...]."""
        return steps / self.per_metre

    def setup(self, axis: Axis) -> StepperSetup:
        """Return the set-up of the board for an axis."""
        ends = sorted((self.steps(axis.low), self.steps(axis.high)))
        return StepperSetup(
            abs(self.steps(axis.acceleration)), abs(self.steps(axis.quick_stop)), abs(self.steps(axis.speed)), *ends
        )


def check_stepper(rig: RigSettings, role: str) -> None:
    """Raise ValueError for an axis that no board can drive."""
    axis: Axis = getattr(rig, role)
    if role != "blade":
        raise ValueError(
            f'{role}.driver = "serial": a board moves the blade alone. Set the angle by hand: angle_mode = "fixed".'
        )
    if axis.options is None:
        raise ValueError(f'{role}.driver = "serial" needs [{role}.options] with port and steps.')
    rates = StepRates(axis, axis.options.steps)
    setup = rates.setup(axis)
    if setup.fastest > FASTEST_STEPS:
        raise ValueError(
            f"{role}.speed_cm_s = {100 * axis.speed:g} is {setup.fastest} steps a second, and the board makes "
            f"{FASTEST_STEPS} at most. Lower the speed, the microsteps, or take a screw of more lead."
        )
    if setup.acceleration < _LEAST_ACCELERATION:
        raise ValueError(
            f"{role}.acceleration_m_s2 = {axis.acceleration:g} is {setup.acceleration} steps/s2, and the board takes "
            f"{_LEAST_ACCELERATION} at least. Raise it, or the microsteps."
        )
    if not rig.bus.sync == BOARD_PERIOD:
        raise ValueError(f"bus.sync_ms = {1e3 * rig.bus.sync:g}: a board reports its position every 10 ms. Write 10.")


_BOARD_CLOCK = 0.02  # [1] relative error of a board's clock, a ceramic resonator at worst
LATE_REPORT = 0.050  # delay of the board's reports beyond the least one, at which the line is too late for a stop [s]
BOARD_PERIOD = 0.010  # period at which the board reports its position [s]; that of the sketch


def on_pseudo_terminal(rig: RigSettings, role: str) -> bool:
    """Return whether a driver's port is an emulator's pseudo-terminal."""
    return is_pseudo_terminal(getattr(rig, role).options.port)


_STATES = {
    BoardState.OFF: DriveState.DISABLED,
    BoardState.ENABLED: DriveState.ENABLED,
    BoardState.STOPPED: DriveState.QUICK_STOP,
    BoardState.FAULT: DriveState.FAULT,
}
_ALARMS = {
    BoardFlag.AT_LOW: (0x8A80, "the limit switch at the clamp is open"),
    BoardFlag.AT_HIGH: (0x8A81, "the limit switch at the far end is open"),
    BoardFlag.SOFT_END: (0x8A82, "it has reached the end of travel that the file sets"),
    BoardFlag.STOP_OPEN: (0x8A88, "the stop button is pressed, or its wire is off"),
    BoardFlag.SILENT: (0x8130, "it heard nothing from this computer, and stopped by itself"),
}
"""Flags that stop the stepper, with the CiA 402 code for the same, and what has happened."""
_RESTARTED = (0x6180, "it was restarted, and no longer knows where the blade stands")


@rig_driver(
    options=StepperOptions, needs=("lead",), check=check_stepper, emulated=on_pseudo_terminal, patience=BOARD_PATIENCE
)
class StepperAxis(AxisDriver):
    """Stepper by step and direction, on a board with assets/firmware.

    Its position counts from where a person has set zero since the board has power: ``cutenv rig zero``. The board never
    leaves a quick stop by a command of speed, so that ``for_good`` changes nothing. The board is shared with a load
    cell at the same port.
    """

    device, silence, report_limit = "board", "our sign of life ends", 0.3

    def __init__(self, mounting: Mounting) -> None:
        super().__init__(mounting.role, mounting.settings, mounting.clock)
        options: StepperOptions = mounting.options
        self._rates = StepRates(self._settings, options.steps)
        self._board = mounting.share(
            ("board", options.port), lambda: SerialBoard(options.port, options.baud, mounting.clock)
        )
        self._last: MotionReport | None = None
        self._arrivals = SampleClock(1.0 / BOARD_PERIOD, _BOARD_CLOCK)

    # Life cycle

    def _connect(self) -> None:
        self._last, self._arrivals = None, SampleClock(1.0 / BOARD_PERIOD, _BOARD_CLOCK)
        self._board.join(self)
        self._await(lambda: self._last is not None, "report its state", self.report_limit)
        if self._state is not DriveState.DISABLED:  # left by a program that has ended
            self._come_off()
        wanted = self._rates.setup(self._settings)
        kept: StepperSetup = self._board.ask("P {} {} {} {} {}".format(*wanted), StepperSetup)
        if kept != wanted:
            raise RigError(
                f"{self.name}: the board keeps the set-up {tuple(kept)}, not {tuple(wanted)} (acceleration, quick "
                "stop [steps/s2], rate [steps/s], ends [steps])."
            )

    def _rest(self) -> None:
        if self._lost is None:
            self._send_stop()
            self._come_off()

    def _disconnect(self) -> None:
        self._board.leave(self)

    def limits(self) -> dict[str, float]:
        """Return "low", "high", "speed", "acceleration" and "quick_stop" read back."""
        kept: StepperSetup = self._board.ask("P", StepperSetup)
        low, high = sorted(map(self._rates.metres, (kept.low, kept.high)))
        speed, acceleration, quick = (
            abs(self._rates.metres(each)) for each in (kept.fastest, kept.acceleration, kept.quick_stop)
        )
        return {"low": low, "high": high, "speed": speed, "acceleration": acceleration, "quick_stop": quick}

    def about(self) -> dict[str, float | str]:
        """Return the board's report and what it misunderstood."""
        asked = self._clock.now()
        self._board.ask("P", StepperSetup)
        trip = self._clock.now() - asked
        report = self._report
        return {
            "port": self._board.port,
            "steps_per_mm": abs(self._rates.per_metre) / 1e3,
            "round_trip_ms": 1e3 * trip,
            "zero_set": "yes" if self.zeroed else "no: put the blade at the clamp, and give 'cutenv rig zero'",
            "state": report.state.name.lower(),
            "damaged_lines_from_board": self._board.damaged,
            "damaged_lines_to_board": report.bad,
        }

    @property
    def zeroed(self) -> bool:
        """True if a person set zero since the board has power."""
        return bool(self._report.flags & BoardFlag.ZEROED)

    def set_zero(self) -> None:
        """Take the present unpowered position, at the clamp, as zero."""
        self._board.send("Z")
        self._await(lambda: self.zeroed and self._report.steps == 0, "set its zero: has the stepper power?")

    # Commands

    def _switch_on(self) -> None:
        if self.latch.closed or self._state not in (DriveState.DISABLED, DriveState.ENABLED):
            raise RigError(f"{self.name}: {self._condition()}; clear it first.")
        if not self.zeroed:
            raise RigError(
                f"{self.name}: the board does not know where the blade stands. Without power, put the blade at the "
                "clamp by hand, and give 'cutenv rig zero'."
            )
        self._energise(partial(self._board.send, "N"))
        self._await(lambda: self._state is DriveState.ENABLED, f"switch on ({self._reason})")

    def _send_speed(self, target: float) -> None:
        self._energise(partial(self._board.send, f"V {self._rates.steps(target)}"))

    def _send_stop(self, *, for_good: bool = False) -> None:
        self._board.send("Q")

    def disable(self) -> None:
        """Switch off the power at rest; raise RigError without rest or answer."""
        self._may_move = False
        self._rested()
        self._board.send("X")
        self._await(lambda: self._state is not DriveState.ENABLED, "switch its power off")

    def clear(self) -> None:
        """Leave quick stop or fault for rest without power, within the latch's reset."""
        self._fresh()
        self._error = ""
        self._may_move = False
        self._come_off()

    def _come_off(self) -> None:
        if self._state is DriveState.ENABLED:
            self._send_stop()
        self._rested()
        self._board.send("C")
        self._await(lambda: self._state is DriveState.DISABLED, f"leave its stop ({self._reason})")

    def _rested(self) -> None:
        self._await_rest(lambda: self._report.rate == 0)

    # Reports of the board, from the loop

    def allows_heartbeat(self, now: float) -> bool:
        """Return whether the stepper may have a sign of life at ``now`` [s]: without, the board stops it by itself."""
        return self.latch.allows_heartbeat(self.name, now)

    def received(self, report: Report, time: float) -> None:
        """Take a motion report; ignore others."""
        if not isinstance(report, MotionReport):
            return
        before, listener = self._last, self._listener
        with self._changed:
            self._last, self._state = report, _STATES[report.state]
            self._reports += 1
            self._may_move = self._may_move and self._state is DriveState.ENABLED
            self._changed.notify_all()
        if listener is None:
            return
        if before is not None:
            self._alarm(before, report, listener, time)
        late = self._arrivals.sensed(report.sequence, time)[1]
        if self._may_move and not late <= LATE_REPORT:
            listener.broken(self.name, f"reports of the board arrive {1e3 * late:.0f} ms later than before", time)
        position, speed = self._rates.metres(report.steps), self._rates.metres(report.rate)
        listener.motion(self.name, MotionSample(time, position, speed, 0.0, self._state))
        listener.alive(self.name, time)

    def _alarm(self, before: MotionReport, report: MotionReport, listener: MotionListener, time: float) -> None:
        alarms = []
        if report.sequence < before.sequence:
            alarms.append(_RESTARTED)
        alarms += [_ALARMS[flag] for flag in _ALARMS if report.flags & ~before.flags & flag]
        for code, meaning in alarms:
            self._error = f" ({meaning})"
            listener.emergency(self.name, code, meaning, time)

    def garbled(self, why: str, time: float) -> None:
        """Ignore a damaged line: the state is repeated, silence noticed."""

    @property
    def _report(self) -> MotionReport:
        if self._last is None:
            raise RigError(f"{self.name}: not open.")
        return self._last

    def _flags_told(self) -> str:
        return "; ".join(meaning for flag, (_, meaning) in _ALARMS.items() if self._report.flags & flag)

    @property
    def _reason(self) -> str:
        return self._flags_told() or "no reason told"

    def _condition(self) -> str:
        why = f" ({flags})" if (flags := self._flags_told()) else self._error
        return f'the stepper is "{self._report.state.name.lower()}"{why}'


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
    """Load cell on an HX711, ADS1220 or NAU7802, on a board with assets/firmware.

    It measures the force along the cut alone; the other components read 0. The board is shared with a stepper at the
    same port.
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
        """Return the board's converter data and counts of readings."""
        return {
            "port": self._board.port,
            "converter": self._converter,
            "rate_Hz": self.rate,
            "counts_per_N": 1.0 / self._newtons,
            "received_readings": self._received,
            "lost_readings": self._lost,
        }

    # Reports of the board, from the loop

    def allows_heartbeat(self, now: float) -> bool:
        """Return True: a sensor keeps nothing alive."""
        return True

    def received(self, report: Report, time: float) -> None:
        """Take a reading; other reports are not for a sensor."""
        if isinstance(report, ForceReport):
            counts = [0, 0, 0]
            counts[self._number] = report.counts
            self._take(report.sequence, time, (counts[0], counts[1], counts[2], 0, 0, 0), report.status)

    def _misplaced(self, number: int, now: float, *, late: bool) -> None:
        if not late:
            self.garbled(f"reading {number} does not follow {self._stream.last}: a restart?", now)

    def lost(self, why: str, time: float) -> None:
        """Note a lost board, which missing readings or an axis will report."""
        self._note(why)


def sensor_delay(rig: RigSettings) -> float:
    """Return a force's delay in readings [s], 0 if unstated."""
    return float(getattr(rig.sensor.options, "delay", 0.0))
