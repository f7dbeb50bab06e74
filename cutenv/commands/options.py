"""Options shared by several sub-commands, under one name each.

They are loaded for ``--help``, so nothing heavy is imported.
"""

from __future__ import annotations

import argparse
import functools
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

from cutenv._base.language_files import ENGLISH, languages, missing_texts
from cutenv._base.output import check_writable, reader_has_gone

if TYPE_CHECKING:  # slow to import, and --help does not need it
    from cutenv.records.measurement import DepthProfile
    from cutenv.records.scoring.study.sequential import SequentialQuestion
    from cutenv.sim.tissue.lines import CutLine

Main = Callable[[Sequence[str]], int]  # entry point of a command: takes its arguments, returns the exit status

LIVE_PORT = 8801  # default port at which a rig's readings can be watched, on its own machine alone
RIG = 'a rig\'s TOML file, "emulator", "serial" or "grbl" (emulated slow rigs) or "fake"'
"""Help of every argument that names a rig."""


def add_option(to: argparse._ActionsContainer, name: str, about: str, kind: Any = str, **more: Any) -> None:
    """Add an option ``--name PLACEHOLDER``, a flag ``--name``, or an argument ``name PLACEHOLDER``, with its help.

    ``kind`` is the type of the value, or the default, which has that type; ``more`` is argparse's.
    """
    name, _, shown = name.partition(" ")
    if not (shown or more or kind is not str):
        to.add_argument(name, action="store_true", help=about)
        return
    if not callable(kind):
        more["default"], kind = kind, Path if isinstance(kind, Path) else type(kind)
    to.add_argument(name, type=kind, metavar=shown or None, help=about, **more)


SCREEN = (24, 80)  # lines and columns of the smallest usual terminal, which ``-h`` fits


class CommandParser(argparse.ArgumentParser):
    """Parser of a sub-command, with ``-h`` for a screen, ``--help`` for all.

    Both begin with common uses. ``common`` are typed whole; ``**keywords`` are those of ``argparse.ArgumentParser``.
    """

    def __init__(self, *, common: Sequence[str] = (), **keywords: Any) -> None:
        super().__init__(**keywords, add_help=False)
        self._common = common
        self.add_argument(
            "-h", action=_Screen, nargs=0, dest="help", default=argparse.SUPPRESS, help="show the options"
        )
        self.add_argument("--help", action="help", default=argparse.SUPPRESS, help="explain every option")

    option = add_option

    def format_help(self) -> str:
        """Return the whole help."""
        return "".join(f"{use}\n" for use in self._common) + "\n" * bool(self._common) + super().format_help()

    def error(self, message: str) -> NoReturn:
        """Print one line with similar options; exit with status 2."""
        from cutenv._base.validation import nearest_choices

        given = message.removeprefix("unrecognized arguments: ").split()
        unknown = next((word for word in given if word.startswith("--")), "") if message.startswith("unrec") else ""
        known = [option for action in self._actions for option in action.option_strings]
        near = nearest_choices(unknown.partition("=")[0], known, most=3) if unknown else ""
        self.exit(2, f"{self.prog}: {message.rstrip('.')}.{near} '{self.prog} -h' lists its options.\n")

    def format_screen(self) -> str:
        """Return the help, shortened if it exceeds a screen."""
        whole, (rows, columns) = self.format_help(), SCREEN
        lines = whole.splitlines()
        if len(lines) <= rows and max(map(len, lines)) <= columns:
            return whole
        first = textwrap.fill((self.description or "").partition("\n\n")[0], columns)
        uses = "".join(f"{_folded(use, columns)}\n" for use in self._common)
        given = [action for action in self._actions if not action.option_strings]
        after = "".join(f" {action.metavar or action.dest}" for action in given)
        options = [_named(action) for action in self._actions if action.option_strings]
        names = textwrap.fill(
            ", ".join(options), columns, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False
        )
        return (
            f"{uses}\n{first}\n\nusage: {self.prog} [OPTION ...]{after}\n\noptions:\n{names.replace(_JOINED, ' ')}\n\n"
            f"'{self.prog} --help' explains every option.\n"
        )


