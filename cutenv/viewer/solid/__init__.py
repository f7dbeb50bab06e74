"""View of a recorded cut in 3-D, as one page that opens from disk; needs meshcat, of ``cutenv[view3d]``."""

from __future__ import annotations

from cutenv.viewer.solid.page import write_view
from cutenv.viewer.solid.shown_cut import COLOURS, ShownCut

__all__ = ["COLOURS", "ShownCut", "write_view"]
