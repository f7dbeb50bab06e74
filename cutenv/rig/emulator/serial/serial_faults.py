"""Faults of the emulated serial rig: each by name, with its parameters, and the functions that start and end it."""

from __future__ import annotations

from typing import Any

from cutenv.rig.emulator.faults import InjectedFault, Parameters, Range
from cutenv.rig.emulator.serial.firmware import HIGH_PIN, STOP_PIN


def _of_line(attribute: str, summary: str, value: Any, healthy: Any, **parameters: Range) -> InjectedFault:
    """Make a fault of the serial line: ``value``, or the parameter of that name."""

    def begin(rig: Any, given: Parameters) -> None:
        setattr(rig.line, attribute, given[value] if isinstance(value, str) else value)

    return InjectedFault(
        summary=summary, parameters=parameters, begin=begin, end=lambda rig, p: setattr(rig.line, attribute, healthy)
    )


def _of_rig(attribute: str, summary: str, value: Any, healthy: Any, **parameters: Range) -> InjectedFault:
    """Make a fault of the rig itself: ``value``, or the parameter of that name."""

    def begin(rig: Any, given: Parameters) -> None:
        setattr(rig, attribute, given[value] if isinstance(value, str) else value)

    return InjectedFault(
        summary=summary, parameters=parameters, begin=begin, end=lambda rig, p: setattr(rig, attribute, healthy)
    )


def _of_pin(pin: int, summary: str) -> InjectedFault:
    return InjectedFault(
        summary=summary,
        begin=lambda rig, p: rig.board.open_pin(pin),
        end=lambda rig, p: rig.board.open_pin(pin, False),
    )


SERIAL_FAULTS: dict[str, InjectedFault] = {
    "cable_out": InjectedFault(
        summary="the cable is pulled out; at the end it is put in again, and the port has another number",
        begin=lambda rig, p: rig.line.unplug(),
        end=lambda rig, p: rig.line.plug(),
    ),
    "board_restart": InjectedFault(
        summary="the board restarts: it loses its set-up, its zero and the motor's power",
        begin=lambda rig, p: rig.restart(),
        end=lambda rig, p: None,
    ),
    "board_deaf": _of_line("deaf", "nothing that the computer sends gets to the board", True, False),
    "board_mute": _of_line("mute", "nothing that the board sends comes here; it hears all", True, False),
    "damaged_lines": _of_line(
        "damaged_share", "a bit is changed in a share of the lines", "share", 0.0, share=Range(0.5, 0.0, 1.0, "1")
    ),
    "lost_lines": _of_line("lost_share", "a share of the lines is lost", "share", 0.0, share=Range(0.5, 0.0, 1.0, "1")),
    "noise": _of_line("noise", "random bytes come, as with another baud rate", True, False),
    "doubled_lines": _of_line("doubled", "each line comes twice", True, False),
    "latency": _of_line("delay", "lines come late", "delay_s", 0.0, delay_s=Range(0.15, 0.0, 2.0, "s")),
    "stop_button": _of_pin(STOP_PIN, "the stop button's contact to the board opens"),
    "limit_switch": _of_pin(HIGH_PIN, "the far limit switch opens"),
    "blocked": InjectedFault(
        summary="the motor stands though it gets pulses: it loses steps, or its supply is off",
        begin=lambda rig, p: rig.board.block(True),
        end=lambda rig, p: rig.board.block(False),
    ),
    "cell_silent": InjectedFault(
        summary="the converter makes no readings",
        begin=lambda rig, p: rig.convert(silent=True),
        end=lambda rig, p: rig.convert(silent=False),
    ),
    "cell_frozen": _of_rig("frozen", "the converter repeats its last counts", True, False),
    "cell_saturated": _of_rig("saturated", "the converter stands at the end of its range", True, False),
    "cell_wire_off": _of_rig("wire_off", "a wire of the load cell is off: the counts jump about", True, False),
    "over_force": InjectedFault(
        summary="a force is added to the tissue's",
        begin=lambda rig, p: rig.bench.add_force(p["force_N"]),
        end=lambda rig, p: rig.bench.add_force(0.0),
        parameters={"force_N": Range(25.0, -190.0, 190.0, "N")},
    ),
}
"""Every fault, by name."""
