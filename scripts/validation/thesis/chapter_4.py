"""Statements of chapter 4: its tables and text among themselves, and beside our models; tested, not listed.

A row "not so" is a reading that must not pass; every erratum is named beside the rows that show it.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from cutenv.sim.tissue import CutModel
from cutenv.sim.tissue.tables import ThesisTable, table
from scripts.validation.thesis.constitutive import constitutive_matrix
from scripts.validation.thesis.elements import DIVISIONS, model
from scripts.validation.thesis.models import EXPERIMENTS, FORMULATIONS, FROM_4_CM, PIECE_LENGTH, four_node_rows, places
from scripts.validation.thesis.rows import (
    Row,
    Statements,
    equal,
    erratum,
    everywhere,
    holds,
    near,
    printed_as,
    refuted,
    statement,
)

TO_ONE_DECIMAL = (1.1, 1.0)  # of the ratios of Table 4.1; everything else is printed to two


def ratios(T: ThesisTable, columns: dict[str, str]) -> list[Row]:
    """Check columns of ratios, given with those of their numerators, plane over brick.

    Some unrounded pair of moduli must round to both of them and to their printed ratio.
    """
    rows = []
    for column, numerator in columns.items():
        half = T.resolution[numerator] / 2
        for at, plane, brick, ratio in zip(T["distance_cm"], T[numerator], T["lem_hex20_Pa"], T[column], strict=True):
            slack = 0.05 if T.number == "4.1" and ratio in TO_ONE_DECIMAL else 0.005
            low, high = (plane - half) / (brick + half) - slack, (plane + half) / (brick - half) + slack
            what = f"at {at:.2f} cm, {numerator} over bricks"
            rows.append(holds(what, f"{ratio:g}", f"{low:.3f} to {high:.3f}", low <= ratio <= high))
    return rows


# 35000/36900 is at least 0.946, printed 0.94: cut off, not rounded.
@statement("table-4.1", "Bricks against 8 nodes; Appendix A", misses=("at 4.75 cm, lem_quad8_plane_strain_Pa",))
def table_4_1() -> Statements:
    """Compare the columns with each other: the two of ratios are printed under each other's labels."""
    T = table("4.1")
    stress, strain = names = [f"lem_quad8_{of}_Pa" for of in FORMULATIONS]
    columns = [f"ratio_{of}_to_hex20" for of in FORMULATIONS]
    yield from ratios(T, dict(zip(columns, names, strict=True)))
    as_labelled = (ratios(T, {column: name}) for column, name in zip(columns, reversed(names), strict=True))
    for one, other in zip(*as_labelled, strict=True):
        yield f"not so: as labelled, {one.what}", not (one.agrees and other.agrees)
    yield erratum("4.1", "under each other's labels")
    yield "bricks lie between", (T[strain] <= T["lem_hex20_Pa"]) & (T["lem_hex20_Pa"] <= T[stress])
    for nu in (0.0, 0.3, 0.45, 0.499):
        for of, entry in zip(FORMULATIONS, ((1 - nu) / (1 - nu**2), 1 / (1 + nu)), strict=True):
            over_ours = entry / constitutive_matrix(of, nu)[2, 2]
            yield near(f"Appendix A, {of}, nu = {nu:g}: shear entry over ours", 2.0, over_ours, relative=1e-12)
    yield erratum("4.1", "Appendix A's shear entries")
    piece = CutModel(length=PIECE_LENGTH, divisions=(8, 12))
    for a, softer in ((0.08, 0.99), (0.11, 0.89)):
        ratio = piece.stiffness(a) / model().stiffness(a)
        yield near(f"a piece 12 cm long over the model's 15 cm, cut {100 * a:g} cm", softer, ratio, absolute=0.005)
    yield erratum("4.1", "pieces of 8 x 12 x 2.5 cm")


