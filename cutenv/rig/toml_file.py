"""File of a rig, in TOML.

In it names end with their unit, read to SI and radians, and written with a comment for each.
"""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.output import atomic_write
from cutenv._base.validation import in_range, one_of
from cutenv.rig.config.file_schema import IDENTIFIED, SECTIONS, FileKey, FileSection
from cutenv.rig.config.mounted_specimen import check_depth_profile, reach_of
from cutenv.rig.config.settings import Identified, RigSettings, day_of
from cutenv.rig.contradictions import refuse_contradictions
from cutenv.rig.devices.driver_registry import (
    CONDITIONAL,
    KIND_OF_ROLE,
    OPTIONS,
    SHIPPED_KEYS,
    DriverKind,
    driven_roles,
    option_keys,
    traits_of,
)

_NAMED = {section.name: section for section in SECTIONS}
_OPTIONAL = ("angle", "height", "side", "position_control", "camera")


def read_rig_file(path: str | os.PathLike[str]) -> RigSettings:
    """Read a rig's file.

    ``path``: file as ``cutenv rig init`` writes it. Return settings in SI; keys missing in the file have their
    defaults. Raise FileNotFoundError if the file does not exist; ValueError if it is not TOML, or a key is unknown,
    missing, of a wrong type or out of range: names file, section and key, in the file's own unit. Missing keys that
    only a person can supply are listed together.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: no such file. 'cutenv rig init {path}' writes one to be filled in.") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: it is not UTF-8 text. Save it as UTF-8.") from None
    return _settings(text, path)


def write_identified(path: str | os.PathLike[str], identified: Identified) -> None:
    """Replace the values in the file's section ``[identified]``.

    Comments, order and the rest of the file stay.

    Values that are None are removed: to keep earlier measurements, give ``dataclasses.replace(settings.identified,
    ...)``. The file is replaced as a whole or not at all. ``path``: path of a valid rig file; ``identified``: values in
    SI, rounded to meaningful digits. Raise FileNotFoundError, ValueError if the file cannot be read, see
    :func:`read_rig_file`, or the measured values are not valid in it; ModuleNotFoundError if tomlkit is not installed;
    OSError if the file cannot be written.
    """
    values: dict[tuple[str, ...], Any] = {
        (IDENTIFIED.name, key.name): None if value is None else key.from_si(value) if key.kind is float else value
        for key in IDENTIFIED.keys
        for value in [getattr(identified, key.field)]
    }
    write_values(path, values)


def write_values(path: str | os.PathLike[str], values: Mapping[tuple[str, ...], Any]) -> None:
    """Replace values in a rig's file.

    Comments, order and the rest of the file stay. ``path``: path of a valid rig file; ``values``: values in the file's
    units, by the names that lead to each: ("calibration", "date"). None removes one. Raise FileNotFoundError,
    ValueError if the file cannot be read, or would not be valid with these values; it is then as before;
    ModuleNotFoundError if tomlkit is not installed; OSError if the file cannot be written.
    """
    import tomlkit

    path = Path(path)
    read_rig_file(path)
    with path.open(encoding="utf-8", newline="") as file:  # line endings stay as they are
        document: Any = tomlkit.parse(file.read())
    for (*tables, name), value in values.items():
        table = document
        for each in tables:
            if each not in table:
                table.append(each, tomlkit.table())
            table = table[each]
        if value is not None:
            table[name] = value
        elif name in table:
            del table[name]
    text = tomlkit.dumps(document)
    _settings(text, path)  # write nothing that could not be read
    with atomic_write(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        file.write(text)


def _settings(text: str, path: Path) -> RigSettings:
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f'{path}: it is not TOML: {error}. Texts need quotation marks, as in name = "rig".') from None
    tables = _tables(content, path)
    needed = _needed({name: table.get("driver") for name, table in tables.items()}, path)
    missing = [
        section.where(key)
        for section in SECTIONS
        if section.name in tables
        for key in section.keys
        if key.example and key.name not in tables[section.name] and _is_needed(section, key, needed)
    ] + [missing for role in KIND_OF_ROLE if role in tables for missing in _missing_options(role, tables[role], path)]
    if missing:
        raise ValueError(
            f"{path}: only a person can supply {', '.join(missing)}. Write them into the file; 'cutenv rig init' writes"
            " one that explains each, and 'cutenv rig drivers NAME' tells a driver's options."
        )
    parts = {name: _part(section, tables[name], path) for name, section in _NAMED.items() if name in tables}
    top = parts.pop("")
    settings: RigSettings = _made(RigSettings, {**top, **parts}, str(path))
    try:
        check_depth_profile(settings.depth_profile, reach_of(settings))
        _check_emulated(settings)
        _check_calibrated(settings)
        refuse_contradictions(settings)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return settings


def _needed(drivers: Mapping[str, Any], path: Path) -> set[str]:
    """Return the fields drivers need from a person, such as ``"blade.lead"``."""
    needed = set()
    for role, kind in KIND_OF_ROLE.items():
        if role in drivers:
            needed |= _needed_by(role, _driver_of(role, drivers[role], path), kind, path)
    return needed


def _driver_of(role: str, given: Any, path: Path | str) -> str:
    """Return a section's driver name, by default the default one."""
    default: str = next(key.default for key in _NAMED[role].keys if key.field == "driver")
    if given is not None and not (isinstance(given, str) and given):
        raise ValueError(f"{path}: [{role}] driver must be a text in quotation marks, got {given!r}.")
    return default if given is None else given


