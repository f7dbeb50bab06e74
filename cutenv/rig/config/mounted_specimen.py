"""Specimen on a rig's bench: drawn, or measured by caliper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cutenv._base.validation import array_in_range
from cutenv.rig.config.settings import RigSettings
from cutenv.sim.quantities import SHALLOWEST
from cutenv.sim.tissue.description import TissueDescription
from cutenv.sim.tissue.grid import N_POINTS, SPACING
from cutenv.sim.tissue.layers import Layers
from cutenv.sim.tissue.lines import CutLine
from cutenv.sim.tissue.specimen import Specimen
from cutenv.task.beginning import SHORTEST


@dataclass(frozen=True, kw_only=True)
class MountedSpecimen:
    """Specimen on the bench, by its key or as an object."""

    seed: int = 0
    episode: int = 0
    specimen_class: str = "liver"
    tissue: TissueDescription | None = None
    specimen: Specimen | None = None
    """Specimen that is given instead of drawn; seed and episode then only select the sensor's noise."""
    layers: Layers | None = None  # layers over its depth, for a rig with a height axis; default one tissue throughout
    line: CutLine | None = None
    """Line along which its profiles lie, for a rig with an axis to the side; default the axis of the slab."""

    def drawn(self) -> Specimen:
        """Return the specimen; raise ValueError for invalid seed, episode or class."""
        if self.specimen is not None:
            return self.specimen
        return Specimen.drawn(self.seed, self.episode, specimen_class=self.specimen_class, tissue=self.tissue)


MAX_DEPTH = 0.060
"""Largest depth of cut allowed in a profile; the smallest is :data:`~cutenv.sim.quantities.SHALLOWEST` [m]."""
_FIRST = 0.001  # [m] from the clamp, within which a profile has to begin
_CURE = "Measure the specimen by caliper: depth_profile = [[position_mm, depth_mm], ...], from the clamp on."


def check_depth_profile(profile: Sequence[tuple[float, float]], reach: float) -> None:
    """Raise an error for a profile that misses part of a cut.

    ``profile``: points from the clamp on [m]; ``reach``: distance from the clamp that it has to cover [m]. Raise
    ValueError if it has fewer than 2 points, positions do not rise from the clamp to `reach`, or a depth is not within
    1 to 60 mm; in mm, as in the file.
    """
    if len(profile) < 2:
        raise ValueError(f"depth_profile has {len(profile)} points, and needs 2 or more. {_CURE}")
    position, depth = 1e3 * np.asarray(profile, dtype=np.float64).T  # [mm]
    array_in_range("depth_profile's position", position, -1e3, 1e3, "mm", _CURE)
    array_in_range("depth_profile's depth", depth, 1e3 * SHALLOWEST, 1e3 * MAX_DEPTH, "mm", _CURE)
    for i in np.flatnonzero(np.diff(position) <= 0.0)[:1]:
        raise ValueError(
            f"depth_profile goes from {position[i]:g} to {position[i + 1]:g} mm; positions must rise. Sort its points."
        )
    if position[0] > 1e3 * _FIRST:
        raise ValueError(f"depth_profile begins at {position[0]:g} mm, and must within 1 mm of the clamp. {_CURE}")
    if position[-1] < 1e3 * reach * (1.0 - 1e-12):  # 0.06 m are 60 mm
        raise ValueError(
            f"depth_profile ends at {position[-1]:g} mm, and the blade goes to {1e3 * reach:g} mm. Measure on, or cut"
            " less far."
        )


def measured_depth(settings: RigSettings, target: float | None = None) -> NDArray[np.float64]:
    """Return the measured depth every 0.5 mm, shape (301,) [m].

    Linear between the points of the profile, constant beyond its ends. ``target``: length of the cut [m], which the
    profile must cover; by default the shortest that the task draws. Raise ValueError if the profile does not cover the
    whole cut: see :func:`check_depth_profile`.
    """
    check_depth_profile(settings.depth_profile, reach_of(settings) if target is None else target)
    position, depth = np.asarray(settings.depth_profile, dtype=np.float64).T
    along: NDArray[np.float64] = np.interp(np.arange(N_POINTS) * SPACING, position, depth)
    return along


def reach_of(settings: RigSettings) -> float:
    """Return the distance a profile must cover [m]: at most the shortest cut."""
    return min(SHORTEST, settings.limits.high)
