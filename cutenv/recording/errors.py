"""The one kind of error in which the reading of a bad record ends."""

from __future__ import annotations

import os
from pathlib import Path


class RecordError(ValueError):
    """A file that is no record, or a record that is not to be trusted: which file, where in it, why, and the cure.

    Parameters
    ----------
    path : path
        Of the file.
    reason : str
        Where, what and the cure, in the reader's words.

    Attributes
    ----------
    path : Path
        Of the file.
    reason : str
        As given.
    """

    def __init__(self, path: str | os.PathLike[str], reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = Path(path)
        self.reason = reason

    def __reduce__(self) -> tuple[type[RecordError], tuple[Path, str]]:
        return type(self), (self.path, self.reason)  # by its own arguments, so that it crosses processes
