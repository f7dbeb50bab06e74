"""Chapter 7, sections 7.1 and 7.2: X-ray images of the beads, and the correction of images; of a rendered session."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from cutenv.vision.fluoroscopy import THESIS_ERROR, CArmView, FittedDistortion, calibrate_view
from cutenv.vision.projection import THESIS_MAGNIFICATION, fit_magnification
from cutenv.vision.spots import GridHoles
from scripts.drawings.thesis.style import FIRST, FORCE, STRAIN, STRESS, named, panels, save
from scripts.validation.vision.carm_measurement import HOLE, HOLE_PX, SPACING, Array, plates_by_distance
from scripts.validation.vision.rendering.xray import XRayCamera
from scripts.validation.vision.rendering.xray_session import ERRORS, Session

SEED = 72
SHOWN = 45.0  # time of the images [s]
_CENTRAL = 21  # holes that tell the true spacing


@cache
def session() -> Session:
    """Draw the session whose images are shown: a cut of 7 cm at 0.1 cm/s."""
    return Session.drawn(SEED)


def views(path: Path, quick: bool) -> None:
    """Draw Figure 7.2: the beads from above and from the side, in the middle of the cut."""
    figure, axes = panels(1, 2, (11.0, 4.2), "Figure 7.2 anew: rendered X-ray images of the slab, beads and blade")
    for ax, name, letter in zip(axes, ("top", "side"), "ab", strict=True):
        image = session().image(name, SHOWN, np.random.default_rng(SEED))
        show(ax, image[::-1] if name == "side" else image)  # the side detector's rows run up
        named(ax, f"{letter}) {name} view, the clamp at the left")
    save(figure, path)


def show(ax: Axes, image: NDArray[np.generic]) -> None:
    """Show a frame of NTSC, whose pixels are 10:11."""
    ax.imshow(image, cmap="gray", aspect=11.0 / 10.0, interpolation="nearest")
    ax.set_axis_off()


@cache
def _grid(name: str) -> tuple[NDArray[np.uint8], CArmView, FittedDistortion, GridHoles]:
    """Render the plate by the thesis's error of a view, and fit its quadratic."""
    camera = XRayCamera(error=ERRORS[name], centre=(330.0, 238.0))
    image = camera.plate(SPACING, HOLE, np.random.default_rng(SEED))
    return image, *calibrate_view(image, HOLE_PX, name=name, model="radial_quadratic", dark=False)


def grid_images(path: Path, quick: bool) -> None:
    """Draw Figure 7.3: the plate before and after the correction, side view."""
    figure, (before, after) = panels(1, 2, (11.0, 4.2), "Figure 7.3 anew: rendered plate with holes, side view")
    image, view, _, holes = _grid("side")
    show(before, image)
    before.plot(*holes.place.T, ".", color=FIRST, markersize=2)
    row, column = np.indices(image.shape)
    ideal = np.stack([column.ravel() * view.aspect, row.ravel()], axis=1).astype(float)
    seen = view.seen(ideal)[:, ::-1].T
    show(after, map_coordinates(image.astype(float), seen, order=1).reshape(image.shape))
    named(before, f"a) before the correction: {len(holes)} holes found (red)")
    named(after, "b) after it")
    save(figure, path)


def radial_errors(path: Path, quick: bool) -> None:
    """Draw Figure 7.4: error of the holes over their distance from the centre, and the thesis's quadratics."""
    title = "Figure 7.4 anew: error of the holes of a rendered plate, true spacing by the central holes"
    figure, axes = panels(1, 2, (10.0, 4.2), title)
    for ax, name, number in zip(axes, ("top", "side"), ("7.1", "7.2"), strict=True):
        _, view, fitted, holes = _grid(name)
        true, error = _errors(holes.place * (view.aspect, 1.0), holes.index, np.array(fitted.distortion.centre))
        radius = np.linspace(0.0, float(true.max()), 200)
        ax.plot(true, error, ".", color="0.6", markersize=4, label="holes")
        ax.plot(radius, fitted.distortion.error(radius), color=STRESS, label="fit, zero at the centre")
        ax.plot(radius, np.polyval(THESIS_ERROR[name], radius), "--", color=STRAIN, label=f"({number}) as printed")
        ax.legend(loc="upper left")
        named(ax, f"{name} view", "true distance from the centre [px]", "error [px]")
    save(figure, path)


def _errors(points: Array, cells: Array, centre: Array) -> tuple[Array, Array]:
    """Return true distances by the grid of the central holes, and how much farther out the holes are seen [px]."""
    near = np.argsort(np.hypot(*(points - centre).T))[:_CENTRAL]
    rows = np.column_stack([cells, np.ones(len(cells))])
    grid = np.linalg.lstsq(rows[near], points[near], rcond=None)[0]
    true = np.hypot(*(rows @ grid - centre).T)
    return true, np.hypot(*(points - centre).T) - true


def magnification(path: Path, quick: bool) -> None:
    """Draw Figure 7.5: length of a pixel over the distance from the detector; and the thesis's lines."""
    figure, (ours, printed) = panels(1, 2, (10.0, 4.2), "Figure 7.5 anew: magnification over distance")
    distance, size = plates_by_distance(SEED)[2:]
    fit, _ = fit_magnification(distance, size)
    ours.plot(100 * distance, 1e3 * size, "o", color=FORCE, label="rendered plate")
    line = np.linspace(0.0, float(distance.max()), 50)
    ours.plot(100 * line, [1e3 * fit.at(d) for d in line], color=STRESS, label="linear fit: a cone beam")
    named(ours, "top view, rendered", "distance from the detector [cm]", "length of a pixel [mm]")
    d = np.linspace(0.0, 100.0, 100)
    for (name, each), number, colour in zip(
        THESIS_MAGNIFICATION.items(), ("7.3", "7.4"), (STRESS, STRAIN), strict=True
    ):
        printed.plot(d, [each.at(float(x)) for x in d], color=colour, label=f"{name} view ({number})")
    printed.set_yscale("log")
    named(printed, "as printed; the units are not", "d", "m")
    for ax in (ours, printed):
        ax.legend(loc="upper right")
    save(figure, path)
