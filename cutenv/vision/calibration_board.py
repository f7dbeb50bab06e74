"""Calibration board: chessboard, circles or ChArUco, and its points in an image to a fraction of a pixel."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range, one_of
from cutenv.vision.cameras import GreyImage

BOARD_KINDS = ("chessboard", "circles", "charuco")
"""Boards that are known; circles stand in a square grid."""
_TAGS = 1000  # of the dictionary of ChArUco boards
_FEWEST_POINTS = 12  # of a ChArUco board, parts of which may be hidden


class BoardPoints(NamedTuple):
    """Points of a board in an image: their numbers on the board, shape (n,), and their places, shape (n, 2) [px]."""

    number: NDArray[np.int64]
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
