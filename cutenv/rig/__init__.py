"""Real rig: motors and force sensor behind the simulator's interface, with safety.

- :mod:`~cutenv.rig.safety`: the supervisor, its monitors, causes of a stop and quick stops;
- :mod:`~cutenv.rig.devices`: clock and loop, protocols and registry of drivers, and those of CAN drives, boards and a
  Net F/T;
- :mod:`~cutenv.rig.operation`: operator, checks before motion, session and recorder;
- :mod:`~cutenv.rig.config`: a rig's settings, calibrations and identified constants;
- ``spine``, ``spine_process``, ``remote_spine``: the process of its own in which safety and drivers run;
- ``plant``, ``travel``: the rig as an environment drives it; ``toml_file``, ``contradictions``: its file.

Where a blade moves, all of it but the drivers that the rig's file does not name has to be believed. Optional drivers
(:mod:`cutenv.drivers`) are loaded by name alone, if the file names them; emulated rigs (:mod:`cutenv.emulation`) never
are.

May import: vision, task, records, sim.
"""

from __future__ import annotations

from cutenv._base.imports import import_when_used

__all__ = ["config", "devices", "operation", "safety"]

__getattr__ = import_when_used(__name__, {}, __all__)
