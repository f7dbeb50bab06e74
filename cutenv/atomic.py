"""Files that are whole or not there: written under another name, flushed to the disk, and then renamed."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_SHOWN = 40  # characters of the name that the unfinished file shares: a name has room for 255 bytes


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give the name of an unfinished file that takes the place of ``path`` when the block ends.

    Until then `path` is what it was, or missing; an exception in the block removes the unfinished file. A
    process that is killed leaves it behind, as ``NAME.DIGITS.part.SUFFIX`` beside `path`; it may be deleted.

    Parameters
    ----------
    path : path
        Of the finished file; a link stays, and what it points to is replaced.

    Yields
    ------
    Path
        In the same folder and with the same suffix, not existing yet, and nobody else's: two processes that
        write the same file do not mix, the last one to finish stands.

    Raises
    ------
    OSError
        If the file cannot be written or put in place.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "numbers.txt"
    >>> with replacing(target) as part:
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
        part.replace(target)
    except BaseException:  # also when interrupted from the keyboard
        part.unlink(missing_ok=True)
        raise
    _flush_folder(target.parent)


def _flush(file: Path) -> None:
    """Let the content reach the disk before its name does: after a power cut a name must not stand for less."""
    with file.open("r+b") as opened:
        os.fsync(opened.fileno())


def _flush_folder(folder: Path) -> None:
    """Let the new name reach the disk, where folders can be opened: not on Windows, which keeps them itself."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