def _needed_by(role: str, driver: str, kind: DriverKind, path: Path) -> set[str]:
    try:
        needs = traits_of(kind, driver).needs
    except ValueError as error:
        raise ValueError(f"{path}: [{role}] {error}") from None
    return {need if "." in need else f"{role}.{need}" for need in needs}


def _missing_options(role: str, table: Mapping[str, Any], path: Path) -> list[str]:
    """Return missing driver options that only a person can supply."""
    keys = option_keys(KIND_OF_ROLE[role], _driver_of(role, table.get("driver"), path))
    given = table.get(OPTIONS, {})
    return [f"{role}.{OPTIONS}.{key.name}" for key in keys if key.example and key.name not in given]


def _is_needed(section: FileSection, key: FileKey, needed: set[str]) -> bool:
    where = f"{section.name}.{key.field}"
    return where not in CONDITIONAL or where in needed


def _check_calibrated(settings: RigSettings) -> None:
    """Raise an error for a calibration in the future."""
    calibrated, today = settings.calibration.date, date.today()
    if calibrated and day_of(calibrated) > today:
        raise ValueError(
            f"calibration.date = {calibrated} is in the future: today is {today}. Correct it, or this computer's clock."
        )


def _check_emulated(settings: RigSettings) -> None:
    """Raise an error for a rig marked as emulated on another computer."""
    if not settings.emulated:
        return
    for role, name in driven_roles(settings).items():
        if role != "camera" and not traits_of(KIND_OF_ROLE[role], name).emulated(settings, role):
            raise ValueError(
                "emulated = true is for an emulator on this computer, and what the driver of "
                f"[{role}], {name!r}, reaches by these settings is none (a CAN gateway or a sensor at 127.0.0.1, a "
                "pseudo-terminal). Set it to false: a real rig moves beside people, who must be asked."
            )


def _tables(content: Mapping[str, Any], path: Path) -> dict[str, Mapping[str, Any]]:
    """Return sections with values, the top under "", optional if present."""
    sections = {name: section for name, section in _NAMED.items() if name}
    for name, value in content.items():
        one_of(f"{path}: name", name, [key.name for key in _NAMED[""].keys] + list(sections))
        if (name in sections) != isinstance(value, dict):
            kind = f"a section, [{name}]" if name in sections else f"a line, {name} = ..., above the first section"
            raise ValueError(f"{path}: {name} must be {kind}.")
    tables = {name: content.get(name, {}) for name in sections if name not in _OPTIONAL or name in content}
    for name, table in tables.items():
        known = [each.name for each in sections[name].keys] + [OPTIONS] * (name in KIND_OF_ROLE)
        for key in table:
            one_of(f"{path}: in [{name}] the name", key, known)
    return {"": {name: value for name, value in content.items() if name not in sections}, **tables}


def _part(section: FileSection, table: Mapping[str, Any], path: Path) -> Any:
    """Return a section as its dataclass, the top as a dictionary."""
    where = f"{path}: [{section.name}] " if section.name else f"{path}: "
    values = _values(section.keys, table, where)
    if section.name in KIND_OF_ROLE:
        driver = _driver_of(section.name, table.get("driver"), path)
        values[OPTIONS] = _driver_options(section.name, driver, table.get(OPTIONS, {}), path)
    names = {key.field: key for key in section.keys}
    for low, high in (("low", "high"), ("angle_low", "angle_high"), ("lowest", "highest")):
        if low in names:
            least, most = (values.get(end, names[end].default) for end in (low, high))
            if not least < most:
                shown = [f"{names[end].name} = {names[end].from_si(at):g}" for end, at in ((low, least), (high, most))]
                raise ValueError(f"{where}{shown[0]} must be below {shown[1]}: they are the ends of travel.")
    return _made(section.of, values, where.rstrip()) if section.name else values


