"""Files written whole, progress, and a reader that may end.

A file is written by a temporary name, flushed (fsync) and renamed.
"""

from __future__ import annotations

import os
import secrets
import select
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

_SHOWN = 40  # characters of the name kept in the temporary one: a file name may have 255 bytes


T = TypeVar("T")


@contextmanager
def progress_bar(description: str, unit: str, *, total: int | None = None) -> Iterator[Callable[[int], object]]:
    """Show a progress bar on standard error, given tqdm; yield what counts units."""
    try:
        from tqdm import tqdm  # an extra
    except ModuleNotFoundError:
        yield lambda count: None
        return
    with tqdm(total=total, desc=description, unit=unit, file=sys.stderr, leave=False) as bar:
        yield bar.update


def watched(items: Iterable[T], description: str, unit: str, *, total: int | None = None) -> Iterator[T]:
    """Yield the items, with a :func:`progress_bar`."""
    length = len(items) if total is None and isinstance(items, Sized) else total
    with progress_bar(description, unit, total=length) as count:
        for item in items:
            yield item
            count(1)


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path that replaces ``path`` at the end.

    Until then `path` is unchanged or missing; an exception in the block removes the temporary file. A process that is
    killed leaves it behind, as ``NAME.DIGITS.part.SUFFIX`` beside `path`; it may be deleted.  A link stays, and what it
    points to is replaced.  The temporary path has the same folder and suffix and a random name: two processes that
    write the same file do not mix, and the last one to finish wins.  OSError if the file cannot be written or put in
    place.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "numbers.txt"
    >>> with atomic_write(target) as part:
    ...     _ = part.write_text("1 2 3")
    ...     print(target.exists())
    False
    >>> target.read_text()
    '1 2 3'
    """
    target = Path(os.path.realpath(path))
    part = target.with_name(f"{target.stem[:_SHOWN]}.{secrets.token_hex(4)}.part{target.suffix}")
    try:
        yield part
        _flush(part)
        put_in_place(part, target)
    except BaseException:  # also when interrupted from the keyboard
        part.unlink(missing_ok=True)
        raise


def put_in_place(part: Path, target: Path) -> None:
    """Rename a whole, flushed file within its folder."""
    part.replace(target)
    _flush_folder(target.parent)


def check_writable(what: str, folder: Path) -> None:
    """Raise OSError, naming ``what``, if a folder is not writable."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise OSError(f"{what} {folder}: nothing can be written there ({reason}). Give another place.") from None


def whole_files(paths: Iterable[Path]) -> list[Path]:
    """Return paths in order, without :func:`atomic_write`'s temporary files."""
    return sorted(path for path in paths if ".part" not in path.suffixes[-2:-1])


def _flush(file: Path) -> None:
    """Flush a file to disk before renaming, against power cuts."""
    with file.open("r+b") as opened:
        os.fsync(opened.fileno())


def _flush_folder(folder: Path) -> None:
    """Flush a directory (fsync) on POSIX, so that renames survive."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def reader_has_gone() -> bool:
    """Return True if standard output is a closed pipe (not Windows)."""
    if not hasattr(select, "poll"):
        return False
    watched = select.poll()
    watched.register(sys.stdout.fileno(), 0)
    return bool(watched.poll(0))
