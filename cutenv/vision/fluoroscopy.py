"""Calibration of C-arm images (thesis, section 7.2): pixels, interlace, distortion, geometry of views; and its file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array
from cutenv._base.output import atomic_write
from cutenv._base.validation import in_range, one_of
from cutenv.vision.distortion import Distortion, FittedDistortion, fit_distortion
from cutenv.vision.projection import fit_projection
from cutenv.vision.spots import CalibrationRefusedError, GridHoles, checked_image, locate_grid, residual_picture

CARM_SCHEMA = "cutenv.carm/1"
"""Name and version of the calibration file."""
NTSC_ASPECT = 10.0 / 11.0
"""Width of a pixel over its height in NTSC video of 720 x 480 [1]; the thesis does not mention it."""
NTSC_RATE = 30000.0 / 1001.0
"""Frames a second of NTSC video, printed as 29.97 [1/s]."""
LARGEST_GRID_RESIDUAL = 0.5
"""RMS residual of the grid above which a calibration is refused [px]."""


_ROUNDS, _SETTLED = 60, 1e-3  # of finding where a place is seen [px]


@dataclass(frozen=True, kw_only=True, eq=False)
class CArmView:
    """One X-ray view: from pixels of its frames to undistorted square pixels, and from space to these.

    Parameters
    ----------
    name : str
        Name of the view, such as "top".
    shape : tuple of int
        Rows and columns of a frame.
    aspect : float
        Width of a pixel over its height [1].
    distortion : Distortion
        Distortion, in square pixels.
    projection : ndarray, shape (3, 4), optional
        From the frame of the calibration [m] to undistorted square pixels; None before `with_projection`.
    residuals : mapping of str to float
        What the calibration left over: ``grid_px``, ``phantom_px``, and others.
    """

    name: str
    shape: tuple[int, int]
    aspect: float
    distortion: Distortion
    projection: Array | None = None
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
        """Return undistorted places of points of a frame, shape (n, 2) [square px]."""
        return self.distortion.undistort(np.asarray(points, float).reshape(-1, 2) * (self.aspect, 1.0))

    def seen(self, ideal: Array) -> Array:
        """Return the points of a frame [px] at which undistorted places, shape (n, 2) [square px], are seen."""
        square = ideal.copy()
        for _ in range(_ROUNDS):
            left = ideal - self.distortion.undistort(square)
            square = square + left
            if not np.abs(left).max(initial=0.0) > _SETTLED:
                break
        return np.asarray(square / (self.aspect, 1.0))

    def undistorted_with_covariance(self, points: Array, covariance: Array) -> tuple[Array, Array]:
        """Return undistorted places and their covariances, shapes (n, 2) and (n, 2, 2)."""
        step = 0.25
        slope = np.stack(
            [(self.undistort(points + e) - self.undistort(points - e)) / (2.0 * step) for e in step * np.eye(2)], axis=2
        )
        return self.undistort(points), slope @ covariance @ slope.transpose(0, 2, 1)

    def checked(self, frame: ArrayLike) -> Array:
        """Return a frame as float64; ValueError if it is none, or of another camera."""
        grey = checked_image(frame, f"a frame of view {self.name!r}")
        if grey.shape != self.shape:
            raise ValueError(
                f"a frame of view {self.name!r} has {grey.shape[0]} x {grey.shape[1]} pixels, its calibration "
                f"{self.shape[0]} x {self.shape[1]}: it is of another camera, or turned."
            )
        return grey

    def with_projection(self, points: ArrayLike, pixels: ArrayLike) -> CArmView:
        """Return this view with its geometry found from a phantom.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Known places [m], 8 or more, not in one plane.
        pixels : array_like, shape (n, 2)
            Their places in a frame [px].
        """
        projection, residual = fit_projection(points, self.undistort(pixels))
        rms = float(np.sqrt((residual**2).sum(axis=1).mean()))
        return CArmView(
            **{name: getattr(self, name) for name in ("name", "shape", "aspect", "distortion")},
            projection=projection,
            residuals={**self.residuals, "phantom_px": rms},
        )


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
    """Find the distortion of a view from one image of a calibration grid on its detector.

    Parameters
    ----------
    image : array_like, shape (rows, columns)
        Frame with the grid.
    hole_diameter : float
        Diameter of a hole in it [px].
    name : str
        Name of the view.
    aspect : float
        Width of a pixel over its height [1].
    model : str, optional
        Model of the distortion; by default chosen by cross-validation (`cutenv.vision.distortion`).
    dark : bool, optional
        Whether holes are darker than the plate; by default found.
    largest_residual : float
        RMS residual above which the image is refused [px].

    Returns
    -------
    view : CArmView
        Without a geometry; `CArmView.with_projection` gives it one.
    fitted : FittedDistortion
        The fit with its residuals.
    holes : GridHoles
        What was found in the image.

    Raises
    ------
    CalibrationRefusedError
        If holes are too few or residuals too large; its picture shows where.
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
    """Return the length of one undistorted pixel at a grid plate, for `fit_magnification`.

    Parameters
    ----------
    image : array_like, shape (rows, columns)
        Frame with the plate, parallel to the detector, at any distance from it.
    view : CArmView
        The view's calibration.
    hole_diameter : float
        Diameter of a hole in the image [px].
    spacing : float
        Spacing of the holes, in any unit of length.
    """
    holes = locate_grid(view.checked(image), hole_diameter)
    square = view.undistort(holes.place)
    step, *_ = np.linalg.lstsq(holes.index - holes.index.mean(axis=0), square - square.mean(axis=0), rcond=None)
    return float(spacing / math.sqrt(abs(np.linalg.det(step))))


@dataclass(frozen=True, kw_only=True, eq=False)
class CArmCalibration:
    """Calibration of the X-ray views of one session.

    Parameters
    ----------
    views : sequence of CArmView
        Two views or more, with different names.
    frame_rate : float
        Frames a second of both [1/s].
    interlaced : {None, "top", "bottom"}
        Which field of a frame was taken first; None: frames are whole.
    """

    views: Sequence[CArmView]
    frame_rate: float = NTSC_RATE
    interlaced: str | None = None

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

        Raises
        ------
        ValueError
            If the file is damaged or another, with what is wrong.
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
    """Return the two fields of an interlaced frame in order of time, each with its missing lines interpolated.

    Parameters
    ----------
    frame : array_like, shape (rows, columns)
        Frame whose lines were taken alternately, half a frame apart.
    first : {"top", "bottom"}
        Whether the first line belongs to the earlier field; DV video has the bottom field first.

    Returns
    -------
    earlier, later : ndarray, shape (rows, columns)
        Whole images, a quarter of a frame before and after the frame's middle.
    """
    grey = checked_image(frame, "the frame")
    one_of("first", first, ("top", "bottom"))
    start = 0 if first == "top" else 1
    return _field(grey, start), _field(grey, 1 - start)


def _field(grey: Array, start: int) -> Array:
    """Return one field with its missing lines from the four nearest of its own (cubic)."""
    lines = grey[start::2]
    padded = np.concatenate([lines[:1], lines[:1], lines, lines[-1:], lines[-1:]])
    between = (9.0 * (padded[1:-1][:-1] + padded[1:-1][1:]) - padded[:-3] - padded[3:]) / 16.0
    whole = np.empty_like(grey)
    whole[start::2] = lines
    missing = whole[1 - start :: 2]
    begin = 1 if start == 0 else 0
    missing[:] = between[begin : begin + len(missing)]
    return whole
