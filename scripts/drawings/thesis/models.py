"""Chapter 4: displacement fields, and one cut evaluated with several models."""

from __future__ import annotations

from itertools import combinations, product
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from numpy.typing import NDArray
from tqdm import tqdm

from cutenv._engine.randomness import generator
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import CutModel, Specimen, quasi_static_modulus
from cutenv.sim.tissue.tables import table
from scripts.drawings.thesis.style import DISTANCE_LABEL, FORCE, LEM_LABEL, SOLID, STRAIN, STRESS, named, panels, save
from scripts.validation.thesis.drawn_livers import measure_as_the_thesis
from scripts.validation.thesis.elements import model
from scripts.validation.thesis.models import places
from scripts.validation.thesis.moduli import means_by_speed

Array = NDArray[np.float64]
CUT_LENGTH, TIP_DISPLACEMENT, DEPTH = 0.07, 0.010, 0.01  # [m]
RUN, LEAD = 0.010, 0.015  # of a unit of cutting: growth, one element, and displacement of the tip before [m]
COLOURS = "viridis"
TRAVEL = 0.12  # [m]
FACES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))  # of a brick


def element_types(path: Path, quick: bool) -> None:
    """Draw Figure 4.1: the elements and their nodes, as the models have them."""
    figure, axes = panels(1, 3, (10.0, 3.6), "Figure 4.1 anew: the elements and the places of their nodes")
    named(axes[0], "a) 3-D quadratic: 20 nodes")
    named(axes[1], "b) 2-D quadratic: 8 nodes")
    named(axes[2], "c) 2-D linear: 4 nodes")
    for ax, name in zip(axes, ("hex20", "quad8", "quad4"), strict=True):
        of = CutModel(name, "solid" if name == "hex20" else "plane_stress")
        spread = np.ptp(of.nodes[of.elements[0]], axis=0)
        corner = of.nodes[of.elements[0]].min(axis=0)
        inside = np.all((of.nodes >= corner - 1e-9) & (of.nodes <= corner + spread + 1e-9), axis=1)
        places = (of.nodes[inside] - corner) / spread
        edges = [
            (p, q)
            for p, q in combinations(np.array(list(product((0.0, 1.0), repeat=of.dim))), 2)
            if abs(p - q).sum() == 1
        ]
        for edge in edges:
            ax.plot(*_in_the_plane(np.array(edge)).T, color=STRESS)
        ax.plot(*_in_the_plane(places).T, "o", color="black", markersize=5)
        ax.set_aspect("equal")
        ax.set_axis_off()
        ax.text(0.5, -0.08, f"{len(places)} nodes", transform=ax.transAxes, ha="center")
    save(figure, path)


def _in_the_plane(x: Array) -> Array:
    """Return points of a plane as they are, and those in space in parallel projection; shape (n, 2)."""
    return x if x.shape[1] == 2 else x[:, :2] + x[:, 2:] * np.array([0.45, 0.35])


def incompressible_models(path: Path, quick: bool) -> None:
    """Draw Figure 4.6: plane stress and 3-D at Poisson's ratio 0.5, as printed and ours."""
    data, a = table("4.5"), np.array(places("4.5"))
    figure, (ax,) = panels(1, 1, (7.0, 4.4), "Figure 4.6 anew: plane stress and 3-D at Poisson's ratio 0.5")
    plane, solid = model("quad8", poisson=0.499), model("hex20", "solid", poisson=0.499, integration="reduced")
    base = data["lem_quad8_plane_stress_Pa"]
    ours = np.array([plane.convert_modulus(e, solid, at) for e, at in zip(base, a, strict=True)])
    ax.plot(100 * a, base / 1e3, "s", color=STRESS, label="2-D, 8 nodes, plane stress, printed")
    ax.plot(100 * a, data["lem_hex20_Pa"] / 1e3, "o", color=SOLID, label="3-D, 20 nodes, reduced integration, printed")
    ax.plot(100 * a, ours / 1e3, "-", color=SOLID, linewidth=0.9, label="3-D: ours at 0.499, from plane stress")
    ax.set_ylim(bottom=0)
    ax.legend(loc="upper left")
    named(ax, "the cut of Table 4.5", DISTANCE_LABEL, LEM_LABEL)
    save(figure, path)


