"""Read damaged and foreign records, and print how that ends.

    python -m scripts.validation.records.record_trials  20,000 damaged files, 1000 valid records
    python -m scripts.validation.records.record_trials --first 1234 --files 1 --keep FOLDER
        one damaged file, kept to look at

Damaged files must load or end in a clear error. A file that loads to other numbers than were written to it has a digit
changed in a way that cannot be detected. What must not happen is any error but RecordError, a crash of the process or a
loading that does not end. Exit status 1 if a file ends otherwise, or if fewer than 95 % of the valid records, in the
dialects of other programs, are accepted.
"""

from __future__ import annotations

import argparse
import functools
import itertools
import multiprocessing
import multiprocessing.connection
import multiprocessing.pool
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cutenv._engine.parallel import cores
from cutenv.records import ColumnMap, RecordError, load, load_foreign, save
from cutenv.sim.trace import Trace
from scripts.validation.records.virtual_records import DIALECTS, valid_record

CLEAR = ("refused", "loaded as it was", "loaded otherwise")
_DEADLINE = 30.0  # [s] for a process to start, and for each file
_ENOUGH = 0.95  # share of valid records that must be accepted

_NO_READINGS = (
    b"nan", b"inf", b"-inf", b"", b" ", b"x", b"1e400", b"-1e300", b"1_0", b"0x1p3", b'"1.0"', b"1.5 N", b"\xc2\xb2",
    b"#", b"--1", b"1e", b"None", b"9" * 400, b"\x00", b"1+2j", b"1e-400", b"\xef\xbc\x91", b"12:30:01", b'"', b"1,5",
    b"1.5.5", b"#2", b"[N]", b"\xa0", b"\x85", b"\x1c",
)  # fmt: skip
_NO_METADATA = (
    b"{", b"[1]", b"NaN", b'{"a": Infinity}', b"[" * 100_000, b'{"a": "\xff"}', b"null", b"7", b'{"a": 1e999}', b"",
    b'{"a":' * 2000 + b"1" + b"}" * 2000, b'{"force_along_cut": [1]}', b'["time_s"]', b"9" * 5000,
)  # fmt: skip
_UNITS = (b"ms", b"mN", b"parsec", b"cm", b"deg", b"", b"kN", b"N m", b"mm_s")
_EXCHANGED = ((b",", b"."), (b".", b","), (b";", b","), (b"\t", b" "), (b"\n", b"\r"), (b"\n", b""), (b" ", b""))

Rng = np.random.Generator
Lines = list[bytes]


def _bits_flipped(content: bytes, rng: Rng) -> bytes:
    changed = np.frombuffer(content, np.uint8).copy()
    for _ in range(rng.integers(1, 9)):
        changed[rng.integers(len(changed))] ^= np.uint8(1 << rng.integers(8))
    return changed.tobytes()


def _stretch(new: Callable[[bytes, Rng], bytes], longest: int = 400) -> Callable[[bytes, Rng], bytes]:
    """Return a damage that puts something into the place of a stretch of the file, made of it and noise."""

    def damage(content: bytes, rng: Rng) -> bytes:
        start = int(rng.integers(len(content) + 1))
        stop = start + (int(rng.integers(1, longest)) if longest else 0)
        return content[:start] + new(content[start:stop], rng) + content[stop:]

    return damage


def _noise(_: bytes, rng: Rng, longest: int = 40) -> bytes:
    return rng.bytes(int(rng.integers(1, longest)))


ANY_FILE: dict[str, Callable[[bytes, Rng], bytes]] = {  # kinds of damage to the bytes of a file
    "truncated": lambda content, rng: content[: rng.integers(len(content))],
    "beheaded": lambda content, rng: content[1 + rng.integers(len(content)) :],
    "bits flipped": _bits_flipped,
    "bytes replaced": _stretch(lambda held, rng: rng.bytes(len(held)), 40),
    "bytes inserted": _stretch(_noise, 0),
    "stretch lost": _stretch(lambda held, rng: b""),
    "stretch zeroed": _stretch(lambda held, rng: bytes(len(held)), 600),  # a block of the disk never written
    "stretch doubled": _stretch(lambda held, rng: held + held),
    "whole doubled": lambda content, rng: content + content,
    "noise": lambda content, rng: _noise(content, rng, 2000),
    "noise after beginning": lambda content, rng: content[:8] + _noise(content, rng, 2000),
    "another encoding": lambda content, rng: content.decode("latin-1").encode(
        str(rng.choice(["utf-16", "utf-16-le", "utf-32"]))
    ),
}


