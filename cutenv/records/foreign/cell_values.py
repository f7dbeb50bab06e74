"""Cells of a text table as numbers.

Decimal signs, thousands, units in the cell, dates, clocks and durations.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cutenv._base.arrays import Array
from cutenv.records.foreign.stated_units import known_spelling

_EXACT = 2**53  # integers beyond lose digits as floating-point numbers: nanoseconds since 1970 do
_EPOCH = datetime.date(1970, 1, 1).toordinal()
_DAY = 86_400 * 10**9  # [ns]
NUMBER_PATTERNS = {
    ".": r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?",
    ",": r"[+-]?(?:\d+(?:,\d*)?|,\d+)(?:[eEdD][+-]?\d+)?",
}
"""Patterns of a number, by its decimal sign."""
_NUMBER = {sign: re.compile(pattern) for sign, pattern in NUMBER_PATTERNS.items()}
_GROUPS = {  # whole numbers in groups of three, and perhaps decimals
    sign: re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:{group}\d{{3}})+(?:{re.escape(sign)}\d*)?(?:[eE][+-]?\d+)?")
    for sign, group in ((".", "[, '\u2019\u00a0\u202f\u2009]"), (",", "[. '\u2019\u00a0\u202f\u2009]"))
}
_WITH_UNIT = {sign: re.compile(rf"({pattern})\s*([^\d\s.,:;+-]\S*)") for sign, pattern in NUMBER_PATTERNS.items()}
MISSING = re.compile(
    r"|[-*.?_#]+|[+-]?(?:nan|inf(?:inity)?|1\.#\w+|ol|over(?:load|flow|range)?)|#?n/?a|#\w+[!?]|#div/0!|null|none|nat|"
    r"err(?:or)?|invalid|missing|open|fault",
    re.IGNORECASE,
)
"""Words in place of a number that a sensor did not give."""
_MONTHS = {
    name: k
    for k, name in enumerate("jan,feb,mar,apr,may,jun,jul,aug,sep,oct,nov,dec".split(","), 1)  # noqa: SIM905
}
_MONTHS |= {"m\u00e4r": 3, "mai": 5, "okt": 10, "dez": 12}
_DATE = (
    r"(?P<date>\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{8}(?=[T _])|"
    r"\d{1,2}[-/. ](?:\d{1,2}|[A-Za-z\u00e4]{3,9})\.?[-/. ]\d{2,4}|[A-Za-z]{3} +\d{1,2},? +\d{4})"
)
_CLOCK = (
    r"(?P<h>\d{1,3}):(?P<m>\d{2})(?::(?P<s>\d{2})(?:(?P<sign>[.,:])(?P<f>\d+))?|(?P<mf>\.\d+))?"
    r"(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
)
_COMPACT = r"(?P<h>\d{2})(?P<m>\d{2})(?P<s>\d{2})(?:(?P<sign>[.,])(?P<f>\d+))?"
_ZONE = r"(?:\s*(?:Z|UTC|GMT|[A-Z]{2,4}T|(?P<zone>[+-]\d{2}:?\d{2})))?(?:\[[\w/]+\])?"
_MOMENTS = (
    re.compile(rf"(?:{_DATE}(?:[T ,;_-]+|\s+)(?:at )?)?{_CLOCK}{_ZONE}"),
    re.compile(rf"(?P<date>\d{{8}})[T _-]{_COMPACT}{_ZONE}"),
    re.compile(rf"(?:[A-Z][a-z]{{2}},? +)?(?P<date>[A-Z][a-z]{{2}} +\d{{1,2}}),? +{_CLOCK}(?: +\d{{4}})?"),
    re.compile(rf"(?:(?P<days>-?\d+) days?,? )(?:\+?){_CLOCK}"),
)
MOMENT_PATTERN = re.compile("|".join(re.sub(r"\?P<\w+>", "", pattern.pattern) for pattern in _MOMENTS))
"""Pattern of a date with its time, a clock time or a duration."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CellValues:
    """Cells of a column as numbers."""

    # numbers; NaN where a cell holds none. Dates, clocks and durations are seconds from `origin`, shape (n,)
    values: Array
    # "number"; "clock", a time of a day or from a start; "date", a moment with its date; "text", anything else
    kind: str = "number"
    unit: str = ""  # unit that stands in the cells themselves, "s" for times; "" without
    origin: float = 0.0  # number taken off all values, so that nanoseconds since 1970 keep their digits
    odd: tuple[int, ...] = ()  # rows whose cells are neither numbers nor words for a missing one
    doubt: str = ""  # words for the reader on how ambiguous cells were read; "" if none was


