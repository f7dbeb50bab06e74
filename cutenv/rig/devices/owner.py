"""Process that owns a rig: a forked child inherits memory and sockets, and must not use them."""

from __future__ import annotations

import os

from cutenv.rig.errors import RigError


class Owner:
    """Process in which this object is made."""

    def __init__(self) -> None:
        self._process = os.getpid()

    @property
    def here(self) -> bool:
        """True in that process, False in a fork of it."""
        return os.getpid() == self._process

    def check(self) -> None:
        """Raise an error in a fork.

        Raises
        ------
        RigError
            If this is another process.
        """
        if not self.here:
            raise RigError(
                f"this process is a fork of the one that has the rig ({self._process}), which alone may use it. "
                "Start the policy's workers before the rig is opened, and let them decide, not move."
            )