@statement("figure-4.4", "Bricks between plane stress and plane strain, our models")
def figure_4_4() -> Statements:
    """Compare the unit stiffness of our models at the places of Table 4.1, from 4.08 cm."""
    a = np.array([place for place in places("4.1") if place >= FROM_4_CM])
    stress, strain = (np.asarray(model("quad8", of).stiffness(a)) for of in FORMULATIONS)
    solid = np.asarray(model("hex20", "solid").stiffness(a))
    yield "bricks are stiffer than plane stress", stress < solid
    yield "bricks are softer than plane strain", solid < strain


@statement("table-4.2", "4-node elements against bricks: the element is not named, and no target")
def table_4_2() -> Statements:
    """Compare with Table 4.1, and with our 4-node element, which is fully integrated.

    Bilinear displacements are among the quadratic ones, so that a conforming 4-node element is stiffer than the 8-node
    one on the same mesh and gives a lower LEM. All printed values are higher.
    """
    T, eight = table("4.2"), table("4.1")
    yield from ratios(T, {f"ratio_{of}_to_hex20": f"lem_quad4_{of}_Pa" for of in FORMULATIONS})
    yield from map(refuted, ratios(T, {"ratio_plane_strain_to_hex20": "lem_quad4_plane_stress_Pa"}))
    for column in ("distance_cm", "lem_hex20_Pa"):
        yield equal(f"{column} repeats Table 4.1", T[column], eight[column])
    yield erratum("4.2", "not named")
    for of in FORMULATIONS:
        yield f"{of}: printed softer than 8 nodes", T[f"lem_quad4_{of}_Pa"] > eight[f"lem_quad8_{of}_Pa"]
    rows = four_node_rows(0.015)
    yield from map(refuted, rows)
    yield "our element is stiffer than 8 nodes", [float(row.ours) < 1.0 for row in rows]
    off = np.array([float(row.ours) / float(row.reference) - 1.0 for row in rows]).reshape(2, -1)
    yield "the largest difference is 45 %, to 2 points", np.abs(off.min(axis=1) + 0.45) <= 0.02
    yield "the smallest difference is 12 %, to 2 points", np.abs(off.max(axis=1) + 0.12) <= 0.02
    yield "the largest difference stands nearest the clamp", off.argmin(axis=1) == 0


@statement("table-4.3", "Sizes of the models")
def table_4_3() -> Statements:
    """Count unknowns."""
    T = table("4.3")
    size, digit = T["n_equations"] / T["n_equations"][0], T.resolution["relative_model_size"]
    yield equal("equations are nodes times dimensions", T["n_equations"], T["n_nodes"] * T["dimensions"])
    for nodes, stated, ours in zip(T["nodes_per_element"], T["relative_model_size"], size, strict=True):
        yield printed_as(f"relative size, {nodes:g} nodes", stated, ours, digit)
    yield refuted(printed_as("the text's relative size of 8 nodes", 0.3, size[1], 0.1))
    yield erratum("4.3", "1.0:0.3:0.04")


@statement("table-4.4", "LEM at four Poisson's ratios")
def table_4_4() -> Statements:
    """Check that the columns are moduli, although the header says ratio, and hardly differ."""
    T = table("4.4")
    base = T["lem_quad8_plane_stress_poisson_0.3_Pa"]
    yield equal("the column at 0.3 repeats Table 4.1", base, table("4.1")["lem_quad8_plane_stress_Pa"])
    for column in (name for name in T.columns if name.startswith("lem_")):
        yield f"{column} holds no ratio, which is of the order of 1", T[column] > 100
        within = 0.02 + T.resolution[column] / base  # half a digit each of two printed numbers
        yield f"{column} is within 2 % of that at 0.3", np.abs(T[column] / base - 1) <= within
    yield refuted(everywhere("Table 4.1's ratios are none", table("4.1")["ratio_plane_stress_to_hex20"] > 100))
    yield erratum("4.4", "Ratio of LEM")


