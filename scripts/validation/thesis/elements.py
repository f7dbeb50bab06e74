"""Meshes by their counts; elements and assembly by closed forms: patch test, order of convergence, Kelvin's load."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve
from skfem import Basis, ElementVector, Functional, LinearForm
from skfem.helpers import ddot, dot, sym_grad, trace

from cutenv.sim.tissue import CutModel
from cutenv.sim.tissue.elasticity import lame_parameters
from cutenv.sim.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.sim.tissue.tables import table
from cutenv.sim.tissue.tip_response import stiffness_matrix
from scripts.validation.thesis.rows import Found, Row, at_most, check, exactly, hits, near

Array = NDArray[np.float64]
MODELS = {
    "3-D, 20 nodes": ("hex20", "solid"),
    "2-D, 8 nodes": ("quad8", "plane_stress"),
    "2-D, 4 nodes": ("quad4", "plane_stress"),
}
DIVISIONS = [(8, 15), (10, 24), (16, 30), (32, 60), (40, 75)]
CORRECTED = {("nodes", 0): 438, ("elements", 1): 240}  # the errata of Table 4.12
KINDS = [
    *((element, of) for element in ("quad4", "quad8") for of in ("plane_stress", "plane_strain")),
    ("hex20", "solid"),
]
SIZE = (0.08, 0.15, 0.02)  # [m]
NU = 0.3
GRADIENT = np.array([[0.3, -0.2, 0.5], [0.7, 0.4, -0.1], [0.2, 0.6, -0.8]])  # of the patch's displacement
KELVIN = {  # of a line load in an infinite plane, per halving of the elements, times modulus and thickness
    "plane_stress": (1 + NU) * (3 - NU) / (4 * math.pi) * math.log(2),
    "plane_strain": (1 + NU) * (3 - 4 * NU) / (4 * math.pi * (1 - NU)) * math.log(2),
}


@cache
def model(
    element: str = "quad8",
    formulation: str = "plane_stress",
    poisson: float = NU,
    divisions: tuple[int, ...] | None = None,
    integration: str = "full",
) -> CutModel:
    """Return a model, built once; by default on the thesis's mesh."""
    return CutModel(element, formulation, poisson, divisions=divisions, integration=integration)


@check(
    "mesh-counts", "Mesh counts", "Tables 4.3, 4.12", "exact", notes=(*table("4.3").errata, *table("4.12").errata[:2])
)
def mesh_counts(quick: bool) -> Found:
    """Compare elements, nodes and equations, exactly."""
    rows = []
    for row, (name, kind) in enumerate(MODELS.items()):
        for what in ("elements", "nodes", "equations"):
            rows.append(exactly(f"{name}: {what}", table("4.3")[f"n_{what}"][row], getattr(model(*kind), f"n_{what}")))
    for row, divisions in enumerate(DIVISIONS):
        for what in ("elements", "nodes"):
            printed = table("4.12")[f"n_{what}"][row]
            corrected = CORRECTED.get((what, row), printed)
            erratum = "" if corrected == printed else f" (printed {printed:g})"
            name = f"level {row + 1}, {divisions[0]} x {divisions[1]}: {what}{erratum}"
            rows.append(exactly(name, corrected, getattr(model(divisions=divisions), f"n_{what}")))
    return rows, f"{hits(rows)} equal, two errata corrected"


def mesh_of(element: str, divisions: tuple[int, ...]) -> CutMesh:
    """Return a mesh of the specimen."""
    return CutMesh(kind=ELEMENT_KINDS[element], divisions=divisions, size=SIZE[: len(divisions)])


def joined(mesh: CutMesh) -> tuple[csr_array, NDArray[np.int64]]:
    """Return the motion of every unknown when nodes at one place move together, and the first node of every place."""
    places = np.round(mesh.nodes / 1e-9).astype(np.int64)
    _, first, same = np.unique(places, axis=0, return_index=True, return_inverse=True)
    columns = (mesh.dim * same.reshape(-1, 1) + np.arange(mesh.dim)).ravel()
    return csr_array((np.ones(columns.size), (np.arange(columns.size), columns))), first


