"""The matrix of Appendix A with its erratum corrected, from the two parameters that the program uses."""

from __future__ import annotations

import numpy as np

from cutenv.sim.tissue.elasticity import lame_parameters


def constitutive_matrix(formulation: str, poisson: float) -> np.ndarray:
    """Return stress over engineering strain at unit modulus: xx, yy, xy; of a solid xx, yy, zz, yz, xz, xy."""
    lam, mu = lame_parameters(formulation, poisson)
    dim = 3 if formulation == "solid" else 2
    matrix = np.diag([2.0 * mu] * dim + [mu] * (dim * (dim - 1) // 2))
    matrix[:dim, :dim] += lam
    return matrix
