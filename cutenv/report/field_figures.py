"""Figures of a filmed cut: moduli along it by force and by image, and a map of its beads."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cutenv.report.figure import PHONE_WIDTH, new_figure, plain_axes
from cutenv.vision.field_comparison import FieldComparison

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cutenv.report.field_page import FieldResult

_FORCE, _IMAGE, _ZONES, _TRUTH = "#d55e00", "#0072b2", "#009e73", "0.35"
_TRACKED, _COMPUTED = "#0072b2", "#d55e00"


def moduli_figure(result: FieldResult, width: float) -> Figure:
    """Draw the modulus of every ramp by force, at its tip, and by image; zones and the value put in as lines."""
    tips, image, zones, truth = result.measured.tips, result.image, result.zones, result.truth
    figure = new_figure(width, 3.6)
    axes = figure.subplots()
    axes.plot(100 * tips, result.measured.by_force / 1e3, "o", color=_FORCE, markersize=5, label="by force")
    axes.errorbar(
        100 * image.position, image.modulus / 1e3, 1.96 * image.standard_error / 1e3,
        fmt="s", color=_IMAGE, markersize=4, elinewidth=1.0, label="by image",
    )  # fmt: skip
    if zones is not None:
        edges = 100 * np.concatenate(([0.0], zones.borders, [float(tips.max()) + 0.01]))
        for i, (low, high) in enumerate(zip(zones.low, zones.high, strict=True)):
            axes.fill_between(edges[i : i + 2], low / 1e3, high / 1e3, color=_ZONES, alpha=0.25, linewidth=0)
        axes.stairs(zones.modulus / 1e3, edges, color=_ZONES, label="zones, by both", baseline=None)
    if truth is not None:
        axes.axhline(truth / 1e3, color=_TRUTH, linestyle="--", linewidth=1.0, label="put in")
    axes.set_xlabel("tip from the clamp [cm]")
    axes.set_ylabel("modulus [kPa]")
    axes.set_ylim(bottom=0.0)
    plain_axes(axes)
    figure.legend(loc="outside upper left", ncols=2 if width < PHONE_WIDTH else 4, frameon=False, fontsize=9)
    return figure


def bead_map(compared: FieldComparison, width: float) -> Figure:
    """Draw the beads of the ramp that moved them most, seen from above, and all ramps computed against tracked.

    Arrows show displacements, enlarged: as tracked, and as computed.
    """
    rises = compared.rises
    size = np.linalg.norm(compared.measured, axis=1)
    ramp = int(rises.ramp[np.argmax(size)])
    own = rises.ramp == ramp
    narrow = width < PHONE_WIDTH
    figure = new_figure(width, 10.0 if narrow else 6.5)
    above, against = figure.subplots(2 if narrow else 1, 1 if narrow else 2, squeeze=False).ravel()
    place = 100 * rises.place[own]
    larger = max(1.0, np.floor(0.012 / size[own].max()))
    for field, colour, name, thickness in (
        (compared.measured, _TRACKED, "as tracked", 0.006),
        (compared.computed, _COMPUTED, "by the model", 0.003),
    ):
        arrows = 100 * larger * field[own]
        above.quiver(
            place[:, 0], place[:, 1], arrows[:, 0], arrows[:, 1],
            angles="xy", scale_units="xy", scale=1.0, color=colour, width=thickness, minlength=0.1, label=name,
        )  # fmt: skip
    tip = float(rises.ramps[ramp].tip.mean())
    above.plot([0.0, 0.0], [0.0, 100 * tip], color="0.2", linewidth=1.5, label="cut")
    above.set_aspect("equal")
    above.set_xlabel("across [cm]")
    above.set_ylabel("along, from the clamp [cm]")
    above.set_title(f"tip at {100 * tip:.1f} cm, arrows {larger:.0f} times", fontsize=10, loc="left")
    against.plot(
        1e3 * compared.computed.ravel(),
        1e3 * compared.measured.ravel(),
        ".",
        color="0.55",
        markersize=2,
        rasterized=True,
    )
    ends = 1e3 * np.array([compared.computed.min(), compared.computed.max()])
    against.plot(ends, ends, color="0.2", linewidth=1.0)
    against.set_xlabel("by the model [mm]")
    against.set_ylabel("as tracked [mm]")
    against.set_title("every component, all ramps", fontsize=10, loc="left")
    plain_axes(above)
    plain_axes(against)
    figure.legend(*above.get_legend_handles_labels(), loc="outside upper left", ncols=3, frameon=False, fontsize=9)
    return figure
