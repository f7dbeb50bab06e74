"""Damage record files in every way and load them: each must load or end in a clear error.

    python scripts/malformed_records.py                   10,000 files
    python scripts/malformed_records.py --files 500       fewer
    python scripts/malformed_records.py --first 1234 --files 1 --keep FOLDER      one case, kept to look at

Prints how the loading of each kind of damage ended. A file that loads to other numbers than were written to it has a
digit changed in a way that cannot be detected. What must not happen is any error but RecordError, a crash of the
process or a loading that does not end. Exit status 1 if it does.
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
from pathlib import Path

import numpy as np
from record_damage import DAMAGES, SUFFIXES, damaged

from cutenv._engine.parallel import cores
from cutenv.recording import RecordError, load, save
from cutenv.trace import Trace

CLEAR = ("refused", "loaded as it was", "loaded otherwise")
_START, _DEADLINE = 20.0, 1.0  # seconds for a process to start, and for each file
_AT_ONCE = 50  # files for one process


@functools.cache
def sound(suffix: str) -> tuple[tuple[bytes, list[Trace]], ...]:
    """Return intact files: one cut; three of the same fields; two of different fields; and their traces."""
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
    short = Trace(time=time[:20], force=np.sin(time[:20]), force_unit="1", metadata={"n": 3})
    found = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"sound{suffix}"
        for traces in ([full], [full.select(slice(i, i + 30)) for i in range(3)], [full, short]):
            save(traces, path)
            found.append((path.read_bytes(), traces))
    return tuple(found)


def ending(content: bytes, suffix: str, traces: list[Trace], folder: Path) -> str:
    """Return how the loading of such a file ends: one of :data:`CLEAR`, or the error that it must not end in."""
    path = folder / f"damaged{suffix}"
    path.write_bytes(content)
    try:
        return "loaded as it was" if load(path) == traces else "loaded otherwise"
    except RecordError as error:
        return "refused" if str(path) in str(error) and len(error.reason) > 20 else f"unclear: {error}"
    except Exception as error:  # the kind of error that this script searches for
        return f"{type(error).__name__}: {error}"[:100]


def case(number: int) -> tuple[str, str, bytes, list[Trace]]:
    """Return the case of that number: suffix, kind of damage, content, and the traces of the intact file."""
    rng = np.random.default_rng(number)
    suffix = str(rng.choice(SUFFIXES))
    kind = str(rng.choice(DAMAGES[suffix]))
    files = sound(suffix)
    content, traces = files[rng.integers(len(files))]
    return suffix, kind, damaged(content, kind, rng), traces


def endings(numbers: range, folder: Path) -> list[tuple[str, str, str]]:
    """Return suffix, kind of damage and ending of some cases, run in this process."""
    found = []
    for number in numbers:
        suffix, kind, content, traces = case(number)
        found.append((suffix, kind, ending(content, suffix, traces, folder)))
    return found


def _work(numbers: range, answer: multiprocessing.connection.Connection) -> None:
    with tempfile.TemporaryDirectory() as folder:
        answer.send(endings(numbers, Path(folder)))


def guarded(numbers: range) -> list[tuple[str, str, str]]:
    """Run :func:`endings` in a separate process, so that a crash or a standstill counts as an ending."""
    context = multiprocessing.get_context("spawn" if os.name == "nt" else "forkserver")
    answer, question = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(numbers, question))
    process.start()
    question.close()
    try:
        if answer.poll(_START + _DEADLINE * len(numbers)):
            return list(answer.recv())
        how = "does not end"
    except EOFError:
        how = "crash"
    finally:
        process.kill()
        process.join()
    if len(numbers) > 1:
        half = len(numbers) // 2
        return [*guarded(numbers[:half]), *guarded(numbers[half:])]
    suffix, kind, _, _ = case(numbers[0])
    return [(suffix, kind, f"{how} (case {numbers[0]})")]


def table(found: Counter[tuple[str, str, str]]) -> str:
    """Return aligned text: a row for each format and kind of damage, a column for each ending."""
    heads = ["file", "damage", *CLEAR, "anything else"]
    rows = []
    for which in [[suffix, kind] for suffix in SUFFIXES for kind in DAMAGES[suffix]]:
        of_kind = {how: n for (*what, how), n in found.items() if what == which}
        rest = sum(n for how, n in of_kind.items() if how not in CLEAR)
        rows.append([*which, *(str(of_kind.get(how, 0)) for how in CLEAR), str(rest)])
    rows.append(["all", "", *(str(sum(int(row[i]) for row in rows)) for i in range(2, len(heads)))])
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    return "\n".join("  ".join(map(_padded, range(len(heads)), row, widths)) for row in [heads, *rows])


def _padded(column: int, cell: str, width: int) -> str:
    return cell.ljust(width) if column < 2 else cell.rjust(width)


def main() -> int:
    """Damage, load and print; return 1 if any ending is not clear."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=10_000, metavar="N", help="default 10000")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="number of the first case; default 0")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="write the files there, do not load them")
    arguments = parser.parse_args()
    numbers = range(arguments.first, arguments.first + arguments.files)
    if arguments.keep:
        arguments.keep.mkdir(parents=True, exist_ok=True)
        for number in numbers:
            suffix, kind, content, _ = case(number)
            (arguments.keep / f"{number}_{kind}{suffix}").write_bytes(content)
        return 0
    with multiprocessing.pool.ThreadPool(cores()) as pool:
        parts = pool.map(guarded, [numbers[i : i + _AT_ONCE] for i in range(0, len(numbers), _AT_ONCE)], chunksize=1)
    found = Counter(itertools.chain.from_iterable(parts))
    print(table(found))
    unclear = {ending: n for (_, _, ending), n in found.items() if ending not in CLEAR}
    for how, n in unclear.items():
        print(f"{n} times {how}")
    return 1 if unclear else 0


if __name__ == "__main__":
    sys.exit(main())
