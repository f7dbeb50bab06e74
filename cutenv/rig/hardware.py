"""Rig made from its file.

Its plant, and the spine through which it is moved.
"""

from __future__ import annotations

import os
from pathlib import Path

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.host import Clock
from cutenv.rig.plant import RigPlant
from cutenv.rig.remote_spine import RemoteSpine
from cutenv.rig.spine import mounted_spine


def rig_plant(
    settings: RigSettings, clock: Clock | None = None, *, file: str | os.PathLike[str] | None = None
) -> RigPlant:
    """Make a rig's plant, real or emulated, without connecting.

    Its spine has a process of its own, unless a ``clock`` is given: drivers and safety then run by it, in this process.
    Beside the rig's ``file``, with the ending ``.proven``, the day is noted on which the stop button was proven.

    Raises
    ------
    ValueError
        In this process, if a driver that the rig's file names does not exist, or refuses its settings; otherwise
        they are made, and refused, when it is opened.
    """
    note = None if file is None else Path(file).with_suffix(".proven")
    return RigPlant(RemoteSpine(settings) if clock is None else mounted_spine(settings, clock), note)