def displacement_at_the_tip(of: CutModel) -> Array:
    """Return the displacement of every node [m] under the force that moves the tip by ``TIP_DISPLACEMENT``."""
    force = TIP_DISPLACEMENT * of.stiffness(CUT_LENGTH) * quasi_static_modulus() * DEPTH
    return of.displacement(CUT_LENGTH, force, quasi_static_modulus(), DEPTH)


def displacement_field(path: Path, quick: bool) -> None:
    """Draw Figure 4.2: the displaced mesh of both quadratic models, true to scale."""
    title = "Figure 4.2 anew: displacement field, tip at 7 cm pushed 1 cm forward (true to scale)"
    figure, (solid, plane) = panels(1, 2, (10.0, 6.4), title, width_ratios=(1.35, 1.0))
    norm = Normalize(0.0, 1e3 * TIP_DISPLACEMENT)
    _draw_solid(solid, model("hex20", "solid"), norm)
    _draw_plane(plane, model(), norm)
    figure.colorbar(ScalarMappable(norm, COLOURS), ax=plane, label="displacement [mm]", shrink=0.75)
    figure.legend(*plane.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    save(figure, path)


def _draw_faces(ax: Axes, points: Array, faces: NDArray[np.int64], size: Array, norm: Normalize) -> None:
    """Draw quadrilaterals in the plane, shaded by ``size`` [mm] at their corners."""
    centres = np.arange(len(faces)) + len(points)  # around which every face is split, so that it is shaded evenly
    vertices = np.concatenate([points, points[faces].mean(axis=1)])
    values = np.concatenate([size, size[faces].mean(axis=1)])
    pies = [np.column_stack([faces[:, i], faces[:, (i + 1) % 4], centres]) for i in range(4)]
    ax.tripcolor(*vertices.T, np.concatenate(pies), values, shading="gouraud", cmap=COLOURS, norm=norm)
    ax.add_collection(PolyCollection(list(points[faces]), facecolor="none", edgecolor="white", linewidth=0.5))


def _corners_of_the_cut(of: CutModel, length: float = CUT_LENGTH) -> NDArray[np.int64]:
    """Return corner nodes of the cut's left face, from the clamp to the tip; for bricks those on top."""
    line = of.pairs[np.isin(of.pairs[:, 0], of.elements), 0]
    place = of.nodes[line]
    return line[(place[:, 1] <= length + 1e-9) & (place[:, -1] >= of.nodes[line, -1].max() * (of.dim == 3) - 1e-9)]


def _draw_cut(ax: Axes, points: Array) -> None:
    ax.plot(*points.T, color="black", linewidth=2.5, label="cut (its faces slide, they do not open)")
    ax.plot(*points[-1], "o", color="#c81e1e", markeredgecolor="white", markersize=8, label="blade at the tip")


def _draw_plane(ax: Axes, of: CutModel, norm: Normalize) -> None:
    u = displacement_at_the_tip(of)
    x = 100 * (of.nodes + u)
    _draw_faces(ax, x, of.elements, 1e3 * np.linalg.norm(u, axis=1), norm)
    _draw_cut(ax, x[_corners_of_the_cut(of)])
    ax.plot([-4, 4], [0, 0], color="black", linewidth=5, solid_capstyle="butt", label="constrained edge")
    ax.set_aspect("equal")
    ax.set_xlim(-4.8, 4.8)
    ax.set_ylim(-0.4, 16.0)
    named(ax, "b) 2-D, 8-node plane stress", "across [cm]", "along the cut [cm]")


def _draw_solid(ax: Axes, of: CutModel, norm: Normalize) -> None:
    u = displacement_at_the_tip(of)
    points, size = seen_from_above(100 * (of.nodes + u)), 1e3 * np.linalg.norm(u, axis=1)
    low, high = of.nodes.min(axis=0), of.nodes.max(axis=0)
    faces = of.elements[:, np.array(FACES)].reshape(-1, 4)
    centre = of.nodes[faces].mean(axis=1)
    for side in (centre[:, 1] < low[1] + 1e-9, centre[:, 0] > high[0] - 1e-9, centre[:, 2] > high[2] - 1e-9):
        _draw_faces(ax, points, faces[side], size, norm)
    _draw_cut(ax, points[_corners_of_the_cut(of)])
    edge = seen_from_above(np.array([[-4.0, 0.0, 0.0], [4.0, 0.0, 0.0]]))
    ax.plot(*edge.T, color="black", linewidth=5, solid_capstyle="butt")
    ax.set_aspect("equal")
    ax.axis("off")
    named(ax, "a) 3-D, 20-node bricks of 1 x 1 x 0.25 cm, 1 cm deep")


def stages_of_fracture(path: Path, quick: bool) -> None:
    """Draw Figures 6.1 and 6.2: the specimen with its cutting path, and the stages of a unit of cutting."""
    title = "Figures 6.1 and 6.2 anew: the cutting path, and the three stages of one unit of cutting (true to scale)"
    figure, (plan, *stages) = panels(1, 4, (13.0, 5.2), title, sharey=True)
    of, grown, modulus = model(), CUT_LENGTH + RUN, quasi_static_modulus()
    force = LEAD * of.stiffness(CUT_LENGTH) * modulus * DEPTH
    kept = (LEAD - RUN) / LEAD  # of the blade's lead, once the tip has run
    after = kept * force * of.stiffness(grown) / of.stiffness(CUT_LENGTH)
    edges = 100 * np.array(
        [[-of.width / 2, 0], [-of.width / 2, of.length], [of.width / 2, of.length], [of.width / 2, 0]]
    )
    plan.plot(*edges.T, color=FORCE)
    ends = 100 * np.array([0.0, 0.5 * CUT_LENGTH, CUT_LENGTH, grown])
    plan.plot(0 * ends, ends, "o-", color="black", markersize=4)
    for number, end in enumerate(ends):
        plan.text(0.25, end, str(number), va="center")
    plan.annotate("", (-1.2, ends[2]), (-1.2, 0.0), arrowprops={"arrowstyle": "<->"})
    plan.text(-1.9, ends[1], "a", va="center")
    plan.annotate("F, dU", (0.0, ends[3] + 2.2), (0.0, ends[3] + 0.3), arrowprops={"arrowstyle": "->"}, ha="center")
    named(plan, "6.1: cut from point 0 to 1, 2, 3", "across [cm]", "along the cut [cm]")
    states = (
        ("1: undeformed", CUT_LENGTH, 0.0),
        (f"2: deformed, F = {force:.2f} N", CUT_LENGTH, force),
        (f"3: cut {1e3 * RUN:.0f} mm longer, F = {after:.2f} N", grown, after),
    )
    for ax, (name, length, pushed) in zip(stages, states, strict=True):
        u = of.displacement(length, pushed, modulus, DEPTH)
        x = 100 * (of.nodes + u)
        ax.add_collection(
            PolyCollection(list(x[of.elements[:, :4]]), facecolor="#f2d3c9", edgecolor="0.6", linewidth=0.5)
        )
        faces = _corners_of_the_cut(of, length)
        ax.plot(*x[faces].T, color="black", linewidth=2.5)
        ax.plot(*x[faces[-1]], "o", color="#c81e1e", markersize=6)
        energy = 0.5 * pushed * float(np.linalg.norm(u[faces[-1]]))
        named(ax, f"6.2, stage {name}\nstrain energy {1e3 * energy:.1f} mJ", "across [cm]")
    for ax in (plan, *stages):
        ax.plot([-4, 4], [0, 0], color="black", linewidth=5, solid_capstyle="butt")
        ax.set_aspect("equal")
        ax.set_xlim(-4.8, 4.8)
        ax.set_ylim(-0.4, 16.0)
    save(figure, path)


def seen_from_above(x: Array) -> Array:
    """Project points in space in parallel, seen from over the right shoulder of the clamp; shape (n, 2)."""
    turned, raised = np.radians(-32.0), np.radians(42.0)
    across = x[:, 0] * np.cos(turned) - x[:, 1] * np.sin(turned)
    along = x[:, 0] * np.sin(turned) + x[:, 1] * np.cos(turned)
    return np.stack([across, along * np.sin(raised) + x[:, 2] * np.cos(raised)], axis=1)


def models_along_the_cut(path: Path, quick: bool) -> None:
    """Draw Figures 4.3 to 4.5: the cut of Table 4.1 by every model; the average by speed with bricks."""
    figure, axes = panels(
        1, 3, (13.0, 4.4), "Figures 4.3 to 4.5 anew: one cut read with several models; average by speed"
    )
    full, magnified, by_speed = axes
    for ax in (full, magnified):
        _draw_models(ax)
    full.legend(loc="upper left", fontsize=7)
    full.set_ylim(0, 95)
    magnified.set_xlim(4.5, 5.9)
    magnified.set_ylim(23, 42)
    named(full, "4.3: the cut of Table 4.1", DISTANCE_LABEL, LEM_LABEL)
    named(magnified, "4.4: 3-D lies between plane stress and strain", DISTANCE_LABEL, LEM_LABEL)
    _draw_average_by_speed(by_speed, 2 if quick else 8)
    save(figure, path)


def _draw_models(ax: Axes) -> None:
    data, four = table("4.1"), table("4.2")
    a = np.array(places("4.1"))
    base = data["lem_quad8_plane_stress_Pa"]
    printed = {
        "3-D, 20 nodes": (data["lem_hex20_Pa"], model("hex20", "solid"), SOLID, "o"),
        "2-D, 8 nodes, plane stress": (base, model(), STRESS, "s"),
        "2-D, 8 nodes, plane strain": (data["lem_quad8_plane_strain_Pa"], model("quad8", "plane_strain"), STRAIN, "^"),
        "2-D, 4 nodes, plane stress": (four["lem_quad4_plane_stress_Pa"], model("quad4"), "0.45", "D"),
    }
    for name, (lem, of, colour, marker) in printed.items():
        ours = np.array([model().convert_modulus(e, of, at) for e, at in zip(base, a, strict=True)])
        ax.plot(100 * a, lem / 1e3, marker, color=colour, ms=5, label=f"{name}, printed")
        style = "--" if name.startswith("2-D, 4") else "-"
        ax.plot(100 * a, ours / 1e3, style, color=colour, linewidth=0.9)
    ax.plot(
        [], [], color="black", linewidth=0.9, label="lines (4 nodes dashed): ours, from the 8-node plane-stress values"
    )


def _draw_average_by_speed(ax: Axes, cuts: int) -> None:
    speeds, lem, sd = means_by_speed("5.5", 90, "plane_stress")
    means, sds = [], []
    for speed in tqdm(speeds / 100, desc="figure 4.5, by speed", leave=False):
        averages = []
        for cut in range(cuts):
            specimen = Specimen.draw(generator(45, cut), specimen_class="liver")
            plant = SimulatedPlant(specimen, seed=45, episode=cut)
            trace = to_trace(plant, run(plant, [Leg(position=TRAVEL, speed=float(speed))]))
            found = measure_as_the_thesis(trace, model("hex20", "solid"))
            if len(found):
                averages.append(float(found.modulus.mean()))
        means.append(np.mean(averages) / 1e3)
        sds.append(np.std(averages) / 1e3)
    ax.errorbar(speeds - 0.02, lem, sd, fmt="s", color=STRESS, ms=4, label="Table 5.5, plane stress, mean ± SD")
    label = f"the same {cuts} virtual livers at each speed,\nread with bricks, mean ± SD"
    ax.errorbar(speeds + 0.02, means, sds, fmt="o", color=SOLID, ms=4, label=label)
    ax.set_ylim(0, 100)
    ax.legend(loc="upper right")
    named(ax, "4.5: average by speed, 90°, force as measured", "cutting speed [cm/s]", LEM_LABEL)
