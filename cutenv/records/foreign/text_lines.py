"""Text files as lines, and lines of no table yet.

JSON, keys and values, the arrows of a serial monitor.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cutenv.records.foreign.cell_values import MOMENT_PATTERN, NUMBER_PATTERNS
from cutenv.records.schema import UTF_16, RecordError, check_beginning

_PAIR = re.compile(
    rf"(?P<key>[^\W\d][\w ./\[\]()-]*?|\"[^\"]+\")\s*[:=]\s*(?P<value>{NUMBER_PATTERNS['.']}|nan|-?inf)\s*"
    r"(?P<unit>[^\W\d]+(?:/\w+)?|%|\u00b0)?(?=[\s,;|}]|$)",
    re.IGNORECASE,
)
_ARROW = re.compile(r"\s*(\S+(?: \S+)?)\s*->\s?(.*?)\s*")
_LOGGED = re.compile(
    rf"\W*({MOMENT_PATTERN.pattern})\W+(?:[A-Z]{{3,8}}\W+)?(.*)"
)  # a time in front of what a logger wrote
_BESIDE = re.compile(
    rf"\s*(?:[+-]?{NUMBER_PATTERNS['.']}\s+[^\W\d]+(?:\s+|$))+"
)  # numbers with their units behind them
_INDENTED = re.compile(r"( *)([^\W\d]\w*):(?:\s+(.*?))?\s*")  # a line of YAML: a key, and perhaps a value
_FEWEST_PAIRS = 0.8  # share of the lines that are pairs, in a file of pairs


def text_lines(path: Path) -> list[str]:
    """Return a text file's lines, in UTF-8, UTF-16 or Windows encodings."""
    content = path.read_bytes()
    check_beginning(path, content, "text", UTF_16)
    encodings = ("utf-16",) if content[:2] in UTF_16 else ("utf-8-sig", "cp1252", "cp932", "gb18030")
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" in text:
            raise RecordError(path, "it is no text: it holds zero bytes. Export the record as text, in UTF-8.")
        return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    raise RecordError(path, "it is no text in UTF-8, UTF-16 or Windows' encoding. Save it as UTF-8.")


class Tabled(NamedTuple):
    """Names, cells and line numbers of tabled text."""

    kind: str  # of its layout
    names: Sequence[str]
    rows: list[list[str]]
    lines: list[int]
    odd: int  # number of other lines
    facts: Sequence[str] = ()  # as stated


