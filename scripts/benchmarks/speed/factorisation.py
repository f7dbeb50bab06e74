"""Speed-up of one factorisation for all tips over one for each tip, and agreement of the two."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.sim.tissue.tip_response import blade_unknowns, factorise, stiffness_matrix, tip_responses
from scripts.benchmarks.speed.measured import Measured, Number

REQUIRED_SPEEDUP = {(8, 15): 8.0, (40, 75): 15.0}
"""Required speed-up of one factorisation over one for each tip, by the numbers of elements across and along."""


class FactorisationSpeedup(TypedDict):
    """Times, the best of the repeats [s], and relative differences."""

    divisions: tuple[int, ...]
    n_tips: int
    n_equations: int
    per_tip_s: float
    one_factorisation_s: float
    one_factorisation_with_slips_s: float
    speedup: float
    speedup_with_slips: float
    largest_difference: float
    largest_difference_with_slips: float


def factorisation_speedup(divisions: tuple[int, int] = (8, 15), repeats: int = 3) -> FactorisationSpeedup:
    """Compare the two ways on 8-node plane-stress elements, in one process, from the same assembled matrix.

    Both ways order and factorise alike; neither time includes assembly. Without slips the specimen is uniform, as
    `CutModel` treats every mirror-symmetric one; with slips its halves differ in modulus.
    """
    specimen = CutModel(divisions=divisions)
    halves = np.where(specimen.element_centres[:, 0] < 0.0, 1.0, 2.0)
    mesh = CutMesh(kind=ELEMENT_KINDS[specimen.element], divisions=divisions, size=(specimen.width, specimen.length))
    uniform = stiffness_matrix(mesh, specimen.formulation, specimen.poisson)
    uneven = stiffness_matrix(mesh, specimen.formulation, specimen.poisson, halves)

    per_tip_s, per_tip = _fastest(lambda: factorising_per_tip(mesh, uniform), repeats)
    once_s, once = _fastest(lambda: tip_responses(mesh, uniform, slipping=False).stiffness, 3 * repeats)
    slips_s, with_slips = _fastest(lambda: tip_responses(mesh, uneven, slipping=True).stiffness, 3 * repeats)
    per_tip_uneven = factorising_per_tip(mesh, uneven)
    return {
        "divisions": divisions,
        "n_tips": len(specimen.tips),
        "n_equations": specimen.n_equations,
        "per_tip_s": per_tip_s,
        "one_factorisation_s": once_s,
        "one_factorisation_with_slips_s": slips_s,
        "speedup": per_tip_s / once_s,
        "speedup_with_slips": per_tip_s / slips_s,
        "largest_difference": float(np.abs(once / per_tip - 1.0).max()),
        "largest_difference_with_slips": float(np.abs(with_slips / per_tip_uneven - 1.0).max()),
    }


def factorising_per_tip(mesh: CutMesh, stiffness: csr_array[np.float64]) -> NDArray[np.float64]:
    """Return the stiffness at each tip from its own constraints and factorisation, shape (n_tips,)."""
    tip_stiffness = np.empty(len(mesh.tip_pairs))
    for tip in range(tip_stiffness.size):
        constraints = mesh.constraints(tip)
        (blade,) = blade_unknowns(mesh, constraints)[tip]
        load = np.zeros(constraints.shape[1])
        load[blade] = 1.0
        tip_stiffness[tip] = 1.0 / factorise(stiffness, constraints).solve(load)[blade]
    return tip_stiffness


def _fastest(way: Callable[[], NDArray[np.float64]], repeats: int) -> tuple[float, NDArray[np.float64]]:
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        answer = way()
        seconds.append(time.perf_counter() - start)
    return min(seconds), answer


def measure() -> Measured:
    """Compare the two on the coarsest and the finest mesh of the thesis."""
    start = time.perf_counter()
    model = CutModel()
    model.stiffness(model.tips)
    whole = 1e3 * (time.perf_counter() - start)
    numbers = {"CutModel() and its stiffnesses": Number(whole, "ms")}
    lines = [f"CutModel() and its {len(model.tips)} stiffnesses: {whole:.0f} ms"]
    for divisions, required in REQUIRED_SPEEDUP.items():
        found = factorisation_speedup(divisions, repeats=5 if divisions == (8, 15) else 1)
        mesh = f"{divisions[0]} x {divisions[1]}"
        numbers |= {
            f"{mesh}, per tip": Number(1e3 * found["per_tip_s"], "ms"),
            f"{mesh}, at once": Number(1e3 * found["one_factorisation_s"], "ms"),
            f"{mesh}, at once with slips": Number(1e3 * found["one_factorisation_with_slips_s"], "ms"),
            f"{mesh}, times faster": Number(found["speedup"], "1"),
            f"{mesh}, times faster with slips": Number(found["speedup_with_slips"], "1"),
        }
        missed = "" if found["speedup"] >= required else "MISSED: "
        lines.append(
            f"{mesh}, {found['n_tips']} tips, {found['n_equations']} equations: "
            f"per tip {1e3 * found['per_tip_s']:.1f} ms, "
            f"at once {1e3 * found['one_factorisation_s']:.1f} ms, {found['speedup']:.1f} times faster "
            f"({missed}required {required:g}), apart by {found['largest_difference']:.0e}; "
            f"with slips {1e3 * found['one_factorisation_with_slips_s']:.1f} ms, "
            f"{found['speedup_with_slips']:.1f} times faster, "
            f"apart by {found['largest_difference_with_slips']:.0e}"
        )
    return Measured(numbers, lines)
