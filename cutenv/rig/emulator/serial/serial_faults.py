"""Faults of the emulated serial rigs: each by name, with its parameters, and the functions that start and end it."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import Any

from cutenv.rig.emulator.faults import InjectedFault, Parameters, Range
from cutenv.rig.emulator.serial.firmware import HIGH_PIN, STOP_PIN


def _of(part: str, attribute: str, summary: str, value: Any, healthy: Any, **parameters: Range) -> InjectedFault:
    """Make a fault of a part of the rig, "" for itself: ``value``, or the parameter of that name."""

    def part_of(rig: Any) -> Any:
        return attrgetter(part)(rig) if part else rig

    def begin(rig: Any, given: Parameters) -> None:
        setattr(part_of(rig), attribute, given[value] if isinstance(value, str) else value)

    return InjectedFault(
        summary=summary,
        parameters=parameters,
        begin=begin,
        end=lambda rig, p: setattr(part_of(rig), attribute, healthy),
    )


def _once(summary: str, begin: Callable[[Any], None]) -> InjectedFault:
    """Make a fault that nothing ends."""
    return InjectedFault(summary=summary, begin=lambda rig, p: begin(rig), end=lambda rig, p: None)


def _of_line(line: str, sender: str, *, share: float, delay: float) -> dict[str, InjectedFault]:
    """Return what can happen to a serial line, by name; ``sender`` is what is at its other end.

    ``share`` of the lines and ``delay`` [s] are those of a fault that is given without.
    """
    return {
        "cable_out": InjectedFault(
            summary=f"the cable of the {sender} is pulled out; at the end it is put in again, and the port has another "
            "number",
            begin=lambda rig, p: attrgetter(line)(rig).unplug(),
            end=lambda rig, p: attrgetter(line)(rig).plug(),
        ),
        f"{sender}_deaf": _of(line, "deaf", f"nothing that the computer sends gets to the {sender}", True, False),
        f"{sender}_mute": _of(line, "mute", f"nothing that the {sender} sends comes here; it hears all", True, False),
        "damaged_lines": _of(
            line, "damaged_share", "a bit is changed in a share of the lines", "share", 0.0,
            share=Range(share, 0.0, 1.0, "1"),
        ),
        "lost_lines": _of(
            line, "lost_share", "a share of the lines is lost", "share", 0.0, share=Range(share, 0.0, 1.0, "1")
        ),
        "noise": _of(line, "noise", "random bytes come, as with another baud rate", True, False),
        "doubled_lines": _of(line, "doubled", "each line comes twice", True, False),
        "latency": _of(line, "delay", "lines come late", "delay_s", 0.0, delay_s=Range(delay, 0.0, 2.0, "s")),
    }  # fmt: skip


def _of_pin(pin: int, summary: str) -> InjectedFault:
    return InjectedFault(
        summary=summary,
        begin=lambda rig, p: rig.board.open_pin(pin),
        end=lambda rig, p: rig.board.open_pin(pin, False),
    )


_OF_CELL: dict[str, InjectedFault] = {
    "cell_silent": InjectedFault(
        summary="the converter makes no readings",
        begin=lambda rig, p: rig.convert(silent=True),
        end=lambda rig, p: rig.convert(silent=False),
    ),
    "cell_frozen": _of("", "frozen", "the converter repeats its last counts", True, False),
    "cell_saturated": _of("", "saturated", "the converter stands at the end of its range", True, False),
    "cell_wire_off": _of("", "wire_off", "a wire of the load cell is off: the counts jump about", True, False),
    "over_force": InjectedFault(
        summary="a force is added to the tissue's",
        begin=lambda rig, p: rig.bench.add_force(p["force_N"]),
        end=lambda rig, p: rig.bench.add_force(0.0),
        parameters={"force_N": Range(25.0, -190.0, 190.0, "N")},
    ),
}
_BOARD = _of_line("line", "board", share=0.5, delay=0.15)
_MACHINE = _of_line("machine.line", "grbl", share=0.8, delay=0.5)  # less is not noticed, as its page says

SERIAL_FAULTS: dict[str, InjectedFault] = {
    **_BOARD,
    "board_restart": _once(
        "the board restarts: it loses its set-up, its zero and the motor's power", lambda rig: rig.restart()
    ),
    "stop_button": _of_pin(STOP_PIN, "the stop button's contact to the board opens"),
    "limit_switch": _of_pin(HIGH_PIN, "the far limit switch opens"),
    "blocked": InjectedFault(
        summary="the motor stands though it gets pulses: it loses steps, or its supply is off",
        begin=lambda rig, p: rig.board.block(True),
        end=lambda rig, p: rig.board.block(False),
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
    "cancel_ignored": _of(
        "machine", "deaf_to_cancel", "jog cancel is not obeyed: it makes the jogs that it has", True, False
    ),
    "blocked": _of("machine", "blocked", "the motor stands though it gets pulses", True, False),
    "board_cable_out": _BOARD["cable_out"],
    "board_restart": _once("the load cell's board restarts", lambda rig: rig.restart()),
    "board_mute": _BOARD["board_mute"],
    **_OF_CELL,
}
"""Every fault of a rig with GRBL, by name; those of the machine's own line begin with "grbl"."""
