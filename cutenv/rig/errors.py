"""Errors of a rig."""

from __future__ import annotations


class RigError(Exception):
    """Error for a rig that cannot do what is asked.

    It is missing, not as expected, or unable to do it; the message gives the cure.
    """
