"""Test a rig's drivers against what their protocol promises.

An axis moves to and fro by some millimetres: take the blade off, and lay nothing in its way. A sensor must not be
touched. Without --section the blade's axis and the sensor are tried. How a whole rig stops at every fault is
measured on an emulator: scripts/validation/rig/rig_faults.py.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from cutenv._base.result_table import aligned
from cutenv.commands.options import RIG, command_parser
from cutenv.commands.rig import reports_rig_errors
from cutenv.drivers.conformance import (
    HEADER,
    TRIAL_TRAVEL,
    TriedPromise,
    conform_force,
    conform_motion,
    conformance_rows,
)
from cutenv.drivers.rig_names import settings_of
from cutenv.rig.config.settings import EMULATED, FAKE, Axis, RigSettings, SensorSettings
from cutenv.rig.devices.driver_registry import (
    KIND_OF_ROLE,
    DriverKind,
    Mounting,
    driver_named,
    mounted,
    registered_drivers,
    traits_of,
)
from cutenv.rig.devices.loop import SystemClock, preferred
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import operator_of

SECTIONS_TRIED = ("blade", "angle", "height", "side", "sensor")  # sections of a rig's file whose drivers can be tried
Tried = dict[str, tuple[str, list[TriedPromise]]]  # name of the driver, and its findings, by section


def tried_drivers(rig: str, sections: list[str] | None = None) -> Tried:
    """Try the drivers of a rig, or one driver.

    ``rig`` is a rig's TOML file, the name of an emulated one, or of a driver that needs no options; ``sections`` are by
    default the blade's axis and the sensor. Raise FileNotFoundError, ValueError if there is no such rig and no such
    driver, or the file is not valid; RigError if a device does not answer, or the operator does not agree.
    """
    if rig == FAKE:
        raise ValueError(f"a fake rig has no drivers to try. Give {', '.join(map(repr, EMULATED))}, or a rig's file.")
    with ExitStack() as stack:
        if rig in EMULATED:
            from cutenv.emulation.process import start

            settings = stack.enter_context(start(free_air=True, kind=rig)).settings
        elif rig.endswith(".toml") or Path(rig).exists():
            settings = settings_of(rig)
        else:
            settings, sections = _rig_of(rig), sections or [_role_of(rig)]
        stack.enter_context(preferred())
        found: Tried = {}
        for role in sections or ("blade", "sensor"):
            part = getattr(settings, role)
            if part is None:
                raise ValueError(f"rig {settings.name!r} has no section [{role}]. Try one that it has.")
            found[role] = part.driver, _findings(settings, role)
        return found


def _findings(settings: RigSettings, role: str) -> list[TriedPromise]:
    clock = SystemClock()
    driver = mounted(Mounting(role=role, rig=settings, clock=clock))
    if KIND_OF_ROLE[role] is DriverKind.FORCE:
        return conform_force(driver, settings, clock)
    if not settings.emulated:
        question = (
            f"The {role} axis of {settings.name} will {_trial_way(role)}, several times. Is the blade off, is its way "
            "clear, and is the stop button within reach?"
        )
        if not operator_of(settings).confirm(question, expected=settings.name):
            raise RigError("the operator has not confirmed: nothing moves.")
    return conform_motion(driver, settings, clock)


def _trial_way(role: str) -> str:
    """Return an axis's movement in its test, in words."""
    if role == "angle":
        return f"turn to and fro by up to {math.degrees(TRIAL_TRAVEL):.1f} degrees"
    return f"move to and fro by up to {1e3 * TRIAL_TRAVEL:g} mm"


def _role_of(name: str) -> str:
    """Return a driver's section in the rig's file, by its methods."""
    if ":" not in name:
        only_force = name in registered_drivers(DriverKind.FORCE) and name not in registered_drivers(DriverKind.MOTION)
        return "sensor" if only_force else "blade"
    return "sensor" if hasattr(driver_named(DriverKind.MOTION, name).load(), "tare") else "blade"


def _rig_of(name: str) -> RigSettings:
    """Return a rig with only this driver, of any kind."""
    role = _role_of(name)
    traits = traits_of(KIND_OF_ROLE[role], name)
    if traits.options is not None:
        raise ValueError(
            f"driver {name!r} takes options, such as its port. Write them into a rig's file ('cutenv rig init'), and "
            "give that file."
        )
    part = Axis(driver=name) if role == "blade" else SensorSettings(driver=name)
    settings: RigSettings = replace(RigSettings(name=name), **{role: part})  # type: ignore[arg-type]
    return replace(settings, emulated=traits.emulated(settings, role))


@reports_rig_errors("conform")
def main(argv: Sequence[str]) -> int:
    """Test drivers; return 0, 1 on failure, 2 on bad input."""
    arguments = _parser().parse_args(argv)
    found = tried_drivers(arguments.rig, arguments.section or None)
    if arguments.json:
        told = {role: [each._asdict() for each in findings] for role, (_, findings) in found.items()}
        print(json.dumps(told, indent=2))
    else:
        for role, (driver, findings) in found.items():
            print(f"{role}: driver {driver}")
            print("\n".join(f"  {line}" for line in aligned([HEADER, *conformance_rows(findings)])))
    missed = [each for _, findings in found.values() for each in findings if not each.kept]
    total = sum(len(findings) for _, findings in found.values())
    if not arguments.json:
        print(f"{len(missed)} of {total} promises are missed" if missed else f"all {total} promises are kept")
    return 1 if missed else 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "rig conform", __doc__, examples=("serial", "my_rig.toml --section sensor", "my_package.stage:Stage")
    )
    add = parser.option
    add("rig RIG", f"{RIG}; or a driver that needs no options, such as module:Class")
    add("--section", "section whose driver is tried; may be given again", action="append", choices=SECTIONS_TRIED)
    add("--json", "print the result as JSON")
    return parser
