"""Chapter 3: force against displacement, the loading segments, and the moduli that they give."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from reproduction.drawn_livers import MODELS, measure_as_the_thesis
from reproduction.virtual_cuts import PLACES, SPEEDS, cm_s, virtual_cut

from cutenv._engine.randomness import generator
from cutenv.measurement import ModulusEstimate, Segment, estimate_local_effective_moduli, loading_segments
from cutenv.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.tissue import CutModel, Specimen, draw_liver
from cutenv.trace import Trace
from thesis_figures.style import (
    DISPLACEMENT_LABEL,
    DISTANCE_LABEL,
    FORCE,
    LEM_LABEL,
    STRAIN,
    STRESS,
    named,
    panels,
    save,
)

KIND = "liver 6"
TRAVEL = 0.12  # [m]
LIVER_SEED = 3
CUTS = 4  # parallel ones in a liver
SLOW = SPEEDS[0]


def force_against_displacement(path: Path, quick: bool) -> None:
    """Draw Figure 3.3: three speeds through one sampled liver."""
    title = "Figure 3.3 anew: cutting force at three speeds, one drawn liver, 90°, virtual sensor"
    figure, axes = panels(3, 1, (7.5, 7.5), title, sharex=True, sharey=True)
    for ax, speed, letter in zip(axes, SPEEDS, "ABC", strict=True):
        cut = virtual_cut(KIND, speed=speed, turns=(TRAVEL,))
        ax.plot(100 * cut.trace.position, cut.trace.force, color=FORCE, linewidth=0.6)
        runs = int(np.count_nonzero(cut.readings["jump"]))
        named(ax, f"{letter}: {cm_s(speed)}, {runs} crack runs in 12 cm", y="force [N]")
    axes[-1].set_xlabel(DISPLACEMENT_LABEL)
    axes[-1].set_xlim(0, 12.2)
    save(figure, path)


def loading_segments_found(path: Path, quick: bool) -> None:
    """Draw Figure 3.6: the ramps that the measurement uses."""
    figure, axes = panels(
        2, 1, (7.5, 6.0), "Figure 3.6 anew: loading segments found in the force (line: fitted slope ΔF/ΔU)"
    )
    for ax, speed, window in zip(axes, SPEEDS[:2], ((4.0, 9.0), (4.0, 12.0)), strict=True):
        trace = virtual_cut(KIND, speed=speed, turns=(TRAVEL,)).trace
        assert trace.position is not None
        x = 100 * trace.position
        ax.plot(x, trace.force, color="0.6", linewidth=0.6, label="measured force")
        found = [s for s in loading_segments(trace) if window[0] <= 100 * s.position <= window[1]]
        mark_segments(ax, trace, found)
        name_segments(ax)
        ax.set_xlim(*window)
        inside = (x >= window[0]) & (x <= window[1])
        low, high = float(trace.force[inside].min()), float(trace.force[inside].max())
        ax.set_ylim(min(0.0, low), 1.12 * high)
        named(ax, f"{cm_s(speed)}: {len(found)} segments shown", DISPLACEMENT_LABEL, "force [N]")
        ax.legend(loc="upper left", ncols=3)
    save(figure, path)


def mark_segments(ax: Axes, trace: Trace, segments: list[Segment]) -> None:
    """Draw the fitted lines over the force, in another colour where the measurement does not use them."""
    for s in segments:
        ends = trace.position[[s.start, s.stop - 1]]
        line = s.force + s.slope * (ends - s.position)
        ax.plot(100 * ends, line, color=STRESS if s.is_steady else STRAIN, linewidth=1.8)
        ax.plot(100 * ends, line, "o", color="black", markersize=2.5)


def name_segments(ax: Axes) -> None:
    """Enter both colours of segments in the legend."""
    ax.plot([], [], color=STRESS, linewidth=1.8, label="loading segment, fitted line")
    ax.plot([], [], color=STRAIN, linewidth=1.8, label="not used: the first, bent, or ended by no drop")


def liver_cuts() -> list[tuple[Specimen, SimulatedPlant]]:
    """Prepare four parallel cuts of one liver, not yet made."""
    factor = draw_liver(generator(LIVER_SEED))
    cuts = []
    for cut in range(CUTS):
        specimen = Specimen.draw(generator(LIVER_SEED, cut + 1), specimen_class="liver", liver_factor=factor)
        cuts.append((specimen, SimulatedPlant(specimen, seed=LIVER_SEED, episode=cut)))
    return cuts


def moduli_along_four_cuts(path: Path, quick: bool) -> None:
    """Draw Figures 3.7 and 3.8: LEM along a cut, averages of four cuts; and per depth, beside the truth."""
    figure, axes = panels(
        2, 2, (10.0, 7.0), "Figures 3.7 and 3.8 anew: local effective modulus in four cuts of one liver"
    )
    along, averages, per_depth, depths = axes
    models = {
        f"plane {of}": (MODELS[f"plane_{of}", 0.3], colour) for of, colour in (("stress", STRESS), ("strain", STRAIN))
    }
    shades = ("#08306b", "#2171b5", "#6baed6", "#b35806")
    for number, (specimen, plant) in enumerate(liver_cuts()):
        trace = to_trace(plant, run(plant, [Leg(position=TRAVEL, speed=SLOW)]))
        for offset, (name, (model, colour)) in enumerate(models.items()):
            as_thesis = measure_as_the_thesis(trace, model)
            at, moduli = number + 1 + 0.35 * (offset - 0.5), as_thesis.modulus / 1e3
            if number == 0:
                along.plot(100 * as_thesis.position, moduli, "os"[offset], color=colour, ms=4, label=name)
            label = name if number == 0 else None
            averages.bar(at, moduli.mean(), 0.33, yerr=moduli.std(), color=colour, label=label)
        corrected = estimate_local_effective_moduli(trace, CutModel(), friction_per_depth=specimen.friction_per_depth)
        _beside_truth(per_depth, specimen, corrected, shades[number], f"cut {number + 1}")
    depths.plot(100 * PLACES, 100 * specimen.depth, color=FORCE)
    depths.fill_between(100 * PLACES, 0.0, 100 * specimen.depth, color="#f2d3c9")
    depths.invert_yaxis()
    depths.set_xlim(0, 15)
    named(along, "3.7: along cut 1 at 0.1 cm/s, force as measured", DISTANCE_LABEL, LEM_LABEL)
    named(averages, "3.8: mean ± SD of the four cuts, force as measured", "cut", LEM_LABEL)
    named(per_depth, "the same per depth of cut (points), and what was put in (lines)", DISTANCE_LABEL, LEM_LABEL)
    named(depths, "why 3.7 rises: depth of cut, the liver's bulge", DISTANCE_LABEL, "depth [cm]")
    averages.set_xticks(range(1, CUTS + 1))
    per_depth.set_ylim(bottom=0)
    along.set_xlim(0, 12.5)
    along.set_ylim(bottom=0)
    per_depth.set_xlim(0, 12.5)
    for ax in (along, averages):
        ax.legend(loc="upper left")
    per_depth.legend(loc="lower right", ncols=4)
    save(figure, path)


def _beside_truth(ax: Axes, specimen: Specimen, found: ModulusEstimate, colour: str, label: str) -> None:
    lem = specimen.stiffness() / (specimen.cut_model().stiffness(PLACES) * specimen.depth)
    lem = lem * (specimen.tissue.local_effective_modulus(SLOW, math.pi / 2) / specimen.tissue.intercept_90)
    ax.plot(100 * PLACES, lem / 1e3, color=colour, linewidth=0.8)
    ax.plot(100 * found.position, found.modulus / 1e3, "o", color=colour, ms=3, label=label)
