"""Text of a rig's file: TOML with a comment above each key, which gives meaning, unit, range and default."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from cutenv.rig.config.file_schema import IDENTIFIED, SECTIONS, FileKey, FileSection
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.driver_registry import KIND_OF_ROLE, OPTIONS, OWN_KEYS, driven_roles, option_keys

_TO_FILL = "# FILL IN: "
_BEGINNING = """\
# A rig for cutenv.  Every name ends with its unit.  A missing key has the default in its comment.
"""
_UNFINISHED = f"""\
#
# Not finished: replace each line that begins with '{_TO_FILL.strip()}' by the true value for this rig, without that
# beginning.  Until then the file is refused, and all missing keys are listed at once.  Sections of which every line is
# a comment are for what this rig need not have, and may stay as they are.
"""
_ON_A_BUS = ("angle", "height", "side", "position_control")  # optional sections that only a rig with CANopen drives has
_WIDTH = 116  # characters of a comment, after its mark


def template(name: str = "rig", like: RigSettings | None = None) -> str:
    """Return a new rig's file: every key with meaning, unit, range and default; it is refused until filled in.

    Values and drivers are those of ``like``, by default of a CANopen drive and a Net F/T.
    """
    return _text(replace(like or RigSettings(), name=name), to_fill=True)


def to_toml(settings: RigSettings) -> str:
    """Return the file of a rig, commented like the template, with up to 15 digits, for :func:`read_rig_file`."""
    return _text(settings, to_fill=False)


def _text(settings: RigSettings, *, to_fill: bool) -> str:
    lines = (_BEGINNING + (_UNFINISHED if to_fill else "")).splitlines()
    unread = _unread(settings)
    for section in SECTIONS:
        part = getattr(settings, section.name) if section.name else settings
        if part is None and section.name in _ON_A_BUS and "canopen" not in driven_roles(settings).values():
            continue  # this rig's drivers know nothing of it
        if part is None:  # no axis of that kind, no camera
            lines += ["", *(f"# {line}".rstrip() for line in _lines(section, section.of(), to_fill=True))]
        else:
            lines += ["", *_lines(section, part, to_fill=to_fill, unread=unread)]
            lines += _option_lines(section, part, to_fill=to_fill)
    return "\n".join(lines) + "\n"


def _unread(settings: RigSettings) -> set[str]:
    """Return the fields, as in ``"bus.host"``, that no driver of this rig reads."""
    drivers = driven_roles(settings)
    used = set(drivers.values()) | {"opencv"}
    unread = set().union(*(keys for name, keys in OWN_KEYS.items() if name not in used))
    for role in ("blade", "angle", "height", "side"):
        if drivers.get(role, "canopen") != "canopen":
            unread |= {key for key in OWN_KEYS["canopen"] if key.startswith(f"{role}.")}
    return unread


def _option_lines(section: FileSection, part: Any, *, to_fill: bool) -> Iterator[str]:
    if section.name not in KIND_OF_ROLE or part.options is None:
        return
    keys = option_keys(KIND_OF_ROLE[section.name], part.driver)
    yield ""
    yield f"# What the driver {part.driver!r} takes."
    yield f"[{section.name}.{OPTIONS}]"
    yield from _key_lines(keys, part.options, to_fill=to_fill)


def _lines(section: FileSection, part: Any, *, to_fill: bool, unread: Iterable[str] = ()) -> Iterator[str]:
    if section.name:
        yield f"# {section.about}"
        yield f"[{section.name}]"
    if section is IDENTIFIED:  # explained on top: the program adds the lines below
        for key in section.keys:
            yield f"#   {key.name:<20} {key.meaning}"
    keys = [key for key in section.keys if f"{section.name}.{key.field}" not in unread]
    yield from _key_lines(keys, part, to_fill=to_fill, comments=section is not IDENTIFIED)


def _key_lines(keys: Iterable[FileKey], part: Any, *, to_fill: bool, comments: bool = True) -> Iterator[str]:
    for key in keys:
        value = getattr(part, key.field)
        if comments:
            yield from key_comment(key)
        if to_fill and key.example:
            yield f"{_TO_FILL}{key.name} = {key.example}"
        elif value is not None:
            yield f"{key.name} = {_toml(key, value)}"


def key_comment(key: FileKey) -> list[str]:
    """Return the comment above a key, in lines: its meaning, range, choices and default."""
    about = [key.meaning]
    if key.limits:
        sign = "" if key.unit.sign == "1" else f" {key.unit.sign}"
        about.append(f"{key.limits[0]:g} to {key.limits[1]:g}{sign}.")
    if key.choices:
        about.append(" or ".join(f'"{choice}"' for choice in key.choices) + ".")
    if not key.example:
        about.append(f"Default {_toml(key, key.default)}.")
    lines = ["#"]
    for word in " ".join(about).split():
        if len(lines[-1]) + len(word) > _WIDTH:
            lines.append("#")
        lines[-1] += f" {word}"
    return lines


def _toml(key: FileKey, value: Any) -> str:
    if key.kind is float:
        return repr(key.from_si(value))
    if key.kind is tuple:
        points = (f"[{key.from_si(position)!r}, {key.from_si(depth)!r}]" for position, depth in value)
        return f"[{', '.join(points)}]"
    if key.kind is str:
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # TOML's only other escape
    return str(value).lower()  # true, false, whole numbers
