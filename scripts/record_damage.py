"""Kinds of damage that a file of records may have: to its bytes, or to its lines if it is text."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

Lines = list[bytes]
Random = np.random.Generator

SUFFIXES = (".csv", ".parquet", ".h5")

_NO_READINGS = (
    *(b"nan", b"inf", b"-inf", b"", b" ", b"x", b"1e400", b"1_0", b"0x1p3", b'"1.0"', b"1.5 N", b"\xc2\xb2"),
    *(b"#", b"--1", b"1e", b"None", b"9" * 400, b"\x00", b"1+2j", b"1e-400", b"-1e300", b"\xef\xbc\x91", b"12:30:01"),
    *(b'"', b"'", b"1,5", b"1.5.5", b"#2", b"[N]", b"N", b"\xa0", b"\x85", b"\x1c"),
)
_NO_METADATA = (
    *(b"{", b"[1]", b"NaN", b'{"a": Infinity}', b"[" * 100_000, b'{"a": "\xff"}', b"null", b"7", b'{"a": 1e999}'),
    *(b"", b'{"a":' * 2000 + b"1" + b"}" * 2000, b'{"force_along_cut": [1]}', b'["time_s"]', b"9" * 5000),
)
_UNITS = (b"ms", b"mN", b"parsec", b"cm", b"deg", b"", b"kN", b"N m", b"mm_s")


def _bits_flipped(content: bytes, rng: Random) -> bytes:
    changed = np.frombuffer(content, np.uint8).copy()
    for _ in range(rng.integers(1, 9)):
        changed[rng.integers(len(changed))] ^= np.uint8(1 << rng.integers(8))
    return changed.tobytes()


def _stretch(content: bytes, rng: Random, longest: int, change: Callable[[bytes], bytes]) -> bytes:
    """Change a stretch of up to ``longest`` bytes."""
    start = rng.integers(len(content))
    stop = start + rng.integers(1, longest)
    return content[:start] + change(content[start:stop]) + content[stop:]


ANY_FILE: Mapping[str, Callable[[bytes, Random], bytes]] = {
    "truncated": lambda content, rng: content[: rng.integers(len(content))],
    "beheaded": lambda content, rng: content[1 + rng.integers(len(content)) :],
    "bits_flipped": _bits_flipped,
    "bytes_replaced": lambda content, rng: _stretch(content, rng, 40, lambda part: rng.bytes(len(part))),
    "bytes_inserted": lambda content, rng: _stretch(content, rng, 40, lambda part: rng.bytes(len(part)) + part),
    "stretch_lost": lambda content, rng: _stretch(content, rng, 400, lambda part: b""),
    # As where a block of the disk was never written.
    "stretch_zeroed": lambda content, rng: _stretch(content, rng, 600, lambda part: bytes(len(part))),
    "stretch_doubled": lambda content, rng: _stretch(content, rng, 400, lambda part: part + part),
    "whole_doubled": lambda content, rng: content + content,
    "noise": lambda content, rng: rng.bytes(rng.integers(0, 2000)),
    # The format is recognised by the first bytes.
    "noise_after_beginning": lambda content, rng: content[:8] + rng.bytes(rng.integers(0, 2000)),
    # As some spreadsheets write it.
    "in_another_encoding": lambda content, rng: content.decode("latin-1").encode(
        str(rng.choice(["utf-16", "utf-16-le", "utf-32"]))
    ),
}


def _line(lines: Lines, rng: Random, change: Callable[[bytes], Lines]) -> Lines:
    i = rng.integers(len(lines))
    return [*lines[:i], *change(lines[i]), *lines[i + 1 :]]


def _lines_swapped(lines: Lines, rng: Random) -> Lines:
    i, k = rng.integers(len(lines), size=2)
    changed = list(lines)
    changed[i], changed[k] = changed[k], changed[i]
    return changed


def _header(lines: Lines) -> int:
    """Return the index of the row of headers, the first that is no comment."""
    return next((i for i, line in enumerate(lines) if not line.startswith(b"#")), 0)


def _headers(lines: Lines, change: Callable[[Lines], Lines]) -> Lines:
    place = _header(lines)
    return [*lines[:place], b",".join(change(lines[place].split(b","))), *lines[place + 1 :]]


def _unit_changed(lines: Lines, rng: Random) -> Lines:
    """Change or remove the unit in one header."""
    unit, chosen = _UNITS[rng.integers(len(_UNITS))], rng.integers(100)
    return _headers(
        lines,
        lambda names: [
            name.partition(b"_")[0] + b"_" + unit if i == chosen % len(names) else name for i, name in enumerate(names)
        ],
    )


def _decimal_commas(lines: Lines, rng: Random) -> Lines:
    """Write decimal commas as in half of Europe; columns separated by semicolons or still by commas."""
    place = _header(lines)
    mark = bytes(rng.choice([b";", b",", b"\t"]))
    changed = [line.replace(b",", b"~").replace(b".", b",").replace(b"~", mark) for line in lines[place:]]
    return [*lines[:place], *changed]


def _cell(line: bytes, rng: Random, new: Lines) -> bytes:
    """Write one cell, or none, in the place of another."""
    separator = next((each for each in (b"\t", b";", b",", b" ") if each in line), b",")
    cells = line.split(separator)
    i = rng.integers(len(cells))
    return separator.join([*cells[:i], *new, *cells[i + 1 :]])


def _cell_changed(lines: Lines, rng: Random) -> Lines:
    """Write something into a cell that is not a reading."""
    text = _NO_READINGS[rng.integers(len(_NO_READINGS))]
    rows = [i for i in range(_header(lines) + 1, len(lines)) if lines[i]]
    if not rows:
        return lines
    row = rng.choice(rows)
    return [*lines[:row], _cell(lines[row], rng, [text]), *lines[row + 1 :]]


def _json_damaged(lines: Lines, rng: Random) -> Lines:
    """Write other JSON, or none, into a comment."""
    text = _NO_METADATA[rng.integers(len(_NO_METADATA))]
    chosen = [i for i, line in enumerate(lines) if line.startswith(b"#") and b":" in line]
    if not chosen:
        return lines
    i = rng.choice(chosen)
    return [*lines[:i], lines[i].partition(b":")[0] + b": " + text, *lines[i + 1 :]]


TEXT_FILE: Mapping[str, Callable[[Lines, Random], Lines]] = {
    "line_doubled": lambda lines, rng: _line(lines, rng, lambda line: [line, line]),
    "line_lost": lambda lines, rng: _line(lines, rng, lambda line: []),
    "lines_swapped": _lines_swapped,
    "headers_shuffled": lambda lines, rng: _headers(
        lines, lambda names: [names[i] for i in rng.permutation(len(names))]
    ),
    "header_doubled": lambda lines, rng: _headers(
        lines, lambda names: [names[i] for i in rng.integers(len(names), size=len(names))]
    ),
    "unit_changed": _unit_changed,
    "headers_lost": lambda lines, rng: [line for i, line in enumerate(lines) if i != _header(lines)],
    "decimal_commas": _decimal_commas,
    "cell_changed": _cell_changed,
    "cell_lost": lambda lines, rng: _line(lines, rng, lambda line: [_cell(line, rng, [])]),
    "comments_lost": lambda lines, rng: [line for line in lines if not line.startswith(b"#")],
    "json_damaged": _json_damaged,
}

DAMAGES: Mapping[str, tuple[str, ...]] = {
    suffix: (*ANY_FILE, *(TEXT_FILE if suffix == ".csv" else ())) for suffix in SUFFIXES
}
"""Names of the kinds of damage that are done to files of each suffix."""


def damaged(content: bytes, kind: str, rng: Random) -> bytes:
    """Return the content of a file, if it has any, with damage of that kind, one of :data:`DAMAGES`."""
    if not content:
        return content
    return ANY_FILE[kind](content, rng) if kind in ANY_FILE else b"\n".join(TEXT_FILE[kind](content.split(b"\n"), rng))