def _any_line(change: Callable[[Lines, int, Rng], Lines]) -> Callable[[Lines, Rng], Lines]:
    return lambda lines, rng: change(lines, int(rng.integers(len(lines))), rng)


def _lines_swapped(lines: Lines, rng: Rng) -> Lines:
    i, k = rng.integers(len(lines), size=2)
    changed = list(lines)
    changed[i], changed[k] = changed[k], changed[i]
    return changed


def _separator(row: bytes) -> bytes:
    return next((each for each in (b"\t", b";", b",", b" ") if each in row), b",")


def _header_place(lines: Lines) -> int:
    """Return the place of the headers: the first line with as many cells as one in the middle of the file."""
    row = lines[len(lines) // 2]
    mark = _separator(row)
    return next((i for i, line in enumerate(lines) if line[:1] != b"#" and line.count(mark) == row.count(mark)), 0)


def _header(change: Callable[[Lines, Rng], Lines]) -> Callable[[Lines, Rng], Lines]:
    """Return a damage that changes the names in the row of headers."""

    def damage(lines: Lines, rng: Rng) -> Lines:
        place, mark = _header_place(lines), _separator(lines[len(lines) // 2])
        return [*lines[:place], mark.join(change(lines[place].split(mark), rng)), *lines[place + 1 :]]

    return damage


def _unit_changed(names: Lines, rng: Rng) -> Lines:
    chosen = rng.integers(len(names))
    return [
        name.partition(b"_")[0] + b"_" + _UNITS[rng.integers(len(_UNITS))] if i == chosen else name
        for i, name in enumerate(names)
    ]


def _decimal_commas(lines: Lines, rng: Rng) -> Lines:
    """Write decimal commas as in half of Europe; columns separated by semicolons or still by commas."""
    place, mark = _header_place(lines), (b";", b",", b"\t")[rng.integers(3)]
    return lines[:place] + [line.replace(b",", mark).replace(b".", b",") for line in lines[place:]]


def _cell(new: Callable[[bytes, Rng], Lines]) -> Callable[[Lines, Rng], Lines]:
    """Return a damage that puts other cells into the place of one, below the header."""

    def damage(lines: Lines, rng: Rng) -> Lines:
        rows = [i for i in range(_header_place(lines) + 1, len(lines)) if lines[i]]
        if not rows:
            return lines
        row = int(rng.choice(rows))
        separator = _separator(lines[row])
        cells = lines[row].split(separator)
        chosen = int(rng.integers(len(cells)))
        cells[chosen : chosen + 1] = new(cells[chosen], rng)
        return [*lines[:row], separator.join(cells), *lines[row + 1 :]]

    return damage


def _json_damaged(lines: Lines, rng: Rng) -> Lines:
    chosen = [i for i, line in enumerate(lines) if line.startswith(b"#") and b":" in line]
    if not chosen:
        return lines
    i = int(rng.choice(chosen))
    text = _NO_METADATA[rng.integers(len(_NO_METADATA))]
    return [*lines[:i], lines[i].partition(b":")[0] + b": " + text, *lines[i + 1 :]]


def _signs_exchanged(lines: Lines, rng: Rng) -> Lines:
    return [b"\n".join(lines).replace(*_EXCHANGED[rng.integers(len(_EXCHANGED))])]


TEXT: dict[str, Callable[[Lines, Rng], Lines]] = {  # kinds of damage to the lines of a text
    "line doubled": _any_line(lambda lines, i, rng: [*lines[: i + 1], *lines[i:]]),
    "line lost": _any_line(lambda lines, i, rng: [*lines[:i], *lines[i + 1 :]]),
    "lines swapped": _lines_swapped,
    "headers shuffled": _header(lambda names, rng: [names[i] for i in rng.permutation(len(names))]),
    "header doubled": _header(lambda names, rng: [names[i] for i in rng.integers(len(names), size=len(names))]),
    "unit changed": _header(_unit_changed),
    "headers lost": lambda lines, rng: [*lines[: _header_place(lines)], *lines[_header_place(lines) + 1 :]],
    "decimal commas": _decimal_commas,
    "cell changed": _cell(lambda cell, rng: [_NO_READINGS[rng.integers(len(_NO_READINGS))]]),
    "cell lost": _cell(lambda cell, rng: []),
    "comments lost": lambda lines, rng: [line for line in lines if not line.startswith(b"#")],
    "JSON damaged": _json_damaged,
    "signs exchanged": _signs_exchanged,
}


def damaged(content: bytes, kind: str, rng: Rng) -> bytes:
    """Return the content of a file after a damage of that kind."""
    return ANY_FILE[kind](content, rng) if kind in ANY_FILE else b"\n".join(TEXT[kind](content.split(b"\n"), rng))


class Sound(NamedTuple):
    """An intact file: what it holds, and the function that reads it."""

    content: bytes
    traces: list[Trace]
    read: Callable[[Path], list[Trace]]


def _reader(mapping: ColumnMap) -> Callable[[Path], list[Trace]]:
    return lambda path: list(load_foreign(path, mapping).records)


@functools.cache
def sound(suffix: str) -> tuple[Sound, ...]:
    """Return intact files: one cut, three of the same fields, two of different ones; for ".txt" one a dialect."""
    rng = np.random.default_rng(0)
    time = np.arange(60) * 1e-3
    full = Trace(
        time=time,
        force=rng.normal(2.0, 0.5, 60),
        position=0.01 * time,
        speed=np.full(60, 0.01),
        angle=np.full(60, 1.3),
        depth=np.full(60, 0.02),
        metadata={"rig": "bench 2", "operator": "P07", "calibration": {"gain": [1.25, None]}},
    )
    if suffix == ".txt":
        trace = Trace(time=full.time, force=full.force, position=full.position)
        return tuple(Sound(each.write(trace), [trace], _reader(each.mapping(trace))) for each in DIALECTS.values())
    found = []
    short = Trace(time=time[:20], force=np.sin(time[:20]), force_unit="1", metadata={"n": 3})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"sound{suffix}"
        for traces in ([full], [full.select(slice(i, i + 30)) for i in range(3)], [full, short]):
            save(traces, path)
            found.append(Sound(path.read_bytes(), traces, load))
    return tuple(found)


KINDS = {suffix: (*ANY_FILE, *TEXT) for suffix in (".csv", ".txt")} | dict.fromkeys(
    (".parquet", ".h5", ".mcap"), tuple(ANY_FILE)
)
"""Kinds of damage by suffix; ".txt" stands for the dialects of other programs."""


def case(number: int) -> tuple[str, str, bytes, Sound]:
    """Return the case of that number: suffix, kind of damage, damaged content, and the intact file."""
    rng = np.random.default_rng(number)
    suffix = str(rng.choice(list(KINDS)))
    kind = str(rng.choice(KINDS[suffix]))
    file = sound(suffix)[rng.integers(len(sound(suffix)))]
    return suffix, kind, damaged(file.content, kind, rng), file


def ending(path: Path, content: bytes, file: Sound) -> str:
    """Return how the loading of such a file ends: one of :data:`CLEAR`, or the error that it must not end in."""
    path.write_bytes(content)
    try:
        loaded = file.read(path)
    except RecordError as error:
        return "refused" if str(path) in str(error) and len(error.reason) > 20 else f"unclear: {error}"
    except Exception as error:  # the kind of error that this script searches for
        return f"{type(error).__name__}: {error}"[:100]
    same = loaded == file.traces if file.read is load else _alike(loaded, file.traces)
    return "loaded as it was" if same else "loaded otherwise"


def _alike(loaded: list[Trace], written: list[Trace]) -> bool:
    """Return whether the same numbers came back, but for rounding in another program's units."""
    return len(loaded) == len(written) and all(
        one.known == other.known
        and len(one) == len(other)
        and all(np.allclose(getattr(one, name), getattr(other, name), rtol=1e-12, atol=0.0) for name in one.known)
        for one, other in zip(loaded, written, strict=True)
    )


def _work(numbers: range, answer: multiprocessing.connection.Connection) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for number in numbers:
            suffix, kind, content, file = case(number)
            answer.send((suffix, kind, ending(Path(folder) / f"damaged{suffix}", content, file)))


def guarded(numbers: range) -> list[tuple[str, str, str]]:
    """Return suffix, kind and ending of cases run in another process, a new one after a crash or a standstill."""
    context = multiprocessing.get_context("spawn" if os.name == "nt" else "forkserver")
    found: list[tuple[str, str, str]] = []
    while len(found) < len(numbers):
        answer, question = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(numbers[len(found) :], question))
        process.start()
        question.close()
        how = "does not end"
        try:
            while answer.poll(_DEADLINE):
                found.append(answer.recv())
        except EOFError:
            how = "crash"
        finally:
            process.kill()
            process.join()
        if len(found) < len(numbers):
            number = numbers[len(found)]
            found.append((*case(number)[:2], f"{how} (case {number})"))
    return found


def table(found: Counter[tuple[str, str, str]]) -> str:
    """Return aligned text: a row for each format and kind of damage, a column for each ending."""
    rows = []
    for which in [(suffix, kind) for suffix in KINDS for kind in KINDS[suffix]]:
        counts = [found[*which, how] for how in CLEAR]
        rest = sum(n for (*what, _), n in found.items() if tuple(what) == which) - sum(counts)
        rows.append([*which, *counts, rest])
    rows.append(["all", "", *(sum(column) for column in list(zip(*rows, strict=True))[2:])])
    heads = ["file", "damage", *CLEAR, "anything else"]
    return "\n".join("{:8} {:21} {:>10} {:>16} {:>16} {:>13}".format(*row) for row in [heads, *rows])


def accidents(numbers: range) -> bool:
    """Damage, load and print; return whether every ending is clear."""
    with multiprocessing.pool.ThreadPool(cores()) as pool:
        parts = pool.map(guarded, [numbers[i : i + 50] for i in range(0, len(numbers), 50)], chunksize=1)
    found = Counter(itertools.chain.from_iterable(parts))
    print(table(found))
    unclear = Counter(how for *_, how in found.elements() if how not in CLEAR)
    for how, n in unclear.items():
        print(f"{n} times {how}")
    return not unclear


def acceptance(n: int) -> bool:
    """Read ``n`` valid records in the dialects of other programs and print; return whether 95 % are accepted."""
    ends, dialects = Counter[str](), list(DIALECTS.values())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.csv"
        for seed in range(n):
            record, dialect = valid_record(seed), dialects[seed % len(dialects)]
            path.write_bytes(dialect.write(record.trace))
            try:
                imported = load_foreign(path, dialect.mapping(record.trace))
            except RecordError as error:
                ends[f"not read: {error.reason[:100]}"] += 1
            else:
                refusing = sorted({flaw.kind for found in imported.flaws for flaw in found if flaw.refuse})
                ends[f"refused for {' and '.join(refusing)}" if refusing else "accepted"] += 1
    print(f"{n} valid records with mild noise: {', '.join(f'{count} {end}' for end, count in ends.most_common())}")
    return ends["accepted"] >= _ENOUGH * n


def main() -> int:
    """Print; return 1 if a damaged file ends in anything but a clear error, or too few valid records are accepted."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=20_000, metavar="N", help="damaged files; default 20000")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="number of the first of these; default 0")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="write these there, and do nothing else")
    parser.add_argument("--valid", type=int, default=1000, metavar="N", help="valid records; default 1000")
    arguments = parser.parse_args()
    numbers = range(arguments.first, arguments.first + arguments.files)
    if arguments.keep:
        arguments.keep.mkdir(parents=True, exist_ok=True)
        for number in numbers:
            suffix, kind, content, _ = case(number)
            (arguments.keep / f"{number}_{kind.replace(' ', '_')}{suffix}").write_bytes(content)
        return 0
    clear = accidents(numbers)
    return 0 if acceptance(arguments.valid) and clear else 1


if __name__ == "__main__":
    sys.exit(main())
