"""Measure how well C-arm images are corrected and beads followed, on rendered X-ray sessions; docs/validation/beads.md.

    python scripts/measure_bead_tracking.py --json runs/bead_tracking.json
    python scripts/update_docs.py bead-tracking

Takes ten minutes of a processor for each session; --quick takes few frames, and is no measurement.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import trackpy
from benchmark.table import markdown_table
from numpy.typing import NDArray
from rendering.xray import XRayCamera
from rendering.xray_session import BALL, BEAD, ERRORS, FieldAtPoints, Session, exposed
from scipy.spatial import cKDTree

from cutenv.tissue.cut_model import CutModel
from cutenv.vision.bead_correspondence import bundle_adjusted, linked, pairs_by_epipolar, places_from_sweep
from cutenv.vision.bead_images import attenuation
from cutenv.vision.beads import find_beads, track_beads
from cutenv.vision.fluoroscopy import CArmCalibration, CArmView, calibrate_view, deinterlaced, length_per_pixel
from cutenv.vision.magnification import fit_magnification
from cutenv.vision.projection import project, triangulate
from cutenv.vision.registration import clock_lag
from cutenv.vision.spots import locate_spots

DEFAULT = "runs/bead_tracking.json"
"""Where the measurement is kept, relative to the repository."""
REGION = [[-0.045, -0.005, -0.002], [0.045, 0.155, 0.03]]
"""Where beads may be [m]."""
BEAD_PX, BALL_PX, HOLE_PX = 3.5, 5.5, 5.0
"""Diameters in frames of 480 lines [px]."""
SPACING, HOLE = 0.010, 0.0024
"""Of the plate [m]."""
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
        """Whether the mark is kept."""
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
    scale = camera.rows / 480
    spots = locate_spots(exposed(camera, camera.light(balls, BALL), rng), BALL_PX * scale)
    away, which = cKDTree(spots.place).query(camera.seen(balls))
    return balls[away < 2.0], spots.place[which[away < 2.0]]


def calibrated(session: Session, rng: np.random.Generator) -> CArmCalibration:
    """Calibrate both views of a session from images of the plate and of the phantom."""
    views = []
    for name, camera in session.cameras.items():
        image = camera.plate(SPACING, HOLE, rng, missing=0.05, turn=float(rng.uniform(-0.05, 0.05)))
        view, _, _ = calibrate_view(image, HOLE_PX * camera.rows / 480, name=name, dark=False)
        views.append(phantom_view(view, camera, session, rng))
    return CArmCalibration(views=views)


def swept(session: Session, view: CArmView, rng: np.random.Generator, count: int = 19) -> tuple[Array, Array]:
    """Find the beads at rest by a rotation of the top arm by 90 degrees, calibrated by the phantom at each stop."""
    projections, images = [], []
    for camera in session.sweep(count):
        stop = phantom_view(view, camera, session, rng)
        picture = exposed(camera, camera.light(session.rest, BEAD, (), (session.slab,)), rng)
        images.append(find_beads(picture, stop, BEAD_PX * camera.rows / 480)[1].place)
        projections.append(stop.projection)
    return places_from_sweep(projections, images, REGION)


def predicted_by(session: Session) -> Callable[[Array, float], Array]:
    """Return the displacement that a model predicts: even tissue in plane stress, not the truth's uneven bricks."""
    kept: list[FieldAtPoints] = []

    def displacement(rest: Array, time: float) -> Array:
        if not kept:
            kept.append(FieldAtPoints(CutModel(), rest))
        blade, tip = session.cut.at(time)
        return kept[0](tip, max(blade - tip, 0.0))

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


