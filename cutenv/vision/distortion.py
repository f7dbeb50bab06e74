"""Distortion of an image intensifier: from places in its image to those of an ideal one, chosen by cross-validation.

Places are in square pixels: the pixel's aspect is corrected before (`cutenv.vision.fluoroscopy`). A grid tells a
distortion up to its scale; here the scale is that of the centre, as in the thesis's section 7.2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from cutenv._base.arrays import Array
from cutenv._base.validation import one_of

DISTORTION_MODELS = (
    "radial_quadratic_printed",
    "radial_quadratic",
    "polynomial3",
    "polynomial4",
    "polynomial5",
    "radial_swirl",
)
"""The thesis's error y = a x² + b x + c over the radius x; the same with c = 0; polynomials in column and row; a radial
polynomial with a turn that grows outward, the S-shape of the earth's field."""
THESIS_ERROR = {"top": (8e-5, -0.0079, 0.4729), "side": (6e-4, -0.0706, 1.6171)}
"""a [1/px], b [1], c [px] of the thesis's equations (7.1) and (7.2)."""
_SWIRL_POWERS = 5  # of the radius in "radial_swirl", each with a stretch and a turn
_FOLDS = 5


@dataclass(frozen=True, kw_only=True)
class Distortion:
    """Distortion of one view.

    Parameters
    ----------
    model : str
        One of `DISTORTION_MODELS`.
    centre : tuple of float
        Centre of the distortion [square px].
    scale : float
        Radius that counts as 1 in polynomials [px]; 1 in the thesis's quadratics.
    coefficients : tuple of float
        Numbers of the model.

    Raises
    ------
    ValueError
        If the model is not known, or has another number of coefficients, or a number is not finite.
    """

    model: str
    centre: tuple[float, float]
    scale: float
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        one_of("model of the distortion", self.model, DISTORTION_MODELS)
        needed = _size(self.model)
        if len(self.coefficients) != needed or len(self.centre) != 2:
            raise ValueError(
                f"the distortion {self.model!r} has {needed} coefficients and 2 coordinates of its centre; "
                f"{len(self.coefficients)} and {len(self.centre)} are given."
            )
        if not np.isfinite([*self.coefficients, *self.centre, self.scale]).all() or self.scale <= 0.0:
            raise ValueError("coefficients, centre and scale of a distortion are finite numbers, the scale above 0.")

    def undistort(self, points: ArrayLike) -> Array:
        """Return where points of the image would be without distortion, shape (n, 2) [square px]."""
        q = (np.asarray(points, float).reshape(-1, 2) - self.centre) / self.scale
        numbers = np.asarray(self.coefficients)
        return np.asarray(self.centre) + self.scale * _undistorted(self.model, q, numbers)

    def error(self, radius: ArrayLike) -> Array:
        """Return the radial error y over the true radius x [px], as the thesis plots it (Figure 7.4).

        For the polynomials in column and row it is the mean over eight directions.
        """
        true = np.atleast_1d(np.asarray(radius, float))
        seen = np.linspace(0.0, 3.0 * float(true.max()) + 10.0, 3000)
        turn = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
        rays = seen[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        ideal = self.undistort(np.asarray(self.centre) + rays) - self.centre
        mean = np.hypot(*ideal.T).reshape(len(seen), -1).mean(axis=1)
        until = len(mean) if (np.diff(mean) >= 0.0).all() else int(np.argmax(np.diff(mean) < 0.0)) + 1
        return np.asarray(np.interp(true, mean[:until], seen[:until]) - true)


def _size(model: str) -> int:
    if model.startswith("radial_quadratic"):
        return 3
    return 2 * (_SWIRL_POWERS if model == "radial_swirl" else len(_powers(model)))


def _powers(model: str) -> list[tuple[int, int]]:
    """Return the powers of column and row beyond the linear ones, which are scale, turn and shift of the grid."""
    return [(total - row, row) for total in range(2, int(model[-1]) + 1) for row in range(total + 1)]


def _undistorted(model: str, q: Array, numbers: Array) -> Array:
    """Undistort places about the centre, over the scale, shape (n, 2)."""
    r = np.hypot(q[:, 0], q[:, 1])
    if model.startswith("radial_quadratic"):
        a, b, c = numbers
        # Seen radius = r + a r² + b r + c, solved for r in the form that stays finite for a = 0.
        linear, seen = 1.0 + b, np.maximum(r - c, 0.0)
        root = np.sqrt(np.maximum(linear**2 + 4.0 * a * seen, 1e-12))
        true = 2.0 * seen / (linear + root)
        return np.asarray(q * (true / np.maximum(r, 1e-12))[:, None])
    return np.asarray(q + (_basis(model, q) @ numbers).reshape(-1, 2))


def _basis(model: str, q: Array) -> Array:
    """Return the matrix from coefficients to shifts, column and row in turn, shape (2 n, coefficients)."""
    if model == "radial_swirl":
        powers = np.hypot(q[:, 0], q[:, 1])[:, None] ** np.arange(1, _SWIRL_POWERS + 1)
        turned = np.stack([-q[:, 1], q[:, 0]], axis=1)
        return np.concatenate([power[:, :, None] * powers[:, None, :] for power in (q, turned)], axis=2).reshape(
            2 * len(q), -1
        )
    monomials = np.stack([q[:, 0] ** m * q[:, 1] ** n for m, n in _powers(model)], axis=1)
    return np.asarray(np.kron(monomials, np.eye(2)))


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedDistortion:
    """A distortion with the grid that it was fitted to.

    Parameters
    ----------
    distortion : Distortion
        The distortion.
    spacing : float
        Spacing of the grid at the centre [square px].
    residual : ndarray, shape (n, 2)
        Undistorted hole minus its place in an ideal grid [square px].
    cross_validated : dict
        RMS residual of holes that were left out of the fit, by model [px].
    """

    distortion: Distortion
    spacing: float
    residual: Array
    cross_validated: dict[str, float]

    @property
    def rms(self) -> float:
        """Root of the mean squared distance between holes and ideal grid [px]."""
        return float(np.sqrt((self.residual**2).sum(axis=1).mean()))


def fit_distortion(
    place: ArrayLike, index: ArrayLike, model: str | None = None, *, models: Sequence[str] | None = None, seed: int = 0
) -> FittedDistortion:
    """Fit a distortion to the holes of a square grid.

    Parameters
    ----------
    place : array_like, shape (n, 2)
        Places of the holes in the image [square px].
    index : array_like of int, shape (n, 2)
        Columns and rows of the holes in the grid.
    model : str, optional
        One of `DISTORTION_MODELS`. By default that of `models` which best predicts holes left out (five folds).
    models : sequence of str, optional
        Candidates; by default all but the thesis's error that is not zero at the centre.
    seed : int
        Seed of the division into folds.

    Raises
    ------
    ValueError
        If there are too few holes for the model, or they lie on one line.
    """
    points, cells = np.asarray(place, float), np.asarray(index, float)
    if points.shape != cells.shape or points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"place has shape {points.shape} and index {cells.shape}: give (n, 2) of both.")
    candidates = list(models or DISTORTION_MODELS[1:]) if model is None else [model]
    for name in candidates:
        one_of("model of the distortion", name, DISTORTION_MODELS)
    needed = max(_size(name) for name in candidates) + 6
    if len(points) < needed or min(len(np.unique(cells[:, 0])), len(np.unique(cells[:, 1]))) < 4:
        raise ValueError(f"{len(points)} holes are too few for {', '.join(candidates)}: {needed} in 4 rows are needed.")
    fold = np.random.default_rng(seed).permutation(len(points)) % _FOLDS
    left_out: dict[str, float] = {}
    for name in candidates:
        squares = 0.0
        for one in range(_FOLDS):
            found, grid = _fit(points[fold != one], cells[fold != one], name)
            squares += float((_residuals(found, grid, points[fold == one], cells[fold == one]) ** 2).sum())
        left_out[name] = float(np.sqrt(squares / len(points)))
    best = min(left_out, key=lambda name: left_out[name])
    found, grid = _fit(points, cells, best)
    return FittedDistortion(
        distortion=found,
        spacing=float(np.hypot(grid[0], grid[1])),
        residual=_residuals(found, grid, points, cells),
        cross_validated=left_out,
    )


