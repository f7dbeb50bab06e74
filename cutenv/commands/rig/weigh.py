"""Calibrate the force sensor by known weights; nothing moves.

The weights are hung on it along the cut. No drive is powered. It prints the counts per newton of a load cell, or the
gain of another sensor, and how straight the line is.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from datetime import date
from pathlib import Path

from cutenv._base.output import check_writable
from cutenv.commands.options import RIG, command_parser
from cutenv.commands.rig import reports_rig_errors
from cutenv.commands.rig.connection import connected
from cutenv.rig.config.settings import RIG_NAMES, RigSettings
from cutenv.rig.operation.operator import operator_of
from cutenv.rig.operation.weighing import Weighing, weigh
from cutenv.rig.toml_file import write_values

_UNITS = {"g": 1e-3, "kg": 1.0}


@reports_rig_errors("weigh")
def main(argv: Sequence[str]) -> int:
    """Weigh; return 0, 1 (refused), 2 (bad input), 130 (Ctrl-C)."""
    arguments = _parser().parse_args(argv)
    masses = [mass_of(text) for text in arguments.masses]
    if arguments.write and arguments.rig in RIG_NAMES:
        raise ValueError(f'--write needs a rig\'s file, and "{arguments.rig}" has none.')
    if arguments.write:
        check_writable("--write", Path(arguments.rig).absolute().parent)
    with connected(arguments.rig) as rig:
        found = weigh(rig.plant, masses, operator_of(rig.settings))
        settings = rig.settings
    print("\n".join(report(found, settings)))
    if arguments.write:
        write_values(arguments.rig, measured_values(found, settings, date.today()))
        print(f"rig: {arguments.rig}")
    return 0


def mass_of(text: str) -> float:
    """Return a mass [kg] from text with its unit."""
    match = re.fullmatch(r"([0-9.]+)(g|kg)", text)
    try:
        if match is None:
            raise ValueError
        return float(match[1]) * _UNITS[match[2]]
    except ValueError:
        raise ValueError(f"--masses {text}: write a mass with its unit, such as 200g or 0.2kg.") from None


def measured_values(found: Weighing, settings: RigSettings, today: date) -> dict[tuple[str, ...], float | str]:
    """Return new values of the rig's file, by key path."""
    day: dict[tuple[str, ...], float | str] = {("calibration", "date"): today.isoformat()}
    if hasattr(settings.sensor.options, "counts_per_N"):
        counts = float(f"{abs(found.counts_per_newton):.6g}")
        return {**day, ("sensor", "options", "counts_per_N"): counts, ("calibration", "gain"): 1.0}
    return {**day, ("calibration", "gain"): float(f"{settings.calibration.gain * found.gain:.6g}")}


def report(found: Weighing, settings: RigSettings) -> list[str]:
    """Return the calibration as lines of text."""
    lines = ["   mass [g]   weight [N]       counts   reading [N]"]
    for mass, force, counts, reading in zip(found.masses, found.forces, found.counts, found.readings, strict=True):
        lines.append(f"{1e3 * mass:11.1f} {force:12.4f} {counts:12.0f} {reading:13.4f}")
    lines.append(f"counts per newton: {found.counts_per_newton:.6g}; the greatest distance from the line is "
                 f"{found.residual:.4f} N")  # fmt: skip
    if found.counts_per_newton < 0.0:
        lines.append("the counts fall as the weight grows: if the weight pulls as the tissue does, write sensor.sign = "
                     f"{-settings.sensor.sign}")  # fmt: skip
    for where, value in measured_values(found, settings, date.today()).items():
        lines.append(f"{'.'.join(where)} = {value}")
    return lines


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "rig weigh",
        __doc__,
        examples=("my_rig.toml --masses 0g 100g 200g 500g --write", "my_rig.toml --masses 0g 500g"),
    )
    add = parser.option
    add("rig RIG", RIG)
    add(
        "--masses MASS",
        "masses in order, with their units: 0g for none, two different ones at least",
        nargs="+",
        required=True,
    )
    add("--write", "write the result and today's date into the rig's file")
    return parser
