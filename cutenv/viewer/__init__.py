"""Pictures of a cut in progress.

Drawing needs pygame-ce, which the extra ``cutenv[view]`` installs.
"""

from __future__ import annotations

from cutenv.viewer.drawn_slab import Slab
from cutenv.viewer.scene import ForceTrace, Layout, Moment
from cutenv.viewer.window import CutViewer

__all__ = ["CutViewer", "ForceTrace", "Layout", "Moment", "Slab"]
