"""Draw the figures of the documentation's concepts: assets/pictures/geometry.svg and law.svg.

    python -m scripts.drawings.concepts

Backgrounds are transparent, and lines and letters of a grey that is read on white and on black.
"""

from __future__ import annotations

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon, Rectangle

from cutenv.sim.plant import Leg, SimulatedPlant, run
from cutenv.sim.tissue import Specimen
from scripts import ROOT

FOLDER = ROOT / "assets" / "pictures"
GREY = "#808080"
TISSUE, CRACK, FORCE, TARGET = "#d98c7a", "#5b9bd5", "#2f8fd0", "#1f9e77"
STYLE = {
    "svg.hashsalt": "cutenv",
    "svg.fonttype": "path",
    "font.size": 11,
    "text.color": GREY,
    "axes.edgecolor": GREY,
    "axes.labelcolor": GREY,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "savefig.transparent": True,
}


def save(figure: plt.Figure, name: str) -> None:
    """Write an SVG that is the same at every run."""
    figure.savefig(FOLDER / name, metadata={"Date": None, "Creator": None})
    plt.close(figure)
    print(FOLDER / name)


def draw_geometry() -> None:
    """Draw a cut from the side: clamp, crack, tip, blade and target."""
    tip, blade, target, end, depth = 55.0, 63.0, 80.0, 110.0, 20.0
    figure, axes = plt.subplots(figsize=(8.0, 4.2), layout="constrained")
    axes.set_xlim(-12, end + 1)
    axes.set_ylim(-47, 18)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.add_patch(Rectangle((0, -25), end, 25, facecolor=TISSUE, alpha=0.9, linewidth=0))
    opened = [(0, 0), (tip, 0), (tip, -depth), (0, -2)]
    axes.add_patch(Polygon(opened, facecolor=CRACK, linewidth=0))
    stretched = np.linspace(tip, blade, 7)
    for x in stretched[1:-1]:
        axes.plot([x, x], [-depth, 0], color=GREY, linewidth=0.7)
    axes.add_patch(Rectangle((-6, -27), 6, 29, facecolor=GREY, alpha=0.8))
    axes.add_patch(Polygon([(blade, -depth), (blade + 2, -depth + 2), (blade + 2, 16), (blade, 16)], facecolor=GREY))
    axes.plot([target, target], [-25, 5], color=TARGET, linewidth=2)
    axes.annotate("", (blade + 16, 11), (blade + 4, 11), arrowprops={"arrowstyle": "->", "color": GREY})
    axes.text(blade + 17, 11, "motion", va="center")
    axes.annotate("", (blade - 15, 6), (blade - 1, 6), arrowprops={"arrowstyle": "->", "color": FORCE, "lw": 2})
    axes.text(blade - 16, 6, "force $F = K(a)\\,(x - a)$", color=FORCE, va="center", ha="right")
    axes.text(-3, 4, "clamp", ha="center", va="bottom")
    axes.text(target, 6, "target", color=TARGET, ha="center", va="bottom")
    axes.text(tip / 2 + 4, -6, "crack", ha="center", va="center", color="black")
    axes.text(95, -12, "tissue", ha="center", va="center", color="black")
    for x, text, level in ((tip, "crack tip $a$: scored, hidden", -36), (blade, "blade $x$: measured", -43)):
        axes.plot([x, x], [-depth, level], color=GREY, linewidth=0.8, linestyle=":")
        axes.annotate(
            "", (x, level), (0, level), arrowprops={"arrowstyle": "<->", "color": GREY, "shrinkA": 0, "shrinkB": 0}
        )
        axes.text(x + 1.5, level, text, va="center")
    axes.annotate(
        "", (blade, -29), (tip, -29), arrowprops={"arrowstyle": "<->", "color": FORCE, "shrinkA": 0, "shrinkB": 0}
    )
    axes.text(blade + 1.5, -29, "lag $x - a$", color=FORCE, va="center")
    save(figure, "geometry.svg")


def draw_law() -> None:
    """Draw what the law makes of a cut, a return by 12 mm and a cut on: force and tip over the blade's position."""
    specimen = Specimen.homogeneous(modulus=38e3, fracture_resistance=240.0, depth=0.02)
    plant = SimulatedPlant(specimen)
    legs = [Leg(position=0.040, speed=0.0127), Leg(position=0.028, speed=0.0127), Leg(position=0.050, speed=0.0127)]
    felt = run(plant, legs)
    x, tip, force = 1e3 * felt["position"], 1e3 * felt["tip"], felt["true_force"]
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(8.0, 5.6), layout="constrained")
    above.plot(x, force, color=FORCE, linewidth=1.3)
    below.plot(x, tip, color=FORCE, linewidth=1.3, label="crack tip $a$")
    below.plot([0, 50], [0, 50], color=GREY, linewidth=0.8, linestyle="--")
    mark(above, x, force, tip)
    below.text(19, 24.5, "$a = x$: no lag", rotation=27, ha="center")
    above.set_ylabel("force on the blade [N]")
    below.set_ylabel("crack tip [mm]")
    below.set_xlabel("blade [mm]")
    for axes in (above, below):
        axes.spines[["top", "right"]].set_visible(False)
    save(figure, "law.svg")


def mark(axes: Axes, x: np.ndarray, force: np.ndarray, tip: np.ndarray) -> None:
    """Name the parts of the force trace."""
    turn = int(np.argmax(x > 39.999))
    runs = np.flatnonzero(np.diff(tip) > 1.0)
    first, second = (int(each) for each in runs[3:5])
    arrow = {"arrowstyle": "->", "color": GREY}
    between = (first + second) // 2
    axes.annotate("loading:\nstable growth", (x[between], force[between]), (3, 6.3), arrowprops=arrow)
    axes.annotate("run, at $(1 + \\eta) R B$", (x[second], force[second]), (15, 8.6), arrowprops=arrow)
    drawn_back = turn + int(np.argmin(np.abs(x[turn:] - 36.0)))
    axes.annotate(
        "drawing back\nand returning:\nelastic", (x[drawn_back], force[drawn_back]), (39, -0.3), arrowprops=arrow
    )
    axes.annotate("only friction", (x[turn:].min() + 1.5, force[turn:].min()), (20, -0.2), arrowprops=arrow)


if __name__ == "__main__":
    with plt.rc_context(STYLE):
        draw_geometry()
        draw_law()
