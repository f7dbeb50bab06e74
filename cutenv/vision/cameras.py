"""Calibrated cameras: their lenses, a pair's geometry, the plane of the cut; and the file that holds them."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv._base.output import atomic_write
from cutenv._base.validation import array_in_range, in_range

GreyImage = NDArray[np.uint8]
"""Grey values, shape (height, width)."""
CAMERAS_SCHEMA = "cutenv-cameras/1"
"""Name and version of the file."""
_COEFFICIENTS = 5  # Brown and Conrady: k1, k2, p1, p2, k3


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """One camera with its lens.

    Parameters
    ----------
    width, height : int
        Size of its images [px].
    matrix : array, shape (3, 3)
        Focal lengths and principal point [px].
    distortion : array, shape (5,)
        Coefficients k1, k2, p1, p2, k3 of Brown and Conrady, as OpenCV has them.
    residual : float
        Root mean square distance of the board's points from where the model puts them [px].
    boards : int
        Number of images of the board from which it was calibrated.
    """

    width: int
    height: int
    matrix: Array
    distortion: Array
    residual: float
    boards: int

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            if not isinstance(getattr(self, name), int) or not 16 <= getattr(self, name) <= 20000:
                raise ValueError(f"{name} = {getattr(self, name)!r} is no size of an image: 16 to 20000 px.")
        _shaped(self, "matrix", (3, 3), 1e6)
        _shaped(self, "distortion", (_COEFFICIENTS,), 1e4)
        if min(self.matrix[0, 0], self.matrix[1, 1]) <= 1.0 or tuple(self.matrix[2]) != (0.0, 0.0, 1.0):
            raise ValueError("matrix is no camera matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]].")
        in_range("residual", self.residual, 0.0, 1e3, "px")

    def ideal(self, pixels: Array) -> Array:
        """Return the directions of pixels, shape (n, 2): x/z and y/z in the camera's frame, the distortion removed."""
        found = cv2.undistortPoints(np.asarray(pixels, np.float64).reshape(-1, 1, 2), self.matrix, self.distortion)
        return np.asarray(found, np.float64).reshape(-1, 2)

    def pixels(self, points: Array) -> Array:
        """Return the pixels, shape (n, 2), of points in the camera's frame, shape (n, 3) [m]."""
        k1, k2, p1, p2, k3 = (
            self.distortion
        )  # by hand: OpenCV's projectPoints, with its derivatives, is ten times slower
        x, y, z = np.asarray(points, np.float64).T
        x, y = x / z, y / z
        r2, xy = x * x + y * y, 2.0 * x * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        seen = np.stack([
            x * radial + p1 * xy + p2 * (r2 + 2.0 * x * x), y * radial + p2 * xy + p1 * (r2 + 2.0 * y * y)
        ])  # fmt: skip
        return np.asarray(seen.T @ self.matrix[:2, :2].T + self.matrix[:2, 2])


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose:
    """Rotation, shape (3, 3), and translation, shape (3,) [m]: a point p there is at ``rotation @ p + translation``.

    ``residual`` tells how well it was measured, as :attr:`Camera.residual` [px].
    """

    rotation: Array
    translation: Array
    residual: float

    def __post_init__(self) -> None:
        _shaped(self, "rotation", (3, 3), 1.0 + 1e-6)
        _shaped(self, "translation", (3,), 100.0)
        if not np.allclose(self.rotation @ self.rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(self.rotation) < 0:
            raise ValueError("rotation is no rotation: its columns are not of length 1 and at right angles.")
        in_range("residual", self.residual, 0.0, 1e3, "px")


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedCameras:
    """Calibration of the camera, or of the pair, that films a cut.

    Parameters
    ----------
    cameras : tuple of Camera
        One, or two of the same size: first the left one, whose half of the image is on the left.
    second : Pose, optional
        From the first camera's frame to the second's; needed for two.
    plane : Pose, optional
        From a board that stood in the plane of the cut (its points have z = 0) to the first camera's frame; needed for
        one camera.
    about : mapping
        What else is known, as JSON: the board, residuals by image.

    Raises
    ------
    ValueError
        If neither a second camera nor a plane is there, or the sizes of two cameras differ.
    """

    cameras: tuple[Camera, ...]
    second: Pose | None = None
    plane: Pose | None = None
    about: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.cameras) not in (1, 2) or (len(self.cameras) == 2) != (self.second is not None):
            raise ValueError("cameras must be one, or two with the pose of the second.")
        if self.second is None and self.plane is None:
            raise ValueError("one camera needs the plane of the cut: calibrate with --plane IMAGE.")
        if len({(each.width, each.height) for each in self.cameras}) > 1:
            raise ValueError("the two cameras have images of different sizes.")
        if self.second is not None and not 1e-3 <= np.linalg.norm(self.second.translation) <= 10.0:
            raise ValueError("the two cameras stand less than 1 mm or more than 10 m apart: check the board's spacing.")

    @property
    def frame_size(self) -> tuple[int, int]:
        """Width and height [px] of a frame of the video; two images stand side by side in it."""
        return sum(each.width for each in self.cameras), self.cameras[0].height

    @functools.cached_property
    def rectified(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Rotation (3, 3) and projection (3, 4) of either camera of a pair that make its rows correspond."""
        left, right = self.cameras
        assert self.second is not None
        size, turn, shift = (left.width, left.height), self.second.rotation, self.second.translation.reshape(3, 1)
        first, other, p1, p2 = cv2.stereoRectify(
            left.matrix, left.distortion, right.matrix, right.distortion, size, turn, shift,
            flags=cv2.CALIB_ZERO_DISPARITY, alpha=-1,
        )[:4]  # fmt: skip
        return (np.asarray(first), np.asarray(p1)), (np.asarray(other), np.asarray(p2))

    def save(self, path: Path | str) -> None:
        """Write the file, as a whole or not at all."""
        content = {
            "schema": CAMERAS_SCHEMA,
            "cameras": [_plain(each) for each in self.cameras],
            "second": None if self.second is None else _plain(self.second),
            "plane": None if self.plane is None else _plain(self.plane),
            "about": dict(self.about),
        }
        with atomic_write(Path(path)) as part:
            part.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: Path | str) -> CalibratedCameras:
        """Read the file.

        Raises
        ------
        ValueError
            If it is no such file, or is damaged; names the file and the field.
        """
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
            if not isinstance(content, dict) or content.get("schema") != CAMERAS_SCHEMA:
                raise ValueError(f"its schema is not {CAMERAS_SCHEMA!r}")
            poses = {name: content[name] for name in ("second", "plane")}
            return cls(
                cameras=tuple(Camera(**each) for each in content["cameras"]),
                about=dict(content["about"]),
                **{name: None if pose is None else Pose(**pose) for name, pose in poses.items()},
            )
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError, AttributeError) as error:
            why = f"{error} is missing" if isinstance(error, KeyError) else str(error)
            raise ValueError(
                f"{path} is no calibration of cameras, or it is damaged: {why}. Make it again: cutenv depth --calibrate"
            ) from None


def angle_between(one: Array, other: Array) -> float:
    """Return the angle between two directions [rad], 0 to pi."""
    cosine = float(one @ other) / float(np.linalg.norm(one) * np.linalg.norm(other))
    return math.acos(min(1.0, max(-1.0, cosine)))


def _shaped(owner: object, name: str, shape: tuple[int, ...], largest: float) -> None:
    """Make a field an array of float64, read-only; raise if its shape or a value is wrong."""
    values = array_in_range(name, getattr(owner, name), -largest, largest, "1").copy()
    if values.shape != shape:
        raise ValueError(f"{name} has shape {values.shape}; it must be {shape}.")
    values.setflags(write=False)
    object.__setattr__(owner, name, values)


def _plain(value: Camera | Pose) -> dict[str, Any]:
    return {name: each.tolist() if isinstance(each, np.ndarray) else each for name, each in vars(value).items()}
