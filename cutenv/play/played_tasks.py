"""Tasks of a session, each with its kind of cut."""

from __future__ import annotations

from cutenv.play.played_cut import PlayedCut
from cutenv.play.played_depth_cut import PlayedDepthCut
from cutenv.play.played_path_cut import PlayedPathCut
from cutenv.play.shared_cut import SharedCut

PLAYED_TASKS: dict[str, type[PlayedCut]] = {
    "gentle": PlayedCut,
    "depth": PlayedDepthCut,
    "path": PlayedPathCut,
    "shared": SharedCut,
}
"""Cut of each task."""
