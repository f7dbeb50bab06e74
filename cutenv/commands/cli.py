"""The command line.

One sub-command for each use of cutenv, its module imported only when it is called.

A sub-command's module has ``main(argv)`` with its own parser: the help stands where the options are used,
and ``cutenv --help`` answers at once.
"""

from __future__ import annotations

import argparse
import difflib
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module

import cutenv
from cutenv._base.imports import missing_extra
from cutenv._base.output import reader_has_gone
from cutenv._base.resources import described_version


@dataclass(frozen=True)
class Command:
    """Command, run by ``main(argv)`` of the module named after it.

    With parts it has sub-commands instead.
    """

    summary: str  # a line of help
    extra: str = ""  # the extra that brings what the command needs beyond the package, or beyond its group's extra
    parts: Mapping[str, Command] = field(default_factory=dict)  # sub-commands
    description: str | None = None  # first line of the help of a command with sub-commands
    uses: tuple[str, ...] = ()  # the commonest uses of a command with sub-commands, with which its help begins


INTERRUPTED = 130  # exit status after Ctrl-C: 128 and the number of the signal, as shells have it

# exit status when the program that reads the output has ended, as ``head`` does: 128 and the number of SIGPIPE
READER_GONE = 141

RIG_COMMANDS = {
    "check": Command("check a rig's connections, limits and noise without moving it"),
    "conform": Command("try a driver against what its protocol promises"),
    "drivers": Command("list the drivers that a rig's file can name, and what each takes"),
    "emulate": Command("run an emulated rig: drive, tissue and force sensor on real wires"),
    "evaluate": Command("compare a policy on a rig with the simulator, or with another", extra="view"),
    "identify": Command("measure a rig's constants with the blade in air"),
    "init": Command("write the file of a new rig for you to fill in"),
    "jog": Command("move the blade while a key is held"),
    "plan": Command("say how many livers a comparison of two policies will need"),
    "run": Command("cut with a policy from simulation, unchanged"),
    "speed": Command("draw desired and actual speed of a cut at constant speed", extra="view"),
    "weigh": Command("calibrate the force sensor by known weights"),
    "zero": Command("set the zero of a stepper, with the blade at the clamp"),
}
"""Sub-commands of ``cutenv rig``."""

COMMANDS = {
    "demo": Command("watch a trained agent cut beside the best script, in half a minute", extra="view"),
    "docs": Command("open the documentation in a browser, without a network"),
    "warm": Command("compile everything ahead of the first cut: for images, clusters and classrooms"),
    "train": Command("train an agent and report how well it cuts", extra="rl"),
    "evaluate": Command("compare policies on the same held-out specimens"),
    "submit": Command("enter a policy on the leaderboard, or check an entry"),
    "datasets": Command("record cuts as a data set of Minari or LeRobot, force included", extra="data"),
    "record": Command("record a force stream of the Lab Streaming Layer as a cut", extra="streams"),
    "look": Command("show any lab's file as it is understood, before a score"),
    "convert": Command("convert records: CSV, Parquet, HDF5, and bags of ROS without ROS"),
    "calibrate": Command("fit a tissue to your own records of cuts"),
    "depth": Command("measure the depth of cut from video of a marked blade", extra="vision"),
    "field": Command("compare beads in the tissue with the model; modulus by force and by image", extra="vision"),
    "play": Command("cut by mouse or gamepad in a window", extra="play"),
    "single-page": Command("write a page that cuts in a browser, nothing installed", extra="view"),
    "serve": Command("serve a class that cuts in browsers, with codes, courses and records", extra="serve"),
    "rig": Command(
        "run a real rig, a motor and a force sensor, or its emulator",
        extra="rig",
        parts=RIG_COMMANDS,
        description="A motor and a force sensor that a policy meets as it meets the simulator.",
        uses=("cutenv rig run --policy ppo-free --rig emulator", "cutenv rig init my_rig.toml"),
    ),
    "score": Command("score recorded cuts: a card and a page"),
    "check": Command("name what is wrong with records of force, each with where it is and its cure"),
    "study": Command("study several people: reliability of the metrics, groups, learning", extra="view"),
    "pass-mark": Command("find a pass mark, how often it errs, and whether raters agree with the score", extra="view"),
    "view": Command("show a recorded cut in 3-D, in a page that opens from disk", extra="view3d"),
}

