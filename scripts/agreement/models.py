"""How the modulus of one cut depends on the model that reads it: Tables 4.1, 4.2 and 4.4.

A local effective modulus is the measured slope over kappa and depth.  Whatever was measured at a place, the moduli of
two models stand there in the inverse ratio of their unit stiffnesses.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from agreement.rows import Comparison, Row, near
from cutenv.tissue import CutModel
from cutenv.tissue.tables import table

QUAD8_COLUMN = "lem_quad8_plane_stress_Pa"
FROM_4_CM = 0.04  # nearer to the clamp the brick model is not compared [m]
KAPPA = {0.02: 0.942, 0.05: 0.668, 0.07: 0.569}  # worked out independently, 8-node plane stress
POISSON_RATIOS = (0.4, 0.45, 0.499)


class Lem(NamedTuple):
    """A printed modulus [Pa] and half a unit of its last digit over it [1]."""

    value: float
    rounding: float


@cache
def model(element: str = "quad8", formulation: str = "plane_stress", poisson: float = 0.3) -> CutModel:
    """A model on the thesis's mesh, built once."""
    return CutModel(element, formulation, poisson)


def places(number: str) -> list[float]:
    """Where the loading segments of a table stand [m]."""
    return [float(d) / 100.0 for d in table(number)["distance_cm"]]


def printed(number: str, column: str, row: int) -> Lem:
    """One cell of a table."""
    data = table(number)
    return Lem(data[column][row], data.resolution[column] / 2 / data[column][row])


def ratio_row(
    what: str,
    a: float,
    lem: Lem,
    base: Lem,
    of: CutModel,
    tolerance: float | None,
    *,
    base_model: CutModel | None = None,
) -> Row:
    """LEM read with ``of`` over LEM read with ``base_model`` (8-node plane stress), printed and ours."""
    ours = (base_model or model()).convert_modulus(1.0, of, a)
    within = None if tolerance is None else tolerance + lem.rounding + base.rounding
    return near(what, lem.value / base.value, ours, relative=within)


def largest_difference(rows: list[Row]) -> str:
    """The largest relative difference of the rows that claim to agree, in words."""
    claimed = [row for row in rows if row.agrees is not None] or rows
    worst = max(abs(float(row.ours) / float(row.reference) - 1.0) for row in claimed)
    return f"within {100 * worst:.1f} %"


def unit_stiffness(quick: bool) -> Comparison:
    """Kappa at three cut lengths against an independent calculation."""
    rows = [
        near(f"kappa at {100 * a:g} cm", reference, model().stiffness(a), absolute=0.0005, form=".4f")
        for a, reference in KAPPA.items()
    ]
    return Comparison(
        title="Unit stiffness, 8 nodes, plane stress",
        source="independent calculation",
        ours=", ".join(f"{model().stiffness(a):.3f}" for a in KAPPA) + " at 2, 5, 7 cm",
        tolerance="third digit",
        rows=tuple(rows),
    )


def plane_strain(quick: bool) -> Comparison:
    """Table 4.1: plane strain over plane stress."""
    rows = [
        ratio_row(
            f"at {100 * a:.2f} cm",
            a,
            printed("4.1", "lem_quad8_plane_strain_Pa", i),
            printed("4.1", QUAD8_COLUMN, i),
            model("quad8", "plane_strain"),
            0.015,
        )
        for i, a in enumerate(places("4.1"))
    ]
    return Comparison(
        title="LEM in plane strain over plane stress, 8 nodes",
        source="Table 4.1",
        ours=largest_difference(rows),
        tolerance="1.5 % + printed digits",
        rows=tuple(rows),
        notes=table("4.1").errata,
    )


def poisson(quick: bool) -> Comparison:
    """Table 4.4: LEM at three other Poisson's ratios over LEM at 0.3."""
    column = "lem_quad8_plane_stress_poisson_{:g}_Pa".format
    rows = [
        ratio_row(
            f"nu = {nu:g}, at {100 * a:.2f} cm",
            a,
            printed("4.4", column(nu), i),
            printed("4.4", column(0.3), i),
            model(poisson=nu),
            0.01,
        )
        for nu in POISSON_RATIOS
        for i, a in enumerate(places("4.4"))
    ]
    return Comparison(
        title="LEM at Poisson's ratios 0.4 to 0.499 over that at 0.3",
        source="Table 4.4",
        ours=largest_difference(rows),
        tolerance="1 % + printed digits",
        rows=tuple(rows),
        notes=table("4.4").errata,
    )


def bricks(quick: bool) -> Comparison:
    """Table 4.1: 20-node bricks over 8-node plane stress, from 4.08 cm on."""
    rows = []
    for i, a in enumerate(places("4.1")):
        lem, base = printed("4.1", "lem_hex20_Pa", i), printed("4.1", QUAD8_COLUMN, i)
        if a >= FROM_4_CM:
            ours = model().convert_modulus(1.0, model("hex20", "solid"), a)
            rows.append(near(f"at {100 * a:.2f} cm", lem.value / base.value, ours, relative=0.04))
        else:
            what = f"at {100 * a:.2f} cm, near the clamp"
            rows.append(ratio_row(what, a, lem, base, model("hex20", "solid"), None))
    return Comparison(
        title="LEM of 20-node bricks over 8-node plane stress, from 4.08 cm",
        source="Table 4.1",
        ours=largest_difference(rows),
        tolerance="4 %",
        rows=tuple(rows),
    )


def four_nodes(quick: bool) -> Comparison:
    """Table 4.2: the 4-node columns, whose element the text does not name; shown only."""
    rows = [
        ratio_row(
            f"{formulation.replace('_', ' ')}, at {100 * a:.2f} cm",
            a,
            printed("4.2", f"lem_quad4_{formulation}_Pa", i),
            printed("4.1", f"lem_quad8_{formulation}_Pa", i),
            model("quad4", formulation),
            None,
            base_model=model("quad8", formulation),
        )
        for formulation in ("plane_stress", "plane_strain")
        for i, a in enumerate(places("4.2"))
    ]
    differences = np.array([float(row.ours) / float(row.reference) - 1.0 for row in rows])
    return Comparison(
        title="LEM of 4-node elements over 8-node ones",
        source="Table 4.2",
        ours=f"{-100 * differences.max():.0f} to {-100 * differences.min():.0f} % lower than printed",
        tolerance="not a target",
        rows=tuple(rows),
        notes=table("4.2").errata,
    )
