"""Driver "serial" of an axis: a stepper by step and direction, on the board of ``assets/firmware``.

It has no encoder: the position is the number of steps that were sent. Steps that the motor loses are not seen.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from cutenv._base.validation import in_range
from cutenv.rig.config.axes import Axis
from cutenv.rig.devices.clock import Clock
from cutenv.rig.devices.driver_registry import Mounting, rig_driver
from cutenv.rig.devices.drivers import MotionListener
from cutenv.rig.devices.latch import Event, Latch
from cutenv.rig.devices.samples import DriveState, MotionSample
from cutenv.rig.devices.serial.board import BOARD_PATIENCE, SerialBoard
from cutenv.rig.devices.serial.board_lines import (
    BoardFlag,
    BoardState,
    MotionReport,
    Report,
    StepperSetup,
)
from cutenv.rig.devices.serial.stepper_settings import StepperOptions, StepRates, check_stepper, on_pseudo_terminal
from cutenv.rig.errors import RigError

_log = logging.getLogger(__name__)

_STATE_LIMIT = 1.0  # [s] for the board to change its state
_REPORTS = 0.3  # [s] for a report to arrive
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
class StepperAxis:
    """Stepper by step and direction, on a board with the sketch of assets/firmware.

    Its position counts from where a person has set zero since the board has power: ``cutenv rig zero``. After
    :meth:`quick_stop` nothing that could give it power or speed is sent until the latch is reset.

    Parameters
    ----------
    mounting : Mounting
        Place on the rig; the board is shared with a load cell at the same port.
    """

    def __init__(self, mounting: Mounting) -> None:
        self.name = mounting.role
        self.latch = Latch()  # until a supervisor replaces it by the shared one
        self._settings: Axis = mounting.settings
        options: StepperOptions = mounting.options
        self._clock: Clock = mounting.clock
        self._rates = StepRates(self._settings, options.steps)
        self._board = mounting.share(
            ("board", options.port), lambda: SerialBoard(options.port, options.baud, mounting.clock)
        )
        self._listener: MotionListener | None = None
        self._changed = threading.Condition()
        self._last: MotionReport | None = None
        self._reports = 0
        self._may_move = False
        self._error = ""
        self._lost: str | None = None

    # Life cycle

    def open(self, listener: MotionListener) -> None:
        """Connect, check who answers, write and verify the set-up; samples arrive from now on, nothing moves.

        Raises
        ------
        RigError
            If it is open already, the port is missing or taken, or the board does not keep the set-up.
        """
        if self._listener is not None:
            raise RigError(f"{self.name}: it is open already; close it first.")
        self._last, self._lost, self._error, self._may_move = None, None, "", False
        self._listener = listener
        try:
            self._board.join(self)
            self._await(lambda: self._last is not None, "report its state", _REPORTS)
            if self._state is not BoardState.OFF:  # left by a program that has ended
                self._come_off()
            wanted = self._rates.setup(self._settings)
            kept: StepperSetup = self._board.ask("P {} {} {} {} {}".format(*wanted), StepperSetup)
            if kept != wanted:
                raise RigError(
                    f"{self.name}: the board keeps the set-up {tuple(kept)}, not {tuple(wanted)} (acceleration, quick "
                    "stop [steps/s2], rate [steps/s], ends [steps])."
                )
        except BaseException:
            self._leave()
            raise

    def close(self) -> None:
        """Leave the axis at rest without power; never raises, and may be called twice."""
        if self._listener is None:
            return
        try:
            if self._lost is None:
                self._board.send("Q")
                self._come_off()
        except Exception as error:  # a lost board or any other error: leave it anyway
            _log.warning("%s: not closed in order: %s", self.name, error, exc_info=not isinstance(error, RigError))
        finally:
            self._leave()

    def _leave(self) -> None:
        self._may_move = False
        self._listener = None
        self._board.leave(self)

    def limits(self) -> dict[str, float]:
        """Return the board's own "low", "high", "speed", "acceleration" and "quick_stop", read back from it.

        Raises
        ------
        RigError
            If it is not open, or does not answer.
        """
        kept: StepperSetup = self._board.ask("P", StepperSetup)
        low, high = sorted(map(self._rates.metres, (kept.low, kept.high)))
        speed, acceleration, quick = (
            abs(self._rates.metres(each)) for each in (kept.fastest, kept.acceleration, kept.quick_stop)
        )
        return {"low": low, "high": high, "speed": speed, "acceleration": acceleration, "quick_stop": quick}

    def about(self) -> dict[str, float | str]:
        """Return the board's report about itself, and what it did not understand."""
        asked = self._clock.now()
        self._board.ask("P", StepperSetup)
        trip = self._clock.now() - asked
        report = self._report
        return {
            "port": self._board.port,
            "steps_per_mm": abs(self._rates.per_metre) / 1e3,
            "round_trip_ms": 1e3 * trip,
            "zero_set": "yes" if self.zeroed else "no: put the blade at the clamp, and give 'cutenv rig zero'",
            "state": self._state.name.lower(),
            "damaged_lines_from_board": self._board.damaged,
            "damaged_lines_to_board": report.bad,
        }

    @property
    def zeroed(self) -> bool:
        """True if a person has set zero since the board has power."""
        return bool(self._report.flags & BoardFlag.ZEROED)

    def set_zero(self) -> None:
        """Take the present position, without power, as zero: the blade stands at the clamp.

        Raises
        ------
        RigError
            If the stepper has power, or the board does not answer.
        """
        self._board.send("Z")
        self._await(lambda: self.zeroed and self._report.steps == 0, "set its zero: has the stepper power?")

    # Commands

    def enable(self) -> None:
        """Switch the power on, at rest. Clears no fault: see :meth:`clear`.

        Raises
        ------
        RigError
            If it was stopped, is in fault, has no zero, or does not power on in time.
        """
        self._fresh()
        if self.latch.closed or self._state not in (BoardState.OFF, BoardState.ENABLED):
            raise RigError(f"{self.name}: the stepper is {self._told()}; clear it first.")
        if not self.zeroed:
            raise RigError(
                f"{self.name}: the board does not know where the blade stands. Without power, put the blade at the "
                "clamp by hand, and give 'cutenv rig zero'."
            )
        self._energise("N")
        self._await(lambda: self._state is BoardState.ENABLED, f"switch on ({self._flags_told() or 'no reason told'})")
        with self._changed:
            self._may_move = self._state is BoardState.ENABLED and not self.latch.closed
        if not self._may_move:
            raise RigError(f"{self.name}: stopped while it was powered on{self._error}; clear it first.")

    def command(self, speed: float) -> None:
        """Put a target speed [m/s] on the line, without waiting for an answer.

        Raises
        ------
        TypeError, ValueError
            If the speed is not a number, or beyond the axis's top speed.
        RigError
            If the axis is not enabled, was stopped, or the line is broken.
        """
        top = self._settings.speed
        speed = in_range(f"{self.name} speed", speed, -top, top, "m/s", "The top speed is in the rig's file.")
        if not self._may_move:
            raise RigError(f"{self.name}: {self._lost or f'not enabled, the stepper is {self._told()}'}.")
        self._energise(f"V {self._rates.steps(speed)}")

    def quick_stop(self, *, for_good: bool = False) -> None:
        """Put a quick stop on the line: at once, from any thread, without waiting, in any state.

        The board never leaves it by a command of speed, so that ``for_good`` changes nothing.

        Raises
        ------
        RigError
            If the port does not take it, or the axis was never opened.
        """
        self.latch.happens(Event.STOP)
        self._may_move = False
        self._board.send("Q")

    def withhold_heartbeat(self, why: str) -> None:
        """End this computer's sign of life until :meth:`clear`: the board stops the stepper by itself."""
        self.latch.happens(Event.STOP)
        self._may_move = False
        _log.warning("%s: %s: our sign of life ends", self.name, why)
        self._board.withhold_life()

    def disable(self) -> None:
        """Switch off the power of an axis at rest.

        Raises
        ------
        RigError
            If it does not come to rest, or does not answer.
        """
        self._may_move = False
        self._rested()
        self._board.send("X")
        self._await(lambda: self._state is not BoardState.ENABLED, "switch its power off")

    def clear(self) -> None:
        """Leave quick stop or fault for rest without power, within the latch's reset.

        Raises
        ------
        RigError
            If the cause is still there, or the board does not answer.
        """
        self._board.resume_life()
        self._fresh()
        self._error = ""
        self._may_move = False
        self._come_off()

    def _come_off(self) -> None:
        if self._state is BoardState.ENABLED:
            self._board.send("Q")
        self._rested()
        self._board.send("C")
        self._await(lambda: self._state is BoardState.OFF, f"leave its stop ({self._flags_told() or 'no reason told'})")

    def _rested(self) -> None:
        stopping = self._settings.speed / min(self._settings.quick_stop, self._settings.acceleration) + _REPORTS
        self._await(lambda: self._report.rate == 0, "come to rest", stopping)

    def _energise(self, text: str) -> None:
        """Send a line that may start the blade, but never after a quick stop from another thread."""
        if self.latch.closed:
            raise RigError(f"{self.name}: stopped; clear it first.")
        self._board.send(text)
        if self.latch.closed:  # stopped between the two lines above: the quick stop has to be the last line
            self._board.send("Q")
            raise RigError(f"{self.name}: stopped; clear it first.")

    # Reports of the board; called by its reader

    def told(self, report: Report, time: float) -> None:
        """Take a report of the motion; others are not for an axis."""
        if not isinstance(report, MotionReport):
            return
        before, listener = self._last, self._listener
        with self._changed:
            self._last = report
            self._reports += 1
            self._may_move = self._may_move and report.state is BoardState.ENABLED
            self._changed.notify_all()
        if listener is None:
            return
        if before is not None:
            self._alarm(before, report, listener, time)
        position, speed = self._rates.metres(report.steps), self._rates.metres(report.rate)
        listener.motion(self.name, MotionSample(time, position, speed, 0.0, _STATES[report.state]))
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
        """Ignore a damaged line: the board repeats its state, and a lack of reports is noticed."""

    def lost(self, why: str, time: float) -> None:
        """Take the news that the board cannot be reached."""
        with self._changed:
            first, self._lost = self._lost is None, self._lost or why
            self._may_move = False
            self._changed.notify_all()
        if first and self._listener is not None:
            self._listener.broken(self.name, why, time)

    # Waiting

    @property
    def _report(self) -> MotionReport:
        if self._last is None:
            raise RigError(f"{self.name}: not open.")
        return self._last

    @property
    def _state(self) -> BoardState:
        return self._report.state

    def _flags_told(self) -> str:
        return "; ".join(meaning for flag, (_, meaning) in _ALARMS.items() if self._report.flags & flag)

    def _told(self) -> str:
        return f'"{self._state.name.lower()}"' + (f" ({why})" if (why := self._flags_told()) else self._error)

    def _await(self, come: Callable[[], bool], what: str, limit: float = _STATE_LIMIT) -> None:
        self._clock.wait_for(lambda: self._lost is not None or come(), limit, self._changed)
        if self._lost is not None:
            raise RigError(f"{self.name}: {self._lost}.")
        if not come():
            raise RigError(f"{self.name}: the board does not {what} within {limit:.1f} s.")

    def _fresh(self) -> None:
        """Wait for a report younger than now, because an older one does not reflect the last command."""
        seen = self._reports
        self._report  # noqa: B018  # raises if the axis is not open
        self._await(lambda: self._reports > seen + 1, "report its state", _REPORTS)
