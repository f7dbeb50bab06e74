"""Keys of a rig's file, with their units.

They are the fields of the settings; the file is read, written and explained from them.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Iterator
from typing import Any, NamedTuple

from cutenv._base.unit_table import NAMED_UNITS, Unit
from cutenv.rig.config.settings import RigSettings


class FileKey(NamedTuple):
    """One line of the file, for a field that :func:`~cutenv.rig.config.settings.setting` declares."""

    field: str  # name of the field
    unit: Unit  # unit in the file; that named "1" for a count, a ratio or a text
    kind: type[Any]  # type of the value: bool, int, float, str or tuple; for an optional one, its type if given
    choices: tuple[str, ...]  # texts allowed; empty if any is
    default: Any  # default in SI
    limits: tuple[float, float] | None  # least and greatest value in the file's unit, if the field documents them
    meaning: str  # explanation for the comment; plausible value if there is no default
    example: str

    @property
    def name(self) -> str:
        """Name in the file: field and unit."""
        pure = self.unit.name == "1" or self.kind is tuple  # a list of pairs, both mm
        return self.field if pure or self.field.endswith(self.unit.name) else f"{self.field}_{self.unit.name}"

    def to_si(self, number: float) -> float:
        """Convert to SI, exactly where possible: 3.81 cm are 0.0381 m."""
        return self.unit.to_si(number)

    def from_si(self, value: float) -> float:
        """Convert from SI with the fewest exact digits, 15 at most."""
        number = value / self.unit.factor
        shorter = (float(f"{number:.{digits}g}") for digits in (6, 12))
        return next((short for short in shorter if self.to_si(short) == value), float(f"{number:.15g}"))


class FileSection(NamedTuple):
    """One table of the file.

    The one without a name is at the top.
    """

    name: str
    about: str
    of: type[Any]
    keys: tuple[FileKey, ...]

    def where(self, key: FileKey) -> str:
        """Return the full name of a key, such as ``limits.force_N``."""
        return f"{self.name}.{key.name}" if self.name else key.name


_ABOUT = {
    "bus": "The CAN bus, as python-can names it, and the period of the axes' samples, whatever drives them.",
    "blade": "The axis that moves the blade along the cut.",
    "angle": 'The axis that turns the blade: with angle_mode = "free" only.',
    "height": "The axis that raises and lowers the blade: optional.",
    "side": "The axis that moves the blade to the side, for cuts along a curve: optional.",
    "position_control": "PD control of position by the blade's drive: optional. Without it the drive has a velocity "
    "loop. It configures no drive: the simulator, a fake and identification read it.",
    "sensor": "The force sensor, and how the cut lies in its axes.",
    "limits": "Limits at which the blade is stopped, whatever the policy commands.",
    "calibration": "When and how the force sensor was last checked with known weights.",
    "camera": "A camera that measures the depth of cut: optional.",
    "identified": "What 'cutenv rig identify' has measured, and written here; the simulator adopts it.",
}


def _sections() -> Iterator[FileSection]:
    """Yield the file's sections, the top lines first."""
    yield FileSection("", "", RigSettings, keys_of(RigSettings))
    hints = typing.get_type_hints(RigSettings)
    for name, about in _ABOUT.items():
        of = _without_none(hints[name])
        yield FileSection(name, about, of, keys_of(of, hinge=name == "angle"))


def keys_of(of: type[Any], *, hinge: bool = False) -> tuple[FileKey, ...]:
    """Return the keys of a dataclass of settings; ``hinge`` selects a hinge's units."""
    hints, which = typing.get_type_hints(of), -1 if hinge else 0
    keys = []
    for field in dataclasses.fields(of):
        about, hint = field.metadata, _without_none(hints[field.name])
        if "units" not in about:
            continue
        choices = typing.get_args(hint) if typing.get_origin(hint) is typing.Literal else ()
        kind = str if choices else typing.get_origin(hint) or hint
        assert kind in (bool, int, float, str, tuple), f"{of.__name__}.{field.name} is of a kind that no file holds"
        unit, example = NAMED_UNITS[about["units"][which]], about["examples"][which]
        key = FileKey(field.name, unit, kind, choices, field.default, None, about["meaning"], example)
        limits = (key.from_si(about["low"]), key.from_si(about["high"])) if "low" in about else None
        keys.append(key._replace(limits=limits))
    return tuple(keys)


def _without_none(hint: Any) -> Any:
    return typing.get_args(hint)[0] if isinstance(hint, types.UnionType) else hint


SECTIONS = tuple(_sections())

IDENTIFIED = SECTIONS[-1]  # section that the program itself writes


def setting_text(settings: RigSettings, field: str) -> str:
    """Return a setting as in the file: ``limits.high_mm = 148`` for ``"limits.high"``."""
    of, _, name = field.rpartition(".")
    section = next(section for section in SECTIONS if section.name == of)
    key = next(key for key in section.keys if key.field == name)
    value = getattr(getattr(settings, of) if of else settings, name)
    told = f"{key.from_si(value):g}" if key.kind is float else repr(value)
    return f"{section.where(key)} = {told}"
