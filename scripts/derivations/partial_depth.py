"""Derive the effect of a partial depth of cut B on the stiffness of a slab of thickness T, from 20-node bricks.

    python -m scripts.derivations.partial_depth            derives the table and prints it
    python -m scripts.derivations.partial_depth --write    also writes assets/derived/partial_depth.json
    python -m scripts.derivations.partial_depth --check    checks field and depth together on another, finer mesh

The 2-D model assumes slabs that are cut through. Here the thesis's slab (8 x 15 x 2.5 cm) is built of bricks, 8 x 15 in
the plane as in the 2-D model, with thin layers under the surface. The blade moves all nodes of the tip from the
surface down to its depth B equally; below it the tissue is whole. Load and faces lie on the mirror plane, so that an
opened cut behind the tip changes nothing, and one half of the slab is enough.

Two numbers are stored for every tip and depth. The *stiffness ratio* is K over that of a cut through the same slab. It
does not vanish with B: an edge of no depth still pushes a patch as wide as an element, the size over which the plane
model spreads its point load. The *local share* is the weight of the two rows of elements at the tip in the modulus that
a shallow blade meets, the rest being the 2-D model's average: fitted to random fields of moduli.
"""

from __future__ import annotations

import argparse
import json

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.sparse.linalg import splu
from skfem import Basis, MeshHex
from skfem.element import ElementHexS2, ElementVector
from tqdm import tqdm

from cutenv._base import resources
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.description import measured_liver
from cutenv.sim.tissue.elasticity import elastic_form
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, SPACING, field_modes, lognormal_sigma
from cutenv.sim.tissue.slab import DEPTHS, ROWS, THICKNESS, local_modulus, row_means, stiffness_along
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.tissue.tables import FOLDER
from scripts.tables import markdown_table

Array = NDArray[np.float64]

WIDTH, POISSON = 0.08, 0.3
LAYERS = np.array([0, 0.5, 1, 1.5, 2, 3, 4, 5, 6, 8, 10, 12.5, 15, 17, 19, 21, 22.5, 24, 25]) * 1e-3
"""Borders of the layers of bricks, from the surface down [m]."""
FINER = 1e-3 * np.array(  # layer borders of the check's finer mesh; only the surfaces coincide with the table's [m]
    [0, 0.3, 0.7, 1.2, 1.7, 2.2, 2.7, 3.3, 3.9, 4.5, 5.5, 6.6, 7.7, 9, 10.5, 12, 13.7, 15.5, 17.5, 19.5, 21.5, 23.3, 25]
)  # fmt: skip
SPARSE = 1e-3 * np.array([0, 0.5, 1, 1.75, 2.5, 3.75, 5, 7.5, 10, 15, 20, 25])
"""Layer borders of the bricks whose size in the plane is halved [m]."""
REFINED, FARTHEST = (1e-3, 2.5e-3, 5e-3, 10e-3, 20e-3), 12
"""Depths at which the halved bricks are compared [m], and the farthest tip [cm]."""
FIELD_CV, FIELDS, CHECKED = 0.4, 12, 6
CORRELATION = 0.020  # [m]


