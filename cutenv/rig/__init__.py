"""Real rig: motors and force sensor behind the simulator's interface, with safety.

- :mod:`~cutenv.rig.safety`: the supervisor, its monitors, causes of a stop and quick stops;
- :mod:`~cutenv.rig.devices`: protocols and registry of drivers, and the drivers of the thesis's rig;
- :mod:`~cutenv.rig.plugins`: further drivers, and the conformance that anybody's driver is tried by;
- :mod:`~cutenv.rig.operation`: operator, checks before motion, session and recorder;
- :mod:`~cutenv.rig.config`: a rig's settings, calibrations and identified constants;
- :mod:`~cutenv.rig.imitated`: the emulator on real wires and the fake in memory;
- ``spine``, ``spine_process``, ``remote_spine``: the process of its own in which safety and drivers run.

Where a blade moves, all but ``imitated`` and the drivers that the rig's file does not name has to be believed. Drivers
and imitated rigs are loaded by name alone.

May import: vision, task, records, sim.
"""

from __future__ import annotations

from cutenv._base.imports import import_when_used

__all__ = ["config", "devices", "drivers", "imitated", "operation", "safety"]

__getattr__ = import_when_used(__name__, {}, __all__)
