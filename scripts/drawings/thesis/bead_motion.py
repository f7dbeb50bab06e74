"""Chapter 7, sections 7.3 and 7.4: the model in sections, one bead against it, and a cut predicted from others."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize

from cutenv.records.measurement import MeasuredCut, loading_segments
from cutenv.records.measurement.prediction import predicted_ramps
from cutenv.sim.tissue import CutModel
from cutenv.sim.tissue.tables import table
from cutenv.sim.trace import Trace
from cutenv.vision.beads import track_beads
from cutenv.vision.field_comparison import zones_as_measured
from cutenv.vision.fluoroscopy import NTSC_RATE, CArmView
from cutenv.vision.projection import project
from scripts.drawings.thesis import xray_images
from scripts.drawings.thesis.experiments import KIND
from scripts.drawings.thesis.models import FACES, seen_from_above
from scripts.drawings.thesis.style import (
    DISPLACEMENT_LABEL,
    FIRST,
    FORCE,
    SECOND,
    SOLID,
    STRAIN,
    STRESS,
    named,
    panels,
    save,
)
from scripts.validation.measurement.field import LEM_AVERAGE, cut_of_liver
from scripts.validation.thesis.drawn_livers import measure_as_the_thesis
from scripts.validation.thesis.models import FROM_THE_CLAMP, FROM_THE_LINE, TIP, displacement_of_beads
from scripts.validation.thesis.virtual_cuts import SPEEDS, virtual_cut
from scripts.validation.vision.carm_measurement import BEAD_PX, Array, calibrated, predicted_by, swept
from scripts.validation.vision.rendering.xray_session import THICKNESS, Session

AXES = ("x, across", "y, along", "z, up")
NEAR, REACHED = 0.022, 0.075  # beads that are followed: from the cut line, and from the clamp [m]
CHOSEN = (0.01, 0.035)  # near this place lies the bead that is shown [m]
COLOURS = "YlOrRd"


def model_in_sections(path: Path, quick: bool) -> None:
    """Draw Figures 7.6 and 7.7: the slab from the side, half of its model, and a LEM in each section of the model."""
    title = "Figures 7.6 and 7.7 anew: rendered slab from the side, half symmetric model of bricks, its sections"
    figure, (image, mesh, sections) = panels(1, 3, (13.0, 4.6), title, width_ratios=(1.5, 1.0, 1.15))
    xray_images.show(image, xray_images.session().image("side", 0.5, np.random.default_rng(1))[::-1])
    found = measure_as_the_thesis(virtual_cut(KIND, speed=SPEEDS[0], turns=(0.07,)).trace)
    borders, moduli = zones_as_measured(found)
    norm = Normalize(0.0, moduli.max() / 1e3)
    _draw_half(mesh, None, norm)
    _draw_half(sections, np.append(borders, 0.07), norm, moduli / 1e3)
    bar = figure.colorbar(ScalarMappable(norm, COLOURS), ax=sections, shrink=0.7)
    bar.set_label("LEM [10$^3$ N/m$^2$]")
    named(image, "7.6 a: side view, the clamp at the left")
    named(mesh, "7.6 b: the half at +x")
    named(sections, f"7.7: LEM of {len(moduli)} sections of 7 cm, at the rows' middles")
    save(figure, path)


def _draw_half(ax: Axes, ends: Array | None, norm: Normalize, moduli: Array | None = None) -> None:
    """Draw the faces of the half model that are seen, in the colour of the section in which they lie."""
    of = CutModel("hex20", "solid", thickness=THICKNESS, divisions=(8, 15, 3))
    faces = of.elements[:, np.array(FACES)].reshape(-1, 4)
    centre = of.nodes[faces].mean(axis=1)
    low, high = np.array([0.0, 0.0, 0.0]), of.nodes.max(axis=0)
    on = (centre[:, 1] < low[1] + 1e-9) | (centre[:, 0] > high[0] - 1e-9) | (centre[:, 2] > high[2] - 1e-9)
    on &= centre[:, 0] > 0.0
    colours: str | list[object] = "#f2d3c9"
    if ends is not None and moduli is not None:
        section = np.searchsorted(ends, centre[on, 1])
        shades = ScalarMappable(norm, COLOURS)
        colours = [shades.to_rgba(moduli[n]) if n < len(moduli) else "0.85" for n in section]
    corners = seen_from_above(100 * of.nodes)[faces[on]]
    ax.add_collection(PolyCollection(list(corners), facecolor=colours, edgecolor="0.4", linewidth=0.5))
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.set_axis_off()


class FollowedBead(NamedTuple):
    """One bead as tracked in rendered images: places [m] at times [s], and the session without the other beads."""

    session: Session
    view: CArmView
    time: Array
    place: Array


@cache
def followed_bead(quick: bool) -> FollowedBead:
    """Calibrate the session's C-arms, and follow the beads near the line through the cut of 7 cm."""
    whole = xray_images.session()
    near = (np.abs(whole.rest[:, 0]) < NEAR) & (whole.rest[:, 1] < REACHED)
    session = replace(whole, rest=whole.rest[near])
    rng = np.random.default_rng(xray_images.SEED)
    arms = calibrated(session, rng)
    rest, covariance = swept(session, arms.views[0], rng)
    time = np.arange(0.5, float(session.cut.time[-1]) - 0.2, (30 if quick else 15) / NTSC_RATE)
    expected = predicted_by(session)
    tracks = track_beads(session.frames(time), time, arms, (rest, covariance), diameter=BEAD_PX, displacement=expected)
    bead = min(tracks.beads, key=lambda each: float(np.hypot(*(rest[each, :2] - CHOSEN))))
    own = tracks.of(bead)
    return FollowedBead(session, arms.views[0], own.time, own.place)


