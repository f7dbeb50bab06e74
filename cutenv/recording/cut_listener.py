"""Interface of whatever listens to cuts while they go on."""

from __future__ import annotations

from typing import Protocol

from cutenv._base.arrays import Array, StructArray


class CutListener(Protocol):
    """Listener to the cuts of a rig or a person while they go on; it must neither wait nor raise."""

    def began(self, name: str) -> None:
        """Take the beginning of a cut."""
        ...

    def readings(self, readings: StructArray, depth: Array, origin: float) -> None:
        """Take new readings, the depth at each [m], and when their time was zero by ``time.monotonic()`` [s]."""
        ...

    def ended(self, cause: str) -> None:
        """Take the end of a cut and its cause."""
        ...
