"""Elastic continuum of a model: element, formulation, integration, checks of arguments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array
from cutenv._base.validation import array_in_range, in_range, one_of
from cutenv.sim.tissue.elasticity import (
    FORMULATIONS,
    LARGEST_POISSON,
    POISSON_CURE,
    mixed_strain_energy_density,
    strain_energy_density,
)
from cutenv.sim.tissue.mesh import ELEMENT_KINDS, CutMesh, ElementKind, read_only
from cutenv.sim.tissue.tip_response import TipResponse, stiffness_matrix, tip_responses


@dataclass(frozen=True, kw_only=True)
class Continuum:
    """Elements and the equations that they solve, as :class:`CutModel` takes them.

    ValueError names an argument that is out of range, or what does not go together.
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
        self, mesh: CutMesh, relative_modulus: Array | None, *, slipping: bool, thickness: float
    ) -> TipResponse:
        """Return the response to a unit blade force, see `tip_responses`.

        Plane models are assembled for unit thickness; solid ones contain their own ``thickness`` [m].
        """
        stiffness = stiffness_matrix(mesh, self.formulation, self.poisson, relative_modulus)
        response = tip_responses(mesh, stiffness, slipping=slipping)
        own = thickness if mesh.dim == 3 else 1.0
        return TipResponse(stiffness=read_only(response.stiffness / own), fields=read_only(response.fields * own))

    def strain_energy_density(self, mesh: CutMesh, displacement: Array, modulus: float, relative: Array) -> Array:
        """Return each element's mean strain energy density [J/m3], shape (n_elements,)."""
        u = displacement.ravel()
        if mesh.kind.has_pressure:
            return modulus * mixed_strain_energy_density(mesh.basis, mesh.pressure_basis, u, self.poisson, relative)
        return modulus * relative * strain_energy_density(mesh.basis, u, self.formulation, self.poisson)


METRES = "Lengths are in metres: 5 cm is 0.05."  # cure of a length that is out of range
POSITIVE_MODULUS = "It is Young's modulus in pascals, and positive."  # cure of a modulus that is out of range
_WHOLE = 1e-6  # of an element: a line that is so close to an edge lies on it


def whole_elements(
    offset: float, earlier: Sequence[tuple[float, float]], size: Sequence[float], divisions: Sequence[int]
) -> tuple[int, tuple[tuple[int, int], ...]]:
    """Return offset and earlier cuts, x and length, counted in elements.

    ValueError if a line is no edge of elements, lies outside, or lies on another one.
    """

    def counted(name: str, value: float, axis: int) -> int:
        step = size[axis] / divisions[axis]
        number = value / step
        if not np.isfinite(number) or abs(number - round(number)) > _WHOLE:
            raise ValueError(f"{name} = {value:g} m is no multiple of the elements' {step:g} m: change divisions.")
        return round(number)

    half = divisions[0] // 2
    shift = counted("offset", offset, 0)
    if abs(shift) >= half:
        raise ValueError(f"offset = {offset:g} m leaves no tissue on one side: the specimen is {size[0]:g} m wide.")
    lines: list[tuple[int, int]] = []
    for x, length in earlier:
        beside, cut = counted("x of an earlier cut", x, 0), counted("length of an earlier cut", length, 1)
        if beside == 0 or abs(shift + beside) >= half or beside in [line for line, _ in lines]:
            raise ValueError(f"an earlier cut at x = {x:g} m lies on another cut, or outside the specimen.")
        if not 1 <= cut <= divisions[1]:
            raise ValueError(f"length = {length:g} m of an earlier cut is outside 0 to {size[1]:g} m.")
        lines.append((beside, cut))
    return shift, tuple(lines)


def unit_force(force: float, modulus: float, thickness: float) -> float:
    """Return force over modulus and thickness [m]; raise if out of range."""
    f = in_range("force", force, -1e6, 1e6, "N", "Forces are in newtons.")
    e = in_range("modulus", modulus, 1e-6, 1e12, "Pa", POSITIVE_MODULUS)
    return f / (e * in_range("thickness", thickness, 1e-6, 1.0, "m", METRES))


def checked_points(points: ArrayLike, nodes: Array) -> Array:
    """Return points, shape (n, dim); raise if one is outside the mesh."""
    places = np.array(points, dtype=np.float64)
    dim = nodes.shape[1]
    if places.ndim != 2 or places.shape[1] != dim:
        raise ValueError(f"points have shape {places.shape}; give {dim} coordinates of each, shape (n, {dim}).")
    for axis, name in enumerate("xyz"[:dim]):
        low, high = float(nodes[:, axis].min()), float(nodes[:, axis].max())
        slack = _WHOLE * (high - low)
        cure = "The specimen ends there. Lengths are in metres, from the cut line and the clamp."
        array_in_range(f"{name} of points", places[:, axis], low - slack, high + slack, "m", cure)
    return places


def checked_relative_modulus(modulus: ArrayLike, n_elements: int) -> Array:
    """Return each element's relative modulus, read-only; raise if invalid."""
    cure = "It is each element's modulus over the common one: divide by that."
    checked = array_in_range("relative_modulus", modulus, 1e-6, 1e6, "1", cure)
    if checked.shape != (n_elements,):
        raise ValueError(
            f"relative_modulus has shape {checked.shape}, but the mesh has {n_elements} elements. Give one "
            "value for each row of element_centres; ravel an array that is shaped as divisions."
        )
    return read_only(checked.copy())