PROGRAM = Command(
    "",
    parts=COMMANDS,
    description=cutenv.__doc__.partition("\n")[0] if cutenv.__doc__ else None,
    uses=("cutenv demo", "cutenv train --quick"),
)
"""The command ``cutenv`` itself."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the sub-command named first in ``argv``.

    ``argv`` is without the program's name. Return the exit status: 0 if all went well.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    chosen = _chosen("cutenv", PROGRAM, arguments)
    if chosen is None:
        return 0
    name = arguments[0]
    try:
        try:
            return _run(f"cutenv {name}", chosen, arguments[1:])
        finally:
            sys.stdout.flush()  # here, because when the interpreter ends it is too late to catch the error
    except BrokenPipeError:
        if not reader_has_gone():
            raise
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())  # for what is still to be written to it
        os.close(nowhere)
        return READER_GONE
    except (KeyboardInterrupt, ImportError) as error:
        if was_interrupted(error):
            print(f"\ncutenv {name}: interrupted; files written before are kept", file=sys.stderr)
            return INTERRUPTED
        cure = missing_extra(error, COMMANDS[name].extra) if isinstance(error, ModuleNotFoundError) else None
        if cure is None:
            raise
        print(f"cutenv {name}: {cure}", file=sys.stderr)
        return 1


def was_interrupted(error: BaseException | None) -> bool:
    """Return whether an error is or comes from a KeyboardInterrupt.

    Interrupted while it is imported, a module in C++ (pybind11) raises an ImportError from the KeyboardInterrupt.
    """
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def module_of(name: str) -> str:
    """Return a command's module, such as of "cutenv rig run"."""
    return name.replace("cutenv", "cutenv.commands", 1).replace(" ", ".").replace("-", "_")


def _chosen(name: str, command: Command, argv: list[str]) -> Command | None:
    """Return the sub-command named first, else print the help."""
    parser = _GroupParser(name, command)
    if not argv:
        parser.print_help()
        return None
    if not argv[0].startswith("-") and argv[0] not in command.parts:
        nearest = difflib.get_close_matches(argv[0].lower(), command.parts, n=1)
        hint = f" Did you mean {nearest[0]!r}?" if nearest else ""
        parser.error(f"there is no command {argv[0]!r}.{hint} '{name} --help' lists all.")
    return command.parts[parser.parse_args(argv[:1]).command]


def _run(name: str, command: Command, argv: list[str]) -> int:
    if command.parts:
        chosen = _chosen(name, command, argv)
        return 0 if chosen is None else _run(f"{name} {argv[0]}", chosen, argv[1:])
    status: int | None = import_module(module_of(name)).main(argv)
    return status or 0


class _Version(argparse.Action):
    """Option that prints the version, which it asks of git."""

    def __call__(self, parser: argparse.ArgumentParser, *given: object) -> None:
        print(f"cutenv {described_version(cutenv.__version__)}")
        parser.exit()


class _GroupParser(argparse.ArgumentParser):
    """Parser of a command with sub-commands, listed in its help."""

    def __init__(self, name: str, command: Command) -> None:
        super().__init__(prog=name, usage=f"{name} [-h] {'[--version] ' * (command is PROGRAM)}COMMAND ...")
        self._command = command
        if command is PROGRAM:
            self.add_argument("--version", action=_Version, nargs=0)
        self.add_argument("command", choices=command.parts, metavar="COMMAND")

    def format_help(self) -> str:
        """Return the whole help."""
        uses = "".join(f"{use}\n" for use in self._command.uses)
        width = max(map(len, self._command.parts))
        listed = "".join(f"  {part:{width}}  {about.summary}\n" for part, about in self._command.parts.items())
        about = f"{uses}\n{self.format_usage()}\n{self._command.description}\n\ncommands:\n{listed}"
        return f"{about}'{self.prog} COMMAND -h' lists its options.\n"