def _on_grid(grid: Array, cells: Array) -> Array:
    """Return the ideal places of cells; the grid is (step across, step down, first column, first row)."""
    c, s, u, v = grid
    return np.stack([c * cells[:, 0] - s * cells[:, 1] + u, s * cells[:, 0] + c * cells[:, 1] + v], axis=1)


def _residuals(found: Distortion, grid: Array, points: Array, cells: Array) -> Array:
    return found.undistort(points) - _on_grid(grid, cells)


def _grid_rows(cells: Array) -> Array:
    """Return the matrix from (step across, step down, first column, first row) to ideal places, shape (2 n, 4)."""
    one, none = np.ones(len(cells)), np.zeros(len(cells))
    column = np.stack([cells[:, 0], -cells[:, 1], one, none], axis=1)
    row = np.stack([cells[:, 1], cells[:, 0], none, one], axis=1)
    return np.stack([column, row], axis=1).reshape(-1, 4)


def _fit(points: Array, cells: Array, model: str) -> tuple[Distortion, Array]:
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    size = float(np.hypot(*(points - middle).T).max())
    rows = _grid_rows(cells)
    if not model.startswith("radial_quadratic"):
        # Everything but the centre is linear, and polynomials in column and row need none.
        centre = middle
        if model == "radial_swirl":

            def beside(shift: Array) -> Array:
                return _linear(points, rows, model, middle + size * shift, size)[2]

            found = least_squares(beside, np.zeros(2), max_nfev=30)
            centre = middle + size * np.clip(found.x, -1.0, 1.0)
        numbers, grid, _ = _linear(points, rows, model, centre, size)
        return Distortion(model=model, centre=_pair(centre), scale=size, coefficients=tuple(numbers.tolist())), grid
    # The thesis takes the spacing at the centre for the true one; without it b and the grid's scale are one number.
    true = _central_spacing(points, cells, middle)
    start = np.linalg.lstsq(rows, points.ravel(), rcond=None)[0]
    turn = float(np.arctan2(start[1], start[0]))

    printed = model.endswith("printed")

    def unpacked(p: Array) -> tuple[Distortion, Array]:
        numbers = (p[3] / size, p[4], size * p[5] if printed else 0.0)
        centre = middle + size * p[-2:]
        grid = np.array([true * np.cos(p[2]), true * np.sin(p[2]), *(middle + size * p[:2])])
        return Distortion(model=model, centre=_pair(centre), scale=1.0, coefficients=numbers), grid

    def left(p: Array) -> Array:
        return _residuals(*unpacked(p), points, cells).ravel()

    first = np.concatenate([(start[2:] - middle) / size, [turn], np.zeros(2 + printed)])

    def about(p: Array) -> Array:
        return left(np.concatenate([p, np.zeros(2)]))

    # First about the middle of the grid: a free centre beside no distortion runs away.
    held = _minimised(about, first)
    return unpacked(_minimised(left, np.concatenate([held, np.zeros(2)])))


