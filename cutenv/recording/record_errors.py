"""Error that every reader of records raises for a bad file."""

from __future__ import annotations

import os
from pathlib import Path


class RecordError(ValueError):
    """Error for a file that is not a record, or is damaged: it names the file, the place, the reason and the cure.

    Parameters
    ----------
    path : path
        Path of the file.
    reason : str
        Place, reason and cure, in the reader's words.

    Attributes
    ----------
    path : Path
        Path of the file.
    reason : str
        Reason as given.
    """

    def __init__(self, path: str | os.PathLike[str], reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = Path(path)
        self.reason = reason

    def __reduce__(self) -> tuple[type[RecordError], tuple[Path, str]]:
        return type(self), (self.path, self.reason)  # by its own arguments, so that it can be pickled between processes
