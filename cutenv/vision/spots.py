"""Round spots in an image.

Placed to a fraction of a pixel with uncertainty; those of a grid given row and column.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import in_range

FLOOR = 1e-12  # smallest pivot of a normal matrix: keeps a flat window solvable
_CANDIDATE = 4.5  # in standard deviations of the filtered noise; the fit then decides
_REACH = 3.2  # widths of a spot around it that are fitted: in a smaller window place and background are confused
_ROUNDS = 14  # of the fit; beads settle in five
_SETTLED = 1e-3  # px
_AT_ONCE = 128  # windows: what fits into a cache
_LAPLACE = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])


@dataclass(frozen=True, kw_only=True, eq=False)
class Spots:
    """Spots of one image."""

    place: Array  # column and row of each centre [px]; the centre of the first pixel is (0, 0), shape (n, 2)
    covariance: Array  # covariance of each centre [px²], from what the fit left over, shape (n, 2, 2)
    amplitude: Array  # height above the background, or depth below it [units of the image], shape (n,)
    sigma: Array  # width of the fitted Gaussian [px], shape (n,)
    scatter: Array  # SD of what the fit left over around each, a pixel's noise [units of the image], shape (n,)

    def __len__(self) -> int:
        return len(self.place)

    def where(self, kept: NDArray[np.bool_]) -> Spots:
        """Return the spots selected by a mask, shape (n,)."""
        return Spots(**{name: values[kept] for name, values in vars(self).items()})


def checked_image(image: ArrayLike, name: str = "image") -> Array:
    """Return a grey image as float64.

    Raises ValueError if it is not two-dimensional, smaller than 16 pixels, not finite or of one value only.
    """
    raw = np.asarray(image)
    if raw.ndim != 2 or min(raw.shape) < 16:
        raise ValueError(f"{name} has shape {raw.shape}: give one grey image, rows by columns, 16 pixels or more.")
    if raw.dtype.kind not in "biuf":
        raise ValueError(f"{name} holds {raw.dtype}, not numbers.")
    grey = raw.astype(np.float64)
    if not np.isfinite(grey).all():
        raise ValueError(f"{name} has pixels that are not finite.")
    if grey.min() == grey.max():
        raise ValueError(f"{name} is {grey.min():g} everywhere: nothing is to be seen in it.")
    return grey


def noise_of(image: Array) -> float:
    """Return an image's noise standard deviation from second differences.

    See Immerkær 1996; here with the median. A slope of the background does not count, and spots count little. It is at
    least 0.29, the rounding to whole grey values, where the image's values are whole.
    """
    left = ndimage.convolve(image, _LAPLACE)[1:-1, 1:-1] / 6.0
    rounding = 1.0 / math.sqrt(12.0) if np.array_equal(image, np.round(image)) else 0.0
    return max(float(1.4826 * np.median(np.abs(left))), rounding, 1e-9 * float(np.ptp(image)))


def locate_spots(image: ArrayLike, diameter: float, *, dark: bool = True, least_snr: float = 5.0) -> Spots:
    """Find round spots and fit a Gaussian, on a linear background, to each.

    They are ``dark`` or bright, of a diameter of 2 to 60 px, of which half and twice are found, too; their height is at
    least ``least_snr`` times the noise of one pixel. Those cut off by the border of the image are left out.  With noise
    N and height A the standard error of a fitted centre is at best sqrt(2/π) N/A pixels, whatever the width of the
    spot.

    Raises ValueError if the image is none (see `checked_image`) or a number is out of range.
    """
    grey = checked_image(image)
    diameter = in_range("diameter", diameter, 2.0, 60.0, "px", "It is the diameter of one bead or hole in the image.")
    least_snr = in_range("least_snr", least_snr, 1.0, 1e3, "1")
    if dark:
        grey = -grey
    width = 0.4 * diameter
    half = max(3, math.ceil(_REACH * width))
    noise = noise_of(grey)
    if min(grey.shape) <= 2 * half + 1:
        raise ValueError(f"image has shape {grey.shape}, too small for spots of {diameter:g} px.")
    filtered = -ndimage.gaussian_laplace(grey, width)
    kernel = np.zeros((8 * half + 1,) * 2)
    kernel[4 * half, 4 * half] = 1.0
    spread = float(np.linalg.norm(ndimage.gaussian_laplace(kernel, width)))
    # The filter answers a spot of height A by A/2 over width²; weaker ones need no fit.
    least = max(_CANDIDATE * spread, 0.25 * least_snr / width**2) * noise
    footprint = np.hypot(*np.mgrid[-half : half + 1, -half : half + 1]) <= max(1.5, 0.5 * diameter)
    peaks = (filtered == ndimage.maximum_filter(filtered, footprint=footprint)) & (filtered > least)
    rows, columns = np.nonzero(peaks)
    fitted, settled = fit_spots(grey, np.stack([columns, rows], axis=1), diameter)
    strong = settled & (fitted.amplitude > least_snr * fitted.scatter)
    found = fitted.where(strong)
    found = found.where(_first_of_each(found, width))
    return replace(found, amplitude=-found.amplitude) if dark else found


def fit_spots(grey: Array, start: Array, diameter: float) -> tuple[Spots, NDArray[np.bool_]]:
    """Fit a Gaussian on a sloping background near each start.

    Each bright spot is expected within half its diameter [px] of a start, (n, 2). Return the fits, and which of them
    are a spot: whole in the image, of half to twice the size, near its start, and more than an edge.
    """
    width = 0.4 * diameter
    half = max(3, math.ceil(_REACH * width))
    nearest = np.round(start).astype(int)
    room = np.array([grey.shape[1], grey.shape[0]]) - half
    inside = ((nearest >= half) & (nearest < room)).all(axis=1)
    columns, rows = np.clip(nearest, half, np.maximum(room - 1, half)).T
    across = np.arange(-half, half + 1)
    windows = grey[rows[:, None, None] + across[:, None], columns[:, None, None] + across]
    y, x = (axis.ravel().astype(float) for axis in np.mgrid[-half : half + 1, -half : half + 1])
    values = windows.reshape(len(rows), len(x))
    # Column, row, height, width, background and its slopes.
    p = np.zeros((len(rows), 7))
    if len(rows):
        p[:, 4] = np.quantile(values, 0.2, axis=1)
        p[:, 2] = values[:, len(x) // 2] - p[:, 4]
    p[:, 3] = width
    parts = [_least_squares(p[n : n + _AT_ONCE], values[n : n + _AT_ONCE], x, y) for n in range(0, len(p), _AT_ONCE)]
    left = np.zeros_like(values)
    whole = np.zeros((len(p), 7, 7))
    if parts:
        p, normal, left = (np.concatenate(part) for part in zip(*parts, strict=True))
        whole = np.asarray(np.linalg.inv(normal + FLOOR * np.eye(7)), float)
    scatter = np.sqrt((left**2).sum(axis=1) / (len(x) - 7)) + FLOOR
    covariance = whole[:, :2, :2] * scatter[:, None, None] ** 2
    settled = (
        inside
        & (p[:, 2] > 2.0 * scatter)  # what is left over is less than the spot: no edge, no heap of others
        & (p[:, 3] > 0.5 * width)
        & (p[:, 3] < 2.0 * width)
        & (np.hypot(p[:, 0], p[:, 1]) < max(2.0, 1.5 * width))
        & (covariance[:, 0, 0] > 0.0)
        & (covariance[:, 1, 1] > 0.0)
    )
    place = np.stack([columns + p[:, 0], rows + p[:, 1]], axis=1)
    spots = Spots(place=place, covariance=covariance, amplitude=p[:, 2], sigma=p[:, 3], scatter=scatter)
    return spots, settled


def _least_squares(p: Array, values: Array, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Fit all windows by Levenberg-Marquardt; return parameters, normal matrices and residuals."""
    damping = np.full(len(p), 1e-3)
    left, slope = _residual(p, values, x, y)
    cost = (left**2).sum(axis=1)
    for _ in range(_ROUNDS):
        transposed = slope.transpose(0, 2, 1)
        normal = transposed @ slope
        scaled = normal * (1.0 + damping[:, None, None] * np.eye(7)) + FLOOR * np.eye(7)
        step = np.linalg.solve(scaled, transposed @ left[:, :, None])[:, :, 0]
        tried = p + np.clip(step, -1e6, 1e6)
        tried[:, 3] = np.clip(tried[:, 3], 0.3, 40.0)
        tried[:, :2] = np.clip(tried[:, :2], x.min(), x.max())
        tried_left, tried_slope = _residual(tried, values, x, y)
        tried_cost = (tried_left**2).sum(axis=1)
        better = tried_cost <= cost
        p = np.where(better[:, None], tried, p)
        left = np.where(better[:, None], tried_left, left)
        slope = np.where(better[:, None, None], tried_slope, slope)
        cost = np.where(better, tried_cost, cost)
        damping = np.clip(np.where(better, damping / 5.0, damping * 5.0), 1e-9, 1e9)
        if (np.abs(step[:, :2]) < _SETTLED).all():
            break
    return p, slope.transpose(0, 2, 1) @ slope, left


