"""Beads in the tissue followed through two X-ray videos.

Places over time, with covariance (thesis, 7.1 to 7.3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import in_range
from cutenv.vision.bead_images import BeadLook, attenuation, groups_of, measure_with_neighbours, shared_shifts
from cutenv.vision.bead_tracks import BeadTracks
from cutenv.vision.fluoroscopy import CArmCalibration, CArmView
from cutenv.vision.projection import project, projection_slope
from cutenv.vision.spots import Spots, locate_spots

_JUMP = 12.0  # squared innovation over its variance, beyond which prediction or image is wrong
_OF_A_JUMP = 0.3  # of a shared jump, that a bead's own may differ from it
_AGREE = 1.5  # px: of the views on a shared jump
_PERSISTENCE = 60.0  # a doubtful image is believed when it has come about five times


@dataclass(kw_only=True, eq=False)
class BeadFilter:
    """Kalman filter of every bead.

    A bead is where it rested, moved as the model predicts, with an offset that wanders.
    """

    rest: Array  # places at rest [m] and covariance of the places [m²]
    variance: Array
    groups: Indices = field(init=False)  # beads that move like each, see `groups_of`, shape (n, k)
    predicted: Array = field(init=False)  # places that the model predicts for this frame [m], shape (n, 3)
    offset: Array = field(init=False)  # place less that predicted [m], shape (n, 3)
    refused: NDArray[np.bool_] = field(init=False)  # whose image a view has refused in this frame, shape (n,)

    def __post_init__(self) -> None:
        self.groups = groups_of(self.rest)
        self.offset = np.zeros_like(self.rest)
        self.begin(self.rest)

    @property
    def place(self) -> Array:
        """Places as they are known now [m], shape (n, 3)."""
        return self.predicted + self.offset

    def begin(self, predicted: Array) -> None:
        """Begin a frame with the places that the model predicts."""
        n = len(self.rest)
        self.predicted = predicted
        self._before = self.offset.copy(), self.variance.copy()
        self._ray = np.zeros((n, 3))  # of the view that has shown the bead in this frame
        self._shown = np.zeros(n, bool)
        self._jumped = np.zeros(n, bool)
        self.refused = np.zeros(n, bool)

    def jump(self, rows: NDArray[np.bool_], slope: Array, shift: Array) -> None:
        """Move some beads as their images have moved together.

        Slope, of shape (n, 2 views, 3) [px/m], and shift, (n, 2 views) [px], are those of ``rows``. Where the views
        contradict each other, nothing moves.
        """
        scale = np.linalg.norm(slope, axis=(1, 2))[:, None, None]
        turned = slope.transpose(0, 2, 1)
        moved = np.linalg.solve(turned @ slope + 1e-6 * scale**2 * np.eye(3), turned @ shift[:, :, None])[:, :, 0]
        agree = np.abs((slope @ moved[:, :, None])[:, :, 0] - shift).max(axis=1) < _AGREE
        rows, moved = np.flatnonzero(rows)[agree], moved[agree]
        self.offset[rows] += moved
        unsure = (_OF_A_JUMP * np.hypot.reduce(moved, axis=1)) ** 2
        self.variance[rows] += unsure[:, None, None] * np.eye(3)

    def update(self, view: CArmView, measured: Array, error: Array, crowded: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Take in what one view shows, in undistorted pixels.

        Return which beads it showed. An image far from the prediction is a jump of the bead, or another bead. It is
        refused where another bead is near in this view (``crowded``), and where it contradicts the view that has shown
        the bead in this frame.
        """
        matrix = view.projection
        assert matrix is not None  # a calibration's views have one
        there = np.asarray(np.isfinite(measured).all(axis=1))
        rows = np.flatnonzero(there)
        place = self.place[rows]
        slope = projection_slope(matrix, place)
        left = measured[rows] - project(matrix, place)
        variance, error = self.variance[rows], error[rows]
        square = _square(left, slope, variance, error)
        metres = np.hypot(*left.T) / np.linalg.norm(slope, axis=(1, 2)) * np.sqrt(2.0)
        # The tissue springs back within a frame when the crack runs: then what was known before is worth little, but
        # across the rays of the view that has just shown the bead.
        ray, again = self._ray[rows], self._shown[rows]
        free = np.where(again[:, None, None], ray[:, :, None] * ray[:, None, :], np.eye(3))
        doubted = square > _JUMP
        wider = variance + np.where(doubted, metres**2, 0.0)[:, None, None] * free
        contrary = doubted & again & (_square(left, slope, wider, error) > _JUMP)
        refused = doubted & (crowded[rows] | contrary)
        taken = ~refused
        self.variance[rows[refused]] += (metres[refused] ** 2 / _PERSISTENCE)[:, None, None] * free[refused]
        both = contrary & self._jumped[rows]  # the view before may be wrong as well
        self.undo(rows[both])
        self.variance[rows[both]] += (metres[both] ** 2 / _PERSISTENCE)[:, None, None] * np.eye(3)
        there[rows[refused]] = False
        self.refused[rows[refused]] = True

        own, slope, left, error, variance = rows[taken], slope[taken], left[taken], error[taken], wider[taken]
        turned = slope.transpose(0, 2, 1)
        gain = variance @ turned @ np.linalg.inv(slope @ variance @ turned + error)
        self.offset[own] += np.einsum("nij,nj->ni", gain, left)
        kept = np.eye(3) - gain @ slope
        # Joseph's form stays symmetric and positive.
        self.variance[own] = kept @ variance @ kept.transpose(0, 2, 1) + gain @ error @ gain.transpose(0, 2, 1)
        self._shown[own] = True
        self._jumped[own] |= doubted[taken]
        across = np.cross(slope[:, 0], slope[:, 1])
        self._ray[own] = across / np.linalg.norm(across, axis=1, keepdims=True)
        return there

    def undo(self, rows: NDArray[np.bool_] | Indices) -> None:
        """Take back what this frame has shown of some beads."""
        self.offset[rows], self.variance[rows] = self._before[0][rows], self._before[1][rows]

    def follow(self, seen: NDArray[np.bool_]) -> None:
        """Move beads not ``seen``, (views, n), with their neighbours.

        A bead that one view shows is known across its rays; along them it goes as its neighbours do.
        """
        whole = np.asarray(seen.all(axis=0))
        step = self.offset - self._before[0]
        for one in np.flatnonzero(~whole):
            near = self.groups[one][whole[self.groups[one]]]
            if len(near) < 2:
                continue
            theirs = np.median(step[near], axis=0)
            scatter = float(np.mean((step[near] - theirs) ** 2))
            if seen[:, one].any():
                along = np.outer(self._ray[one], self._ray[one])
                self.offset[one] += along @ (theirs - step[one])
            else:
                along = np.eye(3)
                self.offset[one] += theirs - step[one]
            self.variance[one] += scatter * along


