"""Calibration of one camera or a pair from images of a board; refuses too few boards and too large residuals."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import in_range, one_of
from cutenv.vision.cameras import CalibratedCameras, Camera, GreyImage, Pose, angle_between

BOARD_KINDS = ("chessboard", "circles", "charuco")
"""Boards that are known; circles stand in a square grid."""
_TAGS = 1000  # of the dictionary of ChArUco boards
_FEWEST_POINTS = 12  # of a ChArUco board, parts of which may be hidden


class BoardPoints(NamedTuple):
    """Points of a board in an image: their numbers on the board, shape (n,), and their places, shape (n, 2) [px]."""

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
        """Return the board of a text such as ``9x6`` (columns and rows of points) and its lengths [m]."""
        found = re.fullmatch(r"(\d{1,3})x(\d{1,3})", points.strip())
        if found is None:
            raise ValueError(f"--board {points!r} is not columns x rows of its inner corners or circles; write 9x6.")
        return cls(columns=int(found[1]), rows=int(found[2]), spacing=spacing, kind=kind, tag=tag)

    @property
    def points(self) -> Array:
        """Places of its points on it, shape (n, 3) [m], row by row."""
        row, column = np.mgrid[: self.rows, : self.columns]
        return self.spacing * np.stack([column.ravel(), row.ravel(), 0 * row.ravel()], axis=1).astype(np.float64)

    def find(self, image: GreyImage) -> BoardPoints | None:
        """Return its points in a grey image; None if it is not there, or too little of it.

        Of a ChArUco board those that are seen, of others all.
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

    Raises
    ------
    ValueError
        If the file is no image.
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
    """Return the left and the right image of a pair that stands side by side."""
    middle = image.shape[1] // 2
    return np.ascontiguousarray(image[:, :middle]), np.ascontiguousarray(image[:, middle : 2 * middle])


FEWEST_BOARDS = 8
"""Least number of images in which the board has to be found."""
LARGEST_RESIDUAL = 0.5
"""Largest root mean square residual of a calibration [px]."""
LARGEST_IMAGE_RESIDUAL = 1.0
"""Largest root mean square residual of a single image [px]."""
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

    Parameters
    ----------
    images : iterable of (str, ndarray of uint8, shape (height, width))
        Name and grey values of each; of a pair, both images side by side. The board is tilted another way in each.
    board : CalibrationBoard
        Board that they show.
    stereo : bool
        Whether each image holds those of two cameras.
    plane : (str, ndarray), optional
        Image in which the board stands in the plane of the cut; needed for one camera. It may be one of the others.

    Raises
    ------
    ValueError
        If the board is found in fewer than :data:`FEWEST_BOARDS` images, the sizes differ, a residual is too large
        (names the image), or the boards are too much alike to determine the focal length.
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