def cell_values(cells: Sequence[str], decimal: str) -> CellValues:
    """Return a column's cells as numbers, by decimal sign."""
    try:
        if decimal == "." and not any("_" in cell for cell in cells):
            found = _exact(cells, np.fromiter(map(float, cells), np.float64, len(cells)))
            return _numbers(cells, decimal) if may_be_thousands(found.values) else found
    except ValueError:
        pass
    filled = next((cell for cell in cells if not MISSING.fullmatch(cell)), "")
    if ":" in filled or MOMENT_PATTERN.fullmatch(filled):
        moments = _times(cells)
        if moments is not None:
            return moments
    return _numbers(cells, decimal)


def of_array(values: object) -> CellValues:
    """Return a binary column: numbers, ``datetime64``, ``timedelta64`` or text."""
    array = np.asarray(values).reshape(-1)
    if array.dtype.kind == "M":
        return _moments(array.astype("datetime64[ns]").astype(np.int64), "date", np.isnat(array))
    if array.dtype.kind == "m":
        return _moments(array.astype("timedelta64[ns]").astype(np.int64), "clock", np.isnat(array))
    if array.dtype.kind in "iu" and array.size and max(abs(int(array.max())), abs(int(array.min()))) > _EXACT:
        first = int(array[0])
        exact = np.array([int(each) - first for each in array.tolist()], dtype=np.float64)
        return CellValues(values=exact, origin=float(first))
    if array.dtype.kind in "fiub":
        return CellValues(values=array.astype(np.float64))
    return cell_values(["" if each is None else str(each).strip() for each in array.tolist()], ".")


def _exact(cells: Sequence[str], values: Array) -> CellValues:
    """Return numbers; large whole ones relative to the first, from digits."""
    if values.size and np.abs(values[np.isfinite(values)]).max(initial=0.0) > _EXACT:
        try:
            whole = [int(cell) for cell in cells]
        except ValueError:
            return CellValues(values=np.where(np.isfinite(values), values, np.nan))
        exact = np.array([each - whole[0] for each in whole], dtype=np.float64)
        return CellValues(values=exact, origin=float(whole[0]))
    return CellValues(values=np.where(np.isfinite(values), values, np.nan))


def may_be_thousands(values: Array) -> bool:
    """Return whether decimals may be thousands separators: 998, then 1.002."""
    known = values[np.isfinite(values)]
    broken = known[known != np.rint(known)]
    whole = known.size - broken.size
    in_thousands = np.abs(1e3 * broken - np.rint(1e3 * broken)) < 1e-6
    return bool(broken.size and whole and (np.abs(broken) >= 1.0).all() and in_thousands.all())


def _numbers(cells: Sequence[str], decimal: str) -> CellValues:
    plain = _read(cells, decimal, thousands=False)
    if any(_GROUPS[decimal].fullmatch(cell) for cell in cells):
        grouped = _read(cells, decimal, thousands=True)
        plain = grouped if len(grouped.odd) < len(plain.odd) else plain
    if may_be_thousands(plain.values):
        other = "," if decimal == "." else "."
        signed = [cell for cell in cells if decimal in cell]
        if all(_GROUPS[other].fullmatch(cell) for cell in signed):
            grouped = _read(cells, other, thousands=True)
            where = np.array([decimal in cell for cell in cells])
            if _jump(grouped.values, where) < _jump(plain.values, where):
                example = max(signed, key=len)
                number = grouped.values[list(cells).index(example)]
                return replace(grouped, doubt=f"{example!r} is read as {number:g}, a whole number with thousands")
    return plain


def _jump(values: Array, signed: Array) -> float:
    """Return the usual change between neighbours with different digit signs."""
    changes = np.abs(np.diff(values))[np.diff(signed)]
    known = changes[np.isfinite(changes)]
    return float(np.median(known)) if len(known) else np.inf


def plain_float(cell: str, decimal: str) -> float:
    """Return a plain cell's number quickly; ValueError if none."""
    if decimal == ",":
        if "." in cell:
            raise ValueError("a sign that parts thousands")
        cell = cell.replace(",", ".", 1)
    elif "_" in cell:
        raise ValueError("a name")
    return float(cell)


def _read(cells: Sequence[str], decimal: str, *, thousands: bool) -> CellValues:
    number, group, with_unit = _NUMBER[decimal], _GROUPS[decimal], _WITH_UNIT[decimal]
    values = np.full(len(cells), np.nan)
    odd, units = [], set()
    for k, cell in enumerate(cells):
        try:
            values[k] = plain_float(cell, decimal)
            units.add("")
            continue
        except ValueError:
            text, unit = cell, ""
        if thousands and group.fullmatch(text):
            text = re.sub(rf"[^\d{re.escape(decimal)}eE+-]", "", text)
        elif not number.fullmatch(text):
            found = with_unit.fullmatch(text)
            if found is not None and known_spelling(found[2]) is not None:
                text, unit = found[1], found[2]
            else:
                if not MISSING.fullmatch(cell):
                    odd.append(k)
                continue
        units.add(unit)
        try:
            values[k] = float(text.replace(",", ".").replace("D", "e").replace("d", "e"))
        except ValueError:
            odd.append(k)
    values[~np.isfinite(values)] = np.nan
    if len(units) > 1:  # "1.2 N" beside "1.2": what the one means is not said
        return CellValues(values=np.full(len(cells), np.nan), kind="text", odd=tuple(range(len(cells))))
    kind = "number" if len(odd) < max(1, len(cells) - len(odd)) or not odd else "text"
    return CellValues(values=values, kind=kind, unit=next(iter(units), ""), odd=tuple(odd))