def bead_in_space(path: Path, quick: bool) -> None:
    """Draw Figures 7.8 and 7.9: the way of one bead in the image from above, and its motion in space."""
    bead = followed_bead(quick)
    place = 1e3 * bead.place
    title = "Figures 7.8 and 7.9 anew: a bead near the cut line during a cut of 7 cm, tracked in rendered images"
    figure, (image, space) = panels(1, 2, (11.0, 4.4), title, width_ratios=(1.0, 1.6))
    assert bead.view.projection is not None  # it is calibrated
    seen = bead.view.seen(project(bead.view.projection, bead.place))
    image.plot(*seen.T, ".-", color=STRESS, linewidth=0.5, markersize=3)
    image.plot(*seen[0], "o", color=FIRST, label="before the cut")
    image.invert_yaxis()
    image.set_aspect(11.0 / 10.0)
    image.legend()
    named(image, "7.8: from above", "column [px]", "row [px]")
    for axis, (name, colour) in enumerate(zip(AXES, (STRESS, STRAIN, SOLID), strict=True)):
        space.plot(bead.time, (place[:, axis] - place[0, axis]) / 10.0, color=colour, label=name)
    space.legend(loc="upper left", ncols=3)
    named(space, "7.9: motion in space; it springs back where the crack runs", "time [s]", "displacement [cm]")
    save(figure, path)


def bead_against_model(path: Path, quick: bool) -> None:
    """Draw Figures 7.10 and 7.11: one bead in one deformation section, by finite elements and as tracked."""
    bead = followed_bead(quick)
    cut, rest = bead.session.cut, bead.place[:1]
    record = Trace(time=cut.time, force=cut.force, position=cut.blade)
    section = max((s for s in loading_segments(record) if s.is_steady), key=lambda s: s.stop - s.start)  # most frames
    start, stop = cut.time[section.start], cut.time[section.stop - 1]
    model = CutModel("hex20", "solid", thickness=THICKNESS, divisions=(8, 15, 2))

    def computed(times: Array) -> Array:
        """Return the displacement of the bead by the model [m], shape (n, 3)."""
        driven = (cut.at(float(now)) for now in times)
        moved = [model.displacement_at(rest, tip, tip_displacement=lead)[0] for _, tip, lead in driven]
        return np.array(moved)

    clock = np.linspace(start, stop, 30)
    rise = 1e3 * (computed(clock) - computed(clock[:1]))
    pushed = 1e3 * (np.interp(clock, cut.time, cut.blade) - np.interp(start, cut.time, cut.blade))
    title = "Figures 7.10 and 7.11 anew: a bead while the longest section deforms, by uniform bricks and as tracked"
    figure, (components, both) = panels(1, 2, (11.0, 4.2), title)
    for axis, (name, colour) in enumerate(zip(AXES, (STRESS, STRAIN, SOLID), strict=True)):
        components.plot(pushed, rise[:, axis], color=colour, label=name)
    size = np.linalg.norm(rise, axis=1)
    components.plot(pushed, size, color=FORCE, linewidth=1.6, label="magnitude")
    inside = (bead.time >= start) & (bead.time <= stop)
    at = np.interp(bead.time[inside], cut.time, cut.blade) - np.interp(start, cut.time, cut.blade)
    # Against its place at the start, which the first frame in the section tells but for what it moved until then.
    moved = bead.place[inside] - bead.place[inside][0] + computed(bead.time[inside][:1]) - computed(clock[:1])
    both.plot(1e3 * at, 1e3 * np.linalg.norm(moved, axis=1), "o", color=STRESS, ms=4, label="as tracked")
    both.plot(pushed, size, color=FORCE, linewidth=1.6, label="finite elements")
    named(components, "7.10: finite elements", "displacement of the blade in the section [mm]", "displacement [mm]")
    named(both, "7.11: magnitude, both", "displacement of the blade in the section [mm]", "displacement [mm]")
    for ax in (components, both):
        ax.legend(loc="upper left")
    save(figure, path)


