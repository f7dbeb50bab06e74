"""One cut, and the file of a laboratory that holds it: what the generators of all formats share."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

RATE = 200.0  # readings a second [Hz]
N = 1361
COUNT = range(N)
TIME = np.arange(N) / RATE
START = datetime.datetime(2026, 3, 2, 10, 11, 12)
EPOCH = 1_772_446_272  # the same in UTC
DURATION, TRAVEL = float(TIME[-1]), 30.0


def _cut(seed: int, peak: float, end: float) -> tuple[Any, Any]:
    """Force [N] and position [mm] of a cut: rest, a rise with drops, an unloading, rest."""
    noise = 0.02 * np.random.default_rng(seed).standard_normal(N)
    moving = np.clip((TIME - 1.0) / 4.0, 0.0, 1.0)
    saw = 0.25 * ((TIME * 3.0) % 1.0)
    load = np.where((TIME > 1.2) & (TIME < 5.0), 1.0 - np.exp(-(TIME - 1.2) / 0.6), 0.0)
    unloading = np.where(TIME >= 5.0, np.exp(-(TIME - 5.0) / 0.05), 0.0)
    force = (load * (0.85 + saw) + 0.9 * unloading) + noise / 3.0
    return force * (peak / force.max()), end * moving


FORCE, WAY = _cut(1, 3.13, TRAVEL)
OTHER_FORCE, OTHER_WAY = _cut(2, 2.71, 24.0)


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Duration [s], peak [N] and travel [mm] of a record; travel None where the file has none."""

    duration_s: float = DURATION
    peak_N: float = 3.13
    travel_mm: float | None = TRAVEL


ONE = (Truth(),)
TWO = (Truth(), Truth(peak_N=2.71, travel_mm=24.0))
FORCE_ALONE = (Truth(travel_mm=None),)


@dataclass(frozen=True, kw_only=True)
class LabFormat:
    """A file of a laboratory."""

    name: str
    maker: str  # program or instrument that writes it
    about: str  # peculiarity of the format
    content: bytes
    truth: tuple[Truth, ...] = ONE  # its records
    asks: int = 0  # questions that the file itself leaves open
    left_out: int = 0  # rows that are no readings
    readable: bool = True  # false if the file leaves open what nobody can guess


FORMATS: list[LabFormat] = []


def table(columns: Sequence[tuple[Any, str]], separator: str = ",", decimal: str = ".", quote: str = "") -> list[str]:
    """Rows of columns, each with its printf format."""
    cells = [[f"{quote}{(form % value).replace('.', decimal)}{quote}" for value in values] for values, form in columns]
    return [separator.join(row) for row in zip(*cells, strict=True)]


def add(
    name: str, origin: str, *lines: str, newline: str = "\n", ended: bool = True, encoding: str = "utf-8", **facts: Any
) -> None:
    """Add a file of a maker, with what is peculiar in it: ``maker: about``."""
    maker, _, about = origin.partition(": ")
    content = newline.join([*lines, ""] if ended else lines).encode(encoding)
    FORMATS.append(LabFormat(name=name, maker=maker, about=about, content=content, **facts))


def add_odd(name: str, *lines: str, **facts: Any) -> None:
    """Add a file that people and programs of many kinds write; its name says what is odd."""
    add(name, f"people and programs: {name.rpartition('.')[0].replace('_', ' ')}", *lines, **facts)


def each(form: Callable[..., str], *columns: Iterable[Any]) -> list[str]:
    """Rows made by a function of the values in them, by default of time, force and way."""
    return [form(*row) for row in zip(*(columns or (TIME, FORCE, WAY)), strict=False)]


def at(seconds: float) -> datetime.datetime:
    return START + datetime.timedelta(seconds=float(seconds))


def clock_time(seconds: float) -> str:
    return at(seconds).strftime("%H:%M:%S.%f")[:-3]


T, F, X = (TIME, "%.4f"), (FORCE, "%.5f"), (WAY, "%.4f")
OTHER_F, OTHER_X = (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")
GRAMS = (1e3 * FORCE / 9.80665, "%.3f")
MILLINEWTONS, MICRO_X = (1e3 * FORCE, "%.2f"), (1e3 * WAY, "%.1f")
STANDARD = table([T, F, X])
