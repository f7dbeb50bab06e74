"""Film: grey frames with their times.

They are of a file, or of a camera, whose newest frame is taken; errors are clear.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from cutenv.vision.cameras import GreyImage

_SHORT = 0.98  # share of the announced frames below which a file has ended early


class VideoFrame(NamedTuple):
    """Video frame: number, time [s], grey values (height, width)."""

    number: int
    time: float
    image: NDArray[np.uint8]


@dataclass(frozen=True)
class VideoFacts:
    """Header of a video.

    Frames a second [Hz], number of frames that it shows or 0 where it does not say.
    """

    rate: float
    frames: int


def video_facts(path: Path | str) -> VideoFacts:
    """Return what a video says about itself; raises as :func:`video_frames`."""
    with _opened(path) as container:
        return _facts(path, container)


def video_frames(
    path: Path | str, *, size: tuple[int, int] | None = None, rate: float | None = None
) -> Iterator[VideoFrame]:
    """Read a video frame by frame, trimmed and turned as shown.

    It has any format that FFmpeg reads, and must have the width and height ``size`` when turned [px]; ``rate`` [Hz]
    stands in place of the times that the file holds.

    Raises ValueError if it is no video, has another size, ends early, or its times do not increase; at the end, for
    what is only seen there, when the frames before were given. Raises FileNotFoundError if there is no such file.
    """
    with _opened(path) as container:
        facts = _facts(path, container)
        count, last, shape = 0, -math.inf, None
        try:
            for frame in container.decode(video=0):
                time = frame.time if rate is None else count / rate
                if time is None or not math.isfinite(time) or time <= last:
                    raise ValueError(
                        f"{path}: the time of frame {count} is {time}, that before {last:g} s: give its rate, --rate."
                    )
                image = _turned(np.asarray(frame.to_ndarray(format="gray"), np.uint8), frame)
                height, width = image.shape
                if size is not None and (width, height) != size:
                    raise ValueError(
                        f"{path} has frames of {width} x {height} px, but the calibration is for {size[0]} x "
                        f"{size[1]}: it is of another camera, or one held otherwise, or the video was scaled. Use "
                        "the camera's own images."
                    )
                if image.shape != (shape or image.shape):
                    raise ValueError(f"{path}: the size changes at frame {count} to {width} x {height} px.")
                yield VideoFrame(count, float(time), image)
                count, last, shape = count + 1, float(time), image.shape
        except av.FFmpegError as error:
            raise ValueError(f"{path} is damaged after frame {count - 1}: {error.strerror}.") from None
        if count < max(2, _SHORT * facts.frames):
            announced = f" of {facts.frames}" if facts.frames else ""
            raise ValueError(f"{path} ends early, after {count}{announced} frames. Copy the file again.")


@contextmanager
def _opened(path: Path | str) -> Iterator[av.container.InputContainer]:
    if not Path(path).is_file():
        raise FileNotFoundError(f"no such file: {path}.")
    try:
        container = av.open(str(path))
    except (av.FFmpegError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is no video, or its beginning or end is missing: {error}") from None
    with container:
        if not container.streams.video:
            raise ValueError(f"{path} holds no video, or it is damaged or ends early.")
        yield container


def _facts(path: Path | str, container: av.container.InputContainer) -> VideoFacts:
    stream = container.streams.video[0]
    # A damaged stream has no codec, and with it none of these.
    if not all(getattr(stream, name, None) for name in ("width", "height", "average_rate")):
        raise ValueError(f"{path} does not say the size or rate of its frames: it is damaged.")
    rate, frames = float(stream.average_rate or 0), stream.frames
    if frames and stream.duration and stream.time_base:  # the file of a trimmed video may hold more than it shows
        frames = min(frames, round(float(stream.duration * stream.time_base) * rate))
    return VideoFacts(rate, frames)


def _turned(image: NDArray[np.uint8], frame: av.VideoFrame) -> NDArray[np.uint8]:
    """Return an image turned and mirrored by the frame's display matrix."""
    beside: Any = frame.side_data  # a mapping, but PyAV's stubs are of another opinion
    if "DISPLAYMATRIX" not in beside:
        return image
    # FFmpeg's libavutil/display.h: x' = a x + c y, y' = b x + d y, by rows (a, b, u), (c, d, v), (x, y, w).
    a, b, _, c, d = np.frombuffer(bytes(beside["DISPLAYMATRIX"]), np.int32)[:5].tolist()
    is_upright = abs(a) + abs(d) > abs(b) + abs(c)
    shown, across, down = (image, a, d) if is_upright else (image.T, c, b)
    return np.ascontiguousarray(shown[:: -1 if down < 0 else 1, :: -1 if across < 0 else 1])


_PATIENCE = 3.0  # [s] without a frame, after which a camera is dead


class CameraDriver(Protocol):
    """Camera that is asked for one frame after another."""

    def open(self) -> None:
        """Connect; raises OSError if it does not answer."""
        ...

    def read(self) -> tuple[float, GreyImage] | None:
        """Return the next frame's monotonic time [s] and grey values, or None."""
        ...

    def close(self) -> None:
        """Disconnect."""
        ...


class OpencvCamera:
    """Camera that OpenCV can read.

    Its number, or the address of a stream.
    """

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
    """Video file played once at its own speed as a camera."""

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
    """Return the camera of a number or address, or a film."""
    return PlayedFilm(source) if Path(source).is_file() else OpencvCamera(source)


def mounted_camera(mounting: Any) -> CameraDriver:
    """Camera by number or stream address (OpenCV), or a film."""
    return camera_of(mounting.settings.source)


def newest_frames(camera: CameraDriver, size: tuple[int, int]) -> Iterator[VideoFrame]:
    """Yield the newest frame of an open camera repeatedly.

    Frames that nobody waits for are lost.

    Raises OSError if the camera ends, sends nothing for seconds, or sends frames that are not of this width and height
    [px].
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
