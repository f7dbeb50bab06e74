"""Measure a rig's constants in air: lag, dead time, acceleration, backlash, friction, sensor.

The carriage makes steps, sines and slow reversals, for about two minutes within some centimetres. The simulator then
uses the values in the file: gymnasium.make("cutenv/GentleCut-v1", rig="RIG.toml").
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import date
from pathlib import Path

from cutenv._base.output import check_writable
from cutenv.agents.sim_to_real.identification import Identification, Plan, identification_from, perform
from cutenv.commands.options import RIG, command_parser, made_picture
from cutenv.commands.rig import reports_rig_errors
from cutenv.commands.rig.connection import connected
from cutenv.drivers.rig_names import settings_of
from cutenv.rig.config.settings import RIG_NAMES, RigSettings
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import operator_of
from cutenv.rig.operation.preflight import prepare
from cutenv.rig.safety.stop_causes import RigStopped
from cutenv.rig.toml_file import write_identified

_SELDOM = 0.05  # [s] between positions, above which no step of some tenths of a second is seen to begin


@reports_rig_errors("identify")
def main(argv: Sequence[str]) -> int:
    """Identify; return 0, 1 (refused, stopped), 2 (bad input), 130 (Ctrl-C)."""
    arguments = _parser().parse_args(argv)
    if arguments.write and arguments.rig in RIG_NAMES:
        raise ValueError(f'--write needs a rig\'s file, and "{arguments.rig}" has none.')
    if (period := settings_of(arguments.rig).bus.sync) > _SELDOM:
        raise ValueError(
            f"{arguments.rig} tells its position every {1e3 * period:g} ms, too seldom to see how it starts: "
            f"{1e3 * _SELDOM:g} ms or less are needed. Write a motor_lag_ms that you know into [identified]."
        )
    if arguments.write:
        check_writable("--write", Path(arguments.rig).absolute().parent)
    if arguments.picture is not None:
        made_picture("--picture", arguments.picture)
    with connected(arguments.rig) as rig:
        settings = rig.settings
        operator = operator_of(settings)
        prepare(rig.plant, operator, today=date.today())
        plan = Plan.within(settings, rig.plant.position)
        if not operator.confirm(_question(plan)):
            raise RigError("the operator has not confirmed: nothing was measured.")

        def again(stop: RigStopped) -> None:
            question = f"The blade was stopped ({stop.report.detail}). May the stop be reset, and is all as it was?"
            rig.plant.supervisor.reset(agreed=operator.confirm(question))
            prepare(rig.plant, operator, today=date.today())

        recorded = perform(rig.plant, plan, tell=print, again=again)
        rig.plant.halt()
    _report(identification_from(settings, plan, recorded), settings, arguments)
    return 0


def _question(plan: Plan) -> str:
    low, high = plan.path
    return (
        f"The blade will move between {1e3 * low:.0f} and {1e3 * high:.0f} mm, at up to"
        f" {1e3 * max(plan.speeds):.0f} mm/s, for about {plan.duration:.0f} s. Is it in air all the way, with no"
        " specimen clamped?"
    )


def _report(found: Identification, settings: RigSettings, arguments: argparse.Namespace) -> None:
    print("\n".join(["", *found.table(settings.identified), "", "the fitted model beside sines:", *found.sine_table()]))
    if arguments.write:
        write_identified(arguments.rig, found.identified(settings.identified, date.today()))
        print(f'rig: {arguments.rig}\n  gymnasium.make("cutenv/GentleCut-v1", rig="{arguments.rig}") simulates it')
    if arguments.picture is not None:
        from cutenv.display.report.axis_figures import draw_identification

        draw_identification(
            arguments.picture, found.drawn_steps(), found.drawn_sines(), title=f"{settings.name}, {date.today()}"
        )
        print(f"picture: {arguments.picture}")


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("rig identify", __doc__, examples=("emulator", "my_rig.toml --write --picture answers.png"))
    add = parser.option
    add("rig RIG", RIG)
    add("--write", "write the constants found into the file's [identified]")
    add("--picture FILE.png", "picture of the measured answers over the fitted model", Path)
    return parser