def magnification(seed: int) -> list[Mark]:
    """Measure the magnification against distance: a plate at six distances, a cone beam fitted to five of them."""
    rng = np.random.default_rng([seed, 3])
    camera = XRayCamera(pitch=float(rng.uniform(3.6e-4, 4e-4)), to_detector=float(rng.uniform(0.95, 1.02)))
    distance = np.array([0.0, 0.06, 0.12, 0.2, 0.28, 0.36])
    images = [camera.plate(SPACING, HOLE, rng, distance=float(d)) for d in distance]
    view, _, _ = calibrate_view(images[0], HOLE_PX, name="top", dark=False)
    size = [
        length_per_pixel(image, view, HOLE_PX / (1.0 - d / camera.to_detector), SPACING)
        for d, image in zip(distance, images, strict=True)
    ]
    pixels = rng.uniform((18.0, 12.0), (701.0, 467.0), (400, 2))
    found, ideal = (points - points.mean(axis=0) for points in (view.undistort(pixels), camera.true_places(pixels)))
    # The scale of a corrected image is that of its centre: an undistorted pixel stands for so many true ones.
    scale = float(np.sqrt((ideal**2).sum() / (found**2).sum()))
    true = camera.pitch * scale * (1.0 - distance / camera.to_detector)
    errors = []
    for one in range(len(distance)):
        rest = np.arange(len(distance)) != one
        fit, _ = fit_magnification(distance[rest], np.array(size)[rest])
        errors.append(abs(fit.at(float(distance[one])) / true[one] - 1.0))
    return [Mark(what="magnification at a distance left out of the fit", value=100 * max(errors), limit=0.3, unit="%")]


def known_points(session: Session, calibration: CArmCalibration, rng: np.random.Generator) -> list[Mark]:
    """Measure the places of phantom balls that were left out of the calibration."""
    balls = session.phantom()
    views = [
        phantom_view(view, session.cameras[view.name], session, rng, balls[::2]).projection
        for view in calibration.views
    ]
    images = np.full((2, len(balls), 2), np.nan)
    for number, view in enumerate(calibration.views):
        known, pixels = phantom_pixels(session.cameras[view.name], balls, rng)
        which = cKDTree(balls).query(known)[1]
        images[number, which] = view.undistort(pixels)
    place, _, _ = triangulate(views, images, np.broadcast_to(0.01 * np.eye(2), (2, len(balls), 2, 2)))
    off = (place - balls)[1::2]
    off = off[np.isfinite(off).all(axis=1)]
    return [Mark(what=f"3-D places of {len(off)} known points, RMS", value=1e3 * rms(off), limit=0.15, unit="mm")]


def detection(session: Session, calibration: CArmCalibration, frames: int) -> tuple[list[Mark], list[str]]:
    """Measure recall and 2-D error in single frames of the top view, at several contrasts; and trackpy beside it."""
    marks, lines = [], []
    view = calibration.views[0]
    for dose in (0.3, 1.2, 4.0):
        camera = replace(session.cameras["top"], photons=session.cameras["top"].photons * dose)
        found, wrong, errors, others, snr = 0, 0, [], [], []
        for number in range(frames):
            rng = np.random.default_rng([session.seed, 31, number])
            image = exposed(camera, camera.light(session.rest, BEAD, (), (session.slab,)), rng)
            true = camera.seen(session.rest)
            spots, _ = find_beads(image, view, BEAD_PX, least_snr=3.0)
            away, which = cKDTree(spots.place).query(true)
            found += int((away < 1.5).sum())
            inside = session.slab_pixels(camera, spots.place)
            wrong += int((cKDTree(true).query(spots.place[inside])[0] > 1.5).sum())
            errors.append(spots.place[which[away < 1.5]] - true[away < 1.5])
            snr.append(np.median(np.abs(spots.amplitude[which]) / spots.scatter[which]))
            dark = attenuation(image.astype(float))
            table = trackpy.locate(255.0 * (dark - dark.min()) / np.ptp(dark), 7, minmass=100.0, engine="python")
            away, which = cKDTree(table[["x", "y"]].to_numpy()).query(true)
            others.append((table[["x", "y"]].to_numpy()[which] - true)[away < 1.5])
        recall, error = 100.0 * found / (frames * len(session.rest)), np.concatenate(errors)
        axis = float(np.sqrt((error**2).mean()))
        theirs = float(np.sqrt((np.concatenate(others) ** 2).mean()))
        share = 100.0 * len(np.concatenate(others)) / (frames * len(session.rest))
        lines.append(
            f"contrast {np.mean(snr):.1f} times the noise: recall {recall:.2f} %, {wrong} false in {frames} frames, "
            f"2-D error {axis:.3f} px along each axis (bound {np.sqrt(2 / np.pi) / np.mean(snr):.3f} px); "
            f"trackpy.locate finds {share:.1f} % within {theirs:.3f} px"
        )
        what = f"contrast {np.mean(snr):.1f} times the noise"
        marks.append(Mark(what=f"recall of beads, {what}", value=recall, limit=99.5, unit="%", at_least=True))
        marks.append(Mark(what=f"2-D error in one frame, {what}", value=axis, limit=0.1, unit="px"))
    return marks, lines


