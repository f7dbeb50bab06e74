"""Run an emulated rig: an EPOS4 drive on a CAN hub, screw, tissue and a Net F/T force sensor, in real time.

Prints one line of JSON when it is ready: the ports and the sensor's page.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cutenv.commands.options import add_specimen_class, command_parser, reports_errors

if TYPE_CHECKING:
    from cutenv.rig.emulator.assembly import Options


@reports_errors("rig emulate", TypeError)
def main(argv: Sequence[str]) -> int:
    """Run the command until it is ended; return 0, or 2 if an option is bad or a port is taken."""
    from cutenv.rig.emulator.faults import FAULTS, parsed_fault

    arguments = _parser().parse_args(argv)
    if arguments.list_faults:
        for name, fault in FAULTS.items():
            known = [f"{key}={about.default:g} {about.unit}" for key, about in fault.parameters.items()]
            known += ["axis=blade"] if fault.of_axis else []
            print(f"{name:<16} {fault.summary}" + (f" ({', '.join(known)})" if known else ""))
        return 0
    from cutenv.rig.emulator.process import serve

    parent = os.getppid() if arguments.with_parent == 0 else arguments.with_parent
    faults = [parsed_fault(text) for text in arguments.fault]
    options = _options(arguments)
    serve(options, faults=faults, parent=parent, real_time=arguments.real_time, file=arguments.write)
    return 0


def _options(arguments: argparse.Namespace) -> Options:
    from cutenv.cutting.parameters import LawParameters
    from cutenv.cutting.sensor import SensorParameters
    from cutenv.rig.emulator.assembly import Options
    from cutenv.rig.emulator.emulated_tissue import Laid
    from cutenv.rig.emulator.motor import Mechanics, hinge
    from cutenv.tissue.description import load_description

    tissue = None if arguments.tissue is None else load_description(arguments.tissue)
    laid = Laid(seed=arguments.seed, episode=arguments.episode, specimen_class=arguments.specimen_class, tissue=tissue)
    mechanics = {"lag": _si(arguments.lag_ms, 1e-3), "dead_time": _si(arguments.dead_time_ms, 1e-3)}
    mechanics |= {"backlash": _si(arguments.backlash_mm, 1e-3), "friction": arguments.friction_N}
    sensor = {"force_delay": _si(arguments.force_delay_ms, 1e-3), "force_noise": arguments.force_noise_N}
    sensor |= {"force_resolution": arguments.force_resolution_N, "force_drift": arguments.force_drift_N}
    law = {"debt_length": _si(arguments.debt_length_mm, 1e-3)}
    law |= {"friction_per_depth_speed": arguments.blade_friction_Ns_m2}
    return Options(
        angle_mode=arguments.angle,
        angle=math.radians(arguments.angle_deg),
        laid=None if arguments.free_air else laid,
        force_limit=arguments.force_limit_N,
        blade_mechanics=Mechanics(**_given(mechanics)),
        hinge_mechanics=hinge(),
        sensor=SensorParameters(**_given(sensor)),
        law=LawParameters(**_given(law)),
        host=arguments.host,
        can_port=arguments.can_port,
        sensor_port=arguments.sensor_port,
        page_port=arguments.page_port,
        control_port=arguments.control_port,
    )


def _si(value: float | None, unit: float) -> float | None:
    return None if value is None else unit * value


def _given(values: dict[str, float | None]) -> dict[str, float]:
    return {name: value for name, value in values.items() if value is not None}


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "rig emulate",
        __doc__,
        examples=("--write emulated.toml", "--seed 3 --fault sensor_silent@5", "--list-faults"),
        note="Drivers meet it by python-can's interface socketcand, channel vcan0, and by UDP. Ctrl-C ends it.",
    )
    add = parser.add_argument
    add("--seed", type=int, default=0, metavar="N", help="seed of the specimen; default 0")
    add("--episode", type=int, default=0, metavar="N", help="number of the specimen under its seed; default 0")
    add_specimen_class(parser, "liver")
    add("--tissue", type=Path, metavar="FILE", help="tissue that the specimen is drawn from; default pig liver")
    add("--free-air", action="store_true", help="no specimen: the blade moves in air")
    add(
        "--angle", choices=("free", "fixed"), default="free", help="whether a second axis turns the blade; default free"
    )
    add(
        "--angle-deg", type=float, default=90.0, metavar="DEG", help="angle of the blade at the start [deg]; default 90"
    )
    add("--fault", action="append", default=[], metavar="NAME@SECONDS", help="fault to raise at this time; "
        "NAME:KEY=VALUE,KEY=VALUE@SECONDS with parameters; may be given again")  # fmt: skip
    add("--list-faults", action="store_true", help="print the faults and their parameters, and end")
    add("--force-limit-N", type=float, default=15.0, metavar="N", help="true force whose crossing is noted [N]; "
        "default 15")  # fmt: skip
    add("--lag-ms", type=float, default=40.0, metavar="MS", help="lag of the blade's speed [ms]; default 40")
    add("--dead-time-ms", type=float, default=0.0, metavar="MS", help="dead time from target to motion [ms]; default 0")
    add("--backlash-mm", type=float, metavar="MM", help="backlash of the screw [mm]; default 0.02")
    add(
        "--friction-N",
        type=float,
        metavar="N",
        help="friction of motor, gear and screw at the carriage [N]; default 20",
    )
    add("--force-delay-ms", type=float, metavar="MS", help="delay of the force sensor [ms]; default the simulator's")
    add("--force-noise-N", type=float, metavar="N", help="noise of the force sensor [N]; default the simulator's")
    add("--force-resolution-N", type=float, metavar="N", help="resolution of the force sensor [N]; default the "
        "simulator's")  # fmt: skip
    add("--force-drift-N", type=float, metavar="N", help="drift of the force sensor's zero: standard deviation of its "
        "random walk one second after the specimen was laid [N]; default 0")  # fmt: skip
    add("--debt-length-mm", type=float, metavar="MM", help="debt length of the cutting law [mm]; default the "
        "simulator's")  # fmt: skip
    add("--blade-friction-Ns-m2", type=float, metavar="F", help="viscous friction of the blade in tissue, per depth "
        "and speed [N s/m2]; default 0")  # fmt: skip
    add("--host", default="127.0.0.1", metavar="ADDRESS", help="address to listen on; default 127.0.0.1, this computer "
        "alone")  # fmt: skip
    for name, used in (("can", "the CAN bus"), ("sensor", "the force sensor"), ("page", "the sensor's page"),
                       ("control", "controlling the emulator")):  # fmt: skip
        add(f"--{name}-port", type=int, default=0, metavar="PORT", help=f"port of {used}; default a free one")
    add("--real-time", action="store_true", help="take priority over other processes, if the system allows")
    add("--write", type=Path, metavar="FILE", help="rig file to write, for 'cutenv rig run --rig FILE'")
    add("--with-parent", type=int, nargs="?", const=0, metavar="PID", help="end when the process PID ends; default "
        "the one that started this")  # fmt: skip
    return parser
