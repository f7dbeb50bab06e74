"""Times of the three models of Table 4.3, compared with the relative sizes printed in the thesis."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.sim.tissue.tables import table
from cutenv.sim.tissue.tip_response import blade_unknowns, factorise, stiffness_matrix
from scripts.benchmarks.speed.measured import Measured, Number

BRICKS = "hex20"
LEVELS = {"quad4": ("plane_stress", 2, 4), "quad8": ("plane_stress", 2, 8), BRICKS: ("solid", 3, 20)}
"""Element -> formulation, dimensions, nodes of an element; the last two are a row of Table 4.3."""


class LevelTimes(NamedTuple):
    """Times of one model, the best of interleaved rounds [ms]."""

    n_equations: int
    whole: float
    """Time of a new model with its stiffness at every tip: mesh, assembly, factorisation, a solve for each tip."""
    analysis: float  # time of one analysis of the assembled model: a factorisation and a solve


def level_times(rounds: int = 5) -> dict[str, LevelTimes]:
    """Time each model; ``rounds`` interleaved, so that a busy machine slows all alike."""
    best = {element: [np.inf, np.inf] for element in LEVELS}
    equations = {}
    for _ in range(rounds):
        for element, (formulation, _, _) in LEVELS.items():
            start = time.perf_counter()
            model = CutModel(element, formulation)
            model.stiffness(model.tips)
            whole = time.perf_counter() - start
            assert model.divisions is not None  # settled by the model
            size = (model.width, model.length, model.thickness)[: model.dim]
            mesh = CutMesh(kind=ELEMENT_KINDS[element], divisions=model.divisions, size=size)
            stiffness, tied = stiffness_matrix(mesh, formulation, model.poisson), mesh.constraints()
            load = np.zeros(tied.shape[1])
            load[blade_unknowns(mesh, tied)[0]] = 1.0
            start = time.perf_counter()
            factorise(stiffness, tied).solve(load)
            analysis = time.perf_counter() - start
            best[element] = [min(best[element][0], whole), min(best[element][1], analysis)]
            equations[element] = model.n_equations
    return {element: LevelTimes(equations[element], *(1e3 * s for s in seconds)) for element, seconds in best.items()}


def printed_sizes() -> dict[str, float]:
    """Return the relative model sizes of Table 4.3, by element."""
    columns = table("4.3")
    kinds = zip(columns["dimensions"], columns["nodes_per_element"], strict=True)
    sizes = dict(zip(kinds, columns["relative_model_size"].tolist(), strict=True))
    return {element: sizes[dimensions, nodes] for element, (_, dimensions, nodes) in LEVELS.items()}


def measure() -> Measured:
    """Measure the three models, and their ratios to the model of bricks."""
    found, printed = level_times(), printed_sizes()
    bricks = found[BRICKS]
    numbers: dict[str, Number] = {}
    lines = [
        "the three models of Table 4.3: their times, and those over the bricks', beside the printed relative size",
        "  element  equations  over bricks  printed    new model, all tips    one analysis, assembled",
    ]
    for element, times in found.items():
        whole, analysis = times.whole / bricks.whole, times.analysis / bricks.analysis
        numbers |= {
            f"{element}, new model": Number(times.whole, "ms"),
            f"{element}, analysis": Number(times.analysis, "ms"),
        }
        if element != BRICKS:
            numbers[f"{element}, new model over bricks'"] = Number(whole, "1")
            numbers[f"{element}, analysis over bricks'"] = Number(analysis, "1")
        lines.append(
            f"  {element:7s} {times.n_equations:10d} {times.n_equations / bricks.n_equations:12.3f} "
            f"{printed[element]:8.2g} {times.whole:12.1f} ms {whole:6.3f} {times.analysis:16.2f} ms {analysis:6.3f}"
        )
    return Measured(numbers, lines)
