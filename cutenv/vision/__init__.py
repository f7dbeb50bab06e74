"""Depth of cut from video, beads tracked in two X-ray views, and their displacements against the model.

The specimen's frame is that of :class:`cutenv.tissue.cut_model.CutModel`: x across the cut line, y along it from the
clamp, z up from the plate [m].
"""

from cutenv.vision.bead_tracks import BeadTracks

__all__ = ["BeadTracks"]
