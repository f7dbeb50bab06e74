"""Check a rig without powering a drive: connections, limits, rates, noise.

Nothing may touch the blade meanwhile: the sensor's zero is taken.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from datetime import date
from typing import Any

from cutenv.commands.options import RIG, command_parser, reports_errors
from cutenv.commands.rig.connection import connected
from cutenv.drivers.rig_names import settings_of
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.errors import RigError
from cutenv.rig.operation.preflight import Check, Inspection, inspect, inspect_camera, may_move
from cutenv.rig.operation.suitability import decisions, fits, stopping_ways, suitability_lines


@reports_errors("rig check")
def main(argv: Sequence[str]) -> int:
    """Check; return 0, 1 if a check fails, 2 on bad input."""
    arguments = _parser().parse_args(argv)
    settings = settings_of(arguments.rig)
    said = may_move(settings, date.today())  # what the file says needs no connection
    try:
        with connected(arguments.rig) as rig:
            found = inspect(rig.plant, date.today())
    except RigError as error:
        found = Inspection(checks=(*said, Check("connection", False, str(error))), devices={})
    if settings.camera is not None:
        seen = inspect_camera(settings.camera)
        found = Inspection(checks=found.checks + seen.checks, devices=found.devices | seen.devices)
    if arguments.json:
        print(json.dumps(as_json(found) | capabilities(settings), indent=2))
    else:
        print("\n".join(lines(found)))
        print("\n".join(suitability_lines(settings)))
    return 0 if found.passed else 1


def as_json(found: Inspection) -> dict[str, Any]:
    """Return the inspection as a dictionary for JSON."""
    checks = [{"name": check.name, "passed": check.passed, "found": check.found} for check in found.checks]
    return {"passed": found.passed, "checks": checks, "devices": found.devices}


def capabilities(settings: RigSettings) -> dict[str, Any]:
    """Return the rig's capabilities as a dictionary for JSON."""
    ways = {what: None if math.isnan(way) else way for what, way in stopping_ways(settings).items()}
    return {
        "decisions_Hz": decisions(settings),
        "stopping_ways_m": ways,
        "tasks": [each._asdict() for each in fits(settings)],
    }


def lines(found: Inspection) -> list[str]:
    """Return the inspection as text: devices, then checks."""
    shown = []
    for device, about in found.devices.items():
        shown.append(f"{device}:")
        shown += [f"  {name:<28} {_shown(value)}" for name, value in about.items()]
    width = max(len(check.name) for check in found.checks)
    shown.append("checks:")
    shown += [f"  {'ok  ' if each.passed else 'FAIL'} {each.name:<{width}}  {each.found}" for each in found.checks]
    blade = found.devices.get("blade", {})
    if (stands := blade.get("position_mm")) is not None and blade.get("zero_set", "yes") == "yes":
        zero = "'cutenv rig zero' sets it" if "zero_set" in blade else "its own homing has to set zero at the clamp"
        shown.append(f"measure it: by its drive the blade stands {stands:.1f} mm from the clamp. If not, {zero}.")
    failed = sum(not check.passed for check in found.checks)
    shown.append(f"{failed} of {len(found.checks)} checks fail" if failed else f"all {len(found.checks)} checks pass")
    return shown


def _shown(value: float | str) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("rig check", __doc__, examples=("emulator", "my_rig.toml --json"))
    add = parser.option
    add("rig RIG", RIG)
    add("--json", "print the result as JSON")
    return parser
