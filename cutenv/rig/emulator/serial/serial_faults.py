"""Faults of the emulated serial rigs: each by name, with its parameters, and the functions that start and end it."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import Any

from cutenv.rig.emulator.faults import OVER_FORCE, Act, InjectedFault, Parameters, Range, attribute, switched
from cutenv.rig.emulator.serial.firmware import HIGH_PIN, STOP_PIN


def _once(summary: str, begin: Callable[[Any], None]) -> InjectedFault:
    """Make a fault that nothing ends."""
    return InjectedFault(summary=summary, begin=lambda rig, p: begin(rig), end=lambda rig, p: None)


def _of_line(line: str, sender: str, *, share: float, delay: float) -> dict[str, InjectedFault]:
    """Return what can happen to a serial line, by name; ``sender`` is what is at its other end.

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
