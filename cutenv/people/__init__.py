"""People who cut in a window, a browser or a class.

Law, task and score are those of an agent.

- :mod:`~cutenv.people.play`: a hand led by mouse, gamepad or haptic device; courses of lessons (extra ``play``);
- :mod:`~cutenv.people.browser`: the same cut as WebAssembly, in a page that fetches nothing;
- :mod:`~cutenv.people.classroom`: server of a class, with codes, courses, records and grades (extra ``serve``).

May import: agents, envs, emulation, drivers, rig, display, vision, task, records, sim.
"""

from __future__ import annotations

from cutenv._base.imports import import_when_used

__all__ = ["browser", "classroom", "play"]

__getattr__ = import_when_used(__name__, {}, __all__)
