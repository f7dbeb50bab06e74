"""Time of the displacement of every node for a picture, on the thesis's coarsest and finest mesh."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv.display.viewer.drawn_slab import Slab
from cutenv.sim.tissue.cut_model import CutModel
from scripts.benchmarks.speed.measured import Measured, Number, at_most

MESHES = ((8, 15), (40, 75))  # numbers of elements across and along
FRAME_MS = 1e3 / 60.0
ALLOWED_OF_FRAME = 0.1  # share of a frame's time that 99 % of the displacements may take: the rest is for drawing

Microseconds = NDArray[np.float64]


class FieldTimes(NamedTuple):
    """Times for one mesh [us], shapes (updates,)."""

    n_equations: int
    first: float  # time of a new model's first displacement [ms]: assembly, factorisation, one solve for each tip
    nodes: Microseconds
    product: Microseconds  # times of the bare weighted sum of two precomputed fields: one product of matrix and vector
    lattice: Microseconds  # times of the lattice that the viewer draws


def field_times(divisions: tuple[int, int], updates: int = 2000) -> FieldTimes:
    """Time displacements at ``updates`` cut lengths from clamp to end; the three ways take turns."""
    start = time.perf_counter()
    model = CutModel(divisions=divisions)
    model.displacement(0.05, 1.0, 1e4, 0.01)
    first = 1e3 * (time.perf_counter() - start)
    slab, fields = Slab(model), model.unit_fields.reshape(len(model.tips), -1)
    slab.displacement(0.05, 0.01)
    times = np.empty((3, updates))
    for i, tip in enumerate(np.linspace(0.0, model.length, updates).tolist()):
        # The weights' values do not matter for the time.
        corner = min(int(tip / model.tips[0]), len(model.tips) - 2)
        weights, two = np.array([0.3, 0.7]), fields[corner : corner + 2]
        begun = time.perf_counter()
        model.displacement(tip, 1.0, 1e4, 0.01)
        done = time.perf_counter()
        weights @ two
        multiplied = time.perf_counter()
        slab.displacement(tip, 0.01)
        times[:, i] = done - begun, multiplied - done, time.perf_counter() - multiplied
    return FieldTimes(model.n_equations, first, *(1e6 * times))


def measure() -> Measured:
    """Measure both meshes, and compare with the time of a frame."""
    numbers: dict[str, Number] = {}
    lines = [f"displacement of every node, precomputed, for a picture of {FRAME_MS:.1f} ms (60 a second)"]
    for divisions in MESHES:
        found = field_times(divisions)
        usual, product, lattice = (float(np.median(t)) for t in (found.nodes, found.product, found.lattice))
        slow = float(np.percentile(found.nodes, 99.0))
        share = slow / (1e3 * FRAME_MS)
        mesh = f"{found.n_equations} equations"
        numbers |= {
            f"{mesh}, first": Number(found.first, "ms"),
            f"{mesh}, p50": Number(usual, "us"),
            f"{mesh}, p99": Number(slow, "us"),
            f"{mesh}, slowest": Number(float(found.nodes.max()), "us"),
            f"{mesh}, bare product": Number(product, "us"),
            f"{mesh}, the viewer's lattice": Number(lattice, "us"),
            f"{mesh}, p99 of a frame": Number(share, "1"),
        }
        lines.append(
            f"  {mesh}: {usual:.0f} us (the bare product of matrix and vector {product:.0f}), {1e6 / usual:.0f} a "
            f"second; as the viewer's lattice {lattice:.0f} us; a new model's first {found.first:.0f} ms"
        )
        within = f"99 % in {slow:.0f} us, {100.0 * share:.1f} % of a picture's time"
        lines.append(at_most(within, share, ALLOWED_OF_FRAME, f"{100.0 * ALLOWED_OF_FRAME:g} %"))
    return Measured(numbers, lines)
