"""Calibrated cameras, their calibration by a board, and its file.

A calibration holds the lenses, a pair's geometry and the plane of the cut. It is made for one camera or a pair from
images of a board, and refuses too few boards and too large residuals.
"""

from __future__ import annotations

import functools
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, Indices
from cutenv._base.output import atomic_write
from cutenv._base.validation import array_in_range, in_range, one_of

GreyImage = NDArray[np.uint8]  # grey values, shape (height, width)
CAMERAS_SCHEMA = "cutenv-cameras/1"  # name and version of the file
_COEFFICIENTS = 5  # Brown and Conrady: k1, k2, p1, p2, k3


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """One camera with its lens."""

    width: int  # size of its images [px]
    height: int
    matrix: Array  # focal lengths and principal point [px], shape (3, 3)
    distortion: Array  # coefficients k1, k2, p1, p2, k3 of Brown and Conrady, as OpenCV has them, shape (5,)
    residual: float  # root mean square distance of the board's points from where the model puts them [px]
    boards: int  # number of images of the board from which it was calibrated

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
        """Return undistorted directions x/z and y/z of pixels, shape (n, 2)."""
        found = cv2.undistortPoints(np.asarray(pixels, np.float64).reshape(-1, 1, 2), self.matrix, self.distortion)
        return np.asarray(found, np.float64).reshape(-1, 2)

    def pixels(self, points: Array) -> Array:
        """Project points in the camera's frame [m], shape (n, 3), to pixels."""
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
    """Rotation, shape (3, 3), and translation, shape (3,) [m].

    A point p there is at ``rotation @ p + translation``. ``residual`` tells how well it was measured, as
    :attr:`Camera.residual` [px].
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
    """Calibration of the camera or stereo pair for a cut.

    Raises ValueError if neither a second camera nor a plane is there, or the sizes of two cameras differ.
    """

    cameras: tuple[Camera, ...]  # one, or two of the same size, of which the first is on the left of the image
    second: Pose | None = None  # from the first camera's frame to the second's; needed for two
    # from a board that stood in the plane of the cut (its points have z = 0) to the first camera's frame; needed for
    # one camera
    plane: Pose | None = None
    about: Mapping[str, Any] = field(default_factory=dict)  # what else is known, as JSON: the board, residuals by image

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
        """Width and height of a video frame, both images included [px]."""
        return sum(each.width for each in self.cameras), self.cameras[0].height

    @functools.cached_property
    def rectified(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Rectifying rotation (3, 3) and projection (3, 4) of each camera."""
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

        Raises ValueError if it is no such file, or is damaged; names the file and the field.
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
    """Convert a field to read-only float64, checking shape and values."""
    values = array_in_range(name, getattr(owner, name), -largest, largest, "1").copy()
    if values.shape != shape:
        raise ValueError(f"{name} has shape {values.shape}; it must be {shape}.")
    values.setflags(write=False)
    object.__setattr__(owner, name, values)


def _plain(value: Camera | Pose) -> dict[str, Any]:
    return {name: each.tolist() if isinstance(each, np.ndarray) else each for name, each in vars(value).items()}


BOARD_KINDS = ("chessboard", "circles", "charuco")  # boards that are known; circles stand in a square grid
_TAGS = 1000  # of the dictionary of ChArUco boards
_FEWEST_POINTS = 12  # of a ChArUco board, parts of which may be hidden


class BoardPoints(NamedTuple):
    """Points of a board in an image.

    Their numbers on the board, shape (n,), and their places, shape (n, 2) [px].
    """

    number: Indices
    pixels: Array


