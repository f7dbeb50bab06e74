"""Errors of a rig."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass


class RigError(Exception):
    """Error for a rig that is missing, not as expected, or unable to do what is asked; the message gives the cure."""
