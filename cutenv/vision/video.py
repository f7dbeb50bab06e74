"""Video as grey frames with their times, and clear errors for files that are none, or are not what was said."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import av
import numpy as np
from numpy.typing import NDArray

_SHORT = 0.98  # share of the announced frames below which a file has ended early


class VideoFrame(NamedTuple):
    """One frame: its number from 0, its time [s] on the video's clock, and its grey values, shape (height, width)."""

    number: int
    time: float
    image: NDArray[np.uint8]


@dataclass(frozen=True)
class VideoFacts:
    """Header of a video: size [px], frames a second [Hz], number of frames or 0 where it does not say."""

    width: int
    height: int
    rate: float
    frames: int


def video_facts(path: Path | str) -> VideoFacts:
    """Return what a video says about itself; raises as :func:`video_frames`."""
    with _opened(path) as container:
        return _facts(path, container)


def video_frames(
    path: Path | str, *, size: tuple[int, int] | None = None, rate: float | None = None
) -> Iterator[VideoFrame]:
    """Read a video frame by frame.

    Parameters
    ----------
    path : path
        Any format that FFmpeg reads.
    size : (int, int), optional
        Width and height that the frames must have [px].
    rate : float, optional
        Frames a second [Hz], in place of the times that the file holds.

    Raises
    ------
    ValueError
        If it is no video, has another size, ends early, or its times do not increase; at the end, for what is only
        seen there. The frames before were given.
    FileNotFoundError
        If there is no such file.
    """
    with _opened(path) as container:
        facts = _facts(path, container)
        if size is not None and (facts.width, facts.height) != size:
            raise ValueError(
                f"{path} has frames of {facts.width} x {facts.height} px, but the calibration is for {size[0]} x "
                f"{size[1]}: it is of another camera, or the video was scaled or turned. Use the camera's own images."
            )
        count, last = 0, -math.inf
        try:
            for frame in container.decode(video=0):
                time = frame.time if rate is None else count / rate
                if time is None or not math.isfinite(time) or time <= last:
                    raise ValueError(
                        f"{path}: the time of frame {count} is {time}, that before {last:g} s: give its rate, --rate."
                    )
                if (frame.width, frame.height) != (facts.width, facts.height):
                    raise ValueError(f"{path}: the size changes at frame {count} to {frame.width} x {frame.height} px.")
                yield VideoFrame(count, float(time), np.asarray(frame.to_ndarray(format="gray"), np.uint8))
                count, last = count + 1, float(time)
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
    # A damaged stream has no codec, and with it neither of these.
    width, height, rate = (getattr(stream, name, None) for name in ("width", "height", "average_rate"))
    if not (width and height and rate):
        raise ValueError(f"{path} does not say the size or rate of its frames: it is damaged.")
    return VideoFacts(width, height, float(rate), stream.frames)
