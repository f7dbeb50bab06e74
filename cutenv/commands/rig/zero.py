"""Set the zero of a stepper, with the blade at the clamp.

The blade is put there by hand. A stepper knows no position when its board gets power. The motor has no power meanwhile:
turn the screw until the blade's edge is at the clamp, where every cut begins.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from cutenv.commands.options import RIG, command_parser
from cutenv.commands.rig import reports_rig_errors
from cutenv.commands.rig.connection import connected
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import operator_of

_QUESTION = (
    "The motor has no power. Turn the screw by hand until the blade's edge stands at the clamp, 0 mm. Is it there, and "
    "are your hands away?"
)


@reports_rig_errors("zero")
def main(argv: Sequence[str]) -> int:
    """Set the zero; return 0, 1 (refused), 2 (bad file), 130 (Ctrl-C)."""
    arguments = _parser().parse_args(argv)
    with connected(arguments.rig) as rig:
        if not operator_of(rig.settings).confirm(_QUESTION, expected=rig.settings.name):
            raise RigError("the operator has not confirmed: the zero is as it was.")
        rig.plant.spine.set_zero()
    print("zero set: the blade stands at 0 mm. It is lost when the board loses its power")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("rig zero", __doc__, examples=("my_rig.toml", "serial"))
    parser.option("rig RIG", RIG)
    return parser
