"""Calibration of rendered C-arms with the package's own tools, and how well images are corrected."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cutenv.sim.tissue.cut_model import CutModel
from cutenv.vision.bead_correspondence import places_from_sweep
from cutenv.vision.beads import find_beads
from cutenv.vision.fluoroscopy import CArmCalibration, CArmView, calibrate_view, length_per_pixel
from cutenv.vision.projection import fit_magnification
from cutenv.vision.spots import locate_spots
from scripts.validation.vision.rendering.xray import XRayCamera
from scripts.validation.vision.rendering.xray_session import BALL, BEAD, ERRORS, Session, exposed

REGION = [[-0.045, -0.005, -0.002], [0.045, 0.155, 0.03]]  # places where beads may be [m]
BEAD_PX, BALL_PX, HOLE_PX = 3.5, 5.5, 5.0  # diameters in frames of 480 lines [px]
SPACING, HOLE = 0.010, 0.0024  # spacing of the plate [m]
SEED = 1  # seed of the session that is drawn
Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Mark:
    """One number beside the mark that it is to keep."""

    what: str
    value: float
    limit: float
    unit: str
    at_least: bool = False

    @property
    def met(self) -> bool:
        """Flag of a mark that is kept."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit


def rms(values: Array) -> float:
    """Return the root of the mean squared length of the rows."""
    return float(np.sqrt((np.asarray(values).reshape(len(values), -1) ** 2).sum(axis=1).mean()))


def phantom_view(
    view: CArmView, camera: XRayCamera, session: Session, rng: np.random.Generator, balls: Array | None = None
) -> CArmView:
    """Give a view its geometry from an image of the phantom, whose balls are told apart by where they really are."""
    places = session.phantom() if balls is None else balls
    known, pixels = phantom_pixels(camera, places, rng)
    return view.with_projection(known, pixels)