def _square(left: Array, slope: Array, variance: Array, error: Array) -> Array:
    spread = slope @ variance @ slope.transpose(0, 2, 1) + error
    return np.asarray(np.einsum("ni,nij,nj->n", left, np.linalg.inv(spread), left))


Displacement = Callable[[Array, float], Array]
"""Displacement that a model predicts [m], shape (n, 3), of resting places (n, 3) [m] at a time [s]."""
_SWAP = 0.75  # diameters: two beads nearer than that in every view are one bead measured twice
_MODEL_ERROR = 0.3  # of what the model moves a bead from frame to frame, that it may be wrong by
_CROWDED = 2.4  # diameters to the next bead, within which the fit may run to it
_OF_A_FIELD = 2.4  # true covariance over that of a fit in a field: interpolated lines tell nothing, and are less noisy
_MIN_SEEN_SHARE = 0.5  # of the beads, to be seen in the first frame of each view


def find_beads(image: ArrayLike, view: CArmView, diameter: float, *, least_snr: float = 4.0) -> tuple[Spots, Spots]:
    """Find the beads of one frame, in its pixels and in undistorted square ones.

    Their diameter is in pixels of the image, their least contrast over the noise of one pixel.

    Raises ValueError if the frame is none, of another camera, or shows no bead.
    """
    seen = locate_spots(view.checked(image), diameter, dark=True, least_snr=least_snr)
    if len(seen) == 0:
        raise ValueError(
            f"view {view.name!r} shows no bead of {diameter:g} px whose contrast is {least_snr:g} times the noise."
        )
    place, covariance = view.undistorted_with_covariance(seen.place, seen.covariance)
    ideal = Spots(place=place, covariance=covariance, amplitude=seen.amplitude, sigma=seen.sigma, scatter=seen.scatter)
    return seen, ideal


def bead_look(image: ArrayLike, view: CArmView, diameter: float) -> BeadLook:
    """Return the usual look of isolated beads in a frame."""
    grey = view.checked(image)
    spots = locate_spots(-attenuation(grey), diameter, dark=True, least_snr=4.0)
    if len(spots) < 5:
        raise ValueError(f"view {view.name!r} shows {len(spots)} beads of {diameter:g} px; it takes 5.")
    return BeadLook(
        diameter=diameter,
        sigma=float(np.median(spots.sigma)),
        height=float(np.median(np.abs(spots.amplitude))),
        noise=float(np.median(spots.scatter)),
    )


