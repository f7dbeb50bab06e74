"""Emulated rig on a serial line, and its faults."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np

from cutenv._base.validation import in_range, one_of
from cutenv.drivers.slow_profile import COUNTS_PER_NEWTON, DELAYS, SCREW, SCREW_STEPS
from cutenv.emulation.emulated_bench import (
    OVER_FORCE,
    Act,
    EmulatedBench,
    InjectedFault,
    Parameters,
    Range,
    attribute,
    switched,
)
from cutenv.emulation.firmware import (
    CONVERTERS,
    HIGH_PIN,
    LOW_PIN,
    STOP_PIN,
    EmulatedGrbl,
    EmulatedLine,
    Firmware,
)
from cutenv.emulation.mechanics import EmulatedTissue
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.config.settings import Axis
from cutenv.rig.devices.serial.board import BoardFlag, BoardState, LineError, MotionReport, board_line, board_report
from cutenv.rig.devices.serial.board_drivers import StepRates
from cutenv.sim.cutting.dtypes import TICK, LawParameters
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.plant.simulator import check_angle


def _once(summary: str, begin: Callable[[Any], None]) -> InjectedFault:
    """Make a fault that nothing ends."""
    return InjectedFault(summary=summary, begin=lambda rig, p: begin(rig), end=lambda rig, p: None)


def _of_line(line: str, sender: str, *, share: float, delay: float) -> dict[str, InjectedFault]:
    """Return what can happen to a serial line, by name.

    ``sender`` is what is at its other end.

    ``share`` of the lines and ``delay`` [s] are those of a fault that is given without.
    """

    def on(name: str) -> Act:
        return attribute(name, line)

    def plugged(rig: Any, given: Parameters, out: bool) -> None:
        found = attrgetter(line)(rig)
        found.unplug() if out else found.plug()

    return {
        "cable_out": switched(
            plugged,
            f"the cable of the {sender} is pulled out; at the end it is put in again, and the port has another number",
        ),
        f"{sender}_deaf": switched(on("deaf"), f"nothing that the computer sends gets to the {sender}"),
        f"{sender}_mute": switched(on("mute"), f"nothing that the {sender} sends comes here; it hears all"),
        "damaged_lines": switched(
            on("damaged_share"), "a bit is changed in a share of the lines", "share", 0.0,
            share=Range(share, 0.0, 1.0, "1"),
        ),
        "lost_lines": switched(
            on("lost_share"), "a share of the lines is lost", "share", 0.0, share=Range(share, 0.0, 1.0, "1")
        ),
        "noise": switched(on("noise"), "random bytes come, as with another baud rate"),
        "doubled_lines": switched(on("doubled"), "each line comes twice"),
        "latency": switched(on("delay"), "lines come late", "delay_s", 0.0, delay_s=Range(delay, 0.0, 2.0, "s")),
    }  # fmt: skip


_OF_CELL: dict[str, InjectedFault] = {
    "cell_silent": switched(lambda rig, p, silent: rig.convert(silent=silent), "the converter makes no readings"),
    "cell_frozen": switched(attribute("frozen"), "the converter repeats its last counts"),
    "cell_saturated": switched(attribute("saturated"), "the converter stands at the end of its range"),
    "cell_wire_off": switched(attribute("wire_off"), "a wire of the load cell is off: the counts jump about"),
    "over_force": OVER_FORCE,
}
_BOARD = _of_line("line", "board", share=0.5, delay=0.15)
_MACHINE = _of_line("machine.line", "grbl", share=0.8, delay=0.5)  # less is not noticed, as its page says

SERIAL_FAULTS: dict[str, InjectedFault] = {
    **_BOARD,
    "board_restart": _once(
        "the board restarts: it loses its set-up, its zero and the motor's power", lambda rig: rig.restart()
    ),
    "stop_button": switched(
        lambda rig, p, opened: rig.board.open_pin(STOP_PIN, opened), "the stop button's contact to the board opens"
    ),
    "limit_switch": switched(lambda rig, p, opened: rig.board.open_pin(HIGH_PIN, opened), "the far limit switch opens"),
    "blocked": switched(
        lambda rig, p, blocked: rig.board.block(blocked),
        "the motor stands though it gets pulses: it loses steps, or its supply is off",
    ),
    **_OF_CELL,
}
"""Every fault of a rig on one board, by name."""

GRBL_FAULTS: dict[str, InjectedFault] = {
    **{name if name.startswith("grbl") else f"grbl_{name}": fault for name, fault in _MACHINE.items()},
    "grbl_restart": _once(
        "the machine restarts: it forgets its jogs and where the blade stands", lambda rig: rig.machine.reset()
    ),
    "grbl_alarm": _once("a limit switch opens: GRBL stops at once, with an alarm", lambda rig: rig.machine.alarm(1)),
    "feed_hold": _once("somebody presses the machine's feed hold", lambda rig: rig.machine.feed_hold()),
    "cancel_ignored": switched(
        attribute("deaf_to_cancel", "machine"), "jog cancel is not obeyed: it makes the jogs that it has"
    ),
    "blocked": switched(attribute("blocked", "machine"), "the motor stands though it gets pulses"),
    "board_cable_out": _BOARD["cable_out"],
    "board_restart": _once("the load cell's board restarts", lambda rig: rig.restart()),
    "board_mute": _BOARD["board_mute"],
    **_OF_CELL,
}
"""Every fault of a rig with GRBL, by name; those of the machine's own line begin with "grbl"."""


