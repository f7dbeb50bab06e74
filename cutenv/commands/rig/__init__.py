"""Commands for a real or emulated rig: ``cutenv rig COMMAND``, each loaded when it is asked for."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module

COMMANDS = {
    "emulate": "run an emulated rig: drive, tissue and force sensor on real wires",
    "init": "write the file of a new rig, to be filled in",
}
"""Name -> line of help; the module of that name here has ``main(argv)``."""


def main(argv: Sequence[str]) -> int:
    """Run the command named first in ``argv``; the exit status is that command's."""
    arguments = list(argv)
    name = _parser().parse_args(arguments[:1]).command
    status: int | None = import_module(f"{__name__}.{name}").main(arguments[1:])
    return status or 0


def _parser() -> argparse.ArgumentParser:
    listed = "\n".join(f"  {name:<10} {summary}" for name, summary in COMMANDS.items())
    parser = argparse.ArgumentParser(
        prog="cutenv rig",
        description="A real or emulated rig: set it up, check it, run it.",
        epilog=f"commands:\n{listed}\n\n'cutenv rig COMMAND --help' tells its options.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="cutenv rig [-h] COMMAND ...",
    )
    parser.add_argument("command", choices=COMMANDS, metavar="COMMAND", help="one of those listed below")
    return parser
