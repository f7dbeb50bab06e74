"""The command line: one sub-command for each use of cutenv, its module imported only when it is called.

A sub-command's module has ``main(argv)`` with its own parser: the help stands where the options are used,
and ``cutenv --help`` answers at once.
"""

from __future__ import annotations

import argparse
import os
import select
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module

import cutenv

_EXTRAS_OF_MODULE = {
    "can": ("rig",),
    "canopen": ("rig",),
    "h5py": ("data",),
    "jinja2": ("view", "rl", "view3d"),
    "matplotlib": ("view", "rl"),
    "meshcat": ("view3d",),
    "minari": ("data",),
    "pyarrow": ("data",),
    "pygame": ("view",),
    "pymunk": ("play",),
    "rich": ("rl",),
    "safetensors": ("view", "data", "play", "rig", "rl"),
    "sb3_contrib": ("rl",),
    "serial": ("rig",),
    "stable_baselines3": ("rl",),
    "tomlkit": ("rig",),
    "torch": ("rl",),
    "tqdm": ("view", "data", "rl"),
    "umsgpack": ("view3d",),
}
"""Extras that bring a module; the first is named unless the command has one of the others."""


@dataclass(frozen=True, kw_only=True)
class Command:
    """One sub-command: the module whose ``main(argv)`` runs it, and a line of help."""

    module: str
    summary: str
    extra: str = ""
    """The extra that brings all that the command needs, if there is one."""


INTERRUPTED = 130
"""Exit status after Ctrl-C: 128 and the number of the signal, as shells have it."""

READER_GONE = 141
"""Exit status when the program that reads the output has ended, as ``head`` does: 128 and the number of SIGPIPE."""

COMMANDS = {
    "demo": Command(
        module="cutenv.commands.demo", summary="watch a trained agent cut beside the best script, in half a minute"
    ),
    "docs": Command(module="cutenv.commands.docs", summary="open the documentation in a browser, without a network"),
    "train": Command(module="cutenv.commands.train", summary="train an agent and report how well it cuts", extra="rl"),
    "evaluate": Command(
        module="cutenv.commands.evaluate", summary="compare policies on the same held-out specimens", extra="rl"
    ),
    "datasets": Command(
        module="cutenv.commands.datasets", summary="record cuts as a Minari data set, force included", extra="data"
    ),
    "calibrate": Command(module="cutenv.commands.calibrate", summary="fit a tissue to your own records of cuts"),
    "play": Command(module="cutenv.commands.play", summary="cut by mouse or gamepad in a window"),
    "rig": Command(module="cutenv.commands.rig", summary="run a real rig, a motor and a force sensor, or its emulator"),
    "score": Command(module="cutenv.commands.score", summary="score recorded cuts: a card and a page"),
    "study": Command(
        module="cutenv.commands.study", summary="study several people: reliability of the metrics, groups, learning"
    ),
    "view": Command(
        module="cutenv.commands.view", summary="show a recorded cut in 3-D, in a page that opens from disk"
    ),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the sub-command named first in ``argv``.

    Parameters
    ----------
    argv : sequence of str, optional
        Without the program's name; those of the process by default.

    Returns
    -------
    int
        The exit status: 0 if all went well.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    parser = _parser()
    if not arguments:
        parser.print_help()
        return 0
    name, rest = parser.parse_args(arguments[:1]).command, arguments[1:]
    try:
        try:
            return _run(COMMANDS[name], rest)
        finally:
            sys.stdout.flush()  # here, because when the interpreter ends it is too late to catch the error
    except BrokenPipeError:
        if not _reader_has_gone():
            raise
        return READER_GONE
    except KeyboardInterrupt:
        print(f"\ncutenv {name}: interrupted; files written before are kept", file=sys.stderr)
        return INTERRUPTED
    except ModuleNotFoundError as error:
        cure = missing_extra(error, COMMANDS[name].extra)
        if cure is None:
            raise
        print(f"cutenv {name}: {cure}", file=sys.stderr)
        return 1


def missing_extra(error: ModuleNotFoundError, preferred: str = "") -> str | None:
    """Return the pip command that brings the missing module, or None if it belongs to no extra.

    ``preferred`` is the extra that is named if it is one of several that bring the module.
    """
    package = (error.name or "").partition(".")[0]
    extras = _EXTRAS_OF_MODULE.get(package)
    if extras is None:
        return None
    extra = preferred if preferred in extras else extras[0]
    return f"{package} is not installed: pip install 'cutenv[{extra}]'"


def _reader_has_gone() -> bool:
    """Return True if standard output is a closed pipe; if so, drop what is still to be written to it."""
    if not hasattr(select, "poll"):  # Windows, where such a pipe raises another error
        return False
    watched = select.poll()
    watched.register(sys.stdout.fileno(), 0)
    if not watched.poll(0):
        return False
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
    return True


def _run(command: Command, argv: list[str]) -> int:
    status: int | None = import_module(command.module).main(argv)
    return status or 0


def _parser() -> argparse.ArgumentParser:
    listed = "\n".join(f"  {name:<10} {command.summary}" for name, command in COMMANDS.items())
    parser = argparse.ArgumentParser(
        prog="cutenv",
        description=cutenv.__doc__.partition("\n")[0] if cutenv.__doc__ else None,
        epilog=f"commands:\n{listed}\n\n'cutenv COMMAND --help' lists its options.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="cutenv [-h] [--version] COMMAND ...",
    )
    parser.add_argument("--version", action="version", version=f"cutenv {cutenv.__version__}")
    parser.add_argument("command", choices=COMMANDS, metavar="COMMAND", help="one of those listed below")
    return parser