# load cell before its converter: noise as assumed of a cell for 50 N; the converter averages it
CELL = SensorParameters(force_delay=0.0, force_noise=0.01, force_resolution=0.0)
_SPEED_OVER = 10  # ms over which the carriage's speed is taken: a step is 2.5 um
SWITCHES = 0.002  # distance beyond the ends of travel at which the limit switches open [m]
_FULL = 8_388_607  # counts of the converter's range


@dataclass(frozen=True, kw_only=True)
class SerialOptions:
    """Construction of the emulated serial rig."""

    angle: float = math.pi / 2  # angle at which the blade is fixed [rad]
    motion: str = "board"  # what moves the blade: a stepper on the "board" of the load cell, or a machine with "grbl"
    converter: str = "hx711"  # converter of the load cell, of :data:`cutenv.emulation.firmware.CONVERTERS`
    clock_error: float = 0.0  # relative error of the converter's own clock [1]: its readings come that much faster
    mounted: MountedSpecimen | None = field(default_factory=MountedSpecimen)  # specimen at the start; None: free air
    force_limit: float = 15.0  # true force whose crossing is recorded as an event [N]
    zeroed: bool = True  # True if a person has already set the blade's zero at the clamp
    sensor: SensorParameters = CELL  # load cell before its converter
    law: LawParameters = field(default_factory=LawParameters)  # cutting law, as in the simulator
    host: str = "127.0.0.1"  # address of the control port
    control_port: int = 0  # control port; 0 takes a free one

    def __post_init__(self) -> None:
        check_angle(self.angle)
        one_of("motion", self.motion, ("board", "grbl"))
        one_of("converter", self.converter, CONVERTERS)
        in_range("clock_error", self.clock_error, -0.2, 0.2, "1", "An HX711 may be off by a tenth.")
        in_range("force_limit", self.force_limit, 0.01, 1000.0, "N", "What the rig's own limit is.")


