"""Unit stiffness and displacement field for tips between element corners, by interpolation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from cutenv.tissue.mesh import ALONG, CutMesh
from cutenv.tissue.tip_response import TipResponse


@dataclass(frozen=True, kw_only=True, eq=False)
class TipInterpolation:
    """Interpolation of stiffness and displacement over the cut length, from the element corners.

    Mid-side nodes are not used as tips: their response to a point load is different.

    Parameters
    ----------
    mesh : CutMesh
    tips : ndarray of shape (n_tips,)
        Cut lengths at which a tip stands on element corners [m].
    response : TipResponse
        Response to a unit blade force at these tips.
    """

    mesh: CutMesh
    tips: NDArray[np.float64]
    response: TipResponse

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self.tips, self.response.stiffness)

    def stiffness(self, cut_length: NDArray[np.float64]) -> NDArray[np.float64]:
        """Interpolate preserving shape (PCHIP); below the first corner hold its value."""
        return np.asarray(self._curve(np.maximum(cut_length, self.tips[0])), dtype=np.float64)

    def shape(self, cut_length: float) -> NDArray[np.float64]:
        """Return the displacement of every node per displacement of the tip, shape (n_nodes, dim).

        The fields per unit force for a tip on the corners to either side are blended linearly, and scaled so
        that the point at the cut length, on the straight line between these corners, moves by one.
        """
        place = max(cut_length / self.tips[0] - 1.0, 0.0)  # in elements, from the first tip
        first = min(int(place), len(self.tips) - 2)
        w = place - first
        fields = self.response.fields
        shape: NDArray[np.float64] = (1.0 - w) * fields[first] + w * fields[first + 1]
        # The mid-side pair between the corners slips behind the farther tip; ahead of this one it is tied.
        ahead = self.mesh.pairs[self.mesh.nodes[self.mesh.pairs[:, 0], ALONG] >= cut_length]
        shape[ahead, ALONG] = shape[ahead, ALONG].mean(axis=1, keepdims=True)
        at_corners = shape[self.mesh.tip_pairs[first : first + 2], ALONG].mean(axis=(1, 2))
        shape /= (1.0 - w) * at_corners[0] + w * at_corners[1]
        return shape
