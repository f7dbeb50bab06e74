"""Condense the 2-D model of a slab with a field of moduli, and print the error of K(a) against the full model.

python -m scripts.derivations.slab            prints errors and the time that a specimen takes
python -m scripts.derivations.slab --write    condenses first, and writes assets/derived/slab.json
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np

from cutenv._base import resources
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, SPACING, field_modes, lognormal_sigma
from cutenv.sim.tissue.slab import condensed
from cutenv.sim.tissue.tables import FOLDER

FIELDS = 60
MODEL = {"element": "quad8", "formulation": "plane_stress", "poisson": 0.3}


def write() -> None:
    """Condense the model and write the result."""
    content = {
        "source": "CutModel condensed by rows of elements (cutenv.sim.tissue.slab)",
        "script": "scripts/derivations/slab.py --write",
        **MODEL,
        **{name: values.tolist() for name, values in condensed(CutModel(**MODEL))._asdict().items()},
    }
    resources.path(FOLDER).joinpath("slab.json").write_text(json.dumps(content) + "\n")


def show() -> None:
    """Print errors against ``CutModel``, by the spread of the field."""
    from cutenv.sim.tissue.slab import ROWS, row_means, slab_of, stiffness_along

    slab = slab_of(*MODEL.values())
    modes = field_modes(N_POINTS, SPACING, 0.020)
    depth, thickness = np.full(N_POINTS, 0.01), 0.01  # cut through
    places = np.arange(N_POINTS) * SPACING
    for cv in (0.1, 0.2, 0.3, 0.4, 0.5, 0.8):
        rng = np.random.default_rng(1000)
        sigma = lognormal_sigma(cv)
        at_tips, between = [], []
        for _ in range(FIELDS):
            field = np.exp(sigma * (rng.standard_normal(len(modes)) @ modes))
            full = CutModel(**MODEL, relative_modulus=np.tile(row_means(field), 8))
            error = (
                stiffness_along(slab, field, depth, thickness) / (np.asarray(full.stiffness(places)) * thickness) - 1
            )
            at_tips.append(error[20 :: N_POINTS // ROWS])
            between.append(error)
        print(
            f"field of CV {cv:.1f}: K over CutModel's - 1, {FIELDS} fields: at tips "
            f"{100 * np.min(at_tips):+.3f} to {100 * np.max(at_tips):+.3f} %, everywhere "
            f"{100 * np.min(between):+.3f} to {100 * np.max(between):+.3f} %"
        )
    start = time.perf_counter()
    for _ in range(1000):
        stiffness_along(slab, field, depth, thickness)
    print(f"one specimen: {1e3 * (time.perf_counter() - start):.1f} us")
    assert abs(LENGTH / ROWS - 0.01) < 1e-12


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write assets/derived/slab.json")
    if parser.parse_args().write:
        write()
    show()
