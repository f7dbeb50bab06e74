"""Pictures of a cut in progress.

Drawing needs pygame-ce, which the extra ``cutenv[view]`` installs.
"""

from __future__ import annotations

from cutenv.display.viewer.drawn_slab import Slab
from cutenv.display.viewer.scene import ForceTrace, Layout, Moment
from cutenv.display.viewer.window import CutViewer

__all__ = ["CutViewer", "ForceTrace", "Layout", "Moment", "Slab"]
