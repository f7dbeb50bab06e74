"""Lock of a server on its class's folder, released with its process."""

from __future__ import annotations

import errno
import os
from pathlib import Path

CLAIM_FILE = "server.lock"
"""Name of the file in the class's folder. It stays when a server has ended, and then claims nothing."""

_TAKEN = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)  # others: a disk without locks, where nothing is known


class FolderClaim:
    """Lock on a folder that names its server to the next one.

    Parameters
    ----------
    folder : Path
        Folder of a class.
    address : str
        Address of the server.

    Attributes
    ----------
    other : str
        Address of a server in another process that has the folder already; empty if there is none.
    """

    def __init__(self, folder: Path, address: str) -> None:
        self._file = (folder / CLAIM_FILE).open("a+", encoding="utf-8")
        self.other = ""
        if self._is_taken():
            self._file.seek(1)  # the first byte is what is locked
            self.other = self._file.read().strip() or "an address that is not known"
        else:
            self._file.truncate(0)
            self._file.write(f" {address}\n")
            self._file.flush()

    def _is_taken(self) -> bool:
        """Lock the first byte; return True if another process has it."""
        try:
            if os.name == "nt":
                import msvcrt

                self._file.seek(0)
                msvcrt.locking(self._file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
            else:
                import fcntl

                fcntl.lockf(self._file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB, 1, 0)
        except OSError as error:
            return error.errno in _TAKEN
        return False

    def close(self) -> None:
        """Give the folder back."""
        self._file.close()