def numbers_of_beads(path: Path, quick: bool) -> None:
    """Draw Figure 7.12: the beads of Table 7.1 where our fit to its finite elements puts them; the drawing is lost."""
    figure, (plan, bars) = panels(1, 2, (9.0, 4.6), "Figure 7.12 anew: layout fitted to Table 7.1", width_ratios=(1, 2))
    places = list(itertools.product(FROM_THE_LINE, FROM_THE_CLAMP))
    for number, (x, y) in enumerate(places, 1):
        plan.plot(100 * x, 100 * y, "o", color=FORCE)
        plan.annotate(f"{number}", (100 * x, 100 * y), (5, -3), textcoords="offset points")
    plan.plot([0, 0], [0, 100 * TIP], color=FIRST, linewidth=2, label="cut")
    plan.plot([-0.5, 4], [0, 0], color="black", linewidth=4)
    plan.set_aspect("equal")
    plan.set_xlim(-0.5, 4)
    plan.set_ylim(0, 6.5)
    plan.legend(loc="upper left")
    named(plan, "a fit, not the thesis's drawing", "across [cm]", "along the cut [cm]")
    data = table("7.1")
    columns = (
        ("finite elements, thesis", data["fem_displacement_cm"], STRAIN),
        ("the fit", 100 * displacement_of_beads(), SOLID),
        ("experiment, thesis", data["experimental_displacement_cm"], STRESS),
    )
    for shift, (name, values, colour) in zip((-0.27, 0.0, 0.27), columns, strict=True):
        bars.bar(data["bead"] + shift, values, 0.25, color=colour, label=name)
    bars.set_xticks(data["bead"])
    bars.legend(loc="upper right")
    named(bars, "Table 7.1: beads 4, 6, 7 and 8 disagree", "bead", "displacement [cm]")
    save(figure, path)


def predicted_cuts(path: Path, quick: bool) -> None:
    """Draw Figure 7.13: a cut and a cut of another liver, predicted from five others by their mean modulus."""
    model, factor = CutModel(), LEM_AVERAGE / float(table("5.6")["lem_plane_stress_90_deg_Pa"][0])
    cuts = [cut_of_liver(0, number, factor, model) for number in range(6)]
    average = float(np.mean([cut.material_modulus for cut in cuts[:5]]))
    title = "Figure 7.13 anew: loading segments predicted from the mean modulus of five cuts of one virtual liver"
    figure, (same, other) = panels(2, 1, (8.0, 6.5), title, sharex=True)
    _draw_prediction(same, cuts[5], model, average)
    _draw_prediction(other, cut_of_liver(1000, 0, None, model), model, average)
    named(same, "a) the sixth cut of the same liver", y="force per depth [N/cm]")
    named(other, "b) a cut of another liver", DISPLACEMENT_LABEL, "force per depth [N/cm]")
    same.legend(loc="upper left")
    save(figure, path)


def _draw_prediction(ax: Axes, cut: MeasuredCut, model: CutModel, modulus: float) -> None:
    (position,) = cut.trace.require("position", by="figure 7.13")
    forward = slice(int(np.argmax(position)) + 1)
    x = position[forward]
    ax.plot(100 * x, cut.trace.force[forward] / (100 * cut.depth.at(x)), color="0.7", linewidth=0.7, label="measured")
    for number, ramp in enumerate(predicted_ramps(cut, model, modulus)):
        label = "predicted" if number == 0 else None
        depth = 100 * cut.depth.at(ramp.position)
        ax.plot(100 * ramp.position, ramp.predicted / depth, color=SECOND, linewidth=1.8, label=label)
    ax.set_ylim(bottom=0)