@statement("table-4.5", "LEM at Poisson's ratio 0.5")
def table_4_5() -> Statements:
    """Compare its columns with each other and with Table 4.4."""
    T, other = table("4.5"), table("4.4")
    eight, four = "lem_quad8_plane_stress_Pa", "lem_quad4_plane_stress_Pa"
    yield from ratios(T, {"ratio_quad8_to_hex20": eight, "ratio_quad4_to_hex20": four})
    yield from map(refuted, ratios(T, {"ratio_quad4_to_hex20": eight}))
    yield equal("the places are those of Table 4.4", T["distance_cm"], other["distance_cm"])
    yield equal("8 nodes repeat 0.499 of Table 4.4", T[eight], other["lem_quad8_plane_stress_poisson_0.499_Pa"])
    yield refuted(equal("8 nodes repeat 0.4 of Table 4.4", T[eight], other["lem_quad8_plane_stress_poisson_0.4_Pa"]))


@statement("tables-4.6-4.11", "Mean LEM of six cuts on five meshes")
def tables_4_6_to_4_11() -> Statements:
    """Check that the mean grows with the logarithm of the element size, as under a point load, to 2 %.

    The line starts at the coarsest mesh and is fitted to the three finer ones that are not in doubt.
    """
    meshes, trusted = table("4.12"), [2, 3, 4]
    refinement = -np.log(meshes["element_area_cm2"]) / 2
    for number in EXPERIMENTS:
        T = table(number)
        for column in ("level", "n_nodes", "n_elements"):
            yield equal(f"Table {number}: {column} is that of Table 4.12", T[column], meshes[column])
        growth = T["mean_lem_Pa"] / T["mean_lem_Pa"][0] - 1
        line = refinement * (refinement[trusted] @ growth[trusted]) / (refinement[trusted] @ refinement[trusted])
        for i in range(1, 5):
            row = near(f"Table {number}, level {i + 1}: growth of the mean", line[i], growth[i], absolute=0.02)
            yield row if i in trusted else refuted(row)
    yield erratum("4.12", "838 nodes in Tables 4.6 to 4.11")


def _nodes_of(across: int, along: int) -> int:
    """Count 8-node elements' corners, mid-sides, and the second copies of the nodes on the cut line."""
    mid_sides = across * (along + 1) + (across + 1) * along
    return (across + 1) * (along + 1) + mid_sides + 2 * along + 1


def _one_mesh(n_nodes: float, n_elements: float) -> Row:
    """Check that some division with element corners on the centre line has both counts."""
    possible = {_nodes_of(n, int(n_elements) // n) for n in range(2, int(n_elements) + 1, 2) if n_elements % n == 0}
    return everywhere(f"{n_nodes:g} nodes and {n_elements:g} elements are one mesh", n_nodes in possible)


@statement("table-4.12", "Meshes of the element-size study")
def table_4_12() -> Statements:
    """Count nodes and elements, and see the modulus rise as elements shrink (section 4.4.2)."""
    T, a = table("4.12"), np.linspace(0.02, 0.12, 6)
    elements, area = T["n_elements"], T["element_area_cm2"]
    rows = [_one_mesh(*counts) for counts in zip(T["n_nodes"], elements, strict=True)]
    yield from [*map(refuted, rows[:2]), *rows[2:], _one_mesh(438, 120), _one_mesh(838, 240)]
    yield erratum("4.12", "440 nodes at level 1")
    yield erratum("4.12", "200 elements at level 2")
    yield equal("438 is the count of Table 4.3", table("4.3")["n_nodes"][1], 438)
    yield equal("elements times area is the specimen but at level 2", elements * area, [120, 100, 120, 120, 120])
    yield (
        "elements per area is the inverse of the area",
        np.isclose(T["elements_per_area_per_cm2"] * area, 1, rtol=1e-6),
    )
    models = [model(divisions=each) for each in DIVISIONS]
    ours = [1e4 * each.width * each.length / each.n_elements for each in models]
    yield "the area is that of our elements", np.isclose(area, ours, rtol=1e-6)
    for coarser, finer in pairwise(1.0 / np.asarray(each.stiffness(a)) for each in models):
        yield "the modulus rises as elements shrink", finer > coarser