def stiffness_by_depth(
    borders: Array, row_modulus: Array, across: int = 4, along: int = ROWS, layer_modulus: Array | None = None
) -> Array:
    """Return K over width-independent modulus, for each tip and each border as depth, shape (along, n_borders) [m].

    ``row_modulus``, shape (15,), is that of each centimetre along the cut, and ``layer_modulus``, shape
    (n_borders - 1,), that of each layer of bricks, relative to a common one.
    """
    mesh = MeshHex.init_tensor(
        np.linspace(0.0, WIDTH / 2, across + 1), np.linspace(0.0, LENGTH, along + 1), np.asarray(borders)
    )
    basis = Basis(mesh, ElementVector(ElementHexS2()), intorder=5)
    centres = mesh.p[:, mesh.t].mean(axis=1)
    modulus = row_modulus[(centres[1] / LENGTH * ROWS).astype(int)]
    if layer_modulus is not None:
        modulus = modulus * layer_modulus[np.searchsorted(borders, centres[2]) - 1]
    stiffness = elastic_form("solid", POISSON, modulus).assemble(basis).tocsc()

    component = np.empty(stiffness.shape[0], dtype=int)
    for k in range(3):
        component[basis.nodal_dofs[k]] = component[basis.edge_dofs[k]] = k
    x, y, z = basis.doflocs
    held = (y < 1e-9) | ((x < 1e-9) & (component == 0))  # the clamp, and the mirror plane
    free = np.flatnonzero(~held)
    number = np.full(len(component), -1)
    number[free] = np.arange(len(free))
    options = {"SymmetricMode": True}
    factors = splu(stiffness[free][:, free].tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)

    found = np.zeros((along, len(borders)))
    for tip in range(along):
        at_tip = (x < 1e-9) & (np.abs(y - (tip + 1) * LENGTH / along) < 1e-9) & (component == 1)
        line = np.flatnonzero(at_tip)
        line = line[np.argsort(z[line])]
        loads = np.zeros((len(free), len(line)))
        loads[number[line], np.arange(len(line))] = 1.0
        compliance = factors.solve(loads)[number[line]]
        for n, depth in enumerate(borders):
            moved = np.flatnonzero(z[line] <= depth + 1e-9)
            forces = np.linalg.solve(compliance[np.ix_(moved, moved)], np.ones(len(moved)))
            found[tip, n] = 2.0 * forces.sum()  # both halves
    return found


def drawn_field(number: int) -> Array:
    """Return a random field of moduli of mean 1 along the cut, shape (301,)."""
    modes = field_modes(N_POINTS, SPACING, CORRELATION)
    sigma = lognormal_sigma(FIELD_CV)
    unit = np.random.default_rng(number).standard_normal(len(modes)) @ modes
    return np.exp(sigma * unit - 0.5 * sigma**2)


def plane_ratio(rows: Array) -> Array:
    """Return K of the 2-D model with these rows over that with modulus 1, at each tip, shape (15,)."""
    tips = CutModel().tips
    return np.asarray(CutModel(relative_modulus=np.tile(rows, 8)).stiffness(tips) / CutModel().stiffness(tips))


def derive() -> tuple[Array, Array]:
    """Return stiffness ratio and local share, each of shape (15, 51): by tip and depth."""
    uniform = stiffness_by_depth(LAYERS, np.ones(ROWS))
    ratio = uniform / uniform[:, -1:]
    products, squares = np.zeros_like(ratio), np.zeros_like(ratio)
    for number in tqdm(range(FIELDS), desc="fields on bricks"):
        rows = row_means(drawn_field(number))
        plane, local = plane_ratio(rows)[:, None], local_modulus(rows)[:, None]
        shallow = stiffness_by_depth(LAYERS, rows) / uniform
        products += (shallow - plane) * (local - plane)
        squares += (local - plane) ** 2
    share = np.clip(products / squares, 0.0, 1.0)

    def at_every_depth(values: Array) -> Array:
        return np.asarray(PchipInterpolator(LAYERS, values, axis=1)(DEPTHS * THICKNESS))

    return at_every_depth(ratio), at_every_depth(share)