def _minimised(left: Callable[[Array], Array], start: Array) -> Array:
    """Return the parameters, of order 1 or less, with the least sum of squares."""

    def shifted(q: Array) -> Array:
        return left(start + q - 1.0)  # steps of the derivative are shares of q, so it must not begin at 0

    found = least_squares(shifted, np.ones(len(start)), method="lm", max_nfev=400)
    return np.asarray(start + found.x - 1.0)


def _linear(points: Array, rows: Array, model: str, centre: Array, size: float) -> tuple[Array, Array, Array]:
    """Return coefficients, grid [px] and what is left over, over the size, for a given centre."""
    q = (points - centre) / size
    matrix = np.hstack([rows, -_basis(model, q)])
    solved = np.linalg.lstsq(matrix, q.ravel(), rcond=None)[0]
    grid = size * solved[:4] + np.array([0.0, 0.0, *centre])
    return np.asarray(solved[4:]), grid, np.asarray(q.ravel() - matrix @ solved)


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _central_spacing(points: Array, cells: Array, middle: Array) -> float:
    """Return the spacing of the 21 holes nearest the middle, from a grid fitted to them [px]."""
    near = np.argsort(np.hypot(*(points - middle).T))[:21]
    grid = np.linalg.lstsq(_grid_rows(cells[near]), points[near].ravel(), rcond=None)[0]
    return float(np.hypot(grid[0], grid[1]))
