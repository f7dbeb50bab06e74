"""Elements and assembly against closed forms: patch test, order of convergence, Kelvin's point load."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve
from skfem import Basis, ElementVector, Functional, LinearForm
from skfem.helpers import ddot, dot, sym_grad, trace

from cutenv.tissue import CutModel
from cutenv.tissue.elasticity import lame_parameters
from cutenv.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.tissue.tip_response import stiffness_matrix
from reproduction.rows import Comparison, Row, at_most, near

Array = NDArray[np.float64]
SIZE = (0.08, 0.15, 0.02)  # [m]
NU = 0.3
GRADIENT = np.array([[0.3, -0.2, 0.5], [0.7, 0.4, -0.1], [0.2, 0.6, -0.8]])  # of the patch's displacement
KELVIN = {  # of a line load in an infinite plane, per halving of the elements, times modulus and thickness
    "plane_stress": (1 + NU) * (3 - NU) / (4 * math.pi) * math.log(2),
    "plane_strain": (1 + NU) * (3 - 4 * NU) / (4 * math.pi * (1 - NU)) * math.log(2),
}


def mesh_of(element: str, divisions: tuple[int, ...]) -> CutMesh:
    """Return a mesh of the specimen."""
    return CutMesh(kind=ELEMENT_KINDS[element], divisions=divisions, size=SIZE[: len(divisions)])


def solve_with_outline(mesh: CutMesh, stiffness: csr_array, known: Array, load: Array) -> Array:
    """Solve for the tied, unclamped specimen whose outline is displaced as ``known``; shape (n_nodes, dim)."""
    places = np.round(mesh.nodes / 1e-9).astype(np.int64)
    _, first, same = np.unique(places, axis=0, return_index=True, return_inverse=True)
    columns = (mesh.dim * same.reshape(-1, 1) + np.arange(mesh.dim)).ravel()
    join = csr_array((np.ones(columns.size), (np.arange(columns.size), columns)))
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    outline = (np.isclose(mesh.nodes, low) | np.isclose(mesh.nodes, high)).any(axis=1)
    fixed = np.repeat(outline[first], mesh.dim)
    u = np.where(fixed, known[first].ravel(), 0.0)
    k = (join.T @ stiffness @ join).tocsc()
    u[~fixed] = spsolve(k[~fixed][:, ~fixed], (join.T @ load - k @ u)[~fixed])
    return np.asarray(join @ u).reshape(mesh.nodes.shape)


def patch_error(element: str, formulation: str) -> float:
    """Return the largest departure from a constant strain imposed by the outline, over the largest displacement."""
    mesh = mesh_of(element, (4, 3, 2) if element == "hex20" else (4, 5))
    exact = mesh.nodes @ GRADIENT[: mesh.dim, : mesh.dim].T
    u = solve_with_outline(mesh, stiffness_matrix(mesh, formulation, NU), exact, np.zeros(mesh.nodes.size))
    return float(np.abs(u - exact).max() / np.abs(exact).max())


def wave(x: Array) -> Array:
    """Return a smooth displacement [m] of the plane; ``x`` of shape (2, ...)."""
    return np.array([np.sin(40 * x[0]) * np.cos(25 * x[1]), np.cos(30 * x[0] + 20 * x[1])])


def wave_strain(x: Array) -> Array:
    """Return the symmetric gradient of :func:`wave`."""
    s = -np.sin(30 * x[0] + 20 * x[1])
    xx, yy = 40 * np.cos(40 * x[0]) * np.cos(25 * x[1]), 20 * s
    xy = 0.5 * (-25 * np.sin(40 * x[0]) * np.sin(25 * x[1]) + 30 * s)
    return np.array([[xx, xy], [xy, yy]])


def wave_body_force(x: Array, lam: float, mu: float) -> Array:
    """Return minus (lambda + mu) grad div u minus mu Laplacian u."""
    c = np.cos(30 * x[0] + 20 * x[1])
    sc, cs = np.sin(40 * x[0]) * np.cos(25 * x[1]), np.cos(40 * x[0]) * np.sin(25 * x[1])
    laplacian = np.array([-(40**2 + 25**2) * sc, -(30**2 + 20**2) * c])
    grad_div = np.array([-(40**2) * sc - 20 * 30 * c, -40 * 25 * cs - 20**2 * c])
    return -(lam + mu) * grad_div - mu * laplacian


def energy_error(element: str, n: int) -> float:
    """Return the energy norm of the error on n x 2 n elements under the wave's body force."""
    lam, mu = lame_parameters("plane_stress", NU)
    mesh = mesh_of(element, (n, 2 * n))
    fine = Basis(mesh.skfem_mesh, ElementVector(mesh.kind.element()), intorder=8)
    load = LinearForm(lambda v, w: dot(wave_body_force(w.x, lam, mu), v)).assemble(fine)
    u = solve_with_outline(mesh, stiffness_matrix(mesh, "plane_stress", NU), wave(mesh.nodes.T).T, load)

    def density(w: Any) -> Array:
        error = sym_grad(w["u"]) - wave_strain(w.x)
        return np.asarray(lam * trace(error) ** 2 + 2 * mu * ddot(error, error))

    return float(np.sqrt(Functional(density).assemble(fine, u=fine.interpolate(u.ravel()))))


def closed_forms(quick: bool) -> Comparison:
    """Compare elements and assembly with closed forms, which hold whatever the tissue."""
    rows: list[Row] = []
    for element, formulation in (
        ("quad4", "plane_stress"),
        ("quad4", "plane_strain"),
        ("quad8", "plane_stress"),
        ("quad8", "plane_strain"),
        ("hex20", "solid"),
    ):
        what = f"patch test, {element} {formulation.replace('_', ' ')}: relative error"
        rows.append(at_most(what, patch_error(element, formulation), 1e-10))
    orders = []
    for element, order in (("quad4", 1.0), ("quad8", 2.0)):
        found = math.log2(energy_error(element, 8) / energy_error(element, 16))
        orders.append(f"{found:.2f}")
        rows.append(near(f"order of convergence in the energy norm, {element}", order, found, absolute=0.1, form=".3f"))
    a = 0.07
    for formulation, expected in KELVIN.items():
        coarse, fine = (CutModel(formulation=formulation, divisions=d) for d in ((16, 30), (32, 60)))
        softening = 1 / fine.stiffness(a) - 1 / coarse.stiffness(a)
        what = f"compliance added by half as large elements, {formulation.replace('_', ' ')} (Kelvin)"
        rows.append(near(what, expected, softening, relative=0.01))
    kelvin = max(abs(float(row.ours) / float(row.reference) - 1.0) for row in rows[-2:])
    patch = max(float(row.ours) for row in rows[:5])
    return Comparison(
        title="Elements: patch test; order of convergence 1 and 2; Kelvin's point load",
        source="closed forms",
        ours=f"{patch:.0e}; {' and '.join(orders)}; within {100 * kelvin:.1f} %",
        tolerance="1e-10; 0.1; 1 %",
        rows=tuple(rows),
    )