@dataclass(frozen=True, kw_only=True)
class Followed:
    """Errors of the tracks of one cut."""

    displacement_mm: float
    image_px: float
    switches_percent: float
    located_percent: float
    hidden_percent: float
    most_hidden_percent: float
    pull: float


def followed(
    session: Session,
    calibration: CArmCalibration,
    rest: Array,
    covariance: Array,
    *,
    every: int = 1,
    fields: bool = False,
) -> Followed:
    """Track the beads of a whole cut, and compare with the truth."""
    rate = calibration.frame_rate / every
    time = np.arange(0.5, session.cut.time[-1] - 0.1, 1.0 / rate)
    frames = session.frames(time, first="bottom" if fields else None)
    if fields:
        quarter = 0.25 / rate
        pairs = ([deinterlaced(image, "bottom") for image in frame] for frame in frames)
        images = chain.from_iterable(zip(*each, strict=True) for each in pairs)
        time = (time[:, None] + [-quarter, quarter]).ravel()
        calibration = replace(calibration, interlaced="bottom")
    else:
        images = frames
    tracks = track_beads(
        images, time, calibration, rest, covariance, diameter=BEAD_PX, displacement=predicted_by(session)
    )
    owner = cKDTree(session.rest).query(rest[np.isfinite(rest).all(axis=1)])[1]
    numbers = np.flatnonzero(np.isfinite(rest).all(axis=1))
    own = dict(zip(numbers.tolist(), owner.tolist(), strict=True))
    truth = {float(now): session.places(float(now)) for now in np.unique(tracks.time)}
    moved, switched, pull = [], 0, []
    first = {bead: tracks.of(bead).place[0] - truth[float(tracks.of(bead).time[0])][own[bead]] for bead in tracks.beads}
    trees = {now: cKDTree(places) for now, places in truth.items()}
    for bead, now, place, spread in zip(tracks.bead, tracks.time, tracks.place, tracks.covariance, strict=True):
        off = place - truth[float(now)][own[int(bead)]]
        moved.append(off - first[int(bead)])
        pull.append(off @ np.linalg.solve(spread, off) / 3.0)
        switched += int(trees[float(now)].query(place)[1] != own[int(bead)])
    matrix = calibration.views[0].projection
    true = np.array([truth[float(now)][own[int(bead)]] for bead, now in zip(tracks.bead, tracks.time, strict=True)])
    flat = project(matrix, tracks.place) - project(matrix, true)
    hidden = np.array([list(each.values()) for each in tracks.metadata["hidden_share"].values()])
    return Followed(
        displacement_mm=1e3 * rms(np.array(moved)),
        image_px=float(np.sqrt((flat**2).mean())),
        switches_percent=100.0 * switched / len(tracks.bead),
        located_percent=100.0 * len(tracks.bead) / (len(numbers) * len(time)),
        hidden_percent=100.0 * float(hidden.mean()),
        most_hidden_percent=100.0 * float(hidden.max()),
        pull=float(np.median(pull)),
    )