def track_beads(
    frames: Iterable[Sequence[ArrayLike]],
    time: ArrayLike,
    calibration: CArmCalibration,
    rest: tuple[ArrayLike, ArrayLike],
    *,
    diameter: float,
    displacement: Displacement | None = None,
    wander: float = 1e-4,
    largest_error: float = 3e-4,
    progress: Callable[[int], None] | None = None,
) -> BeadTracks:
    """Follow beads through the frames of two views or more.

    In every frame each bead is expected where the model's displacement and its last offset from that put it; there it
    is measured in each view, together with the beads that it hides behind. When the crack runs, neighbours jump alike,
    and are looked for together. A view in which a bead is not to be seen, such as behind the blade, or in which its
    image may be another bead's, is left out for that frame: the others, the neighbours' motion and the prediction
    bridge it, and the covariance says what that costs.

    For each time, on the clock of the force record [s], ``frames`` have one image of every view, in the order of the
    calibration. ``rest`` are places in the first frame [m] and covariances [m²], from `places_from_sweep` or
    `triangulate`; rows that are not finite are beads without a place, which keep their number and get no rows.
    ``diameter`` is that of a bead in the images [px]; ``displacement`` is what a model predicts, 0 in the first frame,
    by default none; ``wander`` is how far the offset from it wanders in a second [m/√s]; ``largest_error`` the standard
    error beyond which a place is left out [m]; ``progress`` is called with the number of frames done.

    The tracks are in the frame of the calibration. Their metadata tell which frames were left out and why, in how many
    frames each bead has no place and why, and the share of frames in which each view did not show it.

    Raises ValueError if times do not go with the calibration's frame rate, there are no beads, or the first frame shows
    less than half of them in a view: it is turned or mirrored, or the calibration is another.
    """
    times = _checked_times(time, calibration)
    diameter = in_range("diameter", diameter, 2.0, 60.0, "px", "It is the diameter of a bead in the images.")
    known, state = _at_rest(*rest)
    looks: list[BeadLook] = []
    hidden = np.zeros((len(calibration.views), len(known)))
    left_out: dict[str, str] = {}
    rows: list[tuple[Indices, Array, Array, Array]] = []
    reasons = (
        "its image may be another bead's",
        "no view shows it",
        f"its standard error exceeds {1e3 * largest_error:g} mm",
    )
    unplaced = {reason: np.zeros(len(known), int) for reason in reasons}
    done = 0
    last, before = times[0], state.rest
    for number, (now, images) in enumerate(zip(times, frames, strict=False)):
        done += 1
        predicted = state.rest + (0.0 if displacement is None else displacement(state.rest, float(now)))
        unsure = wander**2 * (now - last) + _MODEL_ERROR**2 * np.sum((predicted - before) ** 2, axis=1)
        state.variance += unsure[:, None, None] * np.eye(3)
        last, before = now, predicted
        try:
            if len(images) != len(calibration.views):
                raise ValueError(f"{len(images)} images for {len(calibration.views)} views")
            greys = [view.checked(image) for view, image in zip(calibration.views, images, strict=True)]
        except ValueError as error:
            if number == 0:
                raise ValueError(f"the first frame cannot be used: {error}") from None
            left_out[f"{now:.4f} s"] = str(error)
            continue
        if not looks:
            looks = [bead_look(grey, view, diameter) for grey, view in zip(greys, calibration.views, strict=True)]
        state.begin(predicted)
        seen = _measured(state, calibration, greys, looks)
        if number == 0:
            _check_first(seen, calibration.views)
        hidden += ~seen
        spread = np.sqrt(np.trace(state.variance, axis1=1, axis2=2) / 3.0)
        shown, certain = np.asarray(seen.any(axis=0)), spread < largest_error
        for reason, which in zip(reasons, (state.refused, ~state.refused), strict=False):
            unplaced[reason] += ~shown & which
        unplaced[reasons[2]] += shown & ~certain
        shown &= certain
        moments = np.full(int(shown.sum()), float(now))
        rows.append((known[shown], moments, state.place[shown], state.variance[shown].copy()))
        if progress is not None:
            progress(done)
    if done == 0:
        raise ValueError("there are no frames.")
    if done < len(times):
        left_out["end"] = f"the video ends after {done} of {len(times)} frames, at {times[done - 1]:.3f} s."
    metadata = {
        "left_out": left_out,
        "hidden_share": {
            view.name: dict(zip(map(str, known.tolist()), np.round(part / len(rows), 4).tolist(), strict=True))
            for view, part in zip(calibration.views, hidden, strict=True)
        },
        "frames_without_place": {
            reason: {str(bead): int(n) for bead, n in zip(known, counts, strict=True) if n}
            for reason, counts in unplaced.items()
        },
        "residuals": {view.name: dict(view.residuals) for view in calibration.views},
    }
    bead, moment, place, covariance = map(np.concatenate, zip(*rows, strict=True))
    return BeadTracks(bead=bead, time=moment, place=place, covariance=covariance, metadata=metadata)


