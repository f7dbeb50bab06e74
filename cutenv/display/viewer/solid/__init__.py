"""View of a recorded cut in 3-D, as one page.

It opens from disk; it needs meshcat, of ``cutenv[view3d]``.
"""

from __future__ import annotations

from cutenv.display.viewer.solid.curved_cut import CurvedCut
from cutenv.display.viewer.solid.solids import COLOURINGS, ShownCut
from cutenv.display.viewer.solid.view_page import write_curved_view, write_view

__all__ = ["COLOURINGS", "CurvedCut", "ShownCut", "write_curved_view", "write_view"]
