"""Pictures of cuts, and pages of results.

- :mod:`~cutenv.display.viewer`: window, picture and 3-D view of a cut in progress (extras ``view``, ``view3d``);
- :mod:`~cutenv.display.report`: figures and HTML pages of records, studies, trainings and calibrations (extra
  ``view``).

May import: vision, task, records, sim.
"""

from __future__ import annotations

from cutenv._base.imports import import_when_used

__all__ = ["report", "viewer"]

__getattr__ = import_when_used(__name__, {}, __all__)
