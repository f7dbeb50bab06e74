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
        shape, first, w = self._blended(cut_length)
        at_corners = shape[self.mesh.tip_pairs[first : first + 2], ALONG].mean(axis=(1, 2))
        shape /= (1.0 - w) * at_corners[0] + w * at_corners[1]
        return shape

    def shared(self, cut_length: float) -> NDArray[np.float64]:
        """Return the displacement of every node per force that the corners to either side share, (n_nodes, dim).

        From the second row of elements around the tip on it is the displacement by a force between them. Below the
        first corner the clamp takes the rest.
        """
        blended: NDArray[np.float64] = self._blended(cut_length)[0] * min(cut_length / self.tips[0], 1.0)
        return blended

    def _blended(self, cut_length: float) -> tuple[NDArray[np.float64], int, float]:
        """Return the blend of the fields on the corners to either side, the first of these, and the second's weight."""
        place = max(cut_length / self.tips[0] - 1.0, 0.0)  # in elements, from the first tip
        first = min(int(place), len(self.tips) - 2)
        w = place - first
        fields = self.response.fields
        blend: NDArray[np.float64] = (1.0 - w) * fields[first] + w * fields[first + 1]
        # The mid-side pair between the corners slips behind the farther tip; ahead of this one it is tied.
        ahead = self.mesh.pairs[self.mesh.nodes[self.mesh.pairs[:, 0], ALONG] >= cut_length]
        blend[ahead, ALONG] = blend[ahead, ALONG].mean(axis=1, keepdims=True)
        return blend, first, w
