"""Write the file of a new rig, with explained keys to fill in."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from cutenv._base import resources
from cutenv._base.output import check_writable
from cutenv.commands.options import command_parser, reports_errors
from cutenv.drivers.bota_sensor import BotaOptions
from cutenv.drivers.robotiq_sensor import ROBOTIQ_RATE, RobotiqOptions
from cutenv.drivers.slow_profile import grbl_settings, slow_limits, slow_settings
from cutenv.rig.config.settings import RigSettings, SensorSettings
from cutenv.rig.toml_file import template

PROFILES: dict[str, Callable[[], RigSettings]] = {
    "canopen": RigSettings,
    "serial": lambda: slow_settings(""),
    "grbl": lambda: grbl_settings("", ""),
}
"""Settings that a new file begins from, by the kind of rig."""
SENSORS: dict[str, SensorSettings] = {
    "bota": SensorSettings(driver="bota", options=BotaOptions(), rate=800.0, components="all"),
    "robotiq": SensorSettings(driver="robotiq", options=RobotiqOptions(), rate=ROBOTIQ_RATE, components="all"),
}
"""Force sensors that can take the place of the profile's."""


@reports_errors("rig init")
def main(argv: Sequence[str]) -> int:
    """Write the file; return 0, or 2 if that is impossible."""
    arguments = _parser().parse_args(argv)
    path: Path = arguments.file
    like = PROFILES[arguments.profile]()
    if arguments.sensor is not None:
        like = replace(like, sensor=SENSORS[arguments.sensor])
    if arguments.sensor == "robotiq":  # whose readings are rare: silence is noticed late, so the blade has to be slow
        like = replace(like, limits=replace(slow_limits(ROBOTIQ_RATE), stale_motion=like.limits.stale_motion))
    if path.suffix != ".toml":
        raise ValueError(f"{path} must end in .toml.")
    if not path.parent.is_dir():
        raise ValueError(f"{path}: there is no folder {path.parent}. Make it, or give another place.")
    check_writable("FILE", path.parent)
    text = template(arguments.name or path.stem, like=like)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise ValueError(f"{path} is there already, and is left as it is. Give another name.") from None
    if arguments.profile != "canopen":
        print(f"sketch of the board: {resources.path('firmware/cutenv_board')}")
    print(f"rig: {path}\n  fill in what its lines '# FILL IN:' ask for; nothing moves while armed_by is empty")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "rig init", __doc__, examples=("my_rig.toml", "my_rig.toml --profile serial", "my_rig.toml --sensor bota")
    )
    add = parser.option
    add("file FILE.toml", "file to write, which must not exist yet", Path)
    add(
        "--profile",
        "kind of rig: a CANopen drive and a Net "
        "F/T; a stepper and a load cell on a board; a machine with GRBL and such a load cell; "
        "default canopen",
        "canopen",
        choices=PROFILES,
    )
    add("--sensor", "a Bota sensor, or a Robotiq FT 300, in place of the force sensor of the profile", choices=SENSORS)
    add("--name NAME", "name of the rig; default the file's")
    return parser
