"""Calibration of C-arm images (thesis, section 7.2), and its file.

It consists of pixels, interlace, distortion and geometry of views. The distortion of an image intensifier leads from
places in its image to those of an ideal one, and is chosen by cross-validation.

These places are in square pixels: the pixel's aspect is corrected before. A grid tells a
distortion up to its scale; here the scale is that of the centre, as in the thesis's section 7.2.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from cutenv._base.arrays import Array
from cutenv._base.output import atomic_write
from cutenv._base.validation import in_range, one_of
from cutenv.vision.projection import fit_projection
from cutenv.vision.spots import CalibrationRefusedError, GridHoles, checked_image, locate_grid, residual_picture

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

    Raises ValueError if the model is not known, or has another number of coefficients, or a number is not finite.
    """

    model: str  # one of `DISTORTION_MODELS`
    centre: tuple[float, float]  # centre of the distortion [square px]
    scale: float  # radius that counts as 1 in polynomials [px]; 1 in the thesis's quadratics
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
        """Return undistorted image points, shape (n, 2) [square px]."""
        q = (np.asarray(points, float).reshape(-1, 2) - self.centre) / self.scale
        numbers = np.asarray(self.coefficients)
        return np.asarray(self.centre) + self.scale * _undistorted(self.model, q, numbers)

    def error(self, radius: ArrayLike) -> Array:
        """Return the radial error over true radius [px] (thesis, Figure 7.4).

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
    """Return the nonlinear powers of column and row."""
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
    """Return the matrix from coefficients to shifts, (2 n, coefficients)."""
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
    """A distortion with the grid that it was fitted to."""

    distortion: Distortion
    spacing: float  # spacing of the grid at the centre [square px]
    residual: Array  # undistorted hole minus its place in an ideal grid [square px], shape (n, 2)
    cross_validated: dict[str, float]  # RMS residual of holes that were left out of the fit, by model [px]

    @property
    def rms(self) -> float:
        """Root mean square distance of holes from the ideal grid [px]."""
        return float(np.sqrt((self.residual**2).sum(axis=1).mean()))


def fit_distortion(
    place: ArrayLike, index: ArrayLike, model: str | None = None, *, models: Sequence[str] | None = None, seed: int = 0
) -> FittedDistortion:
    """Fit a distortion to the holes of a square grid.

    ``place`` are those in the image [square px], ``index`` columns and rows in the grid, (n, 2) each. The model is by
    default that of ``models``, all but the thesis's error that is not zero at the centre, which best predicts holes
    left out (five folds, divided by the seed).

    Raises ValueError if there are too few holes for the model, or they lie on one line.
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
    """Return cells' ideal places on a grid.

    The grid is (step across, step down, first column, first row).
    """
    c, s, u, v = grid
    return np.stack([c * cells[:, 0] - s * cells[:, 1] + u, s * cells[:, 0] + c * cells[:, 1] + v], axis=1)


def _residuals(found: Distortion, grid: Array, points: Array, cells: Array) -> Array:
    return found.undistort(points) - _on_grid(grid, cells)


def _grid_rows(cells: Array) -> Array:
    """Return the matrix from a grid to ideal places, (2 n, 4)."""
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
    """Return the least-squares parameters, of order 1 or less."""

    def shifted(q: Array) -> Array:
        return left(start + q - 1.0)  # steps of the derivative are shares of q, so it must not begin at 0

    found = least_squares(shifted, np.ones(len(start)), method="lm", max_nfev=400)
    return np.asarray(start + found.x - 1.0)


def _linear(points: Array, rows: Array, model: str, centre: Array, size: float) -> tuple[Array, Array, Array]:
    """Return coefficients, grid [px] and scaled residuals for a centre."""
    q = (points - centre) / size
    matrix = np.hstack([rows, -_basis(model, q)])
    solved = np.linalg.lstsq(matrix, q.ravel(), rcond=None)[0]
    grid = size * solved[:4] + np.array([0.0, 0.0, *centre])
    return np.asarray(solved[4:]), grid, np.asarray(q.ravel() - matrix @ solved)


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _central_spacing(points: Array, cells: Array, middle: Array) -> float:
    """Return the spacing of the 21 central holes [px]."""
    near = np.argsort(np.hypot(*(points - middle).T))[:21]
    grid = np.linalg.lstsq(_grid_rows(cells[near]), points[near].ravel(), rcond=None)[0]
    return float(np.hypot(grid[0], grid[1]))


CARM_SCHEMA = "cutenv.carm/1"  # name and version of the calibration file
NTSC_ASPECT = 10.0 / 11.0
"""Width of a pixel over its height in NTSC video of 720 x 480 [1]; the thesis does not mention it."""
NTSC_RATE = 30000.0 / 1001.0  # frames a second of NTSC video, printed as 29.97 [1/s]
LARGEST_GRID_RESIDUAL = 0.5  # RMS residual of the grid above which a calibration is refused [px]


_ROUNDS, _SETTLED = 60, 1e-3  # of finding where a place is seen [px]