def _at_rest(rest: ArrayLike, rest_covariance: ArrayLike) -> tuple[Indices, BeadFilter]:
    """Return numbers and filter of the beads with places."""
    place, covariance = np.asarray(rest, float), np.asarray(rest_covariance, float)
    if place.ndim != 2 or place.shape[1] != 3 or covariance.shape != (len(place), 3, 3):
        raise ValueError(f"rest has shape {place.shape}, its covariance {covariance.shape}: give (n, 3), (n, 3, 3).")
    known = np.flatnonzero(np.isfinite(place).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2)))
    if len(known) == 0:
        raise ValueError("there are no beads: not one row of rest is a place.")
    return known.astype(np.int64), BeadFilter(rest=place[known], variance=covariance[known])


def _checked_times(time: ArrayLike, calibration: CArmCalibration) -> Array:
    times = np.asarray(time, float)
    if times.ndim != 1 or len(times) < 2 or not np.isfinite(times).all() or (np.diff(times) <= 0.0).any():
        raise ValueError("time needs two finite times or more, ascending.")
    # Frames may be left out, and a frame may be split into two fields; nothing else goes with the rate.
    step = float(np.median(np.diff(times))) * calibration.frame_rate * (2.0 if calibration.interlaced else 1.0)
    if abs(step - round(step)) > 0.02 * step or round(step) < 1:
        raise ValueError(
            f"frames are {np.median(np.diff(times)):.5f} s apart, the calibration is of a video with "
            f"{calibration.frame_rate:.2f} frames a second. Which rate is wrong?"
        )
    return times


def _measured(
    state: BeadFilter, calibration: CArmCalibration, greys: Sequence[Array], looks: Sequence[BeadLook]
) -> NDArray[np.bool_]:
    """Take in all views; return seen beads, shape (views, n)."""
    views = calibration.views
    images = [attenuation(grey) for grey in greys]
    _jump(state, views, images, looks)
    seen = np.zeros((len(views), len(state.rest)), bool)
    for number, (view, image, look) in enumerate(zip(views, images, looks, strict=True)):
        expected = _seen(view, state.place)
        place, covariance = measure_with_neighbours(image, expected, state.groups, look)
        ideal, error = view.undistorted_with_covariance(place, covariance)
        if calibration.interlaced:
            error = _OF_A_FIELD * error
        away = np.asarray(cKDTree(expected).query(expected, k=2)[0])[:, 1]
        crowded = away < _CROWDED * look.diameter
        seen[number] = state.update(view, ideal, error, crowded)
    # Two that ended in one place everywhere: neither is believed, both go on as predicted.
    near = np.ones((len(state.rest),) * 2, bool)
    for view, look in zip(views, looks, strict=True):
        assert view.projection is not None
        image = project(view.projection, state.place)
        near &= np.hypot(*(image[:, None] - image[None]).transpose(2, 0, 1)) < _SWAP * look.diameter
    doubtful = near.sum(axis=1) > 1
    state.undo(doubtful)
    seen[:, doubtful] = False
    state.follow(seen)
    return seen


def _seen(view: CArmView, places: Array) -> Array:
    assert view.projection is not None  # a calibration's views have one
    # A place that no pixel shows is out of every image.
    return np.nan_to_num(view.seen(project(view.projection, places)), nan=-1e6)


def _jump(state: BeadFilter, views: Sequence[CArmView], images: Sequence[Array], looks: Sequence[BeadLook]) -> None:
    """Move beads by their groups' jump since the last frame."""
    shifts, slopes = [], []
    for view, image, look in zip(views, images, looks, strict=True):
        expected = _seen(view, state.place)
        shift = shared_shifts(image, expected, state.rest, state.groups, look)
        shifts.append(view.undistort(expected + shift) - view.undistort(expected))
        assert view.projection is not None
        slopes.append(projection_slope(view.projection, state.place))
    jumped = np.any([(shift != 0.0).any(axis=1) for shift in shifts], axis=0)
    if jumped.any():
        state.jump(jumped, np.concatenate(slopes, axis=1)[jumped], np.concatenate(shifts, axis=1)[jumped])


def _check_first(seen: NDArray[np.bool_], views: Sequence[CArmView]) -> None:
    for view, shown in zip(views, seen, strict=True):
        if shown.mean() < _MIN_SEEN_SHARE:
            raise ValueError(
                f"view {view.name!r} shows {shown.sum()} of {len(shown)} beads where the calibration and their places "
                "expect them. Is it turned or mirrored, are the views in another order, or is the calibration another?"
            )