def check() -> None:
    """Print the error of K by the table against bricks of a finer mesh: sampled livers, depths between layers."""
    liver = measured_liver()
    tips = np.arange(1, 13)  # [cm]
    depths = FINER[(FINER >= liver.edge_depth) & (FINER < THICKNESS)]
    print(
        f"bricks 8 x {ROWS} x {len(FINER) - 1}; {CHECKED} drawn livers, modulus within a cut of CV "
        f"{liver.modulus_within_cut_cv:.2f}; tips of 1 to 12 cm; error of K, %:\n"
        f"          rows of elements   {len(depths)} depths, {1e3 * depths[0]:.1f} to {1e3 * depths[-1]:.1f} mm"
        "     own depth"
    )
    uniform = stiffness_by_depth(FINER, np.ones(ROWS))
    kappa = np.asarray(CutModel().stiffness(tips / 100))
    slab = liver.slab()

    def by_table(modulus: Array, depth: Array) -> Array:
        return stiffness_along(slab, modulus, depth, THICKNESS)[20 : 20 * 13 : 20] / (kappa * THICKNESS)

    for number in range(CHECKED):
        specimen = Specimen.drawn(number)
        modulus = specimen.modulus / specimen.modulus.mean()
        rows = row_means(modulus)
        bricks = stiffness_by_depth(FINER, rows)[:12] / uniform[:12, -1:]
        errors = np.array(
            [by_table(modulus, np.full(N_POINTS, B)) / bricks[:, FINER == B].ravel() - 1.0 for B in depths]
        )
        at_own_depth = [PchipInterpolator(FINER, bricks[n])(specimen.depth[20 * (n + 1)]) for n in range(12)]
        own = by_table(modulus, specimen.depth) / np.array(at_own_depth) - 1.0
        size = np.abs(100 * errors)
        print(
            f"  liver {number}   {rows.min():.2f} to {rows.max():.2f}   median {np.median(size):.2f}, 95th percentile "
            f"{np.quantile(size, 0.95):.2f}, largest {size.max():.2f}   largest {np.abs(100 * own).max():.2f}"
        )


def elements_matter() -> str:
    """Return as Markdown how the stiffness ratio changes with the bricks' size, and K of bricks over E kappa T g."""
    coarse = stiffness_by_depth(SPARSE, np.ones(ROWS))
    fine = stiffness_by_depth(SPARSE, np.ones(ROWS), across=8, along=2 * ROWS)[1::2]
    change = (fine / fine[:, -1:]) / (coarse / coarse[:, -1:]) - 1.0
    lower = []
    for depth in REFINED:
        at_tips = 100.0 * change[:FARTHEST, int(np.argmin(np.abs(SPARSE - depth)))]
        lower.append((f"{1e3 * depth:g}", f"{np.median(at_tips):.0f}", f"{at_tips.min():.1f} to {at_tips.max():.1f}"))
    tips = np.arange(1, ROWS + 1)
    over = coarse[:, -1] / (np.asarray(CutModel().stiffness(tips / 100)) * THICKNESS)
    above = [(str(tips[n]), f"{over[n]:.3f}") for n in (0, 1, 4, 8, 12)]
    header = ("depth B [mm]", "change of g on bricks of 5 mm, median [%]", f"tips of 1 to {FARTHEST} cm [%]")
    return f"{markdown_table(header, lower)}\n\n{markdown_table(('tip [cm]', 'K of bricks over E kappa T g'), above)}"


def main() -> None:
    """Derive and print; write or check if requested."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write assets/derived/partial_depth.json")
    parser.add_argument("--check", action="store_true", help="only check the table in use")
    parser.add_argument("--elements", action="store_true", help="only show what the size of the elements makes of it")
    arguments = parser.parse_args()
    if arguments.elements:
        print(elements_matter())
        return
    if arguments.check:
        check()
        return
    ratio, share = derive()
    shown = range(0, len(DEPTHS), 5)
    print("B/T           " + " ".join(f"{DEPTHS[n]:6.2f}" for n in shown))
    for tip in (0, 1, 3, 5, 7, 9, 11, 14):
        print(f"K ratio {tip + 1:3d} cm " + " ".join(f"{ratio[tip, n]:6.3f}" for n in shown))
    for tip in (0, 1, 3, 5, 7, 9, 11, 14):
        print(f"local   {tip + 1:3d} cm " + " ".join(f"{share[tip, n]:6.3f}" for n in shown))
    if arguments.write:
        content = {
            "source": f"20-node bricks, 8 x 15 x {len(LAYERS) - 1}, nu = {POISSON}, T = {THICKNESS} m; "
            f"{FIELDS} fields of CV {FIELD_CV}",
            "script": "scripts/derivations/partial_depth.py --write",
            "depth_over_thickness": DEPTHS.tolist(),
            "stiffness_ratio": np.round(ratio, 6).tolist(),
            "local_share": np.round(share, 6).tolist(),
        }
        text = json.dumps(content, indent=1).replace(",\n   ", ", ")
        resources.path(FOLDER).joinpath("partial_depth.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
