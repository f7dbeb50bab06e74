"""Elastic continuum of a model: element, formulation, Poisson's ratio and integration, and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cutenv._base.validation import in_range, one_of
from cutenv.tissue.elasticity import (
    FORMULATIONS,
    LARGEST_POISSON,
    POISSON_CURE,
    mixed_strain_energy_density,
    strain_energy_density,
)
from cutenv.tissue.mesh import ELEMENT_KINDS, CutMesh, ElementKind, read_only
from cutenv.tissue.tip_response import TipResponse, stiffness_matrix, tip_responses


@dataclass(frozen=True, kw_only=True)
class Continuum:
    """Elements and the equations that they solve; the parameters are those of `CutModel`.

    Raises
    ------
    ValueError
        If an argument is out of range, or element, formulation and integration do not go together.
    """

    element: str
    formulation: str
    poisson: float
    integration: str

    def __post_init__(self) -> None:
        one_of("element", self.element, ELEMENT_KINDS)
        one_of("formulation", self.formulation, FORMULATIONS)
        if (self.element == "hex20") != (self.formulation == "solid"):
            cure = 'formulation="solid"' if self.element == "hex20" else 'element="hex20"'
            raise ValueError(
                f"element={self.element!r} does not go with formulation={self.formulation!r}: bricks are "
                f"solid, quadrilaterals plane stress or plane strain. Ask for {cure}, or change the other."
            )
        one_of("integration", self.integration, ("full", "reduced"))
        if self.element == "quad8_mixed" and self.formulation != "plane_strain":
            raise ValueError(
                f'element="quad8_mixed" does not go with formulation={self.formulation!r}, which does not lock. '
                'Ask for formulation="plane_strain", or for element="quad8".'
            )
        largest = 0.5 if self.kind.has_pressure else LARGEST_POISSON
        object.__setattr__(self, "poisson", in_range("poisson", self.poisson, 0.0, largest, "1", POISSON_CURE))

    @property
    def kind(self) -> ElementKind:
        """Element with the Gauss points of the integration."""
        kind = ELEMENT_KINDS[self.element]
        return kind if self.integration == "full" else kind.reduced()

    def unit_response(
        self, mesh: CutMesh, relative_modulus: NDArray[np.float64] | None, *, slipping: bool, thickness: float
    ) -> TipResponse:
        """Return the response to a unit blade force at unit modulus and unit thickness, see `tip_responses`.

        Plane models are assembled for unit thickness; solid ones contain their own ``thickness`` [m].
        """
        stiffness = stiffness_matrix(mesh, self.formulation, self.poisson, relative_modulus)
        response = tip_responses(mesh, stiffness, slipping=slipping)
        own = thickness if mesh.dim == 3 else 1.0
        return TipResponse(stiffness=read_only(response.stiffness / own), fields=read_only(response.fields * own))

    def strain_energy_density(
        self, mesh: CutMesh, displacement: NDArray[np.float64], modulus: float, relative: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the mean strain energy per volume of each element [J/m3], shape (n_elements,)."""
        u = displacement.ravel()
        if mesh.kind.has_pressure:
            return modulus * mixed_strain_energy_density(mesh.basis, mesh.pressure_basis, u, self.poisson, relative)
        return modulus * relative * strain_energy_density(mesh.basis, u, self.formulation, self.poisson)