_JOINED = "\N{NO-BREAK SPACE}"  # where no line may end: between an option and its value, and in quotes


def _named(action: argparse.Action) -> str:
    """Return an option with its placeholder, required ones marked."""
    value = "" if action.nargs == 0 or action.choices or not isinstance(action.metavar, str) else action.metavar
    required = "(required)" if action.required else ""
    return _JOINED.join(filter(None, (action.option_strings[-1], value, required)))


def _folded(line: str, columns: int) -> str:
    """Return a long shell line folded by backslashes."""
    if len(line) <= columns:
        return line
    words = re.sub(r"\"[^\"]*\"|'[^']*'", lambda quoted: quoted[0].replace(" ", _JOINED), line)
    lines = textwrap.wrap(words, columns - 2, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
    return " \\\n".join(lines).replace(_JOINED, " ")


class _Screen(argparse.Action):
    """Prints what fits a screen."""

    def __call__(self, parser: argparse.ArgumentParser, *given: object) -> None:
        assert isinstance(parser, CommandParser)
        print(parser.format_screen(), end="")
        parser.exit()


def command_parser(
    name: str, description: str | None, *, examples: Sequence[str] = (), note: str = ""
) -> CommandParser:
    """Return the parser of ``cutenv NAME``.

    Its help begins with the first two examples, the commonest uses, and ends with all of them and a note; they are
    given without the name of the command.
    """
    uses = [f"cutenv {name} {example}".rstrip() for example in examples]
    listed = "".join(f"  {use}\n" for use in uses)
    parts = [f"examples:\n{listed}".rstrip()] * bool(examples) + [note] * bool(note)
    return CommandParser(
        common=uses[:2],
        prog=f"cutenv {name}",
        description=description,
        epilog="\n\n".join(parts),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,  # an option has one spelling
    )


def reports_errors(name: str, *also: type[Exception]) -> Callable[[Main], Main]:
    """Decorate ``main`` to report bad input on one line, exit status 2.

    That is OSError, ValueError, a keyword that no environment takes, and ``also``.  A missing module passes, because
    the command line names its extra, and so does the end of the program that reads the output.
    """
    bad: tuple[type[Exception], ...] = (OSError, ValueError, *also)
    looked_at: tuple[type[Exception], ...] = (*bad, TypeError)

    def decorated(main: Main) -> Main:
        @functools.wraps(main)
        def guarded(argv: Sequence[str]) -> int:
            try:
                return main(argv)
            except ModuleNotFoundError:
                raise
            except looked_at as error:
                if isinstance(error, BrokenPipeError) and reader_has_gone():
                    raise
                if not isinstance(error, bad) and not _is_unexpected_keyword(error):
                    raise
                print(f"cutenv {name}: {error}", file=sys.stderr)
                return 2

        return guarded

    return decorated


def _is_unexpected_keyword(error: Exception) -> bool:
    from cutenv._base.validation import UnexpectedKeyword

    return isinstance(error, UnexpectedKeyword)


def add_target_length(parser: argparse.ArgumentParser, default: str) -> None:
    """Add ``--target-length``, read by :func:`target_length`; ``default`` completes its help."""
    add_option(
        parser,
        "--target-length LENGTH",
        f"length of the cut from the clamp, with its unit: 80mm, 8cm, 3.15in; default {default}",
    )


def target_length(arguments: argparse.Namespace) -> float | None:
    """Return ``--target-length`` in metres, or None.

    Raise ValueError if it is not a length with a unit, or no specimen is so long.
    """
    return length_given(arguments, "target_length", (0.005, 0.15), "Write 80mm or 8cm.")


def length_given(arguments: argparse.Namespace, name: str, limits: tuple[float, float], cure: str) -> float | None:
    """Return the length [m] of an option, or None.

    Raise ValueError if it is not a length with a unit, or outside the limits [m]; the message ends with the ``cure``.
    """
    from cutenv._base.validation import in_range
    from cutenv.records.schema import parse_length

    text, option = getattr(arguments, name), "--" + name.replace("_", "-")
    return None if text is None else in_range(option, parse_length(option, text), *limits, "m", cure)


def add_depth_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--wanted-depth`` and ``--layer-depth``, for :func:`wanted_depth_given` and :func:`layer_depth_given`."""
    add_option(
        parser,
        "--wanted-depth DEPTH",
        "depth below the surface that the cut should have, with its unit: 8mm; or along the cut, linear between "
        "POSITION:DEPTH: 0mm:6mm,80mm:14mm; default the record's own",
    )
    add_layer_depth(parser, "the record's own")


def add_line(parser: argparse.ArgumentParser, of: str, default: str) -> None:
    """Add ``--line``, read by :func:`line_given`; ``of`` and ``default`` complete the help."""
    add_option(
        parser,
        "--line LINE",
        f"line to cut along, {of}: straight, arc:RADIUS, s:RADIUS, excision:LENGTH:HEIGHT (to the right: "
        "negative), with units (arc:40mm), or a CSV file of places with columns such as x_mm,y_mm; default "
        f"{default}",
    )


def check_line(line: str, tasks: Iterable[str]) -> None:
    """Raise ValueError for ``--line`` without a task along one."""
    from cutenv.task.registry import TASKS

    if not any(TASKS[name].line for name in tasks):
        along = " or ".join(name for name, task in TASKS.items() if task.line)
        raise ValueError(f"--line {line} is for cuts along a drawn line. Give --task {along} too.")


_LINES = "write straight, arc:40mm, s:40mm, excision:80mm:15mm, or a file"


def line_given(arguments: argparse.Namespace) -> CutLine | None:
    """Return ``--line``, None if it is not given.

    Raise ValueError if it is no line, leaves the slab, turns back or bends too far; OSError if the file cannot be read.
    """
    from cutenv.records.line_file import read_line
    from cutenv.records.schema import parse_length
    from cutenv.sim.tissue.lines import arc, half_ellipse, s_shape, straight

    given: str | None = arguments.line
    if given is None:
        return None
    kind, *sizes = given.split(":")
    kinds: dict[str, tuple[Callable[..., CutLine], int]] = {
        "straight": (straight, 0), "arc": (arc, 1), "s": (s_shape, 1), "excision": (half_ellipse, 2),
    }  # fmt: skip
    if kind not in kinds:
        if not Path(given).exists():
            raise ValueError(f"--line {given}: no such file; {_LINES}.")
        return read_line(Path(given))
    made, count = kinds[kind]
    if len(sizes) != count:
        raise ValueError(f"--line {given}: {_LINES}.")
    return made(*(parse_length("--line", size) for size in sizes))


def add_layer_depth(parser: argparse.ArgumentParser, default: str) -> None:
    """Add ``--layer-depth``, read by :func:`layer_depth_given`; ``default`` completes its help."""
    add_option(
        parser,
        "--layer-depth DEPTH",
        f"depth below the surface at which another layer begins, with its unit: 12mm; default {default}",
    )


def wanted_depth_given(arguments: argparse.Namespace) -> DepthProfile | None:
    """Return ``--wanted-depth``, None if it is not given.

    Raise ValueError if it is neither a length with a unit nor pairs of them, or out of range.
    """
    from cutenv.records.measurement.depth import wanted_depth
    from cutenv.records.schema import parse_length

    given: str | None = arguments.wanted_depth
    if given is None:
        return None
    option, points = "--wanted-depth", []
    for part in given.split(","):
        position, colon, depth = part.partition(":")
        if not colon and given != part:
            raise ValueError(f"{option} {given}: {part!r} is no POSITION:DEPTH. Write 8mm, or 0mm:6mm,80mm:14mm.")
        points.append([parse_length(option, position) if colon else 0.0, parse_length(option, depth or position)])
    return wanted_depth(points, name=option)


def layer_depth_given(arguments: argparse.Namespace) -> float | None:
    """Return ``--layer-depth`` in metres, or None.

    Raise ValueError if it is not a length with a unit, or out of range.
    """
    return length_given(arguments, "layer_depth", (0.0005, 0.1), "Write 12mm.")


def add_specimen_class(parser: argparse.ArgumentParser, default: str) -> None:
    """Add ``--specimen-class``."""
    from cutenv.sim.tissue.specimen import CLASSES

    add_option(parser, "--specimen-class", f"class of drawn specimens; default {default}", default, choices=CLASSES)


def add_tissue(parser: argparse.ArgumentParser) -> None:
    """Add ``--tissue``; see :func:`drawn_given`."""
    add_option(
        parser,
        "--tissue FILE",
        "a tissue of your own, from 'cutenv calibrate', of which the specimens are drawn; default pig liver",
    )


def drawn_given(arguments: argparse.Namespace) -> dict[str, str]:
    """Return environment keyword arguments for ``--specimen-class`` and ``--tissue``.

    Raise FileNotFoundError, ValueError if the file is missing, or no tissue.
    """
    from cutenv.agents.learning.option_fields import drawn_as
    from cutenv.envs.tissue_source import TissueSource

    TissueSource(arguments.tissue)  # refuses another file before anything is cut
    return drawn_as(vars(arguments))


def add_task(parser: argparse.ArgumentParser, part: str, more: str = "", *, several: bool = False) -> None:
    """Add ``--task`` for tasks with a part in the registry. The help ends with ``more``."""
    from cutenv.task.registry import tasks_in_words, tasks_with

    names = tasks_with(part)
    action, default = ("append", None) if several else ("store", names[0])
    about = f"{tasks_in_words(names)}{more}; default {names[0]}"
    add_option(parser, "--task", about, choices=names, action=action, default=default)


def add_watch(parser: argparse.ArgumentParser, about: str) -> None:
    """Add ``--watch``, the port of live readings."""
    add_option(parser, "--watch PORT", f"{about}; default port {LIVE_PORT}", _port, nargs="?", const=LIVE_PORT)


def add_lsl(parser: argparse.ArgumentParser) -> None:
    """Add ``--lsl``, the visibility of Lab Streaming Layer streams."""
    add_option(
        parser,
        "--lsl",
        "stream force, position, depth and markers by the Lab Streaming Layer while a cut goes on, to be found on "
        "this machine (the default), its network (link) or its site; off unless asked",
        choices=("machine", "link", "site"),
        nargs="?",
        const="machine",
    )


def _port(text: str) -> int:
    if not text.isdecimal() or not int(text) <= 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is no port. Give a whole number up to 65535, such as 8801.")
    return int(text)


def add_record_options(
    parser: argparse.ArgumentParser,
    *,
    files: int | Literal["+", "*"] = "+",
    metavar: str = "FILE",
    about: str = "records of cuts, or folders of them: CSV, Parquet or HDF5, one cut or several in a file",
    option: str | None = None,
) -> None:
    """Add the options of every sub-command that reads records.

    ``files`` is argparse's ``nargs``. The records are arguments, or follow an ``option`` such as ``--record``.
    """
    if option is None:
        parser.add_argument("records", nargs=files, type=Path, metavar=metavar, help=about)
    else:
        parser.add_argument(option, dest="records", nargs=files, type=Path, metavar=metavar, help=about, required=True)
    add_option(
        parser,
        "--specimen PATTERN",
        "regular expression for the file's path; what it matches (its first group) names the specimen, where "
        "the record does not",
    )
    add_option(parser, "--verbose", "print how each file was read")
    add_option(parser, "--skip-bad", "leave bad records out, with a note, and go on")
    foreign = parser.add_argument_group("files of other programs")
    add_option(
        foreign,
        "--map FIELD=COLUMN",
        "which column is what: time=t force=Fx, force=norm(Fx,Fy,Fz), position=x[mm], angle=90deg, depth=20mm, "
        "rate=1000Hz, split_by=trial,cut; kept beside the files as cutenv-columns.json for the next time",
        nargs="+",
    )
    add_option(foreign, "--unit UNIT", "unit of the force: N, mN, kN, gf, kgf, lbf, or 1 if it is normalised")
    add_option(
        foreign, "--confirm FOLDER", "draw every record into this folder: offset taken off, cuts and flaws found", Path
    )


def add_question(parser: argparse.ArgumentParser, *, unit: str, smallest: str, most: int, always: bool = False) -> None:
    """Add ``--until decided`` and its options, read by :func:`question_given`.

    A difference is in ``unit``. A command that ``always`` stops when it is decided has no ``--until``.
    """
    asked = parser.add_argument_group("stop when it is decided")
    if not always:
        add_option(
            asked,
            "--until",
            f"look after every {unit}, and stop when it is decided: better, worse, or equivalent within --smallest",
            choices=("decided",),
        )
    add_option(asked, "--error P", "largest probability of a wrong decision; default 0.05", 0.05)
    add_option(asked, "--smallest DIFFERENCE", f"smallest that matters; default {smallest}", float)
    add_option(asked, "--most N", f"end undecided after so many; default {most}", int, default=most)


def question_given(arguments: argparse.Namespace, *, smallest: float, reach: float = 1.0) -> SequentialQuestion:
    """Return what the options of :func:`add_question` ask; raise ValueError if a number is out of range."""
    from cutenv.records.scoring.study.sequential import SequentialQuestion

    given = smallest if arguments.smallest is None else arguments.smallest
    return SequentialQuestion(error=arguments.error, smallest=given, most=arguments.most, reach=reach)


def add_study_options(parser: argparse.ArgumentParser, *, columns: str) -> None:
    """Add options of studies; ``columns`` names the table's last."""
    add_record_options(
        parser, metavar="FOLDER", about="folder of records (CSV, Parquet or HDF5), or the records themselves"
    )
    add_option(
        parser,
        "--operators TABLE.csv",
        f"table with columns record, operator (an anonymous code, P07), and where known {columns}; default the "
        "operators and dates in the records: an operator's days are the sessions",
        Path,
    )
    add_option(
        parser,
        "--reference SET",
        "cuts that the overall score of a record of force alone compares with, as for cutenv score; default baselines",
        "baselines",
    )
    add_target_length(parser, "the records' own, which always hold")
    add_option(parser, "--name NAME", "title; default the table's name, or the folder's")
    add_language(parser)


def add_language(parser: argparse.ArgumentParser) -> None:
    """Add the language of the pages."""
    add_option(
        parser, "--language", "language of the pages; tables for programs are English", ENGLISH, choices=languages()
    )


def note_missing(language: str) -> None:
    """Print the gaps of a language file; ValueError if unreadable."""
    if lacking := missing_texts(language):
        shown = ", ".join(lacking[:3]) + (", ..." if len(lacking) > 3 else "")
        print(
            f"note: the file of {language!r} lacks {len(lacking)} texts, which stay English: {shown}", file=sys.stderr
        )


def add_cut(parser: argparse.ArgumentParser) -> None:
    """Add ``--cut``, see :func:`cutenv.commands.inputs.chosen_cut`."""
    add_option(parser, "--cut N", "number of the cut in the file, from 1; default the first", int)


def made_folder(option: str, folder: Path) -> Path:
    """Return the folder; make it and its parents if missing.

    Raise ValueError if a file has its name; OSError if it cannot be made, or nothing can be written there.
    """
    check_place(option, folder)
    folder.mkdir(parents=True, exist_ok=True)
    check_writable(option, folder)
    return folder


def check_place(option: str, folder: Path) -> None:
    """Raise unless a folder could be made here; make none.

    Raise ValueError if a file has its name, or that of a folder above it; OSError if nothing can be written in the
    nearest folder that exists.
    """
    there = next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists())
    if not there.is_dir():
        shown = folder if there == folder.absolute() else there
        raise ValueError(f"{option} {shown} is a file; give a folder.")
    check_writable(option, folder if there == folder.absolute() else there)


def made_picture(option: str, file: Path) -> Path:
    """Return the path of a picture to write (.png); make folders.

    Raise ValueError if its name does not end in ``.png``, or it is a folder; OSError if its folder cannot be made, or
    nothing can be written there.
    """
    if file.suffix.lower() != ".png":
        raise ValueError(f"{option} {file} is no PNG. Give a name that ends in .png.")
    return made_place(option, file)


def made_place(option: str, file: Path) -> Path:
    """Return the path of a file to write; make folders.

    Raise ValueError if it is a folder; OSError if its folder cannot be made, or nothing can be written there.
    """
    if file.is_dir():
        raise ValueError(f"{option} {file} is a folder; give a file.")
    made_folder(option, file.parent)
    return file