@dataclass(frozen=True, kw_only=True)
class CalibrationBoard:
    """Flat board with ``columns`` times ``rows`` points, ``spacing`` [m] apart.

    The points are the inner corners of a chessboard, or the centres of circles. In the bright squares of a ChArUco
    board are ArUco tags with sides of ``tag`` [m], of OpenCV's dictionaries 4X4; a part of it may be hidden.
    """

    columns: int
    rows: int
    spacing: float
    kind: str = "chessboard"
    tag: float | None = None

    def __post_init__(self) -> None:
        one_of("kind of board", self.kind, BOARD_KINDS)
        in_range("columns of the board", self.columns, 3, 100, "1")
        in_range("rows of the board", self.rows, 3, 100, "1")
        in_range("spacing of the board", self.spacing, 1e-4, 1.0, "m", "Write it with its unit: 5mm.")
        if (self.kind == "charuco") != (self.tag is not None):
            raise ValueError("tag is the side of a ChArUco board's tags: give it for that kind of board alone.")
        if self.tag is not None:
            in_range("side of the board's tags", self.tag, 0.3 * self.spacing, 0.95 * self.spacing, "m",
                     "A tag stands inside a bright square.")  # fmt: skip
            if (self.columns + 1) * (self.rows + 1) // 2 > _TAGS:
                raise ValueError(f"a ChArUco board has at most {_TAGS} tags: give fewer columns or rows.")

    @classmethod
    def parse(cls, points: str, spacing: float, kind: str = "chessboard", tag: float | None = None) -> CalibrationBoard:
        """Return the board of a text such as ``9x6``, lengths [m]."""
        found = re.fullmatch(r"(\d{1,3})x(\d{1,3})", points.strip())
        if found is None:
            raise ValueError(f"--board {points!r} is not columns x rows of its inner corners or circles; write 9x6.")
        return cls(columns=int(found[1]), rows=int(found[2]), spacing=spacing, kind=kind, tag=tag)

    @property
    def points(self) -> Array:
        """Points of the board, row by row [m], shape (n, 3)."""
        row, column = np.mgrid[: self.rows, : self.columns]
        return self.spacing * np.stack([column.ravel(), row.ravel(), 0 * row.ravel()], axis=1).astype(np.float64)

    def find(self, image: GreyImage) -> BoardPoints | None:
        """Return its points in a grey image.

        It is None if it is not there, or too little of it. Of a ChArUco board those that are seen, of others all.
        """
        size = (self.columns, self.rows)
        if self.kind == "charuco":
            board, detector = _charuco(self)
            pixels, numbers, _, _ = detector.detectBoard(image)
            if numbers is None or len(numbers) < _FEWEST_POINTS or board.checkCharucoCornersCollinear(numbers):
                return None
            return BoardPoints(np.ravel(numbers).astype(np.int64), np.asarray(pixels, np.float64).reshape(-1, 2))
        if self.kind == "circles":
            found, pixels = cv2.findCirclesGrid(image, size, flags=cv2.CALIB_CB_SYMMETRIC_GRID)
        else:
            found, pixels = cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_ACCURACY)
        if not found:
            return None
        return BoardPoints(np.arange(self.columns * self.rows), np.asarray(pixels, np.float64).reshape(-1, 2))


@functools.cache
def _charuco(board: CalibrationBoard) -> tuple[cv2.aruco.CharucoBoard, cv2.aruco.CharucoDetector]:
    assert board.tag is not None
    size = (board.columns + 1, board.rows + 1)
    tags = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_1000)  # the smaller ones are its beginning
    made = cv2.aruco.CharucoBoard(size, board.spacing, board.tag, tags)
    return made, cv2.aruco.CharucoDetector(made)


def read_image(path: Path | str) -> GreyImage:
    """Read an image as grey values, shape (height, width).

    Raises ValueError if the file is no image.
    """
    raw = np.frombuffer(Path(path).read_bytes(), np.uint8)
    try:
        image = cv2.imdecode(raw, cv2.IMREAD_GRAYSCALE) if raw.size else None
    except cv2.error:
        image = None
    if image is None:
        raise ValueError(f"{path} is no image, or it is damaged.")
    return np.asarray(image, np.uint8)


