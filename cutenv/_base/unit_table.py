"""Units of measurement: how each is spelled, and its exact size in SI units; every other table reads from these."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

_Number = TypeVar("_Number", float, NDArray[np.float64])


class Unit(NamedTuple):
    """Unit of ``size / parts`` SI units, for numbers from people and for people.

    Attributes
    ----------
    sign : str
        Spelling beside a number: ``cm/s``.
    si : str
        The SI unit (or rad) of the same quantity.
    size : float
        Number of SI units in `parts` of this one.
    parts : int
        Divisor of `size`: 2.54 cm are 2.54 / 100 = 0.0254 m to the last bit, which 2.54 times the rounded 0.01 are not.
    spellings : tuple of str
        Other spellings that people use.
    word : str
        Spelling inside a name, if it is not that of the sign: ``percent``.
    """

    sign: str
    si: str
    size: float = 1.0
    parts: int = 1
    spellings: tuple[str, ...] = ()
    word: str = ""

    @property
    def name(self) -> str:
        """Spelling inside the name of a column or key, which can hold no slash: ``cm_s``."""
        return self.word or self.sign.replace("/", "_")

    @property
    def factor(self) -> float:
        """Number of SI units in one."""
        return self.size / self.parts

    def to_si(self, number: _Number) -> _Number:
        """Convert to SI, of the same shape; an array that is in SI already is returned itself."""
        if self.size != 1.0:
            number = number * self.size
        return number / self.parts if self.parts != 1 else number

    def from_si(self, value: _Number) -> _Number:
        """Convert from SI, of the same shape."""
        return value * self.parts / self.size


_RADIANS = math.pi / 180.0
LENGTHS = (
    Unit("m", "m"),
    Unit("cm", "m", parts=100),
    Unit("mm", "m", parts=1000),
    Unit("um", "m", parts=10**6, spellings=("\u00b5m", "\u03bcm")),
    Unit("in", "m", 0.0254, spellings=("inch",)),
)
TIMES = (
    Unit("s", "s", spellings=("sec", "second", "seconds")),
    Unit("ms", "s", parts=1000, spellings=("msec",)),
    Unit("us", "s", parts=10**6, spellings=("\u00b5s", "\u03bcs")),
    Unit("min", "s", 60.0),
)
# gf, kgf, lbf: by the standard acceleration of free fall, 9.80665 m/s2. "1": normalised, a pure number.
FORCES = (
    Unit("N", "N", spellings=("newton", "newtons")),
    Unit("mN", "N", parts=1000),
    Unit("kN", "N", 1e3),
    Unit("gf", "N", 9.80665e-3),
    Unit("kgf", "N", 9.80665),
    Unit("lbf", "N", 4.4482216152605),
    Unit("1", "1", spellings=("-",)),
)
SPEEDS = (
    Unit("m/s", "m/s"),
    Unit("cm/s", "m/s", parts=100),
    Unit("mm/s", "m/s", parts=1000),
    Unit("in/s", "m/s", 0.0254),
)
TORQUES = (Unit("N m", "N m", word="N_m"), Unit("N mm", "N m", parts=1000, word="N_mm"))
ANGLES = (Unit("rad", "rad"), Unit("deg", "rad", _RADIANS, spellings=("\u00b0", "degree", "degrees")))
_SQUARE_MILLIMETRE = Unit("mm2", "m2", parts=10**6)
_OTHERS = (
    Unit("m/s2", "m/s2"),
    Unit("deg/s", "rad/s", _RADIANS),
    Unit("deg/s2", "rad/s2", _RADIANS),
    Unit("Hz", "Hz"),
    Unit("N/s", "N/s", word="N_per_s"),
    Unit("N s/m2", "N s/m2", word="Ns_m2"),
    Unit("N/m", "N/m", word="N_per_m"),
    Unit("N s/m", "N s/m", word="Ns_per_m"),
    Unit("kg", "kg"),
    Unit("A", "A"),
    Unit("bit/s", "bit/s"),
    Unit("%", "1", parts=100, word="percent"),
    Unit("days", "days"),
    Unit("periods", "1"),
)

NAMED_UNITS: Mapping[str, Unit] = MappingProxyType(
    {unit.name: unit for unit in (*LENGTHS, *TIMES, *FORCES, *SPEEDS, *ANGLES, *TORQUES, *_OTHERS)}
)
"""Every unit by its name."""


def shown_unit(si: str) -> Unit:
    """Return the unit in which pages show a quantity of this SI unit: millimetres for metres, else the unit itself."""
    return {"m": NAMED_UNITS["mm"], "m2": _SQUARE_MILLIMETRE}.get(si) or Unit(si, si)