def solve_with_outline(mesh: CutMesh, stiffness: csr_array, known: Array, load: Array) -> Array:
    """Solve for the tied, unclamped specimen whose outline is displaced as ``known``; shape (n_nodes, dim)."""
    join, first = joined(mesh)
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    outline = (np.isclose(mesh.nodes, low) | np.isclose(mesh.nodes, high)).any(axis=1)
    fixed = np.repeat(outline[first], mesh.dim)
    u = np.where(fixed, known[first].ravel(), 0.0)
    k = (join.T @ stiffness @ join).tocsc()
    u[~fixed] = spsolve(k[~fixed][:, ~fixed], (join.T @ load - k @ u)[~fixed])
    return np.asarray(join @ u).reshape(mesh.nodes.shape)


def patch(mesh: CutMesh, stiffness: csr_array) -> tuple[Array, float]:
    """Return the displacement with which the outline imposes a constant strain, and its error over the largest one."""
    exact = mesh.nodes @ GRADIENT[: mesh.dim, : mesh.dim].T
    u = solve_with_outline(mesh, stiffness, exact, np.zeros(mesh.nodes.size))
    return u, float(np.abs(u - exact).max() / np.abs(exact).max())


def small_mesh(element: str) -> CutMesh:
    """Return the mesh of the patch test."""
    return mesh_of(element, (4, 3, 2) if element == "hex20" else (4, 5))


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


def in_plane_stress(mesh: CutMesh) -> csr_array:
    """Return the stiffness of a mesh in plane stress."""
    return stiffness_matrix(mesh, "plane_stress", NU)


def energy_error(element: str, n: int, assemble: Callable[[CutMesh], csr_array] = in_plane_stress) -> float:
    """Return the energy norm of the error on n x 2 n elements under the wave's body force."""
    lam, mu = lame_parameters("plane_stress", NU)
    mesh = mesh_of(element, (n, 2 * n))
    fine = Basis(mesh.skfem_mesh, ElementVector(mesh.kind.element()), intorder=8)
    load = LinearForm(lambda v, w: dot(wave_body_force(w.x, lam, mu), v)).assemble(fine)
    u = solve_with_outline(mesh, assemble(mesh), wave(mesh.nodes.T).T, load)

    def density(w: Any) -> Array:
        error = sym_grad(w["u"]) - wave_strain(w.x)
        return np.asarray(lam * trace(error) ** 2 + 2 * mu * ddot(error, error))

    return float(np.sqrt(Functional(density).assemble(fine, u=fine.interpolate(u.ravel()))))


def convergence(element: str, assemble: Callable[[CutMesh], csr_array] = in_plane_stress) -> float:
    """Return the order of convergence in the energy norm."""
    return math.log2(energy_error(element, 8, assemble) / energy_error(element, 16, assemble))


@check(
    "elements",
    "Elements: patch test; order of convergence 1 and 2; Kelvin's point load",
    "closed forms",
    "1e-10; 0.1; 1 %",
)
def closed_forms(quick: bool) -> Found:
    """Compare elements and assembly with closed forms, which hold whatever the tissue."""
    rows: list[Row] = []
    for element, formulation in KINDS:
        what = f"patch test, {element} {formulation.replace('_', ' ')}: relative error"
        mesh = small_mesh(element)
        rows.append(at_most(what, patch(mesh, stiffness_matrix(mesh, formulation, NU))[1], 1e-10))
    orders = []
    for element, order in (("quad4", 1.0), ("quad8", 2.0)):
        found = convergence(element)
        orders.append(f"{found:.2f}")
        rows.append(near(f"order of convergence in the energy norm, {element}", order, found, absolute=0.1, form=".3f"))
    a = 0.07
    for formulation, expected in KELVIN.items():
        coarse, fine = (model(formulation=formulation, divisions=d) for d in ((16, 30), (32, 60)))
        softening = 1 / fine.stiffness(a) - 1 / coarse.stiffness(a)
        what = f"compliance added by half as large elements, {formulation.replace('_', ' ')} (Kelvin)"
        rows.append(near(what, expected, softening, relative=0.01))
    kelvin = max(abs(float(row.ours) / float(row.reference) - 1.0) for row in rows[-2:])
    worst = max(float(row.ours) for row in rows[:5])
    return rows, f"{worst:.0e}; {' and '.join(orders)}; within {100 * kelvin:.1f} %"