def tabled(lines: Sequence[str]) -> Tabled | None:
    """Return JSON, key-value or serial monitor lines as table, or None."""
    filled = [line for line in lines[:200] if line.strip()]
    if not filled:
        return None
    if filled[0].lstrip()[:1] in "[{":
        return _json(lines)
    if any(line.strip() == "---" for line in filled) and _INDENTED.fullmatch(filled[0 if filled[0] != "---" else 1]):
        return _documents(lines)
    if sum(bool(_ARROW.match(line)) for line in filled) > _FEWEST_PAIRS * len(filled):
        return _arrows(lines, _ARROW)
    if sum(bool(_LOGGED.fullmatch(line) and _PAIR.search(line)) for line in filled) > _FEWEST_PAIRS * len(filled):
        return _arrows(lines, _LOGGED)
    middle = filled[len(filled) // 2]
    pairs = _PAIR.findall(middle)
    if (
        pairs
        and not _leftover(middle)
        and sum(bool(_PAIR.search(line)) for line in filled) > _FEWEST_PAIRS * len(filled)
    ):
        return _key_values(lines)
    return None


def plain_rows(lines: Sequence[str]) -> list[str]:
    """Return lines without brackets around cells and blanks before units."""
    filled = [line for line in lines[:400] if line.strip()]
    few = _FEWEST_PAIRS * len(filled)
    if sum(bool(re.fullmatch(r"\s*(?:\[.*\]|\([^()]*\)),?\s*", line)) for line in filled) > few:
        return [line.strip(" [](),") for line in lines]
    if sum(bool(_BESIDE.fullmatch(line)) for line in filled) > few:
        return [re.sub(r"(?<=\d)\s+(?=[^\W\d])", "", line) for line in lines]
    return list(lines)


def _leftover(line: str) -> str:
    """Return text in a line besides its pairs and leading word."""
    return re.sub(r"[\s,;|{}]+", "", _PAIR.sub("", re.sub(r"^\s*[A-Za-z]+[:>\s]+(?=[A-Za-z_]+\s*[:=])", "", line)))


def _documents(lines: Sequence[str]) -> Tabled | None:
    """Read ROS-printed messages separated by "---", with nested keys."""
    objects: list[dict[str, str]] = [{}]
    numbers, odd = [0], 0
    above: list[tuple[int, str]] = []
    for number, line in enumerate(lines, 1):
        if line.strip() == "---":
            objects.append({})
            numbers.append(number)
        elif (found := _INDENTED.fullmatch(line)) is not None:
            above = [*(each for each in above if each[0] < len(found[1])), (len(found[1]), found[2])]
            if found[3]:
                objects[-1][".".join(key for _, key in above)] = found[3].strip("'\"")
        else:
            odd += bool(line.strip())
    kept = [(number + 1, each) for number, each in zip(numbers, objects, strict=True) if each]
    names = list(dict.fromkeys(name for _, each in kept for name in each))
    rows = [[each.get(name, "") for name in names] for _, each in kept]
    return Tabled("messages", names, rows, [number for number, _ in kept], odd) if len(rows) > 1 else None


def _key_values(lines: Sequence[str]) -> Tabled | None:
    by_line = [(i, [found.groupdict() for found in _PAIR.finditer(line)]) for i, line in enumerate(lines, 1)]
    keys: dict[str, str] = {}
    for _, pairs in by_line[:400]:
        for pair in pairs:
            keys.setdefault(pair["key"].strip().strip('"'), pair["unit"] or "")
    rows, numbers, odd = [], [], 0
    for number, pairs in by_line:
        found = {pair["key"].strip().strip('"'): pair["value"] for pair in pairs}
        if not found or _leftover(lines[number - 1]):
            odd += bool(lines[number - 1].strip())
            continue
        rows.append([found.get(key, "") for key in keys])
        numbers.append(number)
    names = [f"{key} [{unit}]" if unit else key for key, unit in keys.items()]
    return Tabled("key and value", names, rows, numbers, odd) if rows else None


def _arrows(lines: Sequence[str], form: re.Pattern[str]) -> Tabled | None:
    """Split off each line's leading time, as serial monitors print it."""
    parted = [(i, found) for i, line in enumerate(lines, 1) if (found := form.fullmatch(line))]
    clocks = [found[1] for _, found in parted]
    if not MOMENT_PATTERN.fullmatch(clocks[len(clocks) // 2]):
        return None
    written = [found[form.groups] for _, found in parted]
    inner = tabled(written)
    if inner is not None:
        rows = [[clocks[line - 1], *row] for line, row in zip(inner.lines, inner.rows, strict=True)]
        numbers = [parted[line - 1][0] for line in inner.lines]
        return Tabled(f"serial monitor, {inner.kind}", ["clock", *inner.names], rows, numbers, inner.odd)
    counts: dict[int, int] = {}
    split = [re.split(r"\s*[,;\t]\s*|\s+", each.strip()) for each in written]
    for cells in split:
        counts[len(cells)] = counts.get(len(cells), 0) + 1
    usual = max(counts, key=lambda length: counts[length])
    number = re.compile(NUMBER_PATTERNS["."])
    good = [k for k, cells in enumerate(split) if len(cells) == usual and all(number.fullmatch(cell) for cell in cells)]
    if not good:
        return None
    heading = next((re.split(r"\s*[,;\t]\s*", each.strip()) for each in written[: good[0]][::-1]), [])
    names = heading if len(heading) == usual else [""] * usual
    rows = [[clocks[k], *split[k]] for k in good]
    odd = len(split) - len(good) - (len(heading) == usual)
    return Tabled("serial monitor", ["clock", *names], rows, [parted[k][0] for k in good], odd)


def _json(lines: Sequence[str]) -> Tabled | None:
    """Read JSON objects: one a line, a list, or of lists."""
    objects, numbers, odd = [], [], 0
    for number, line in enumerate(lines, 1):
        text = line.strip().rstrip(",")
        if not text:
            continue
        try:
            value = json.loads(text)
        except (ValueError, RecursionError):
            odd += 1
            continue
        if isinstance(value, dict):
            objects.append(dict(_leaves(value)))
            numbers.append(number)
        else:
            odd += 1
    if len(objects) < 2 or odd > len(objects):
        return _whole_json("\n".join(lines))
    names = list(dict.fromkeys(name for each in objects for name in each))
    rows = [[_text(each.get(name)) for name in names] for each in objects]
    return Tabled("JSON lines", names, rows, numbers, odd)


def _whole_json(text: str) -> Tabled | None:
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return None
    lists = _of_pandas(value) or _lists(value)
    if lists is not None:
        units = _units_of(value, set(lists))
        names = [f"{name} [{units[name]}]" if units.get(name) else name for name in lists]
        rows = [[_text(cell) for cell in row] for row in zip(*lists.values(), strict=True)]
        facts = [f"{name}: {each}" for name, each in _leaves(value) if isinstance(each, str | int | float)]
        return Tabled("JSON", names, rows, list(range(1, len(rows) + 1)), 0, facts)
    objects = _objects(value)
    if objects is None:
        return None
    flat = [dict(_leaves(each)) for each in objects]
    names = list(dict.fromkeys(name for each in flat for name in each))
    rows = [[_text(each.get(name)) for name in names] for each in flat]
    return Tabled("JSON", names, rows, list(range(1, len(rows) + 1)), 0)


def _of_pandas(value: Any) -> dict[str, list[Any]] | None:
    """Return columns of a pandas "columns" or "split" JSON, or None."""
    if not isinstance(value, dict):
        return None
    names, rows = value.get("columns"), value.get("data")
    if isinstance(names, list) and isinstance(rows, list) and rows and all(isinstance(row, list) for row in rows):
        full = all(len(row) == len(names) for row in rows)
        return {str(name): [row[k] for row in rows] for k, name in enumerate(names)} if full else None
    by_row = [each for each in value.values() if isinstance(each, dict)]
    if len(by_row) < 2 or len(by_row) < len(value) or len({tuple(each) for each in by_row}) > 1 or "0" not in by_row[0]:
        return None
    return {name: list(each.values()) for name, each in value.items()}


def _lists(value: Any) -> dict[str, list[Any]] | None:
    """Return an object's longest lists of equal length."""
    if not isinstance(value, dict):
        return None
    lists = {str(name): each for name, each in value.items() if isinstance(each, list) and len(each) > 1}
    lists = {name: each for name, each in lists.items() if not isinstance(each[0], dict | list)}
    longest = max(map(len, lists.values()), default=0)
    lists = {name: each for name, each in lists.items() if len(each) == longest}
    if len(lists) > 1:
        return lists
    return next((found for each in value.values() if (found := _lists(each)) is not None), None)


def _units_of(value: Any, names: set[str]) -> dict[str, str]:
    """Return a JSON object's units of its lists, or {}."""
    if not isinstance(value, dict):
        return {}
    if names & set(value) and all(isinstance(each, str) for each in value.values()):
        return {name: unit for name, unit in value.items() if name in names}
    return next((found for each in value.values() if (found := _units_of(each, names))), {})


def _objects(value: Any) -> list[dict[str, Any]] | None:
    if isinstance(value, list) and len(value) > 1 and all(isinstance(each, dict) for each in value):
        return value
    if isinstance(value, dict):
        return next((found for each in value.values() if (found := _objects(each)) is not None), None)
    return None


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, each in value.items():
            yield from _leaves(each, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list):
        for k, each in enumerate(value[:16]):
            yield from _leaves(each, f"{name}.{k}")
    else:
        yield name, value


def _text(value: Any) -> str:
    return "" if value is None else str(value)
