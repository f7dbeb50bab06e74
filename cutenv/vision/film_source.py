"""Camera that is read while it films: its newest frame again and again, or a video file in its place."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from cutenv.vision.cameras import GreyImage
from cutenv.vision.video import VideoFrame, video_frames

_PATIENCE = 3.0  # [s] without a frame, after which a camera is dead


class CameraDriver(Protocol):
    """Camera that is asked for one frame after another."""

    def open(self) -> None:
        """Connect; raises OSError if it does not answer."""
        ...

    def read(self) -> tuple[float, GreyImage] | None:
        """Wait for the next frame; return its time [s] on the monotonic clock and its grey values, None at the end."""
        ...

    def close(self) -> None:
        """Disconnect."""
        ...


class OpencvCamera:
    """Camera that OpenCV can read: its number, or the address of a stream."""

    def __init__(self, source: str) -> None:
        self._source = source

    def open(self) -> None:
        """Connect; raises OSError if it does not answer."""
        self._capture = cv2.VideoCapture(int(self._source) if self._source.isdigit() else self._source)
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        if not self._capture.isOpened():
            raise OSError(f"camera {self._source} does not answer")

    def read(self) -> tuple[float, GreyImage] | None:
        """Wait for the next frame."""
        there, image = self._capture.read()
        if not there:
            return None
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return time.monotonic(), np.asarray(grey, np.uint8)

    def close(self) -> None:
        """Disconnect."""
        self._capture.release()


class PlayedFilm:
    """Video file that is played once, at its own speed, as if it were a camera."""

    def __init__(self, path: str) -> None:
        self._path = path

    def open(self) -> None:
        """Begin to play; raises OSError if there is no such file."""
        self._frames, self._begun = video_frames(self._path), time.monotonic()

    def read(self) -> tuple[float, GreyImage] | None:
        """Wait for the next frame."""
        frame = next(self._frames, None)
        if frame is None:
            return None
        time.sleep(max(self._begun + frame.time - time.monotonic(), 0.0))
        return time.monotonic(), frame.image

    def close(self) -> None:
        """End."""


def camera_of(source: str) -> CameraDriver:
    """Return the camera of this number or address, or the film of this name in its place."""
    return PlayedFilm(source) if Path(source).is_file() else OpencvCamera(source)


def mounted_camera(mounting: Any) -> CameraDriver:
    """Camera that OpenCV reads, by its number or the address of a stream, or a film in its place."""
    return camera_of(mounting.settings.source)


def newest_frames(camera: CameraDriver, size: tuple[int, int]) -> Iterator[VideoFrame]:
    """Yield the newest frame of an open camera, again and again; frames that nobody waits for are lost.

    Raises
    ------
    OSError
        If the camera ends, sends nothing for seconds, or sends frames that are not of this width and height [px].
    """
    changed, number, why = threading.Condition(), 0, ""
    newest: list[tuple[float, GreyImage]] = []

    def watch() -> None:
        nonlocal why
        told = "the camera sends no more frames"
        try:
            while (frame := camera.read()) is not None:
                with changed:
                    newest[:] = [frame]
                    changed.notify()
        except (OSError, ValueError, cv2.error) as error:
            told = f"the camera has failed: {error}"
        with changed:
            why = told
            changed.notify()

    threading.Thread(target=watch, name="camera", daemon=True).start()
    while True:
        with changed:
            if not changed.wait_for(lambda: newest or why, timeout=_PATIENCE):
                raise OSError(f"the camera has sent no frame for {_PATIENCE:g} s")
            if not newest:
                raise OSError(why)
            moment, image = newest.pop()
        if image.shape != (size[1], size[0]):
            raise OSError(
                f"the camera sends {image.shape[1]} x {image.shape[0]} px, its calibration is for {size[0]} x {size[1]}"
            )
        yield VideoFrame(number, moment, image)
        number += 1
