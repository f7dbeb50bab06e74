"""Draw desired and actual speed of a cut, as the thesis's Figure 3.2.

A simulated cut, a cut on an emulated or fake rig, or the record of a cut: of your own rig, one of 'cutenv rig run'.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cutenv._base.validation import in_range
from cutenv.commands import options
from cutenv.commands.inputs import chosen_cut, read_records
from cutenv.rig.config.settings import EMULATOR, FAKE
from cutenv.rig.errors import RigError
from cutenv.sim.cutting.drive import DRIVES

if TYPE_CHECKING:
    from cutenv.sim.trace import Trace

_SIMULATOR = "simulator"
_MADE = (_SIMULATOR, EMULATOR, FAKE)
_LENGTH = 0.1  # [m] of the cut
_USUAL = 1.27  # [cm/s]


@options.reports_errors("rig speed", RigError)
def main(argv: Sequence[str]) -> int:
    """Draw speeds; return 0, or 2 on bad input or rig."""
    arguments = _parser().parse_args(argv)
    (source,) = arguments.records
    made = str(source) in _MADE
    if not made and source.suffix == ".toml":
        raise ValueError(
            f"{source}: a real rig is not moved by this command: 'cutenv rig run --rig {source} --out FOLDER', "
            "then give its record."
        )
    if arguments.speed_cm_s is None and not made:
        raise ValueError("--speed-cm-s: a record does not hold the desired speed; give the one that was commanded.")
    speed = in_range("--speed-cm-s", arguments.speed_cm_s or _USUAL, 0.05, 3.81, "cm/s", "The rig reaches 3.81.") / 100
    given = dict(_gain(text) for text in arguments.gain)
    if arguments.picture is not None:
        options.made_picture("--picture", arguments.picture)
    trace = _cut(str(source), speed, given, arguments) if made else chosen_cut(read_records(arguments), arguments.cut)
    from cutenv.records.measurement import speed_tracking

    found = speed_tracking(trace, speed)
    print("\n".join(found.lines))
    if arguments.picture is not None:
        from cutenv.display.report.axis_figures import draw_speed

        name = trace.metadata.get("name", source)
        kind = f", {_DRIVEN[arguments.drive]}" if made else ""
        draw_speed(arguments.picture, found, title=f"Desired and actual speed of the blade: {name}{kind}")
        print(f"picture: {arguments.picture}")
    return 0


_DRIVEN = {"rig": "velocity loop", "pd": "PD control of position", "hand": "a hand"}


def _gain(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise ValueError(f"--set {text!r} is no NAME=NUMBER, such as proportional_gain=75e3 (SI).") from None


def _cut(source: str, speed: float, given: dict[str, float], arguments: argparse.Namespace) -> Trace:
    """Cut at constant speed without hardware; return the record."""
    if source == _SIMULATOR:
        return _simulated(speed, given, arguments)
    in_range("--speed-cm-s", 100.0 * speed, 0.05, 2.54, "cm/s", "Commands of a task reach 2.54; the simulator goes on.")
    if arguments.drive == "hand":
        raise ValueError(f'--drive hand is of the simulator; rig "{source}" has a motor.')
    import numpy as np

    from cutenv.agents.policy import ConstantFeed
    from cutenv.envs.rig_cut import RigCutEnv
    from cutenv.records import load_one

    with tempfile.TemporaryDirectory() as folder:
        keywords: dict[str, Any] = {"drive": arguments.drive, "specimen_class": arguments.specimen_class, **given}
        env = RigCutEnv(rig=source, records=folder, target_length=_LENGTH, **keywords)
        try:
            policy = ConstantFeed(speed=speed)
            observation, _ = env.reset(seed=arguments.seed)
            policy.reset(np.random.default_rng(0))
            ended = False
            while not ended:
                observation, _, ended, _, _ = env.step(policy(observation))
        finally:
            env.close()
        (record,) = env.records
        return load_one(record).with_metadata({"name": f"{source} rig"})


def _simulated(speed: float, given: dict[str, float], arguments: argparse.Namespace) -> Trace:
    import numpy as np

    from cutenv.envs.constants import Constants
    from cutenv.sim.plant import SimulatedPlant, to_trace
    from cutenv.sim.tissue import Specimen

    constants = Constants.from_keywords(given, drive=arguments.drive)
    specimen = Specimen.drawn(arguments.seed, 0, specimen_class=arguments.specimen_class)
    plant = SimulatedPlant(
        specimen, drive=constants.drive, sensor=constants.sensor, law=constants.law, seed=arguments.seed
    )
    upright = float(np.pi / 2)
    rest = plant.advance(0.0, upright, 200).copy()
    cut = plant.advance(speed, upright, round(1000 * _LENGTH / speed)).copy()
    end = plant.advance(0.0, upright, 500).copy()
    return to_trace(plant, np.concatenate([rest, cut, end]), name="simulator")


def _parser() -> argparse.ArgumentParser:
    parser = options.command_parser(
        "rig speed",
        __doc__,
        examples=(
            "simulator --drive pd --picture speed.png",
            "emulator --drive pd --set proportional_gain=250e3 --set derivative_gain=14e3 --picture speed.png",
            "cut.csv --speed-cm-s 1.27 --picture speed.png",
        ),
    )
    add = parser.option
    options.add_record_options(
        parser, files=1, metavar="SOURCE", about='"simulator", "emulator", "fake", or a record of a cut'
    )
    options.add_cut(parser)
    add("--speed-cm-s SPEED", f"desired speed [cm/s]; default {_USUAL:g}, of a record none", float)
    add(
        "--drive",
        "drive of the simulator or rig: rig (velocity loop), pd (PD control of position), hand; default rig",
        "rig",
        choices=tuple(DRIVES),
    )
    add(
        "--set NAME=NUMBER",
        "constant of drive, sensor or law by its name in the table of constants, SI; may be given again",
        dest="gain",
        action="append",
        default=[],
    )
    options.add_specimen_class(parser, "liver")
    add("--seed N", "seed of the specimen; default 0", 0)
    add("--picture FILE.png", "picture to draw", Path)
    return parser