def _values(keys: Iterable[FileKey], table: Mapping[str, Any], where: str) -> dict[str, Any]:
    values = {}
    for key in keys:
        if key.name in table:
            try:
                values[key.field] = _value(key, table[key.name], f"{where}{key.name}")
            except TypeError as error:
                raise ValueError(str(error)) from None
    return values


def _driver_options(role: str, driver: str, table: Any, path: Path) -> Any:
    """Return a driver's options, of its declared class, or None."""
    where, kind = f"{path}: [{role}.{OPTIONS}] ", KIND_OF_ROLE[role]
    of, keys = traits_of(kind, driver).options, option_keys(kind, driver)
    if not isinstance(table, dict):
        raise ValueError(f"{path}: {role}.{OPTIONS} must be a table, [{role}.{OPTIONS}], got {table!r}.")
    if of is None:
        if table:
            raise ValueError(
                f"{where.rstrip()} driver {driver!r} has no options; found {', '.join(table)}. Remove them."
            )
        return None
    for name in table:
        one_of(f"{where}the name", name, [key.name for key in keys])
    return _made(of, _values(keys, table, where), where.rstrip())


def _made(of: type[Any], values: Mapping[str, Any], where: str) -> Any:
    try:
        return of(**values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where.removesuffix(':')}: {error}") from None


def _value(key: FileKey, raw: Any, name: str) -> Any:
    """Return a value of the file in SI, with its field's type."""
    if key.kind is tuple:
        return _profile(key, raw, name)
    if key.kind is float:
        low, high = key.limits or (0.0, np.inf)
        if key.field == "counts_per_N" and isinstance(raw, (int, float)) and raw < 0.0:
            raise ValueError(f"{name} = {raw:g} is negative. Write {-raw:g}, and turn the direction by sensor.sign.")
        return key.to_si(in_range(name, raw, low, high, key.unit.sign))
    if key.field == "date":
        if raw == "" and key.default == "":
            return raw
        text = raw.isoformat() if isinstance(raw, date) else raw
        if not isinstance(text, str):
            raise TypeError(f"{name} must be a date such as 2026-03-01, got {raw!r}.")
        try:
            day_of(text)
        except ValueError as error:
            raise ValueError(f"{name} = {error}") from None
        return text
    if type(raw) is not key.kind:  # True is an int to isinstance
        called = {bool: "true or false", int: "a whole number", str: "a text in quotation marks"}[key.kind]
        raise TypeError(f"{name} must be {called}, got {raw!r}.")
    return one_of(name, raw, key.choices) if key.choices else raw


def _profile(key: FileKey, raw: Any, name: str) -> tuple[tuple[float, float], ...]:
    if not (isinstance(raw, list) and all(isinstance(point, list) and len(point) == 2 for point in raw)):
        raise TypeError(f"{name} must be a list of [position_mm, depth_mm], such as {key.example}, got {raw!r}.")
    points = [[key.to_si(in_range(name, number, -1e3, 1e3, "mm")) for number in point] for point in raw]
    return tuple((position, depth) for position, depth in points)


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
    """Return a new rig's file with explained keys, refused until filled in.

    A key has its meaning, unit, range and default. Values and drivers are those of ``like``, by default of a CANopen
    drive and a Net F/T.
    """
    return _text(replace(like or RigSettings(), name=name), to_fill=True)


def to_toml(settings: RigSettings) -> str:
    """Return a rig's commented file, with 15 digits, for :func:`read_rig_file`."""
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
    """Return the fields that no driver reads, such as ``"bus.host"``."""
    drivers = driven_roles(settings)
    used = set(drivers.values()) | {"opencv"}
    unread = set().union(*(keys for name, keys in SHIPPED_KEYS.items() if name not in used))
    for role in ("blade", "angle", "height", "side"):
        if drivers.get(role, "canopen") != "canopen":
            unread |= {key for key in SHIPPED_KEYS["canopen"] if key.startswith(f"{role}.")}
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
            likely = key.example if value in (None, key.default) else _toml(key, value)  # of this kind of rig
            yield f"{_TO_FILL}{key.name} = {likely}"
        elif value is not None:
            yield f"{key.name} = {_toml(key, value)}"


def key_comment(key: FileKey) -> list[str]:
    """Return a key's comment: meaning, range, choices, default."""
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
