"""Measure how well C-arm images are corrected and beads followed, on rendered X-ray sessions; docs/validation/beads.md.

python -m scripts.validation.vision.bead_tracking  all parts, one after the other: a quarter of an hour
python -m scripts.update_docs bead-tracking
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import chain
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from cutenv.vision.bead_correspondence import bundle_adjusted, linked, pairs_by_epipolar
from cutenv.vision.bead_images import attenuation
from cutenv.vision.bead_tracks import clock_lag
from cutenv.vision.beads import find_beads, track_beads
from cutenv.vision.fluoroscopy import CArmCalibration, deinterlaced
from cutenv.vision.projection import project, triangulate
from scripts import ROOT
from scripts.tables import keep_json, kept_json, markdown_table
from scripts.validation.vision.carm_measurement import (
    BEAD_PX,
    SEED,
    Array,
    Mark,
    calibrated,
    correction,
    magnification,
    phantom_pixels,
    phantom_view,
    predicted_by,
    rms,
    swept,
)
from scripts.validation.vision.rendering.xray_session import BEAD, Session, exposed

FOLDER = "runs/bead_tracking"  # folder where each part of the measurement is kept, relative to the repository


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
    import trackpy  # pip install trackpy: it has no wheel, so set-up leaves it out

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
    session: Session, calibration: CArmCalibration, rest: Array, covariance: Array, *, fields: bool = False
) -> Followed:
    """Track the beads of a whole cut, and compare with the truth."""
    rate = calibration.frame_rate
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
        images, time, calibration, (rest, covariance), diameter=BEAD_PX, displacement=predicted_by(session)
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
    seconds = min(4.0, float(session.cut.time[-1]) - 0.7)
    time = np.arange(0.5, 0.5 + seconds, 1.0 / calibration.frame_rate)
    near = np.where((np.abs(rest[:, :1]) < 0.015) & (rest[:, 1:2] < 0.045), rest, np.nan)
    tracks = track_beads(session.frames(time), time, calibration, (near, covariance), diameter=BEAD_PX)
    frames = np.unique(tracks.time)
    motion = np.array([np.mean(tracks.place[tracks.time == now, 1]) for now in frames])
    try:
        lag, agreement = clock_lag(frames - session.lag, motion, session.cut.time, session.cut.force)
    except ValueError as error:
        return [f"lag of the force record: not found, {error}"]
    off = 1e3 * (lag - session.lag)
    return [f"lag of the force record, from {seconds:.0f} s: {off:+.0f} ms off, correlation {agreement:.2f}"]


Part = tuple[list[Mark], list[str]]  # marks and other numbers of one part of the measurement


@cache
def prepared(seed: int) -> tuple[Session, CArmCalibration, Array, Array]:
    """Draw a session, calibrate it and find its beads at rest; the same for every part."""
    rng = np.random.default_rng([seed, 27])
    session = Session.drawn(seed)
    calibration = calibrated(session, rng)
    return session, calibration, *swept(session, calibration.views[0], rng)


def images_part(seed: int) -> Part:
    """Measure the correction of images, and the magnification."""
    return [*correction(range(1)), *magnification(seed)], []


def rest_part(seed: int) -> Part:
    """Measure what is known before the cut: known points, beads in single frames, poses."""
    session, calibration, rest, _ = prepared(seed)
    rng = np.random.default_rng([seed, 28])
    away, owner = cKDTree(session.rest).query(rest[np.isfinite(rest).all(axis=1)])
    line = (
        f"a rotation of the top arm gives {len(np.unique(owner))} of {len(session.rest)} beads a place, "
        f"{1e3 * np.sqrt((away**2).mean()):.3f} mm RMS off"
    )
    marks, lines = detection(session, calibration, 3)
    return [*known_points(session, calibration, rng), *marks], [line, *lines, *adjusted(session, calibration, rng)]


def slow_part(seed: int) -> Part:
    """Measure tracks of a cut at 0.1 cm/s."""
    session, calibration, rest, covariance = prepared(seed)
    return report(followed(session, calibration, rest, covariance), "cut at 0.1 cm/s", 0.0)


def fast_part(seed: int) -> Part:
    """Measure tracks of a cut at 1.27 cm/s from interlaced frames."""
    session, calibration, rest, covariance = prepared(seed)
    session = replace(session, cut=type(session.cut).simulated(0.0127, 0.07, seed))
    result = followed(session, calibration, rest, covariance, fields=True)
    return report(result, "cut at 1.27 cm/s", 1.0)


def motion_part(seed: int) -> Part:
    """Measure what the motion tells without a model: the lag of the record, and pairs without a rotation."""
    session, calibration, rest, covariance = prepared(seed)
    lines = in_step(session, calibration, rest, covariance)
    return [], lines + without_sweep(session, calibration, 25)


def report(result: Followed, cut: str, most: float) -> Part:
    """Return the marks and the line of one cut."""
    marks = [
        Mark(what=f"{cut}: 3-D displacement, RMS", value=result.displacement_mm, limit=0.1, unit="mm"),
        Mark(what=f"{cut}: 2-D error of the tracks along each axis", value=result.image_px, limit=0.1, unit="px"),
        Mark(what=f"{cut}: switched identities", value=result.switches_percent, limit=most, unit="%"),
        Mark(what=f"{cut}: places located", value=result.located_percent, limit=95.0, unit="%", at_least=True),
    ]
    line = (
        f"{cut}: a view hides a bead in {result.hidden_percent:.1f} % of frames, one bead in "
        f"{result.most_hidden_percent:.1f} %; median squared error over covariance {result.pull:.2f} (0.79 is right)"
    )
    return marks, [line]


PARTS = {"images": images_part, "rest": rest_part, "slow": slow_part, "fast": fast_part, "motion": motion_part}
"""Parts of the measurement, in the order of the page."""


def markdown(marks: list[Mark], lines: list[str]) -> str:
    """Return the table of marks, misses shown, and the other numbers."""
    rows = [
        (
            m.what,
            f"{m.value:.3g} {m.unit}",
            f"{'at least' if m.at_least else 'at most'} {m.limit:g} {m.unit}",
            "yes" if m.met else "**no**",
        )
        for m in marks
    ]
    table = markdown_table(("what", "measured", "mark", "kept"), rows)
    return table + "\n\n" + "\n".join(f"- {line}" for line in lines)


def kept_markdown() -> str:
    """Return the table of all parts, of an earlier measurement; SystemExit with the cure where one is missing."""
    marks, lines = [], []
    for name in PARTS:
        command = f"scripts.validation.vision.bead_tracking --part {name}"
        told = kept_json(ROOT / FOLDER / f"{name}.json", command)
        marks += [Mark(**mark) for mark in told["marks"]]
        lines += told["lines"]
    return markdown(marks, lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", choices=PARTS, help="measure this part alone")
    parser.add_argument("--out", type=Path, default=Path(FOLDER), metavar="FOLDER", help="where the parts are kept")
    parser.add_argument("--seed", type=int, default=SEED, help=f"draws the session; default {SEED}, that of the page")
    arguments = parser.parse_args()
    met = True
    for name in [arguments.part] if arguments.part else PARTS:
        marks, lines = PARTS[name](arguments.seed)
        print(markdown(marks, lines), flush=True)
        met &= all(mark.met for mark in marks)
        keep_json(arguments.out / f"{name}.json", {"marks": [asdict(mark) for mark in marks], "lines": lines})
    sys.exit(int(not met))