def halves(image: GreyImage) -> tuple[GreyImage, GreyImage]:
    """Return the left and right image of a side-by-side pair."""
    middle = image.shape[1] // 2
    return np.ascontiguousarray(image[:, :middle]), np.ascontiguousarray(image[:, middle : 2 * middle])


FEWEST_BOARDS = 8  # least number of images in which the board has to be found
LARGEST_RESIDUAL = 0.5  # largest root mean square residual of a calibration [px]
LARGEST_IMAGE_RESIDUAL = 1.0  # largest root mean square residual of a single image [px]
_FEWEST_SHARED = 12  # points that both cameras of a pair see in an image
_LEAST_TILT_DEG = 15.0  # between the first board and the one that faces another way most
_FOCAL_SD = 0.01  # largest standard error of the focal length, relative: boards that are all alike do not determine it


def calibrate_cameras(
    images: Iterable[tuple[str, GreyImage]],
    board: CalibrationBoard,
    *,
    stereo: bool = False,
    plane: tuple[str, GreyImage] | None = None,
) -> CalibratedCameras:
    """Calibrate one camera, or a pair, from images of a board.

    The board is tilted another way in each, an image by its name; of a pair, ``stereo``, both images stand side by
    side. In that of the ``plane``, which may be one of the others, the board stands in the plane of the cut; one camera
    needs it.

    Raises ValueError if the board is found in fewer than :data:`FEWEST_BOARDS` images, the sizes differ, a residual is
    too large (names the image), or the boards are too much alike to determine the focal length.
    """
    found: dict[str, tuple[BoardPoints, ...]] = {}
    missed: list[str] = []
    size: tuple[int, int] | None = None
    for name, image in images:
        views = halves(image) if stereo else (image,)
        shape = (views[0].shape[1], views[0].shape[0])
        if size not in (None, shape):
            raise ValueError(f"{name} is {shape[0]} x {shape[1]} px, the images before {size}: use one camera's.")
        size = shape
        points = [board.find(view) for view in views]
        known = tuple(each for each in points if each is not None)
        if len(known) == len(views):
            found[name] = known
        else:
            missed.append(name)
    if len(found) < FEWEST_BOARDS or size is None:
        where = f" It is not seen whole in {', '.join(missed[:5])}." if missed else ""
        raise ValueError(
            f"the board with {board.columns} x {board.rows} points is found in {len(found)} images; {FEWEST_BOARDS} or "
            f"more are needed.{where} Count its inner corners, and take more images with the board tilted."
        )
    cameras: list[Camera] = []
    residuals: dict[str, float] = {}
    for k in range(2 if stereo else 1):
        side = f" ({('left', 'right')[k]})" if stereo else ""
        camera, by_image = _one_camera({name: points[k] for name, points in found.items()}, board, size, side)
        cameras.append(camera)
        residuals |= {f"{name}{side}": residual for name, residual in by_image.items()}
    about: dict[str, Any] = {"board": vars(board), "residual_px": residuals, "left_out": missed}
    second = _second(cameras, list(found.values()), board) if stereo else None
    known_plane = None if plane is None else _plane(cameras[0], plane, board, stereo)
    return CalibratedCameras(cameras=tuple(cameras), second=second, plane=known_plane, about=about)


