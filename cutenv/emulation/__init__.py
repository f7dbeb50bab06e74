"""Emulated and fake rigs, apart from the code that moves hardware.

- :mod:`~cutenv.emulation.process`: the emulated rig in a process of its own, on the same wires as a real one;
- :mod:`~cutenv.emulation.control_port`: requests to it that no real rig could answer;
- :mod:`~cutenv.emulation.fake_rig`: drivers in memory, on a clock of their own, with every fault at any instant;
- :mod:`~cutenv.emulation.fake_benches`: a specimen, a recorded cut, or nothing, under the blade of a fake rig.

- :mod:`~cutenv.emulation.emulated_drive`, ``emulated_axis``, ``can_hub``: a drive on the bus, its states and motor, and
  the bus; ``sensor_server``, ``firmware``: a Net F/T, and the boards of serial rigs.

The other modules are parts of these. ``cutenv.rig`` knows none of them: where a blade moves, none has to
be believed.

May import: drivers, rig, display, vision, task, records, sim.
"""

from __future__ import annotations

from cutenv._base.imports import import_when_used

__all__ = ["control_port", "emulated_drive", "fake_benches", "fake_rig", "process"]

__getattr__ = import_when_used(__name__, {}, __all__)
