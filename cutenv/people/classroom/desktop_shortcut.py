"""Desktop shortcut that starts a class, for Linux, macOS or Windows."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path


def write_shortcut(
    command: Sequence[str],
    name: str,
    *,
    place: Path | None = None,
    folder: Path | None = None,
    platform: str = sys.platform,
) -> Path:
    """Write a shortcut that runs a command in a terminal; return its path.

    One of the same name is replaced. It is placed on the desktop, or in the present folder where there is none, and the
    command runs in the present folder. The platform is as in :data:`sys.platform`. Raises ValueError for a character,
    such as a line break, that no such file can hold.
    """
    where = str(folder or Path.cwd())
    for argument in (*command, where, name):
        if not argument.isprintable() or (platform == "win32" and '"' in argument):
            raise ValueError(f"--shortcut: {argument!r} has a character that no shortcut can hold.")
    ending, content = {"win32": (".bat", _batch), "darwin": (".command", _command_file)}.get(
        platform, (".desktop", _desktop_entry)
    )
    name = re.sub(r"[^\w .-]", "_", name)
    path = (place or _desktop() or Path.cwd()) / (name + ending)
    path.write_bytes(content(command, where, name).encode())
    path.chmod(0o755)
    return path


def _desktop_entry(command: Sequence[str], where: str, name: str) -> str:
    waits = ("sh", "-c", '"$@" || read -r enter', "cutenv", *command)  # the window stays open to show what went wrong
    quoted = " ".join('"' + re.sub(r'([\\"`$])', r"\\\1", each).replace("%", "%%") + '"' for each in waits)
    lines = {"Type": "Application", "Name": name, "Terminal": "true", "Path": where, "Exec": quoted}
    values = {key: value.replace("\\", "\\\\") for key, value in lines.items()}
    return "[Desktop Entry]\n" + "".join(f"{key}={value}\n" for key, value in values.items())


def _command_file(command: Sequence[str], where: str, name: str) -> str:
    return f"#!/bin/sh\n# {name}\ncd {shlex.quote(where)} && exec {shlex.join(command)}\n"


def _batch(command: Sequence[str], where: str, name: str) -> str:
    # Between quotation marks the shell takes every character as it is, but for a percent sign.
    line, place = (
        " ".join('"' + re.sub(r"(\\+)$", r"\1\1", each).replace("%", "%%") + '"' for each in part)
        for part in (command, [where])
    )
    return f"@chcp 65001 > nul\r\n@title {name}\r\n@cd /d {place} && {line} || pause\r\n"


def _desktop() -> Path | None:
    home = Path.home()
    try:
        chosen = (home / ".config" / "user-dirs.dirs").read_text(encoding="utf-8")
    except OSError:
        chosen = ""
    found = re.search(r'^XDG_DESKTOP_DIR="(?:\$HOME/)?(.+)"$', chosen, re.MULTILINE)
    desktop = home / (found[1] if found else "Desktop")
    return desktop if desktop.is_dir() else None