def _times(cells: Sequence[str]) -> CellValues | None:
    """Return dates, clocks or durations as seconds from the first, or None."""
    pattern = next((each for each in _MOMENTS if any(each.fullmatch(cell) for cell in cells[:50])), None)
    if pattern is None:
        return None
    days: dict[str, int] = {}
    day_first = not any(re.match(r"\d{1,2}[-/]([13-9]\d|2\d|1[3-9])[-/]", cell) for cell in cells[:1])
    moments = np.zeros(len(cells), dtype=np.int64)
    missing = np.zeros(len(cells), dtype=bool)
    odd, is_date = [], False
    padded = _fraction_reader([found for cell in cells[:400] if (found := pattern.fullmatch(cell))])
    for k, cell in enumerate(cells):
        found = pattern.fullmatch(cell)
        if found is None:
            missing[k] = True
            if not MISSING.fullmatch(cell):
                odd.append(k)
            continue
        part = found.groupdict()
        hours, minutes, seconds = int(part["h"]), int(part["m"]), int(part["s"] or 0)
        if part.get("mf"):  # minutes and seconds alone
            hours, minutes, seconds = 0, hours, minutes
            nanoseconds = int((part["mf"][1:] + "0" * 9)[:9])
        else:
            nanoseconds = padded(part["f"], part["sign"]) if part["f"] else 0
        if part.get("half"):
            hours = hours % 12 + (12 if part["half"] in "pP" else 0)
        moment = ((hours * 60 + minutes) * 60 + seconds) * 10**9 + nanoseconds
        if date := part.get("date"):
            is_date = True
            if date not in days:
                days[date] = _day(date, day_first=day_first)
            moment += days[date] * _DAY
        moment += int(part.get("days") or 0) * _DAY
        if zone := part.get("zone"):
            offset = int(zone[1:3]) * 60 + int(zone[-2:])
            moment -= (offset if zone[0] == "+" else -offset) * 60 * 10**9
        moments[k] = moment
    if len(odd) * 2 > len(cells):
        return None
    return replace(_moments(moments, "date" if is_date else "clock", missing), odd=tuple(odd))


def _fraction_reader(found: Sequence[re.Match[str]]) -> Callable[[str, str], int]:
    """Return a reader of second fractions [ns]: decimals or unpadded milliseconds."""
    fractions = [(each["f"], each["sign"]) for each in found if "f" in each.re.groupindex and each["f"]]
    lengths = {len(digits) for digits, _ in fractions}
    if (
        len(lengths) > 1
        and max(lengths) == 3
        and not any(digits[0] == "0" and len(digits) > 1 for digits, _ in fractions)
    ):
        return lambda digits, sign: int(digits) * 10**6
    if lengths and max(lengths) <= 3 and all(sign == ":" for _, sign in fractions):
        return lambda digits, sign: int(digits) * 10**6
    return lambda digits, sign: int((digits + "0" * 9)[:9])


def _moments(moments: np.ndarray[tuple[int], np.dtype[np.int64]], kind: str, missing: object) -> CellValues:
    absent = np.asarray(missing, dtype=bool)
    origin = int(moments[~absent][0]) if (~absent).any() else 0
    values = (moments - origin) / 1e9
    values[absent] = np.nan
    return CellValues(values=values, kind=kind, unit="s", origin=origin / 1e9)


def _day(date: str, *, day_first: bool) -> int:
    """Return a date's day number from 1970, 0 if invalid."""
    parts = [part for part in re.split(r"[-/., ]+", date) if part]
    if len(parts) == 1:
        parts = [date[:4], date[4:6], date[6:]]
    if len(parts) == 2:  # in some year
        parts.append("2000")
    if parts[0].isalpha():
        parts = [parts[1], parts[0], parts[2]]
    if len(parts[0]) == 4:
        year, month, day = parts
    elif parts[1].isdigit() and (int(parts[1]) > 12 or not day_first):
        month, day, year = parts
    else:
        day, month, year = parts
    number = int(month) if month.isdigit() else _MONTHS.get(month[:3].lower(), 0)
    try:
        return datetime.date(int(year) + (2000 if len(year) == 2 else 0), number, int(day)).toordinal() - _EPOCH
    except ValueError:
        return 0