def without_sweep(session: Session, calibration: CArmCalibration, count: int) -> list[str]:
    """Pair the views by epipolar lines and motion alone, and tell how many pairs are right."""
    time = np.linspace(0.5, session.cut.time[-1] - 0.1, count)
    spots: list[list[Array]] = [[], []]
    for frame in session.frames(time):
        for number, (view, image) in enumerate(zip(calibration.views, frame, strict=True)):
            spots[number].append(find_beads(image, view, BEAD_PX)[1].place)
    tracks = [linked(spots[0], 6.0), linked(spots[1], 3.0)]
    pairs, doubtful = pairs_by_epipolar(*calibration.projections, *tracks)
    owner = []
    for number, view in enumerate(calibration.views):
        nearest = np.full((count, tracks[number].shape[1]), -1)
        for k, now in enumerate(time):
            seen = np.isfinite(tracks[number][k, :, 0])
            true = project(view.projection, session.places(float(now)))
            away, which = cKDTree(true).query(tracks[number][k, seen])
            nearest[k, seen] = np.where(away < 1.5, which, -1)
        owner.append([int(np.bincount(row[row >= 0], minlength=1).argmax()) for row in nearest.T])
    right = sum(owner[0][a] == owner[1][b] for a, b in pairs)
    return [
        f"without a rotation, by epipolar lines and motion in {count} frames: {right} of {len(session.rest)} beads "
        f"paired rightly, {len(pairs) - right} wrongly, {len(doubtful)} tracks of the top view left out as doubtful"
    ]


def adjusted(session: Session, calibration: CArmCalibration, rng: np.random.Generator) -> list[str]:
    """Turn the side arm by 3 mrad after its calibration, and adjust its pose to the beads."""
    side = session.cameras["side"]
    moved = replace(side, angle=side.angle + 0.003, tilt=side.tilt + 0.002)
    images, errors = np.full((2, len(session.rest), 2), np.nan), np.zeros((2, len(session.rest), 2, 2))
    for number, (view, camera) in enumerate(zip(calibration.views, (session.cameras["top"], moved), strict=True)):
        picture = exposed(camera, camera.light(session.rest, BEAD, (), (session.slab,)), rng)
        spots, ideal = find_beads(picture, view, BEAD_PX)
        away, which = cKDTree(spots.place).query(camera.seen(session.rest))
        images[number, away < 1.0] = ideal.place[which[away < 1.0]]
        errors[number] = ideal.covariance[which]
    before = triangulate(calibration.projections, images, errors)
    views, _ = bundle_adjusted(calibration.projections, images, errors)
    after = triangulate(views, images, errors)
    middle = [float(np.nanmedian(misfit)) for *_, misfit in (before, after)]
    return [
        f"side arm turned by 3 and 2 mrad after its calibration: median misfit of the beads {middle[0]:.1f} "
        f"before and {middle[1]:.1f} after the bundle adjustment (1 is noise alone)"
    ]


def in_step(session: Session, calibration: CArmCalibration, rest: Array, covariance: Array) -> list[str]:
    """Find the lag of the force record from the motion of beads near the cut line, without a model."""
    seconds = min(8.0, float(session.cut.time[-1]) - 0.7)
    time = np.arange(0.5, 0.5 + seconds, 1.0 / calibration.frame_rate)
    near = np.where((np.abs(rest[:, :1]) < 0.015) & (rest[:, 1:2] < 0.045), rest, np.nan)
    tracks = track_beads(session.frames(time), time, calibration, near, covariance, diameter=BEAD_PX)
    frames = np.unique(tracks.time)
    motion = np.array([np.mean(tracks.place[tracks.time == now, 1]) for now in frames])
    try:
        lag, agreement = clock_lag(frames - session.lag, motion, session.cut.time, session.cut.force)
    except ValueError as error:
        return [f"lag of the force record: not found, {error}"]
    off = 1e3 * (lag - session.lag)
    return [f"lag of the force record, from {seconds:.0f} s: {off:+.0f} ms off, correlation {agreement:.2f}"]


