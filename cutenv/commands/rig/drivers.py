"""List the drivers for a rig's file, or explain one's options.

A package adds its own by the entry points cutenv.motion_drivers, cutenv.force_drivers and cutenv.camera_drivers; a
class of your own is named as module:Class.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from typing import Any

from cutenv._base.validation import one_of
from cutenv.commands.options import command_parser, reports_errors
from cutenv.rig.devices.driver_registry import (
    DriverKind,
    RegisteredDriver,
    driver_named,
    option_keys,
    registered_drivers,
    traits_of,
)
from cutenv.rig.toml_file import key_comment


@reports_errors("rig drivers")
def main(argv: Sequence[str]) -> int:
    """List or explain drivers; return 2 for a bad name."""
    arguments = _parser().parse_args(argv)
    if arguments.name is None:
        found = [each for kind in DriverKind for each in registered_drivers(kind).values()]
    else:
        found = _named(arguments.name)
    told = [_about(each, options=arguments.name is not None) for each in found]
    print(json.dumps(told, indent=2) if arguments.json else "\n".join(_lines(told)))
    return 0


def _named(name: str) -> list[RegisteredDriver]:
    """Return the drivers of that name, of any kind."""
    if ":" in name:
        return [driver_named(DriverKind.MOTION, name)]  # its kind is not known before it is used
    known = {kind: registered_drivers(kind) for kind in DriverKind}
    one_of("driver", name, sorted({each for of_kind in known.values() for each in of_kind}))
    return [of_kind[name] for of_kind in known.values() if name in of_kind]


def _about(driver: RegisteredDriver, *, options: bool) -> dict[str, Any]:
    about: dict[str, Any] = {
        "name": driver.name, "kind": driver.kind.value, "origin": driver.origin, "target": driver.target,
    }  # fmt: skip
    try:
        summary = (driver.load().__doc__ or "").strip().partition("\n")[0]
    except (ValueError, ModuleNotFoundError) as error:
        if options:
            raise
        return about | {"summary": f"cannot be loaded: {error}"}
    about["summary"] = summary or "its class has no docstring; the first line of one would stand here"
    if options:
        about["needs"] = list(traits_of(driver.kind, driver.name).needs)
        about["options"] = [
            {"name": key.name, "about": " ".join(line.removeprefix("# ") for line in key_comment(key))}
            for key in option_keys(driver.kind, driver.name)
        ]
    return about


def _lines(told: list[dict[str, Any]]) -> Iterator[str]:
    width = max(len(each["name"]) for each in told)
    for each in told:
        yield f"{each['kind']:<7} {each['name']:<{width}}  {each['summary']} ({each['origin']})"
        if needs := each.get("needs"):
            yield f"        needs in its section of the file: {', '.join(needs)}"
        for option in each.get("options", ()):
            yield f"        {option['name']}: {option['about']}"


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("rig drivers", __doc__, examples=("", "canopen", "my_package.stage:Stage --json"))
    add = parser.option
    add("name NAME", "driver to explain; default all are listed", nargs="?")
    add("--json", "print the list as JSON")
    return parser