def _residual(p: Array, values: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Return residuals (n, pixels) and Jacobian (n, pixels, 7)."""
    u, v = x - p[:, :1], y - p[:, 1:2]
    height, sigma = p[:, 2:3], p[:, 3:4]
    bell = np.exp(-0.5 * (u**2 + v**2) / sigma**2)
    left = values - (height * bell + p[:, 4:5] + p[:, 5:6] * x + p[:, 6:7] * y)
    one = np.ones_like(bell)
    slope = np.stack(
        [
            height * bell * u / sigma**2,
            height * bell * v / sigma**2,
            bell,
            height * bell * (u**2 + v**2) / sigma**3,
            one,
            one * x,
            one * y,
        ],
        axis=2,
    )
    return left, slope


def _first_of_each(spots: Spots, width: float) -> NDArray[np.bool_]:
    """Return a mask without fits that reached a better one's place."""
    kept = np.ones(len(spots), bool)
    order = np.argsort(-np.abs(spots.amplitude))
    for rank, one in enumerate(order):
        if kept[one]:
            others = order[rank + 1 :]
            near = np.hypot(*(spots.place[others] - spots.place[one]).T) < width
            kept[others[near]] = False
    return kept


LEAST_HOLES = 60  # holes without which a distortion is not fitted
_NEAR = 0.3  # of the spacing: how far a hole may lie from where its neighbour expects it
_FORGET = 0.5  # how much of a step from hole to hole is taken on to the next


class CalibrationRefusedError(ValueError):
    """A calibration image cannot be used, which ``picture`` shows.

    In its colours, (rows, columns, 3), holes that were used are green, those left out red, residuals yellow lines, ten
    times their length.
    """

    def __init__(self, message: str, picture: NDArray[np.uint8]) -> None:
        super().__init__(message)
        self.picture = picture


@dataclass(frozen=True, kw_only=True, eq=False)
class GridHoles:
    """Holes of a calibration grid."""

    place: Array  # column and row of each hole in the image [px], shape (n, 2)
    index: Indices  # its column and row in the grid, counted from the hole nearest the middle, shape (n, 2)
    covariance: Array  # covariance of the places [px²], shape (n, 2, 2)
    left_out: Array  # places of spots that fit nowhere into the grid [px], shape (m, 2)

    def __len__(self) -> int:
        return len(self.place)


def locate_grid(image: ArrayLike, diameter: float, *, dark: bool | None = None) -> GridHoles:
    """Find the holes of a calibration grid, of a diameter [px].

    Its rows are within 40 degrees of the image's. By default the spots are darker or brighter than the plate, whichever
    gives more holes.

    Raises CalibrationRefusedError if fewer than `LEAST_HOLES` lie on a grid, or they cover less than a quarter of the
    image; ValueError if the image is none.
    """
    grey = checked_image(image, "the image of the grid")
    found = [_indexed(locate_spots(grey, diameter, dark=one)) for one in ((True, False) if dark is None else (dark,))]
    holes = max(found, key=len)
    if len(holes) < LEAST_HOLES:
        seen = len(holes) + len(holes.left_out)
        raise CalibrationRefusedError(
            f"{seen} spots of about {diameter:g} px were found, and {len(holes)} of them lie on a square grid; "
            f"{LEAST_HOLES} are needed. Is the diameter that of a hole in this image, and is the plate all in view?",
            residual_picture(grey, holes),
        )
    covered = float(np.prod(np.ptp(holes.place, axis=0)) / (grey.shape[0] * grey.shape[1]))
    if covered < 0.25:
        raise CalibrationRefusedError(
            f"the grid covers {covered:.0%} of the image; beyond it the distortion would be guessed. "
            "Use a plate that fills the view.",
            residual_picture(grey, holes),
        )
    return holes


def _indexed(spots: Spots) -> GridHoles:
    """Index spots by grid column and row, hole by hole."""
    place = spots.place
    index = np.zeros((len(place), 2), np.int64)
    reached = np.zeros(len(place), bool)
    if len(place) >= 9:
        tree = cKDTree(place)
        spacing = float(np.median(np.asarray(tree.query(place, k=2)[0])[:, 1]))
        middle = np.median(place, axis=0)
        for start in np.argsort(np.hypot(*(place - middle).T))[:20]:
            steps = _first_steps(place, tree, int(start), spacing)
            if steps is None:
                continue
            tried_index, tried = _spread(place, tree, int(start), steps)
            if tried.sum() > reached.sum():
                index, reached = tried_index, tried
            if reached.mean() > 0.5:
                break
    return GridHoles(
        place=place[reached], index=index[reached], covariance=spots.covariance[reached], left_out=place[~reached]
    )


def _first_steps(place: Array, tree: cKDTree, start: int, spacing: float) -> Array | None:
    """Return steps to the next column and row, (2, 2), or None."""
    near = [other for other in tree.query_ball_point(place[start], 1.3 * spacing) if other != start]
    steps = place[near] - place[start]
    if len(steps) < 2:
        return None
    chosen = np.stack([steps[np.argmax(steps @ axis / np.hypot(*steps.T))] for axis in np.eye(2)])
    lengths = np.hypot(*chosen.T)
    across = abs(float(np.linalg.det(chosen))) / float(lengths.prod())
    return chosen if across > 0.8 and chosen[0, 0] > 0.0 and chosen[1, 1] > 0.0 else None


def _spread(place: Array, tree: cKDTree, start: int, steps: Array) -> tuple[Indices, NDArray[np.bool_]]:
    index = np.zeros((len(place), 2), np.int64)
    reached = np.zeros(len(place), bool)
    reached[start] = True
    taken = {(0, 0)}
    waiting = deque([(start, steps)])
    while waiting:
        hole, own = waiting.popleft()
        for axis in (0, 1):
            for sign in (1, -1):
                step = sign * own[axis]
                distance, other = tree.query(place[hole] + step)
                cell = index[hole].copy()
                cell[axis] += sign
                key = (int(cell[0]), int(cell[1]))
                if reached[other] or key in taken or distance > _NEAR * float(np.hypot(*step)):
                    continue
                reached[other] = True
                taken.add(key)
                index[other] = cell
                learnt = own.copy()
                learnt[axis] += _FORGET * (sign * (place[other] - place[hole]) - own[axis])
                waiting.append((int(other), learnt))
    return index, reached


def residual_picture(image: Array, holes: GridHoles, residual: Array | None = None) -> NDArray[np.uint8]:
    """Draw holes and residuals [px] as `CalibrationRefusedError` describes it."""
    low, high = float(image.min()), float(image.max())
    grey = ((image - low) * (160.0 / max(high - low, 1e-9))).astype(np.uint8)
    picture = np.repeat(grey[:, :, None], 3, axis=2)

    def paint(points: Array, colour: tuple[int, int, int], radius: int) -> None:
        column, row = np.round(points).astype(int).T if len(points) else np.zeros((2, 0), int)
        for across in range(-radius, radius + 1):
            for down in range(-radius, radius + 1):
                u, v = column + across, row + down
                inside = (u >= 0) & (u < image.shape[1]) & (v >= 0) & (v < image.shape[0])
                picture[v[inside], u[inside]] = colour

    paint(holes.place, (0, 200, 0), 1)
    paint(holes.left_out, (230, 0, 0), 1)
    if residual is not None and len(residual):
        for part in np.linspace(0.0, 10.0, 41):
            paint(holes.place + part * residual, (255, 220, 0), 0)
    return picture
