"""Kinds of damage that a file of records may have: to its bytes, or to its lines if it is text."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

Lines = list[bytes]

SUFFIXES = (".csv", ".parquet", ".h5")

_NO_READINGS = (
    *(b"nan", b"inf", b"-inf", b"", b" ", b"x", b"1e400", b"1_0", b"0x1p3", b'"1.0"', b"1.5 N", b"\xc2\xb2"),
    *(b"#", b"--1", b"1e", b"None", b"9" * 400, b"\x00", b"1+2j", b"1e-400"),
)
_NO_METADATA = (
    *(b"{", b"[1]", b"NaN", b'{"a": Infinity}', b"[" * 100_000, b'{"a": "\xff"}', b"null", b"7", b'{"a": 1e999}'),
    *(b"", b'{"a":' * 2000 + b"1" + b"}" * 2000, b'{"force_along_cut": [1]}', b'["time_s"]', b"9" * 5000),
)


def truncated(content: bytes, rng: np.random.Generator) -> bytes:
    """Lose the end."""
    return content[: rng.integers(len(content))]


def beheaded(content: bytes, rng: np.random.Generator) -> bytes:
    """Lose the beginning."""
    return content[1 + rng.integers(len(content)) :]


def bits_flipped(content: bytes, rng: np.random.Generator) -> bytes:
    """Flip one to eight bits."""
    changed = np.frombuffer(content, np.uint8).copy()
    for _ in range(rng.integers(1, 9)):
        changed[rng.integers(len(changed))] ^= np.uint8(1 << rng.integers(8))
    return changed.tobytes()


def bytes_replaced(content: bytes, rng: np.random.Generator) -> bytes:
    """Replace a stretch by noise."""
    start, length = rng.integers(len(content)), rng.integers(1, 40)
    return content[:start] + rng.bytes(length) + content[start + length :]


def bytes_inserted(content: bytes, rng: np.random.Generator) -> bytes:
    """Push noise in between."""
    start = rng.integers(len(content) + 1)
    return content[:start] + rng.bytes(rng.integers(1, 40)) + content[start:]


def stretch_lost(content: bytes, rng: np.random.Generator) -> bytes:
    """Lose a stretch."""
    start = rng.integers(len(content))
    return content[:start] + content[start + rng.integers(1, 400) :]


def stretch_zeroed(content: bytes, rng: np.random.Generator) -> bytes:
    """Write zeros, as where a block of the disk was never written."""
    start, length = rng.integers(len(content)), int(rng.integers(1, 600))
    return content[:start] + bytes(len(content[start : start + length])) + content[start + length :]


def stretch_doubled(content: bytes, rng: np.random.Generator) -> bytes:
    """Write a stretch twice."""
    start = rng.integers(len(content))
    stop = start + rng.integers(1, 400)
    return content[:stop] + content[start:stop] + content[stop:]


def whole_doubled(content: bytes, rng: np.random.Generator) -> bytes:
    """Append the file to itself."""
    return content + content


def noise(content: bytes, rng: np.random.Generator) -> bytes:
    """Return nothing but noise."""
    return rng.bytes(rng.integers(0, 2000))


def noise_after_beginning(content: bytes, rng: np.random.Generator) -> bytes:
    """Write noise after the first bytes, by which the format is recognised."""
    return content[:8] + rng.bytes(rng.integers(0, 2000))


def in_another_encoding(content: bytes, rng: np.random.Generator) -> bytes:
    """Encode text in UTF-16, as some spreadsheets write it."""
    return content.decode("latin-1").encode(str(rng.choice(["utf-16", "utf-16-le", "utf-32"])))


ANY_FILE: tuple[Callable[[bytes, np.random.Generator], bytes], ...] = (
    truncated,
    beheaded,
    bits_flipped,
    bytes_replaced,
    bytes_inserted,
    stretch_lost,
    stretch_zeroed,
    stretch_doubled,
    whole_doubled,
    noise,
    noise_after_beginning,
    in_another_encoding,
)


def line_doubled(lines: Lines, rng: np.random.Generator) -> Lines:
    """Write a line twice."""
    i = rng.integers(len(lines))
    return [*lines[: i + 1], *lines[i:]]


def line_lost(lines: Lines, rng: np.random.Generator) -> Lines:
    """Lose a line."""
    i = rng.integers(len(lines))
    return [*lines[:i], *lines[i + 1 :]]


def lines_swapped(lines: Lines, rng: np.random.Generator) -> Lines:
    """Swap two lines."""
    i, k = rng.integers(len(lines), size=2)
    changed = list(lines)
    changed[i], changed[k] = changed[k], changed[i]
    return changed


def headers_shuffled(lines: Lines, rng: np.random.Generator) -> Lines:
    """Put the headers above other columns."""
    return _header_changed(lines, lambda names: [names[i] for i in rng.permutation(len(names))])


def header_doubled(lines: Lines, rng: np.random.Generator) -> Lines:
    """Give two columns the same header."""
    return _header_changed(lines, lambda names: [names[i] for i in rng.integers(len(names), size=len(names))])


def unit_changed(lines: Lines, rng: np.random.Generator) -> Lines:
    """Change or remove the unit in one header."""
    unit = rng.choice([b"ms", b"mN", b"parsec", b"cm", b"deg", b"", b"kN", b"N m", b"mm_s"])
    chosen = rng.integers(100)
    return _header_changed(
        lines,
        lambda names: [
            name.partition(b"_")[0] + b"_" + bytes(unit) if i == chosen % len(names) else name
            for i, name in enumerate(names)
        ],
    )


def headers_lost(lines: Lines, rng: np.random.Generator) -> Lines:
    """Remove all headers."""
    place = _header(lines)
    return [*lines[:place], *lines[place + 1 :]]


def decimal_commas(lines: Lines, rng: np.random.Generator) -> Lines:
    """Write decimal commas as in half of Europe; columns separated by semicolons or still by commas."""
    place = _header(lines)
    mark = bytes(rng.choice([b";", b",", b"\t"]))
    changed = [line.replace(b",", b"~").replace(b".", b",").replace(b"~", mark) for line in lines[place:]]
    return [*lines[:place], *changed]


def cell_changed(lines: Lines, rng: np.random.Generator) -> Lines:
    """Write something into a cell that is not a reading."""
    text = _NO_READINGS[rng.integers(len(_NO_READINGS))]
    rows = [i for i in range(_header(lines) + 1, len(lines)) if lines[i]]
    if not rows:
        return lines
    row = rng.choice(rows)
    cells = lines[row].split(b",")
    cells[rng.integers(len(cells))] = text
    return [*lines[:row], b",".join(cells), *lines[row + 1 :]]


def cell_lost(lines: Lines, rng: np.random.Generator) -> Lines:
    """Write a row with a cell too few."""
    row = rng.integers(len(lines))
    cells = lines[row].split(b",")
    del cells[rng.integers(len(cells))]
    return [*lines[:row], b",".join(cells), *lines[row + 1 :]]


def comments_lost(lines: Lines, rng: np.random.Generator) -> Lines:
    """Remove schema and metadata."""
    return [line for line in lines if not line.startswith(b"#")]


def json_damaged(lines: Lines, rng: np.random.Generator) -> Lines:
    """Write other JSON, or none, into a comment."""
    text = _NO_METADATA[rng.integers(len(_NO_METADATA))]
    chosen = [i for i, line in enumerate(lines) if line.startswith(b"#") and b":" in line]
    if not chosen:
        return lines
    i = rng.choice(chosen)
    return [*lines[:i], lines[i].partition(b":")[0] + b": " + text, *lines[i + 1 :]]


def _header(lines: Lines) -> int:
    """Return the index of the row of headers."""
    return next(i for i, line in enumerate(lines) if not line.startswith(b"#"))


def _header_changed(lines: Lines, change: Callable[[Lines], Lines]) -> Lines:
    place = _header(lines)
    return [*lines[:place], b",".join(change(lines[place].split(b","))), *lines[place + 1 :]]


TEXT_FILE: tuple[Callable[[Lines, np.random.Generator], Lines], ...] = (
    line_doubled,
    line_lost,
    lines_swapped,
    headers_shuffled,
    header_doubled,
    unit_changed,
    headers_lost,
    decimal_commas,
    cell_changed,
    cell_lost,
    comments_lost,
    json_damaged,
)

DAMAGES: Mapping[str, tuple[str, ...]] = {
    suffix: tuple(damage.__name__ for damage in (*ANY_FILE, *(TEXT_FILE if suffix == ".csv" else ())))
    for suffix in SUFFIXES
}
"""Names of the kinds of damage that are done to files of each suffix."""


def damaged(content: bytes, kind: str, rng: np.random.Generator) -> bytes:
    """Return the content of a file with damage of that kind, one of :data:`DAMAGES`."""
    for whole in ANY_FILE:
        if whole.__name__ == kind:
            return whole(content, rng)
    (by_line,) = (by_line for by_line in TEXT_FILE if by_line.__name__ == kind)
    return b"\n".join(by_line(content.split(b"\n"), rng))
