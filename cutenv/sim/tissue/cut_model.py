"""Finite-element model of a clamped, straight cut specimen (thesis, chapters 3 and 4)."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import array_in_range, in_range
from cutenv.sim.tissue.continuum import (
    METRES,
    POSITIVE_MODULUS,
    Continuum,
    checked_points,
    checked_relative_modulus,
    unit_force,
    whole_elements,
)
from cutenv.sim.tissue.mesh import ACROSS, ALONG, CutMesh, checked_divisions, read_only
from cutenv.sim.tissue.tip_response import TipInterpolation

_MIRROR_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class CutModel:
    """Linear finite-element model of a specimen with a doubled cut line.

    The specimen is clamped along the short edge where the cut starts (y = 0). The nodes on the cut line x = 0, by
    default the centre line, are doubled. Pairs ahead of the tip and at the tip are tied; pairs behind it slide along
    the line (y) and share the other components of their displacement: the faces neither open nor overlap, and in 3-D
    do not slide through the thickness either. The blade is a force on the tip pair along +y, away from the
    clamp; in 3-D it moves all tip nodes through the thickness equally, and its force is their sum.

    A model is immutable; equal arguments make equal models. Everything is computed on first use and cached: one
    sparse factorisation serves every cut length. On a specimen that is mirror-symmetric about
    the cut line the faces carry no shear, so that cutting does not soften it: `stiffness` falls along the cut
    because the load moves away from the clamp. With a `relative_modulus` that differs between left and right
    the faces behind the tip slip, and that does soften the specimen.

    The stiffness under a point load in 2-D falls with the logarithm of the element size. A modulus found with one
    model therefore belongs to that model; `convert_modulus` converts it to another.

    Parameters
    ----------
    element : {"quad8", "quad4", "quad8_mixed", "hex20"}
        8-node serendipity quadrilateral, 4-node quadrilateral, the first with the pressure as a further unknown
        on its corners (Taylor-Hood, see `cutenv.sim.tissue.elasticity`), 20-node serendipity brick.
    formulation : {"plane_stress", "plane_strain", "solid"}
        ``"solid"`` goes with ``"hex20"``, ``"plane_strain"`` with ``"quad8_mixed"``, the plane ones with the others.
    poisson : float
        Poisson's ratio [1], 0 to 0.499, for ``"quad8_mixed"`` to 0.5. Nearly incompressible, the others lock in
        plane strain and in 3-D (they are too stiff), less so with reduced integration.
    width, length : float
        Size of the specimen, across and along the cut [m], 1 mm to 5 m.
    thickness : float
        Thickness of the solid model [m], 0.1 mm to 0.5 m; the plane models do not depend on it.
    divisions : tuple of int, optional
        Elements across (even), along (2 or more) and, for bricks, through the specimen. By default the
        thesis's mesh: (8, 15), for bricks (8, 15, 4).
    relative_modulus : ndarray of shape (n_elements,), optional
        Modulus of each element over the common one that the methods take [1], 1e-6 to 1e6. Elements are in
        the order of `element_centres`: reshaped to `divisions` the array is indexed by position across (from
        -x to +x), along (from the clamp) and through the specimen. By default uniform.
    integration : {"full", "reduced"}
        Gauss points of each element: 3 x 3 and 3 x 3 x 3 for the quadratic ones, or 2 x 2 and 2 x 2 x 2 for
        ``"quad8"`` and ``"hex20"``, which makes them softer.
    offset : float
        Distance of the cut line from the centre line, towards +x [m]: whole elements. The nodes lie from
        -width/2 - offset to width/2 - offset, so that the cut line stays x = 0.
    earlier_cuts : tuple of (float, float)
        Cuts made before, parallel to this one: x and length of each [m], whole elements. Their faces slide as those
        behind the tip do.

    Raises
    ------
    ValueError, TypeError
        If an argument is out of range, or arguments do not go together; the message names the cure.

    Notes
    -----
    Mesh, elements and formulations are those of the thesis's sections 4.1 to 4.4 and of its
    Appendix A (with the erratum that `cutenv.sim.tissue.elasticity` names).

    Examples
    --------
    >>> model = CutModel()
    >>> model.n_nodes, model.n_equations
    (438, 876)
    >>> round(model.stiffness(0.05), 3)
    0.668
    """

    element: str = "quad8"
    formulation: str = "plane_stress"
    poisson: float = 0.3
    width: float = 0.08
    length: float = 0.15
    thickness: float = 0.01
    divisions: tuple[int, ...] | None = None
    relative_modulus: Array | None = None
    integration: str = "full"
    offset: float = 0.0
    earlier_cuts: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        settled: dict[str, object] = {
            "poisson": self._continuum.poisson,
            "width": in_range("width", self.width, 1e-3, 5.0, "m", METRES),
            "length": in_range("length", self.length, 1e-3, 5.0, "m", METRES),
            "thickness": in_range("thickness", self.thickness, 1e-4, 0.5, "m", METRES),
            "divisions": checked_divisions(self.element, self.divisions),
        }
        for name, value in settled.items():
            object.__setattr__(self, name, value)
        if self.relative_modulus is not None:
            modulus = checked_relative_modulus(self.relative_modulus, self.n_elements)
            object.__setattr__(self, "relative_modulus", modulus)
        object.__setattr__(self, "earlier_cuts", tuple((float(x), float(a)) for x, a in self.earlier_cuts))
        _ = self._lines  # raises for lines that are no element edges

    def __reduce__(self) -> tuple[type[CutModel], tuple[object, ...]]:
        # The arguments are the model; a copy computes its results again.
        return type(self), tuple(getattr(self, field.name) for field in fields(self))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, CutModel):
            return NotImplemented
        return self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __repr__(self) -> str:
        names = [field.name for field in fields(self) if field.name != "relative_modulus"]
        given = [n for n in names if n not in ("offset", "earlier_cuts") or getattr(self, n)]
        arguments = ", ".join(f"{n}={getattr(self, n)!r}" for n in given)
        modulus = "" if self.relative_modulus is None else ", relative_modulus=..."
        return f"CutModel({arguments}{modulus})"

    @property
    def _key(self) -> tuple[object, ...]:
        arguments = (getattr(self, field.name) for field in fields(self))
        return tuple(each.tobytes() if isinstance(each, np.ndarray) else each for each in arguments)

    @property
    def _divisions(self) -> tuple[int, ...]:
        assert self.divisions is not None  # settled in __post_init__
        return self.divisions

    @property
    def dim(self) -> int:
        """Number of space dimensions: 2, or 3 for bricks."""
        return len(self._divisions)

    @property
    def n_elements(self) -> int:
        """Number of elements."""
        return math.prod(self._divisions)

    @property
    def n_nodes(self) -> int:
        """Number of nodes, including paired and clamped ones (Table 4.3)."""
        return len(self.nodes)

    @property
    def n_equations(self) -> int:
        """Number of unknowns, including clamped, tied and pressures (Table 4.3)."""
        return self._mesh.n_unknowns

    @cached_property
    def _continuum(self) -> Continuum:
        names = ("element", "formulation", "poisson", "integration")
        return Continuum(**{name: getattr(self, name) for name in names})

    @cached_property
    def _mesh(self) -> CutMesh:
        size = (self.width, self.length, self.thickness)[: self.dim]
        shift, earlier = self._lines
        return CutMesh(kind=self._continuum.kind, divisions=self._divisions, size=size, shift=shift, earlier=earlier)

    @property
    def _lines(self) -> tuple[int, tuple[tuple[int, int], ...]]:
        """Cut line and earlier cuts counted in elements, see `CutMesh`."""
        size = (self.width, self.length)
        return whole_elements(self.offset, self.earlier_cuts, size, self._divisions[:2])

    @property
    def nodes(self) -> Array:
        """Nodes' positions [m], shape (n_nodes, dim): corners, then mid-side nodes."""
        return self._mesh.nodes

    @property
    def elements(self) -> Indices:
        """Corner nodes of elements, shape (n_elements, 4), bricks (n_elements, 8).

        Counter-clockwise seen from +z; bricks list the lower face, then the upper one.
        """
        return self._mesh.elements

    @property
    def pairs(self) -> Indices:
        """Facing nodes, (left, right), from the clamp, shape (n_pairs, 2)."""
        return self._mesh.pairs

    @cached_property
    def element_centres(self) -> Array:
        """Elements' centres [m], shape (n_elements, dim), ordered as `relative_modulus`."""
        return read_only(self.nodes[self.elements].mean(axis=1))

    @cached_property
    def tips(self) -> Array:
        """Cut lengths with the tip on element corners [m], shape (n_tips,)."""
        return read_only(np.linspace(0.0, self.length, self._divisions[ALONG] + 1)[1:].copy())

    @property
    def is_mirror_symmetric(self) -> bool:
        """True if the cut line's sides are mirror images."""
        if self.offset or self.earlier_cuts:
            return False
        if self.relative_modulus is None:
            return True
        modulus = self.relative_modulus.reshape(self._divisions)
        return np.allclose(modulus, np.flip(modulus, axis=ACROSS), rtol=_MIRROR_TOLERANCE, atol=0.0)

    @property
    def unit_fields(self) -> Array:
        """Displacement with tips on corners, times modulus, thickness, over force [1].

        Shape (n_tips, n_nodes, dim).
        """
        return self._interpolation.response.fields

    @cached_property
    def _interpolation(self) -> TipInterpolation:
        unit = self._continuum.unit_response(
            self._mesh, self.relative_modulus, slipping=not self.is_mirror_symmetric, thickness=self.thickness
        )
        return TipInterpolation(mesh=self._mesh, tips=self.tips, response=unit)

    @overload
    def stiffness(self, cut_length: float) -> float: ...
    @overload
    def stiffness(self, cut_length: ArrayLike) -> float | Array: ...
    def stiffness(self, cut_length: ArrayLike) -> float | Array:
        """Return stiffness kappa [1]: force over displacement, modulus and thickness.

        Computed where the tip stands on element corners and interpolated in between with shape-preserving cubics
        (PCHIP). Between the clamp and the first corner it is constant, because there is no tip.  ValueError for a
        distance of the tip from the clamp [m] that is not from 0 to `length`.
        """
        a = array_in_range("cut_length", cut_length, 0.0, self.length, "m", self._cut_length_cure)
        kappa = self._interpolation.stiffness(a)
        return float(kappa) if a.ndim == 0 else kappa

    def displacement(self, cut_length: float, force: float, modulus: float, thickness: float) -> Array:
        """Return every node's displacement under a blade force [m], (n_nodes, dim).

        The tip moves by force / (kappa modulus thickness). Between two element corners the fields for a tip on either
        are blended linearly and scaled to that; the tip is then taken on the straight line between these corners (in
        3-D, at their mean through the thickness). Pairs at or ahead of the tip stay tied. Below the first corner the
        field keeps the first corner's shape.

        The force [N], -1e6 to 1e6, points away from the clamp; the modulus [Pa], up to 1e12, is that where
        `relative_modulus` is 1, and the thickness [m], up to 1, the depth of the cut.  ValueError if one is out of
        range.
        """
        a = in_range("cut_length", cut_length, 0.0, self.length, "m", self._cut_length_cure)
        return unit_force(force, modulus, thickness) / self.stiffness(a) * self._interpolation.shape(a)

    def displacement_at(
        self,
        points: ArrayLike,
        cut_length: float,
        *,
        tip_displacement: float | None = None,
        force: float | None = None,
        modulus: float | None = None,
        thickness: float | None = None,
    ) -> Array:
        """Return the displacement at points [m], (n, dim), by shape functions.

        With the tip on element corners it is, at a node, that of `displacement`, and on a cut line that of the right
        face. Between corners these share the force: beyond the elements at the tip that is the displacement by the
        force, where `displacement` is larger, for it is scaled to the motion of the tip itself.

        Parameters
        ----------
        points : array_like of shape (n, dim)
            Places before the load [m]: across the cut line, along it from the clamp and, for bricks, from the lower
            surface up.
        tip_displacement : float, optional
            Displacement of the tip along +y [m], -1 to 1: the force is what `stiffness` gives for it.
        force, modulus, thickness : float, optional
            Without it: as for `displacement`.

        Raises
        ------
        ValueError, TypeError
            If a point is outside, or an argument is missing or out of range.

        Examples
        --------
        >>> model = CutModel()
        >>> bead = [[0.01, 0.04]]  # 1 cm beside the line, 4 cm from the clamp
        >>> (1e3 * model.displacement_at(bead, 0.05, tip_displacement=0.01)).round(2)
        array([[-0.54,  3.88]])
        """
        places = checked_points(points, self.nodes)
        a = in_range("cut_length", cut_length, 0.0, self.length, "m", self._cut_length_cure)
        if tip_displacement is not None:
            if not force is modulus is thickness is None:
                raise TypeError("displacement_at takes tip_displacement, or force, modulus and thickness, not both.")
            load = self.stiffness(a) * in_range("tip_displacement", tip_displacement, -1.0, 1.0, "m", METRES)
        elif force is None or modulus is None or thickness is None:
            raise TypeError("displacement_at needs tip_displacement, or force, modulus and thickness.")
        else:
            load = unit_force(force, modulus, thickness)
        return self._mesh.interpolated(load * self._interpolation.shared(a), places)

    def strain_energy_density(self, displacement: Array, modulus: float) -> Array:
        """Return each element's mean strain energy density [J/m3], shape (n_elements,).

        They are in the order of `element_centres`. Summed over the elements times their volumes it is half the blade's
        force times the displacement of the tip, if the tip is on element corners.  The arguments are from and as for
        `displacement`; ValueError if the modulus is out of range or the displacement has another shape.
        """
        e = in_range("modulus", modulus, 1e-6, 1e12, "Pa", POSITIVE_MODULUS)
        if displacement.shape != self.nodes.shape:
            raise ValueError(f"displacement has shape {displacement.shape}; give one of each node, {self.nodes.shape}.")
        relative = np.ones(self.n_elements) if self.relative_modulus is None else self.relative_modulus
        return self._continuum.strain_energy_density(self._mesh, displacement, e, relative)

    @overload
    def convert_modulus(self, modulus: float, to: CutModel, cut_length: float) -> float: ...
    @overload
    def convert_modulus(self, modulus: ArrayLike, to: CutModel, cut_length: ArrayLike) -> float | Array: ...
    def convert_modulus(self, modulus: ArrayLike, to: CutModel, cut_length: ArrayLike) -> float | Array:
        """Convert a local effective modulus to another model (section 4.4.2).

        Both models then respond to the same force with the same displacement: modulus kappa_self / kappa_to.  Moduli
        [Pa], up to 1e12, and cut lengths at which they were found [m], up to the length of the shorter model,
        broadcast.  ValueError if one is out of range, TypeError if ``to`` is no `CutModel`.
        """
        if not isinstance(to, CutModel):
            raise TypeError(f"to must be a CutModel, got {to!r}. Build the model that shall use the modulus.")
        found = array_in_range("modulus", modulus, 1e-6, 1e12, "Pa", POSITIVE_MODULUS)
        converted = found * (np.asarray(self.stiffness(cut_length)) / np.asarray(to.stiffness(cut_length)))
        return float(converted) if np.ndim(converted) == 0 else converted

    @property
    def _cut_length_cure(self) -> str:
        return f"The specimen ends at {self.length:g} m. {METRES}"