def phantom_pixels(camera: XRayCamera, balls: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the balls that are found in an image of the phantom, and where."""
    spots = locate_spots(exposed(camera, camera.light(balls, BALL), rng), BALL_PX)
    away, which = cKDTree(spots.place).query(camera.seen(balls))
    return balls[away < 2.0], spots.place[which[away < 2.0]]


def calibrated(session: Session, rng: np.random.Generator) -> CArmCalibration:
    """Calibrate both views of a session from images of the plate and of the phantom."""
    views = []
    for name, camera in session.cameras.items():
        image = camera.plate(SPACING, HOLE, rng, missing=0.05, turn=float(rng.uniform(-0.05, 0.05)))
        view, _, _ = calibrate_view(image, HOLE_PX, name=name, dark=False)
        views.append(phantom_view(view, camera, session, rng))
    return CArmCalibration(views=views)


def swept(session: Session, view: CArmView, rng: np.random.Generator, count: int = 10) -> tuple[Array, Array]:
    """Find the beads at rest by a rotation of the top arm by 90 degrees, calibrated by the phantom at each stop."""
    projections, images = [], []
    for camera in session.sweep(count):
        stop = phantom_view(view, camera, session, rng)
        picture = exposed(camera, camera.light(session.rest, BEAD, (), (session.slab,)), rng)
        images.append(find_beads(picture, stop, BEAD_PX)[1].place)
        projections.append(stop.projection)
    return places_from_sweep(projections, images, REGION)


def predicted_by(session: Session) -> Callable[[Array, float], Array]:
    """Return the displacement that a model predicts: even tissue in plane stress, not the truth's uneven bricks."""
    model = CutModel()

    def displacement(rest: Array, time: float) -> Array:
        _, tip, lead = session.cut.at(time)
        moved = model.displacement_at(rest[:, : model.dim], tip, tip_displacement=lead)
        return np.pad(moved, ((0, 0), (0, 3 - model.dim)))

    return displacement


def off_by_similarity(found: Array, true: Array) -> Array:
    """Return what is left between two sets of points after the best turn, scale and shift."""
    a, b = (points - points.mean(axis=0) for points in (found, true))
    z, w = a[:, 0] + 1j * a[:, 1], b[:, 0] + 1j * b[:, 1]
    left = z - w * (np.vdot(w, z) / np.vdot(w, w))
    return np.stack([left.real, left.imag], axis=1)


def correction(seeds: range) -> list[Mark]:
    """Measure the correction of grid images: residuals, true errors of the field, and the thesis's curves."""
    inside: dict[bool, list[float]] = {False: [], True: []}
    true_error: dict[bool, list[float]] = {False: [], True: []}
    curve: dict[str, list[float]] = {"top": [], "side": []}
    for seed in seeds:
        for name, swirl in ((n, s) for n in ERRORS for s in (False, True)):
            rng = np.random.default_rng([seed, swirl, name == "top"])
            size = {"centre": tuple(np.array([327.0, 239.5]) + rng.uniform(-8, 8, 2)), "error": ERRORS[name]}
            camera = XRayCamera(**size, swirl=float(rng.choice([-1, 1]) * rng.uniform(0.8e-7, 2e-7)) * swirl)
            image = camera.plate(SPACING, HOLE, rng, missing=0.05 * swirl, turn=float(rng.uniform(-0.1, 0.1)))
            view, fitted, holes = calibrate_view(image, HOLE_PX, name=name, dark=False)
            r = np.hypot(*(holes.place * (view.aspect, 1.0) - camera.centre).T)
            central = r <= np.quantile(r, 0.95)
            inside[swirl].append(rms(fitted.residual[central]))
            u, v = np.meshgrid(np.linspace(18, 701, 40), np.linspace(12, 467, 30))
            pixels = np.stack([u.ravel(), v.ravel()], axis=1)
            true_error[swirl].append(rms(off_by_similarity(view.undistort(pixels), camera.true_places(pixels))))
            if not swirl:
                curve[name].append(curve_error(fitted.distortion.error, ERRORS[name]))
        for name, (a, b, _) in ERRORS.items():  # as printed: not zero at the centre
            camera = XRayCamera(error=(a, b, {"top": 0.4729, "side": 1.6171}[name]), centre=(330.0, 238.0))
            image = camera.plate(SPACING, HOLE, np.random.default_rng([seed, 9]))
            _, fitted, _ = calibrate_view(image, HOLE_PX, name=name, model="radial_quadratic_printed", dark=False)
            curve.setdefault(f"{name}, as printed", []).append(curve_error(fitted.distortion.error, camera.error))
    worst = "worst image"
    bound: dict[str, Any] = {"limit": 0.2, "unit": "px"}
    return [
        Mark(what=f"grid residual in 95 % of the field, {worst}", value=max(inside[False]), limit=0.15, unit="px"),
        Mark(what="the same with S-shape and 5 % of holes missing", value=max(inside[True]), limit=0.3, unit="px"),
        Mark(what="true error of the corrected field, RMS", value=max(true_error[False]), limit=0.15, unit="px"),
        Mark(what="the same with S-shape and 5 % of holes missing", value=max(true_error[True]), limit=0.3, unit="px"),
        *(
            Mark(what=f"({n}) recovered, {which}: largest difference to 280 px", value=max(curve[key]), **bound)
            for key, n, which in (
                ("top", "7.1", "zero at the centre"), ("side", "7.2", "zero at the centre"),
                ("top, as printed", "7.1", "as printed"), ("side, as printed", "7.2", "as printed"),
            )
        ),
    ]  # fmt: skip


def curve_error(found: Callable[[Array], Array], error: tuple[float, float, float]) -> float:
    """Return the largest difference of a recovered radial error from the true one, at the scale that suits it best.

    A grid tells its distortion up to a scale: a linear term of the error is the same as another size of the grid.
    """
    a, b, c = error
    true = np.linspace(30.0, 280.0, 60)
    seen = true + a * true**2 + b * true + c

    def left(scale: float) -> Array:
        return np.asarray(scale * true + found(scale * true) - seen)

    scales = np.linspace(0.9, 1.1, 2001)
    return float(min(np.abs(left(float(scale))).max() for scale in scales))


def plates_by_distance(seed: int) -> tuple[XRayCamera, CArmView, Array, Array]:
    """Image a plate at six distances from the detector; return camera, view, distances, and lengths of a pixel [m]."""
    rng = np.random.default_rng([seed, 3])
    camera = XRayCamera(pitch=float(rng.uniform(3.6e-4, 4e-4)), to_detector=float(rng.uniform(0.95, 1.02)))
    distance = np.array([0.0, 0.06, 0.12, 0.2, 0.28, 0.36])
    images = [camera.plate(SPACING, HOLE, rng, distance=float(d)) for d in distance]
    view, _, _ = calibrate_view(images[0], HOLE_PX, name="top", dark=False)
    size = [
        length_per_pixel(image, view, HOLE_PX / (1.0 - d / camera.to_detector), SPACING)
        for d, image in zip(distance, images, strict=True)
    ]
    return camera, view, distance, np.array(size)


def magnification(seed: int) -> list[Mark]:
    """Measure the magnification against distance: a plate at six distances, a cone beam fitted to five of them."""
    camera, view, distance, size = plates_by_distance(seed)
    pixels = np.random.default_rng([seed, 4]).uniform((18.0, 12.0), (701.0, 467.0), (400, 2))
    found, ideal = (points - points.mean(axis=0) for points in (view.undistort(pixels), camera.true_places(pixels)))
    # The scale of a corrected image is that of its centre: an undistorted pixel stands for so many true ones.
    scale = float(np.sqrt((ideal**2).sum() / (found**2).sum()))
    true = camera.pitch * scale * (1.0 - distance / camera.to_detector)
    errors = []
    for one in range(len(distance)):
        rest = np.arange(len(distance)) != one
        fit, _ = fit_magnification(distance[rest], size[rest])
        errors.append(abs(fit.at(float(distance[one])) / true[one] - 1.0))
    return [Mark(what="magnification at a distance left out of the fit", value=100 * max(errors), limit=0.3, unit="%")]