@dataclass(frozen=True, kw_only=True, eq=False)
class CArmView:
    """One X-ray view.

    It leads from pixels of its frames to undistorted square pixels, and from space to these.
    """

    name: str  # name of the view, such as "top"
    shape: tuple[int, int]  # rows and columns of a frame
    aspect: float  # width of a pixel over its height [1]
    distortion: Distortion  # distortion, in square pixels
    projection: Array | None = None  # (3, 4), from the frame of the calibration [m] to undistorted square pixels
    # what the calibration left over: ``grid_px``, ``phantom_px``, and others
    residuals: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        in_range("aspect", self.aspect, 0.2, 5.0, "1", "NTSC has 10/11.")
        if self.projection is None:
            return
        matrix = np.array(self.projection, float)
        if matrix.shape != (3, 4) or not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix) < 3:
            raise ValueError(f"the projection of view {self.name!r} is not a finite 3 x 4 matrix of rank 3.")
        matrix.setflags(write=False)
        object.__setattr__(self, "projection", matrix)

    def undistort(self, points: ArrayLike) -> Array:
        """Return undistorted frame points, shape (n, 2) [square px]."""
        return self.distortion.undistort(np.asarray(points, float).reshape(-1, 2) * (self.aspect, 1.0))

    def seen(self, ideal: Array) -> Array:
        """Return frame points [px] of undistorted places, (n, 2) [square px]."""
        square = ideal.copy()
        for _ in range(_ROUNDS):
            left = ideal - self.distortion.undistort(square)
            square = square + left
            if not np.abs(left).max(initial=0.0) > _SETTLED:
                break
        return np.asarray(square / (self.aspect, 1.0))

    def undistorted_with_covariance(self, points: Array, covariance: Array) -> tuple[Array, Array]:
        """Return undistorted places and their covariances, (n, 2) and (n, 2, 2)."""
        step = 0.25
        slope = np.stack(
            [(self.undistort(points + e) - self.undistort(points - e)) / (2.0 * step) for e in step * np.eye(2)], axis=2
        )
        return self.undistort(points), slope @ covariance @ slope.transpose(0, 2, 1)

    def checked(self, frame: ArrayLike) -> Array:
        """Return a frame as float64; ValueError if invalid or another camera's."""
        grey = checked_image(frame, f"a frame of view {self.name!r}")
        if grey.shape != self.shape:
            raise ValueError(
                f"a frame of view {self.name!r} has {grey.shape[0]} x {grey.shape[1]} pixels, its calibration "
                f"{self.shape[0]} x {self.shape[1]}: it is of another camera, or turned."
            )
        return grey

    def with_projection(self, points: ArrayLike, pixels: ArrayLike) -> CArmView:
        """Return this view with its geometry found from a phantom.

        The known places [m], 8 or more and not in one plane, are seen at these pixels of a frame.
        """
        projection, residual = fit_projection(points, self.undistort(pixels))
        rms = float(np.sqrt((residual**2).sum(axis=1).mean()))
        return replace(self, projection=projection, residuals={**self.residuals, "phantom_px": rms})


def calibrate_view(
    image: ArrayLike,
    hole_diameter: float,
    *,
    name: str,
    aspect: float = NTSC_ASPECT,
    model: str | None = None,
    dark: bool | None = None,
    largest_residual: float = LARGEST_GRID_RESIDUAL,
) -> tuple[CArmView, FittedDistortion, GridHoles]:
    """Find a view's distortion from a calibration grid's image.

    A hole's diameter and the largest residual are in pixels of it, ``aspect`` is a pixel's width over its height. By
    default the model is chosen by cross-validation (`cutenv.vision.fluoroscopy`), and whether holes are darker than the
    plate is found.

    Return the view, to which `CArmView.with_projection` gives a geometry, the fit with its residuals, and the holes.

    Raises CalibrationRefusedError if holes are too few or residuals too large; its picture shows where.
    """
    grey = checked_image(image, "the image of the grid")
    holes = locate_grid(grey, hole_diameter, dark=dark)
    square = np.array([in_range("aspect", aspect, 0.2, 5.0, "1", "NTSC has 10/11."), 1.0])
    fitted = fit_distortion(holes.place * square, holes.index, model)
    if not fitted.rms <= largest_residual:
        raise CalibrationRefusedError(
            f"holes are {fitted.rms:.2f} px off a square grid after {fitted.distortion.model!r}, more than "
            f"{largest_residual:g} px. Is the pixels' aspect {aspect:.3f}, the plate flat on the detector, and the "
            "image whole?",
            residual_picture(grey, holes, fitted.residual / square),
        )
    view = CArmView(
        name=name,
        shape=(grey.shape[0], grey.shape[1]),
        aspect=aspect,
        distortion=fitted.distortion,
        residuals={
            "grid_px": fitted.rms,
            "grid_holes": len(holes),
            "cross_validated_px": min(fitted.cross_validated.values()),
        },
    )
    return view, fitted, holes