def _one_camera(
    seen: Mapping[str, BoardPoints], board: CalibrationBoard, size: tuple[int, int], side: str
) -> tuple[Camera, dict[str, float]]:
    pixels = [points.pixels.astype(np.float32) for points in seen.values()]
    places = [board.points[points.number].astype(np.float32) for points in seen.values()]
    residual, matrix, distortion, turns, _, sd, _, each = cv2.calibrateCameraExtended(
        places, pixels, size, np.eye(3), np.zeros(5)
    )
    by_image = dict(zip(seen, np.ravel(each).tolist(), strict=True))
    worst = max(by_image, key=lambda name: by_image[name])
    if not residual <= LARGEST_RESIDUAL or not by_image[worst] <= LARGEST_IMAGE_RESIDUAL:
        raise ValueError(
            f"{worst}{side}: its board lies {by_image[worst]:.2f} px from where the camera should see it "
            f"(all images {residual:.2f} px; at most {LARGEST_IMAGE_RESIDUAL:g} and {LARGEST_RESIDUAL:g} px). Leave it "
            "out if it is blurred or of another camera or board; else check that the board is flat."
        )
    spread = float(np.ravel(sd)[:2].max() / matrix[0, 0])
    facing = [np.array(cv2.Rodrigues(turn)[0], np.float64)[:, 2] for turn in turns]
    tilt = math.degrees(max(angle_between(facing[0], other) for other in facing[1:]))
    if not spread <= _FOCAL_SD or tilt < _LEAST_TILT_DEG:
        raise ValueError(
            f"the boards differ by a tilt of {tilt:.0f} degrees, and leave the focal length{side} uncertain by "
            f"{100 * spread:.1f} %: tilt the board by 30 degrees and more, another way in each image."
        )
    camera = Camera(
        width=size[0], height=size[1], matrix=np.array(matrix, np.float64),
        distortion=np.ravel(np.array(distortion, np.float64))[:5], residual=float(residual),
        boards=len(pixels),
    )  # fmt: skip
    return camera, by_image


def _second(cameras: Sequence[Camera], seen: Sequence[tuple[BoardPoints, ...]], board: CalibrationBoard) -> Pose:
    left, right = cameras
    places, first, other = [], [], []
    for one, two in seen:
        both, k, j = np.intersect1d(one.number, two.number, return_indices=True)
        if len(both) >= _FEWEST_SHARED:
            places.append(board.points[both].astype(np.float32))
            first.append(one.pixels[k].astype(np.float32))
            other.append(two.pixels[j].astype(np.float32))
    if len(places) < FEWEST_BOARDS:
        raise ValueError(
            f"in {len(places)} images both cameras see {_FEWEST_SHARED} points or more in common; {FEWEST_BOARDS} are "
            "needed. Hold the board where both see it."
        )
    residual, _, _, _, _, rotation, translation = cv2.stereoCalibrate(
        places, first, other, left.matrix.copy(), left.distortion.copy(),
        right.matrix.copy(), right.distortion.copy(), (left.width, left.height), flags=cv2.CALIB_FIX_INTRINSIC,
    )[:7]  # fmt: skip
    if not residual <= LARGEST_RESIDUAL:
        raise ValueError(
            f"the two cameras together leave a residual of {residual:.2f} px (at most {LARGEST_RESIDUAL:g}): were both "
            "images of each pair taken at the same time, and is the left one on the left?"
        )
    return Pose(
        rotation=np.array(rotation, np.float64),
        translation=np.ravel(np.array(translation, np.float64)),
        residual=float(residual),
    )


def _plane(camera: Camera, plane: tuple[str, GreyImage], board: CalibrationBoard, stereo: bool) -> Pose:
    name, image = plane
    view = halves(image)[0] if stereo else image
    if view.shape != (camera.height, camera.width):
        raise ValueError(f"{name} is {view.shape[1]} x {view.shape[0]} px; the other images are of another size.")
    points = board.find(view)
    if points is None:
        raise ValueError(f"{name}: the board in the plane of the cut is not found. It has to be seen whole.")
    places = board.points[points.number]
    found, turn, shift = cv2.solvePnP(places, points.pixels, camera.matrix, camera.distortion)
    rotation = np.array(cv2.Rodrigues(turn)[0], np.float64)
    far = camera.pixels(places @ rotation.T + np.ravel(shift)) - points.pixels
    residual = float(np.sqrt((far**2).sum(axis=1).mean()))
    if not found or not residual <= LARGEST_IMAGE_RESIDUAL:
        raise ValueError(f"{name}: the board in the plane of the cut leaves {residual:.2f} px: is it of this camera?")
    return Pose(rotation=rotation, translation=np.ravel(shift), residual=residual)
