"""Film of a cut by rendered cameras; blade, slab, lenses, light and spoilt frames are drawn at random and known."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from scripts.validation.vision.rendering.blade_scene import Blade, FilmedScene, Slab, draw_blade, draw_slab
from scripts.validation.vision.rendering.board_images import held_boards, standing_board
from scripts.validation.vision.rendering.lens import Array, RenderedCamera, draw_pair
from scripts.validation.vision.rendering.moved_tissue import MovedTissue

BED = 0.004  # height of the blade's end over the plate [m]: tissue that is not cut
SPOILT = ("glare", "hidden strip", "hidden surface", "blur", "dark")  # ways in which a frame is spoilt
_CLOCK = 90_000  # time base of the video files [Hz]


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmedCut:
    """Film of a cut, and what is true of every frame."""

    cameras: list[RenderedCamera]  # left and right
    scenes: list[FilmedScene]
    blade: Blade
    time: Array  # of each frame on the video's clock [s]
    lag: float  # time on the record's clock at the video's time 0 [s]
    along: Array  # true embedded length along the blade [m]
    vertical: Array  # true depth [m]
    spoilt: list[str]  # in which way each frame is, or ""
    ends: Array
    velocity: Array
    target: Array
    noise: float
    field: float
    seed: int
    tissue: MovedTissue | None = None

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """Render every frame; the images of both cameras stand side by side."""
        rng = np.random.default_rng([self.seed, 1])
        exposure = rng.uniform(2e-3, 8e-3)
        for k, end in enumerate(self.ends):
            flicker = rng.normal(1.0, 0.01)
            to_rest = None if self.tissue is None else self.tissue.at_rest(float(self.time[k]) + self.lag)
            pictures = [scene.frame(end, self.velocity[k], exposure, to_rest) * flicker for scene in self.scenes]
            pictures = [self._spoil(p, c, k, rng) for p, c in zip(pictures, self.cameras, strict=True)]
            counts = 255.0 * np.hstack(pictures)
            noise = self.noise * np.sqrt(0.5 + 0.5 * np.clip(counts, 0, 255) / 128.0)  # read noise and shot noise
            yield np.clip(np.rint(counts + noise * rng.normal(size=counts.shape)), 0, 255).astype(np.uint8)

    def boards(self, count: int) -> tuple[list[NDArray[np.uint8]], NDArray[np.uint8]]:
        """Render a board of 10 x 7 corners, 5.3 % of the field apart: held at random, and in the plane of the cut."""
        rng, square = np.random.default_rng([self.seed, 2, 0]), 0.053 * self.field
        held = held_boards(self.cameras, self.target, count, rng, square=square)
        return held, standing_board(self.cameras, self.target, rng, square=square)

    def write(
        self, path: Path, left: Path | None = None, watched: Callable[[Array], Iterable[float]] = iter,
        frames: Iterable[NDArray[np.uint8]] | None = None,
    ) -> None:  # fmt: skip
        """Write the film as H.264, and the left camera's half into another file.

        ``watched`` may show progress; ``frames`` are those that have been rendered already.
        """
        paths = [path] if left is None else [path, left]
        width, height = self.cameras[0].width, self.cameras[0].height
        with contextlib.ExitStack() as stack:
            files = [stack.enter_context(av.open(str(each), "w")) for each in paths]
            streams = [self._stream(file, width * size, height) for file, size in zip(files, (2, 1), strict=False)]
            for time, image in zip(watched(self.time), self.frames() if frames is None else frames, strict=True):
                for file, stream in zip(files, streams, strict=True):
                    part = np.ascontiguousarray(image[:, : stream.width])
                    frame = av.VideoFrame.from_ndarray(part, format="gray").reformat(format="yuv420p")
                    frame.pts, frame.time_base = round(time * _CLOCK), Fraction(1, _CLOCK)
                    file.mux(stream.encode(frame))
            for file, stream in zip(files, streams, strict=True):
                file.mux(stream.encode(None))

    def _stream(self, file: av.container.OutputContainer, width: int, height: int) -> av.VideoStream:
        rate = (len(self.time) - 1) / float(self.time[-1] - self.time[0])
        options = {"crf": "10", "preset": "veryfast"}
        stream = file.add_stream("libx264", rate=Fraction(round(1000 * rate), 1000), options=options)
        stream.width, stream.height, stream.pix_fmt, stream.time_base = width, height, "yuv420p", Fraction(1, _CLOCK)
        return stream

    def _spoil(self, picture: Array, camera: RenderedCamera, k: int, rng: np.random.Generator) -> Array:
        kind = self.spoilt[k]
        if not kind:
            return picture
        if kind == "blur":
            return np.asarray(gaussian_filter(picture, rng.uniform(4.0, 7.0)))
        if kind == "dark":
            return picture * rng.uniform(0.02, 0.1)
        strip = self.ends[k] - self.blade.total * self.blade.down
        surface = self.ends[k] - self.along[k] * self.blade.down
        place = strip if kind == "hidden strip" or (kind == "glare" and k % 2) else surface
        u, v = camera.project(place) + rng.normal(0.0, 2.0, 2)
        y, x = np.mgrid[: camera.height, : camera.width]
        size = rng.uniform(14.0, 22.0) * camera.width / 512.0
        r = np.hypot((x - u) / size, (y - v) / size / rng.uniform(0.8, 1.2))
        if kind == "glare":
            return np.asarray(picture + 2.0 * np.exp(-(r**4)))
        return np.where(r < 1.0, 0.5 + 0.05 * np.sin(0.2 * x), picture)


def film_cut(
    time: Array, position: Array, depth: Array, *, angle: float, seed: int, rate: float = 15.0, noise: float = 5.0,
    spoilt: float = 0.05, total: float = 0.0425, strip: float = 0.004, width: float = 0.008,
    size: tuple[int, int] = (512, 384), field: float = 0.17, lag: float | None = None,
    tag: NDArray[np.uint8] | None = None, tissue: MovedTissue | None = None,
) -> FilmedCut:  # fmt: skip
    """Film a cut of a blade that is at ``position`` [m] at ``time`` [s], at an angle against the surface [rad].

    ``depth`` is the depth of cut that the blade meets at positions 0, 0.5 mm, 1 mm, ... [m]. ``seed`` draws all that
    the measurement is not told: cameras, lenses, light, look of blade and slab, times, faults. ``rate`` is in frames a
    second, ``noise`` that of the images at middle grey [DN], ``spoilt`` the share of spoilt frames; ``total`` goes from
    the strip's centre to the blade's end, ``field`` is the width of the scene that an image shows [m], ``size`` in
    pixels. ``lag``, the time on the record's clock at the video's time 0 [s], is drawn by default. A ``tag``, cells
    that are 0 for black, is on the blade in place of the strip; ``tissue`` that the cut moves stands still by default.
    """
    rng = np.random.default_rng([seed, 0])
    blade = draw_blade(rng, angle=angle, total=total, strip=strip, width=width, tag=tag)
    places = 0.0005 * np.arange(len(depth))
    reached = places <= position.max() + 0.02  # a liver falls steeply at its free end, where no blade comes
    slab = _slab(rng, blade, places[reached], depth[reached])
    middle = np.array([0.0, 0.5 * (position.min() + position.max()), BED + 0.5 * float(depth.max()) + 0.012])
    target = middle - 0.4 * total * blade.down * np.array([0.0, 1.0, 0.0]) + rng.normal(0.0, 2e-3, 3)
    cameras = draw_pair(rng, target, width=size[0], height=size[1], field=field)
    light = np.array([rng.uniform(-0.5, 0.8), rng.uniform(-0.6, 0.6), 1.0])
    blur = rng.uniform(0.5, 0.8) * size[0] / 512.0
    scenes = [FilmedScene(camera, slab, blade, light, blur) for camera in cameras]
    begin = float(time[0]) + (rng.uniform(0.0, 0.4) if lag is None else 0.0)
    shots = np.arange(math.floor((float(time[-1]) - begin) * rate)) / rate
    shots = shots + rng.uniform(-2e-3, 2e-3, len(shots)) + 0.01
    lag = (begin if lag is None else lag) + float(shots[0])
    shots = shots - shots[0]  # a file's clock begins with its first frame
    place = np.interp(shots + lag, time, position)
    speed = np.interp(shots + lag, time, np.gradient(position, time))
    ends = np.stack([np.zeros_like(place), place, np.full_like(place, BED)], axis=1)
    velocity = np.stack([0 * speed, speed, 0 * speed], axis=1)
    kinds = [str(rng.choice(SPOILT)) if rng.random() < spoilt else "" for _ in shots]
    along = np.array([scenes[0].embedded(end) for end in ends])
    return FilmedCut(
        cameras=cameras, scenes=scenes, blade=blade, time=shots, lag=lag, along=along,
        vertical=along * math.sin(angle), spoilt=kinds, ends=ends, velocity=velocity, target=target, noise=noise,
        field=field, seed=seed, tissue=tissue,
    )  # fmt: skip


def _slab(rng: np.random.Generator, blade: Blade, places: Array, depth: Array) -> Slab:
    """Return a slab whose top an inclined blade meets so deep as ``depth`` says, for its end at ``places``."""
    entry = places - blade.lean * depth / math.tan(blade.angle)
    if (np.diff(entry) <= 0.0).any():
        raise ValueError("the depth grows too steeply along the cut for the inclined blade.")
    return draw_slab(rng, entry, BED + depth)
