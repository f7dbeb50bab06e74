"""Units of measurement: spellings, and exact sizes in SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

_Number = TypeVar("_Number", float, NDArray[np.float64])


class Unit(NamedTuple):
    """Unit of ``size / parts`` SI units, as people use it."""

    sign: str  # spelling beside a number: cm/s
    si: str  # the SI unit (or rad) of the same quantity
    size: float = 1.0  # number of SI units in `parts` of this one
    parts: int = 1  # 2.54 cm are 2.54 / 100 = 0.0254 m to the last bit, which 2.54 times the rounded 0.01 are not
    spellings: tuple[str, ...] = ()  # other ones that people use
    word: str = ""  # spelling inside a name, if it is not that of the sign: percent

    @property
    def name(self) -> str:
        """Spelling in names of columns or keys, without slash: ``cm_s``."""
        return self.word or self.sign.replace("/", "_")

    @property
    def factor(self) -> float:
        """Number of SI units in one."""
        return self.size / self.parts

    def to_si(self, number: _Number) -> _Number:
        """Convert to SI in the same shape; SI arrays are unchanged."""
        if self.size != 1.0:
            number = number * self.size
        return number / self.parts if self.parts != 1 else number

    def from_si(self, value: _Number) -> _Number:
        """Convert from SI, of the same shape."""
        return value * self.parts / self.size


_RADIANS = math.pi / 180.0
LENGTHS = (
    Unit("m", "m", spellings=("meter", "meters", "metre", "metres")),
    Unit("cm", "m", parts=100, spellings=("centimeter", "centimeters", "centimetre", "centimetres")),
    Unit("mm", "m", parts=1000, spellings=("millimeter", "millimeters", "millimetre", "millimetres")),
    Unit("um", "m", parts=10**6, spellings=("\u00b5m", "\u03bcm", "micron", "microns", "micrometer", "micrometre")),
    Unit("in", "m", 0.0254, spellings=("inch", "inches", "\u2033")),
    Unit("ft", "m", 0.3048, spellings=("feet", "foot")),
)
TIMES = (
    Unit("s", "s", spellings=("sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden", "seconde", "secondes")),
    Unit("ms", "s", parts=1000, spellings=("msec", "msecs", "millis", "millisec", "milliseconds", "millisekunden")),
    Unit("us", "s", parts=10**6, spellings=("\u00b5s", "\u03bcs", "usec", "micros", "microsec", "microseconds")),
    Unit("ns", "s", parts=10**9, spellings=("nsec", "nsecs", "nanosec", "nanosecs", "nanoseconds")),
    Unit("min", "s", 60.0, spellings=("minute", "minutes", "mins", "minuten")),
    Unit("h", "s", 3600.0, spellings=("hr", "hour", "hours", "std", "stunden")),
    Unit("d", "s", 86400.0, spellings=("day", "days")),
)
# gf, kgf, lbf: by the standard acceleration of free fall, 9.80665 m/s2; a load cell's g, kg and lb are these. "1":
# normalised, a pure number.
FORCES = (
    Unit("N", "N", spellings=("newton", "newtons")),
    Unit("mN", "N", parts=1000, spellings=("millinewton", "millinewtons")),
    Unit("uN", "N", parts=10**6, spellings=("\u00b5N", "\u03bcN", "micronewton", "micronewtons")),
    Unit("cN", "N", parts=100),
    Unit("daN", "N", 10.0),
    Unit("kN", "N", 1e3),
    Unit("gf", "N", 9.80665e-3, spellings=("g", "gram", "grams", "gramm", "p", "pond")),
    Unit("kgf", "N", 9.80665, spellings=("kg", "kp", "kilogram", "kilograms")),
    Unit("lbf", "N", 4.4482216152605, spellings=("lb", "lbs", "pound", "pounds", "lbsf")),
    Unit("ozf", "N", 0.27801385095378, spellings=("oz", "ounce", "ounces")),
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
    """Return the unit that pages show: millimetres for metres, else SI."""
    return {"m": NAMED_UNITS["mm"], "m2": _SQUARE_MILLIMETRE}.get(si) or Unit(si, si)
