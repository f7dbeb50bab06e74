"""Chapter 3: force against displacement, the loading segments, and the moduli that they give."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from cutenv._engine.randomness import generator
from cutenv.records.measurement import (
    ModulusEstimate,
    Segment,
    estimate_local_effective_moduli,
    filtered,
    loading_segments,
)
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import CutModel, Specimen, draw_liver
from cutenv.sim.trace import Trace, blade_speed
from scripts.drawings.thesis.style import (
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
from scripts.validation.thesis.drawn_livers import MODELS, measure_as_the_thesis
from scripts.validation.thesis.virtual_cuts import PLACES, SPEEDS, cm_s, virtual_cut

KIND = "liver 6"
TRAVEL = 0.12  # [m]
LIVER_SEED = 3
CUTS = 4  # parallel ones in a liver
SLOW = SPEEDS[0]


def desired_and_actual_speed(path: Path, quick: bool) -> None:
    """Draw Figure 3.2: the speed that was asked for, and that of the blade, at three speeds."""
    title = "Figure 3.2 anew: desired and actual speed of the blade; virtual drive, one drawn liver, 90°"
    figure, axes = panels(3, 1, (7.5, 6.0), title, sharex=True)
    for ax, speed in zip(axes, SPEEDS, strict=True):
        trace = virtual_cut(KIND, speed=speed, turns=(TRAVEL,)).trace
        assert trace.position is not None
        moving = (trace.position > 0.001) & (trace.position < TRAVEL - 0.001)
        x, actual = 100 * trace.position[moving], 100 * blade_speed(trace.time, trace.position)[moving]
        ax.axhline(100 * speed, color=STRAIN, linewidth=2.0, label="desired")
        ax.plot(x, actual, color=FORCE, linewidth=0.6, label="actual: differences of the encoder over 50 ms")
        ax.set_ylim(0, 130 * speed)
        off = float(np.abs(actual - 100 * speed)[(x > 1.0) & (x < 11.0)].max())
        named(ax, f"{cm_s(speed)}: from 1 to 11 cm the speed is off by {off:.4f} cm/s at most", y="speed [cm/s]")
    axes[0].legend(loc="lower right", ncols=2)
    axes[-1].set_xlabel(DISPLACEMENT_LABEL)
    save(figure, path)


def filtered_force(path: Path, quick: bool) -> None:
    """Draw Figure 3.4: the record reduced to its significant hilltops and valleys."""
    figure, axes = panels(2, 1, (7.5, 6.0), "Figure 3.4 anew: hilltops and valleys of the significant loadings")
    for ax, speed, window in zip(axes, SPEEDS[:2], ((4.0, 8.0), (4.0, 12.0)), strict=True):
        trace = virtual_cut(KIND, speed=speed, turns=(TRAVEL,)).trace
        assert trace.position is not None
        x = 100 * trace.position
        ax.plot(x, trace.force, color="0.7", linewidth=0.6, label="as measured")
        ax.plot(x, filtered(trace).force, color=STRESS, label="filtered")
        inside = (x >= window[0]) & (x <= window[1])
        ax.set_xlim(*window)
        ax.set_ylim(0.0, 1.15 * float(trace.force[inside].max()))
        named(ax, cm_s(speed), DISPLACEMENT_LABEL, "force [N]")
        ax.legend(loc="upper left", ncols=2)
    save(figure, path)


def iteration_of_the_modulus(path: Path, quick: bool) -> None:
    """Draw Figure 3.5: the iteration for the local effective modulus, with the numbers of one loading segment."""
    trace = virtual_cut(KIND, speed=SLOW, turns=(TRAVEL,)).trace
    steady = [s for s in loading_segments(trace) if s.is_steady and s.position is not None and s.position > 0.06]
    chosen, model = max(steady, key=lambda s: s.force_rise), CutModel()
    position, travel = chosen.require("position", "displacement", by="figure 3.5")
    rise, tip = chosen.force_rise, position - chosen.force / float(chosen.slope or math.nan)
    assert trace.depth is not None
    stiffness = float(model.stiffness(tip)) * float(trace.depth[chosen.samples].mean())  # per modulus
    first = 5e3  # [Pa], anything
    last = first * rise / (first * stiffness * travel)
    figure, (force, chart) = panels(
        1, 2, (11.0, 5.0), "Figure 3.5 anew: from a loading segment to its local effective modulus (LEM)"
    )
    around = slice(max(chosen.start - 4000, 0), chosen.stop + 4000)
    assert trace.position is not None
    force.plot(100 * trace.position[around], filtered(trace).force[around], color=STRESS, label="filtered force")
    mark_segments(force, trace, [chosen])
    force.legend(loc="upper left")
    named(force, "the segment: a ramp that a drop ends", DISPLACEMENT_LABEL, "force [N]")
    boxes = [
        f"Segment of the filtered force:\nΔF = {rise:.3f} N over ΔU = {1e3 * travel:.2f} mm, tip at {100 * tip:.1f} cm",
        f"Assume a modulus:\nE = {first / 1e3:.1f} kPa",
        f"Finite elements under ΔU:\nΔF = {first * stiffness * travel:.3f} N",
        f"|ΔF(FEM) − ΔF(EXP)| / ΔF(EXP) = {abs(first * stiffness * travel / rise - 1.0):.2f} ≤ 0.01?",
        f"No: E = {last / 1e3:.1f} kPa, by the ratio of the forces.\nThe model is linear: once is enough.",
        f"Yes: LEM = {last / 1e3:.1f} kPa",
    ]
    places = np.linspace(0.92, 0.08, len(boxes))
    for text, y in zip(boxes, places, strict=True):
        chart.text(0.5, y, text, ha="center", va="center", bbox={"boxstyle": "round", "facecolor": "white"})
    for above, below in itertools.pairwise(places):
        arrow = {"arrowstyle": "->", "color": FORCE}
        chart.annotate("", (0.5, below + 0.055), (0.5, above - 0.055), arrowprops=arrow)
    chart.set_axis_off()
    named(chart, "the iteration")
    save(figure, path)


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
