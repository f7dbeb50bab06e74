"""The error of a metric that cannot be computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass


class Unavailable(ValueError):
    """The reason why a metric cannot be computed from a cut."""
