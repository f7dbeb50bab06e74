"""Sub-commands of ``cutenv rig``: a module with ``main(argv)`` for each, loaded when it is asked for."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module


@dataclass(frozen=True, kw_only=True)
class RigCommand:
    """Sub-command: the module whose ``main(argv)`` runs it, and a line of help."""

    module: str
    summary: str


RIG_COMMANDS = {
    "check": RigCommand(
        module="cutenv.commands.rig.check", summary="check a rig's connections, limits and noise without moving it"
    ),
    "emulate": RigCommand(
        module="cutenv.commands.rig.emulate",
        summary="run an emulated rig: drive, tissue and force sensor on real wires",
    ),
    "evaluate": RigCommand(
        module="cutenv.commands.rig.evaluate", summary="compare a policy on a rig with the simulator"
    ),
    "identify": RigCommand(
        module="cutenv.commands.rig.identify", summary="measure a rig's constants with the blade in air"
    ),
    "init": RigCommand(module="cutenv.commands.rig.init", summary="write the file of a new rig for you to fill in"),
    "jog": RigCommand(module="cutenv.commands.rig.jog", summary="move the blade while a key is held"),
    "run": RigCommand(module="cutenv.commands.rig.run", summary="cut with a policy from simulation, unchanged"),
}


def main(argv: Sequence[str]) -> int:
    """Run the sub-command named first in ``argv``; return its exit status."""
    arguments = list(argv)
    parser = _parser()
    if not arguments:
        parser.print_help()
        return 0
    name = parser.parse_args(arguments[:1]).command
    status: int | None = import_module(RIG_COMMANDS[name].module).main(arguments[1:])
    return status or 0


def _parser() -> argparse.ArgumentParser:
    listed = "\n".join(f"  {name:<10} {command.summary}" for name, command in RIG_COMMANDS.items())
    parser = argparse.ArgumentParser(
        prog="cutenv rig",
        description="A motor and a force sensor that a policy meets through the simulator's interface.",
        epilog=f"commands:\n{listed}\n\n'cutenv rig COMMAND --help' lists its options.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="cutenv rig [-h] COMMAND ...",
    )
    parser.add_argument("command", choices=RIG_COMMANDS, metavar="COMMAND", help="one of those listed below")
    return parser