def told(marks: list[Mark], lines: list[str]) -> None:
    """Print what has been measured so far."""
    print(*(f"{mark.what}: {mark.value:.3g} {mark.unit}" for mark in marks), *lines, "", sep="\n", flush=True)


def measured(sessions: int, quick: bool) -> dict[str, Any]:
    """Run everything; return marks and lines."""
    marks, lines = correction(range(1 if quick else 2)), []
    marks += magnification(1)
    told(marks, lines)
    for seed in range(1, 1 + sessions):
        rng = np.random.default_rng([seed, 27])
        session = Session.drawn(seed)
        calibration = calibrated(session, rng)
        rest, covariance = swept(session, calibration.views[0], rng)
        places = cKDTree(session.rest).query(rest[np.isfinite(rest).all(axis=1)])
        lines.append(
            f"session {seed}: the rotation gives {len(np.unique(places[1]))} of {len(session.rest)} beads a place, "
            f"{1e3 * np.sqrt((places[0] ** 2).mean()):.3f} mm RMS off"
        )
        marks += known_points(session, calibration, rng)
        found, seen = detection(session, calibration, 3 if quick else 8)
        marks, lines = marks + found, lines + seen
        told(marks, lines)
        lines += adjusted(session, calibration, rng) + in_step(session, calibration, rest, covariance)
        lines += without_sweep(session, calibration, 20 if quick else 40)
        told(marks, lines)
        slow = followed(session, calibration, rest, covariance, every=30 if quick else 6)
        fast_cut = replace(session, cut=type(session.cut).simulated(0.0127, 0.07, seed))
        fast = followed(fast_cut, calibration, rest, covariance, fields=True, every=5 if quick else 1)
        for name, result, most in (("0.1 cm/s", slow, 0.0), ("1.27 cm/s, interlaced", fast, 1.0)):
            cut = f"session {seed}, cut at {name}"
            marks += [
                Mark(what=f"{cut}: 3-D displacement, RMS", value=result.displacement_mm, limit=0.1, unit="mm"),
                Mark(what=f"{cut}: 2-D error of the track", value=result.image_px, limit=0.1, unit="px"),
                Mark(what=f"{cut}: switched identities", value=result.switches_percent, limit=most, unit="%"),
            ]
            lines.append(
                f"{cut}: {result.located_percent:.1f} % of places located; a view hides a bead in "
                f"{result.hidden_percent:.1f} % of frames, one bead in {result.most_hidden_percent:.1f} %; median squared "
                f"error over covariance {result.pull:.2f} (0.79 is right)"
            )
        told(marks, lines)
    return {"marks": [asdict(mark) for mark in marks], "lines": lines, "quick": quick}


def markdown(kept: dict[str, Any]) -> str:
    """Return the table of marks, misses shown, and the other numbers."""
    marks = [Mark(**mark) for mark in kept["marks"]]
    rows = [
        (
            m.what,
            f"{m.value:.3g} {m.unit}",
            f"{'≥' if m.at_least else '≤'} {m.limit:g} {m.unit}",
            "yes" if m.met else "**no**",
        )
        for m in marks
    ]
    table = markdown_table(("what", "measured", "mark", "kept"), rows)
    return table + "\n\n" + "\n".join(f"- {line}" for line in kept["lines"])


def main() -> None:
    """Measure, print, and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE", help="keep the numbers for scripts/update_docs.py")
    parser.add_argument("--quick", action="store_true", help="few frames: to see that everything runs")
    parser.add_argument("--sessions", type=int, default=1, help="how many sessions are drawn")
    arguments = parser.parse_args()
    kept = measured(arguments.sessions, arguments.quick)
    print(markdown(kept))
    if arguments.json:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        arguments.json.write_text(json.dumps(kept, indent=1))


if __name__ == "__main__":
    main()
