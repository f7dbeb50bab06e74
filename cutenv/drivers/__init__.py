"""Optional drivers, profiles and names of rigs, and the conformance tests for any driver.

- :mod:`~cutenv.drivers.grbl_axis`: axis of a machine with GRBL, "grbl";
- :mod:`~cutenv.drivers.analogue_sensor`: six-axis sensor by a board of National Instruments, "analogue";
- :mod:`~cutenv.drivers.robotiq_sensor`, :mod:`~cutenv.drivers.bota_sensor`: force sensors with a serial line,
  "robotiq" and "bota"; both read their frames by ``framed_sensor``;
- :mod:`~cutenv.drivers.slow_profile`: settings of a slow rig, with the serial board or with GRBL;
- :mod:`~cutenv.drivers.rig_names`: settings of a rig by its name, or of its file;
- :mod:`~cutenv.drivers.conformance`: what every driver is tried by, of this package or another.

The rig finds them as it finds those of other packages, by ``module:attribute``, but in a table of its registry. Entry
points would need a new installation for a new driver, and would be missing where the source alone is on the path.

May import: rig, display, vision, task, records, sim.
"""

from __future__ import annotations

from cutenv._base.imports import import_when_used

__all__ = ["analogue_sensor", "bota_sensor", "conformance", "grbl_axis", "rig_names", "robotiq_sensor", "slow_profile"]

__getattr__ = import_when_used(__name__, {}, __all__)