def length_per_pixel(image: ArrayLike, view: CArmView, hole_diameter: float, spacing: float) -> float:
    """Return the undistorted pixel size at a plate, for `fit_magnification`.

    The plate is parallel to the detector, at any distance from it; the spacing of its holes is in any unit of length,
    their diameter in pixels.
    """
    holes = locate_grid(view.checked(image), hole_diameter)
    square = view.undistort(holes.place)
    step, *_ = np.linalg.lstsq(holes.index - holes.index.mean(axis=0), square - square.mean(axis=0), rcond=None)
    return float(spacing / math.sqrt(abs(np.linalg.det(step))))


@dataclass(frozen=True, kw_only=True, eq=False)
class CArmCalibration:
    """Calibration of the X-ray views of one session."""

    views: Sequence[CArmView]  # two views or more, with different names
    frame_rate: float = NTSC_RATE  # frames a second of both [1/s]
    interlaced: str | None = None  # field of a frame that was taken first, top or bottom; None: frames are whole

    def __post_init__(self) -> None:
        in_range("frame_rate", self.frame_rate, 0.1, 1e5, "1/s", "NTSC has 29.97.")
        one_of("interlaced", self.interlaced, (None, "top", "bottom"))
        names = [view.name for view in self.views]
        if len(names) < 2 or len(set(names)) < len(names):
            raise ValueError(f"a calibration has two views or more of different names, not {names}.")
        if any(view.projection is None for view in self.views):
            raise ValueError("a view has no geometry: image a phantom of known points, and use `with_projection`.")
        object.__setattr__(self, "views", tuple(self.views))

    @property
    def projections(self) -> list[Array]:
        """Projection matrices of the views."""
        return [view.projection for view in self.views if view.projection is not None]

    def save(self, path: Path | str) -> None:
        """Write the calibration as JSON."""
        views = [
            {**asdict(view), "projection": matrix.tolist()}
            for view, matrix in zip(self.views, self.projections, strict=True)
        ]
        whole = {
            "schema": CARM_SCHEMA,
            "frame_rate_Hz": self.frame_rate,
            "interlaced": self.interlaced,
            "views": views,
        }
        with atomic_write(Path(path)) as part:
            part.write_text(json.dumps(whole, indent=1), encoding="utf-8")

    @classmethod
    def load(cls, path: Path | str) -> CArmCalibration:
        """Read a calibration.

        Raises ValueError if the file is damaged or another, with what is wrong.
        """
        try:
            told = json.loads(Path(path).read_text(encoding="utf-8"))
            if not isinstance(told, dict) or told.get("schema") != CARM_SCHEMA:
                raise ValueError(f"its schema is not {CARM_SCHEMA!r}")
            return cls(
                views=[_view(each) for each in told["views"]],
                frame_rate=_number(told["frame_rate_Hz"]),
                interlaced=told["interlaced"],
            )
        except (KeyError, IndexError) as error:
            raise ValueError(f"{path} is no calibration of C-arms: {error} is missing.") from None
        except (ValueError, TypeError, RecursionError) as error:
            raise ValueError(f"{path} is no calibration of C-arms, or it is damaged: {error}") from None


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(f"{value!r} is not a finite number")
    return float(value)


def _view(told: Mapping[str, Any]) -> CArmView:
    distortion = told["distortion"]
    rows, columns = (int(_number(each)) for each in told["shape"])
    if min(rows, columns) < 16:
        raise ValueError(f"frames of {rows} x {columns} pixels")
    return CArmView(
        name=str(told["name"]),
        shape=(rows, columns),
        aspect=_number(told["aspect"]),
        distortion=Distortion(
            model=distortion["model"],
            centre=(_number(distortion["centre"][0]), _number(distortion["centre"][1])),
            scale=_number(distortion["scale"]),
            coefficients=tuple(_number(each) for each in distortion["coefficients"]),
        ),
        projection=np.array([[_number(each) for each in row] for row in told["projection"]]),
        residuals={str(name): _number(value) for name, value in dict(told.get("residuals", {})).items()},
    )


def deinterlaced(frame: ArrayLike, first: str) -> tuple[Array, Array]:
    """Return both fields of an interlaced frame in time order.

    They are whole images, a quarter of a frame before and after the frame's middle. ``first`` is "top" if the first
    line belongs to the earlier field; DV video has the bottom field first.
    """
    grey = checked_image(frame, "the frame")
    one_of("first", first, ("top", "bottom"))
    start = 0 if first == "top" else 1
    return _field(grey, start), _field(grey, 1 - start)


def _field(grey: Array, start: int) -> Array:
    """Return one field with its missing lines interpolated cubically."""
    lines = grey[start::2]
    padded = np.concatenate([lines[:1], lines[:1], lines, lines[-1:], lines[-1:]])
    between = (9.0 * (padded[1:-1][:-1] + padded[1:-1][1:]) - padded[:-3] - padded[3:]) / 16.0
    whole = np.empty_like(grey)
    whole[start::2] = lines
    missing = whole[1 - start :: 2]
    begin = 1 if start == 0 else 0
    missing[:] = between[begin : begin + len(missing)]
    return whole
