"""Errors of a rig."""

from __future__ import annotations


class RigError(Exception):
    """Error for a rig that is missing, not as expected, or unable to do what is asked; the message gives the cure."""