class EmulatedSerialRig(EmulatedBench):
    """Emulated serial rig, whose board runs the sketch of ``assets/firmware``.

    ``frozen``, ``saturated``, ``wire_off``: faults of the load cell.
    """

    faults: ClassVar[Mapping[str, InjectedFault]] = SERIAL_FAULTS
    stands_after = 10

    def __init__(self, options: SerialOptions | None = None) -> None:
        self.options = options = options or SerialOptions()
        super().__init__(EmulatedTissue(options.sensor, options.law), options.force_limit)
        self._rates, self._axis = StepRates(SCREW, SCREW_STEPS), SCREW
        self._made = 0  # steps by boards before the last restart
        self.board = Firmware(options.converter)
        self.convert()
        self.frozen = self.saturated = self.wire_off = False
        window = max(round(DELAYS[options.converter] / TICK), 1)
        self._readings: deque[float] = deque([0.0] * window, maxlen=window)
        self._positions: deque[float] = deque([0.0] * (_SPEED_OVER + 1), maxlen=_SPEED_OVER + 1)
        self._random = np.random.default_rng(0)
        self._flags, self._state = BoardFlag(0), BoardState.OFF
        if options.zeroed:
            self.board.feed(board_line("Z"))
            self.board.advance()
            self.board.drain()
        if options.mounted is not None:
            self.mount(options.mounted)
        self.line = EmulatedLine()  # its serial line; ``line.port`` is the port to open

    def restart(self) -> None:
        """Restart the board, with the carriage where it is."""
        self._made += self.board.steps
        self.board = Firmware(self.options.converter)
        self.convert()

    def convert(self, *, silent: bool = False) -> None:
        """Let the converter run at its rate, or fall silent."""
        self.board.converting(CONVERTERS[self.options.converter] * (1.0 + self.options.clock_error), silent=silent)

    @property
    def position(self) -> float:
        """Position of the carriage from the clamp [m]."""
        return self._rates.metres(self._made + self.board.steps)

    @property
    def speed(self) -> float:
        """Speed of the carriage over the last ten milliseconds [m/s]."""
        return (self._positions[-1] - self._positions[0]) / (_SPEED_OVER * TICK)

    @property
    def angle(self) -> float:
        """Angle of the blade [rad]."""
        return self.options.angle

    @property
    def axis_names(self) -> Sequence[str]:
        """Names of the driven axes."""
        return ["blade"]

    @property
    def axis(self) -> Axis:
        """Axis as mounted."""
        return self._axis

    def ready(self) -> dict[str, Any]:
        """Return what drivers have to know to reach it."""
        return {"port": self.line.port, "converter": self.options.converter}

    def state(self) -> dict[str, Any]:
        """Return whether the stepper is powered and the cable in."""
        state = "operation enabled" if self._state is BoardState.ENABLED else "not enabled"
        return {"nodes": [{"axis": "blade", "state": state}], "clients": {"port": int(self.line.plugged)}}

    def truth(self) -> dict[str, Any]:
        """Return the steps that the motor has made."""
        return {"steps": self._made + self.board.steps}

    def step(self, due: float) -> None:
        """Advance by one millisecond, that of time ``due`` [s]."""
        with self.lock:
            heard = self.line.heard()
            if heard:
                self.board.feed(heard)
                if b"Q*" in heard:
                    self.happened("quick stop received", time=due, axis="blade")
            self.board.advance(round(1e6 * TICK))
            self._move(due)
            position = self.position
            self._positions.append(position)
            before = abs(self.bench.true_force)
            self._readings.append(self.bench.advance(position, self.angle))
            if not self.frozen:
                self.board.weigh(self._counts())
            for line in self.line.say(self.board.drain(), due):
                self._overhear(line, due)
            moved = abs(self._positions[-1] - self._positions[-2]) / TICK
        self._watch(due, before, abs(self.bench.true_force), moved)

    def _move(self, due: float) -> None:
        """Let the carriage move a millisecond; open limit switches."""
        position = self.position
        self.board.open_pin(LOW_PIN, position < self._axis.low - SWITCHES or self._opened(LOW_PIN))
        self.board.open_pin(HIGH_PIN, position > self._axis.high + SWITCHES or self._opened(HIGH_PIN))

    def _opened(self, pin: int) -> bool:
        return pin == HIGH_PIN and ("limit_switch", "") in self.active

    def _counts(self) -> int:
        if self.saturated:
            return _FULL
        if self.wire_off:
            return int(self._random.integers(-_FULL, _FULL))
        return round(COUNTS_PER_NEWTON * sum(self._readings) / len(self._readings))

    def _overhear(self, line: bytes, due: float) -> None:
        """Record that the board has stopped by its own watch."""
        try:
            report = board_report(line)
        except LineError:
            return
        if isinstance(report, MotionReport):
            if report.flags & ~self._flags & BoardFlag.SILENT:
                self.happened("heartbeat of the master lost", time=due, axis="blade")
            self._flags, self._state = report.flags, report.state

    def close(self) -> None:
        """Remove the port; may be called twice."""
        self.stopped.set()
        with self.lock:  # a step that is under way reads the line
            self.line.close()


class EmulatedGrblRig(EmulatedSerialRig):
    """Emulated rig on two serial lines: a machine with GRBL, and the board."""

    faults: ClassVar[Mapping[str, InjectedFault]] = GRBL_FAULTS

    def __init__(self, options: SerialOptions | None = None) -> None:
        self.machine = EmulatedGrbl()  # the machine; ``machine.line.port`` is its port, ``line.port`` the board's
        self._seen = 0, 0  # cancels, and ends of its jogs
        super().__init__(options or SerialOptions(motion="grbl"))
        if self.options.zeroed:
            self.machine.set_zero()

    @property
    def position(self) -> float:
        """Position of the carriage from the clamp [m]."""
        return 1e-3 * self.machine.carriage

    def ready(self) -> dict[str, Any]:
        """Return what drivers have to know to reach it."""
        return {**super().ready(), "port": self.machine.line.port, "sensor_port": self.line.port}

    def state(self) -> dict[str, Any]:
        """Return whether it jogs, and whether both cables are in."""
        state = "operation enabled" if self.machine.state == "Jog" else "not enabled"
        cables = {"port": int(self.machine.line.plugged), "sensor_port": int(self.line.plugged)}
        return {"nodes": [{"axis": "blade", "state": state}], "clients": cables}

    def truth(self) -> dict[str, Any]:
        """Return the jogs that the machine has taken."""
        return {"jogs": self.machine.jogs_read}

    def _move(self, due: float) -> None:
        machine = self.machine
        machine.step(due)
        cancels, ends = self._seen
        self._seen = machine.cancels, machine.runs_out
        if machine.cancels > cancels:
            self.happened("quick stop received", time=due, axis="blade")
        if machine.runs_out > ends:
            self.happened("jogs made", time=due, axis="blade")
        outside = not self._axis.low - SWITCHES <= self.position <= self._axis.high + SWITCHES
        if outside and machine.state == "Jog":
            machine.alarm(1)

    def close(self) -> None:
        """Remove the ports; may be called twice."""
        super().close()
        with self.lock:
            self.machine.close()
