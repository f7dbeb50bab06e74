"""The process that has a rig: a forked child has its memory and its sockets too, and must not speak for it."""

from __future__ import annotations

import os

from cutenv.rig.drivers import RigError


class Owner:
    """The process in which it is made."""

    def __init__(self) -> None:
        self._process = os.getpid()

    @property
    def here(self) -> bool:
        """Whether this is that process, and no fork of it."""
        return os.getpid() == self._process

    def check(self) -> None:
        """Refuse whatever a fork asks for.

        Raises
        ------
        RigError
            If this is another process.
        """
        if not self.here:
            raise RigError(
                f"this process is a fork of the one that has the rig ({self._process}), which alone may speak for it. "
                "Start the policy's workers before the rig is opened, and let them decide, not move."
            )
