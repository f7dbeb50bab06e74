"""Calibration of one camera or a pair from images of a board; refuses too few boards and too large residuals."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from cutenv.vision.calibration_board import BoardPoints, CalibrationBoard, halves
from cutenv.vision.cameras import CalibratedCameras, Camera, GreyImage, Pose, angle_between

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
