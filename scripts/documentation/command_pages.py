"""Reference pages of the commands: each one's ``--help``, printed by running its parser."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Iterator, Mapping

from cutenv.commands import cli

WIDTH = 96  # columns of the printed help
FOLDER = "reference/commands"
_WITHOUT_CONTENTS = "---\nhide: [toc]\n---\n\n"  # leaves the column to the printed help


def commands() -> dict[str, cli.Command]:
    """Return every command that can be typed after ``cutenv``, such as ``"score"`` and ``"rig init"``."""
    found: dict[str, cli.Command] = {}
    for name, command in sorted(cli.COMMANDS.items()):
        found[name] = command
        found |= {f"{name} {part}": own for part, own in sorted(command.parts.items())}
    return found


def pages() -> Iterator[tuple[str, str, str]]:
    """Yield path below ``docs``, title in the navigation and Markdown of every page."""
    yield f"{FOLDER}/index.md", "All commands", _index(commands())
    for name, command in commands().items():
        text = f"{_WITHOUT_CONTENTS}# cutenv {name}\n\n{_sentence(command.summary)}\n\n{_block(name)}\n"
        yield f"{FOLDER}/{_file(name)}", f"cutenv {name}", text


def _file(command: str) -> str:
    return f"{command.replace(' ', '-')}.md"


def _sentence(summary: str) -> str:
    return f"{summary[0].upper()}{summary[1:]}."


def _index(listed: Mapping[str, cli.Command]) -> str:
    rows = [f"| [`cutenv {name}`]({_file(name)}) | {command.summary} |" for name, command in listed.items()]
    table = "\n".join(["| command | what it does |", "| --- | --- |", *rows])
    return f"{_WITHOUT_CONTENTS}# Commands\n\n{table}\n\n{_block('')}\n"


def _block(name: str) -> str:
    return f"```text\n{printed_help(name.split())}\n```"


def printed_help(arguments: list[str]) -> str:
    """Return what ``cutenv ... --help`` prints."""
    out = io.StringIO()
    status: object = "no exit"
    before = {name: os.environ.get(name) for name in ("COLUMNS", "NO_COLOR")}
    os.environ.update(COLUMNS=str(WIDTH + 2), NO_COLOR="1")  # argparse leaves two columns free
    try:
        with contextlib.redirect_stdout(out):
            cli.main([*arguments, "--help"])
    except SystemExit as ended:
        status = ended.code
    finally:
        for variable, value in before.items():
            os.environ.pop(variable, None)
            if value is not None:
                os.environ[variable] = value
    if status not in (0, None) or not out.getvalue().strip():
        raise RuntimeError(f"cutenv {' '.join(arguments)} --help printed no help: exit status {status!r}.")
    return out.getvalue().rstrip()
