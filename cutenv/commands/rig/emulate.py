"""Run an emulated rig in real time: drive, screw, tissue, force sensor.

That is an EPOS4 drive on a CAN hub and a Net F/T; with --serial a board with stepper and load cell behind a
pseudo-terminal, which runs its own sketch and needs a C++ compiler; with --grbl a machine with GRBL and such a board,
each behind a pseudo-terminal.
Prints one line of JSON when it is ready: the ports and the sensor's page.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cutenv.commands.options import add_option, add_specimen_class, command_parser, made_place, reports_errors
from cutenv.rig.config.settings import Axis

if TYPE_CHECKING:
    from cutenv.emulation.canopen_rig import Options
    from cutenv.emulation.serial_rig import SerialOptions
    from cutenv.rig.config.mounted_specimen import MountedSpecimen

_ROTOR_INERTIA_PER_MASS = (Axis().lead / (2.0 * math.pi * Axis().gear)) ** 2  # [m2]
_CONSTANTS = (
    ("--lag-ms", "mechanics.lag", 1e-3, "MS", "lag of the blade's speed [ms]; default 40"),
    ("--dead-time-ms", "mechanics.dead_time", 1e-3, "MS", "dead time from target to motion [ms]; default 0"),
    ("--backlash-mm", "mechanics.backlash", 1e-3, "MM", "backlash of the screw [mm]; default 0.02"),
    ("--proportional-gain-N-per-m", "mechanics.proportional_gain", 1.0, "KP", "PD control of the blade's position in "
     "place of a velocity loop: force at the carriage for an error of position [N/m]; default a velocity loop"),
    ("--derivative-gain-Ns-per-m", "mechanics.derivative_gain", 1.0, "KD",
     "force for an error of speed under PD control [N s/m]; default 0"),
    ("--moved-mass-kg", "mechanics.rotor_inertia", _ROTOR_INERTIA_PER_MASS, "KG",
     "mass that the motor moves, at the carriage [kg]; default 191"),
    ("--drag-Ns-per-m", "mechanics.viscosity", 1.0, "B",
     "viscous friction of motor, gear and screw at the carriage [N s/m]; default 300"),
    ("--friction-N", "mechanics.friction", 1.0, "N",
     "friction of motor, gear and screw at the carriage [N]; default 20"),
    ("--force-delay-ms", "sensor.force_delay", 1e-3, "MS", "delay of the force sensor [ms]; default the simulator's"),
    ("--force-noise-N", "sensor.force_noise", 1.0, "N", "noise of the force sensor [N]; default the simulator's"),
    ("--force-resolution-N", "sensor.force_resolution", 1.0, "N",
     "resolution of the force sensor [N]; default the simulator's"),
    ("--force-drift-N", "sensor.force_drift", 1.0, "N", "drift of the force sensor's zero: standard deviation of its "
     "random walk one second after the specimen was laid [N]; default 0"),
    ("--debt-length-mm", "law.debt_length", 1e-3, "MM",
     "debt length of the cutting law [mm]; default the simulator's"),
    ("--blade-friction-Ns-m2", "law.friction_per_depth_speed", 1.0, "F",
     "viscous friction of the blade in tissue, per depth and speed [N s/m2]; default 0"),
)  # fmt: skip
"""Option, the constant that it sets, its unit in SI, placeholder and help."""


@reports_errors("rig emulate", TypeError)
def main(argv: Sequence[str]) -> int:
    """Emulate until ended; return 0, or 2 for bad options or ports."""
    arguments = _parser().parse_args(argv)
    from cutenv.emulation.emulated_bench import FAULTS, parsed_fault
    from cutenv.emulation.serial_rig import GRBL_FAULTS, SERIAL_FAULTS

    known_faults = GRBL_FAULTS if arguments.grbl else SERIAL_FAULTS if arguments.serial else FAULTS
    if arguments.list_faults:
        for name, fault in known_faults.items():
            known = [f"{key}={about.default:g} {about.unit}" for key, about in fault.parameters.items()]
            known += ["axis=blade"] if fault.of_axis else []
            print(f"{name:<16} {fault.summary}" + (f" ({', '.join(known)})" if known else ""))
        return 0
    if arguments.write is not None:
        made_place("--write", arguments.write)
    from cutenv.emulation.process import serve

    parent = os.getppid() if arguments.with_parent == 0 else arguments.with_parent
    faults = [parsed_fault(text, known_faults) for text in arguments.fault]
    slow = arguments.serial or arguments.grbl
    options = _serial_options(arguments) if slow else _options(arguments)
    serve(options, faults=faults, parent=parent, real_time=arguments.real_time, file=arguments.write)
    return 0


def _mounted(arguments: argparse.Namespace) -> MountedSpecimen | None:
    from cutenv.rig.config.mounted_specimen import MountedSpecimen
    from cutenv.sim.tissue.description import load_description

    if arguments.free_air:
        return None
    tissue = None if arguments.tissue is None else load_description(arguments.tissue)
    return MountedSpecimen(
        seed=arguments.seed, episode=arguments.episode, specimen_class=arguments.specimen_class, tissue=tissue
    )


def _serial_options(arguments: argparse.Namespace) -> SerialOptions:
    from cutenv.emulation.serial_rig import SerialOptions
    from cutenv.sim.cutting.dtypes import LawParameters

    kind = "--grbl" if arguments.grbl else "--serial"
    allowed = {"debt_length_mm": "debt_length", "blade_friction_Ns_m2": "friction_per_depth_speed"}
    law = {}
    for option, _, unit, *_ in _CONSTANTS:
        name = option.removeprefix("--").replace("-", "_")
        value = getattr(arguments, name)
        if value is not None and name not in allowed:
            raise ValueError(f"{option}: a serial rig has no such property. Leave it out, or leave out {kind}.")
        if value is not None:
            law[allowed[name]] = unit * value
    ports = arguments.can_port or arguments.sensor_port or arguments.page_port
    if arguments.height or arguments.side or ports:
        raise ValueError(f"--height, --side and the ports of bus, sensor and page are not for {kind}. Leave them out.")
    if arguments.sensor != "netft" or arguments.range != "task":
        raise ValueError(f"--sensor and --range are not for {kind}, which has a load cell. Leave them out.")
    return SerialOptions(
        angle=math.radians(arguments.angle_deg),
        motion="grbl" if arguments.grbl else "board",
        converter=arguments.converter,
        mounted=_mounted(arguments),
        force_limit=arguments.force_limit_N,
        zeroed=not arguments.no_zero,
        law=LawParameters(**law),
        host=arguments.host,
        control_port=arguments.control_port,
    )


def _options(arguments: argparse.Namespace) -> Options:
    from cutenv.emulation.canopen_rig import Options
    from cutenv.emulation.mechanics import Mechanics, hinge
    from cutenv.rig.config.settings import across
    from cutenv.sim.cutting.dtypes import LawParameters
    from cutenv.sim.cutting.sensor import SensorParameters

    given: dict[str, dict[str, float]] = {"mechanics": {}, "sensor": {}, "law": {}}
    for option, constant, unit, *_ in _CONSTANTS:
        value = getattr(arguments, option.removeprefix("--").replace("-", "_"))
        if value is not None:
            group, _, name = constant.partition(".")
            given[group][name] = unit * value
    return Options(
        angle_mode=arguments.angle,
        angle=math.radians(arguments.angle_deg),
        mounted=_mounted(arguments),
        force_limit=arguments.force_limit_N,
        cross_axes=across(*(name for name in ("height", "side") if getattr(arguments, name))),
        blade_mechanics=Mechanics(**given["mechanics"]),
        hinge_mechanics=hinge(),
        sensor=SensorParameters(**given["sensor"]),
        law=LawParameters(**given["law"]),
        analogue=arguments.calibration if arguments.sensor == "analogue" else None,
        range=arguments.range,
        host=arguments.host,
        can_port=arguments.can_port,
        sensor_port=arguments.sensor_port,
        page_port=arguments.page_port,
        control_port=arguments.control_port,
    )


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "rig emulate",
        __doc__,
        examples=(
            "--write emulated.toml",
            "--serial --write serial.toml",
            "--grbl --list-faults",
            "--seed 3 --fault sensor_silent@5",
            "--list-faults",
        ),
        note="Drivers meet it by python-can's interface socketcand, channel vcan0, and by UDP. Ctrl-C ends it.",
    )
    add = parser.option
    add("--seed N", "seed of the specimen; default 0", 0)
    add("--episode N", "number of the specimen under its seed; default 0", 0)
    add_specimen_class(parser, "liver")
    add("--tissue FILE", "tissue that the specimen is drawn from; default pig liver", Path)
    add("--free-air", "no specimen: the blade moves in air")
    add("--angle", "whether a second axis turns the blade; default free", "free", choices=("free", "fixed"))
    add("--angle-deg DEG", "angle of the blade at the start [deg]; default 90", 90.0)
    add("--height", "a further axis raises and lowers the blade")
    add("--side", "a further axis moves the blade to the side")
    slow = parser.add_mutually_exclusive_group()
    add_option(slow, "--serial", "a board with stepper and load cell on a serial line, not CAN and Net F/T")
    add_option(slow, "--grbl", "a machine with GRBL, and a board with the load cell")
    add(
        "--converter",
        "converter of the load cell of a serial rig; default hx711",
        "hx711",
        choices=("hx711", "ads1220", "nau7802"),
    )
    add("--no-zero", "a serial rig, or one with GRBL, whose zero is not set yet")
    add(
        "--fault NAME@SECONDS",
        "fault to raise at this time; NAME:KEY=VALUE,KEY=VALUE@SECONDS with parameters; may be given again",
        action="append",
        default=[],
    )
    add("--list-faults", "print the faults and their parameters, and end")
    add("--force-limit-N N", "true force whose crossing is noted [N]; default 15", 15.0)
    for option, _, _, metavar, about in _CONSTANTS:
        add(f"{option} {metavar}", about, float)
    add(
        "--range",
        "mechanical range: task (43 to 92 deg, 2.65 cm/s) "
        "or thesis (0 to 180 deg, which is 90 either way from upright, and 3.81 cm/s); default task",
        "task",
        choices=("task", "thesis"),
    )
    add(
        "--sensor",
        "force sensor: a Net F/T, or an analogue six-axis one on a board; default netft",
        "netft",
        choices=("netft", "analogue"),
    )
    add(
        "--calibration FILE",
        "matrix and converter of the analogue sensor; default the shipped one, in its resolution the thesis's JR3",
        "jr3_85m35a_i40",
    )
    add("--host ADDRESS", "address to listen on; default 127.0.0.1, this computer alone", "127.0.0.1")
    for name, used in (("can", "the CAN bus"), ("sensor", "the force sensor"), ("page", "the sensor's page"),
                       ("control", "controlling the emulator")):  # fmt: skip
        add(f"--{name}-port PORT", f"port of {used}; default a free one", 0)
    add("--real-time", "take priority over other processes, if the system allows")
    add("--write FILE", "rig file to write, for 'cutenv rig run --rig FILE'", Path)
    add(
        "--with-parent PID", "end when the process PID ends; default the one that started this", int, nargs="?", const=0
    )
    return parser
