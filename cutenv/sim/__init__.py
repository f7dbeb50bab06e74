"""Simulator of a cut: tissue, cutting law, drive and sensor.

Everything physical is here, and nothing of a task, an agent or a file. Start with :mod:`~cutenv.sim.cutting`: its
module ``law`` has the growth of the crack, ``update`` a millisecond of a cut with the start of a run.

- :mod:`~cutenv.sim.tissue`: finite-element model of the slab, measured moduli and toughness, specimens drawn from them;
- :mod:`~cutenv.sim.cutting`: crack growth under a driven blade, the drive, the force sensor, and the motions of a blade
  (straight, up and down, steered);
- :mod:`~cutenv.sim.plant`: one interface for the simulated cut, a replayed record and a rig;
- :mod:`~cutenv.sim.trace`: what was moved and felt in one cut, as arrays in SI units;
- :mod:`~cutenv.sim.quantities`: quantities of a cut that the reward charges and the score reports, defined once.

May import: nothing of the package but its compiled engine and its helpers (``cutenv._engine``, ``cutenv._base``).
"""

from __future__ import annotations

from cutenv._base.imports import import_when_used

__all__ = ["cutting", "plant", "quantities", "tissue", "trace"]

__getattr__ = import_when_used(__name__, {}, __all__)
