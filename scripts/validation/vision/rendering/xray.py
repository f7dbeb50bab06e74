"""X-ray images by Beer-Lambert's law: beads, a slab of tissue, a blade, a plate with holes; with all that spoils them.

A ray from a point source is weakened by exp(-sum of attenuation times length); the intensifier distorts the image
(radially by the thesis's error y over the radius, and by a turn that grows with its square), darkens it outward and
blurs it; photons are counted (Poisson) and rounded to 8 bits; pixels are 10:11, and lines may be interlaced.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Array = NDArray[np.float64]
STEEL, TISSUE = 620.0, 20.0  # linear attenuation at about 70 keV [1/m]
_FINE = 3  # rays across a pixel


@dataclass(frozen=True, kw_only=True)
class Box:
    """Box along the axes with one attenuation: tissue, a blade."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    attenuation: float

    def path(self, source: Array, ends: Array) -> Array:
        """Return the length of straight rays from a source to end points (..., 3) within the box [m]."""
        way = ends - source
        with np.errstate(divide="ignore", invalid="ignore"):
            one, two = (np.asarray(self.low) - source) / way, (np.asarray(self.high) - source) / way
        enter = np.nan_to_num(np.minimum(one, two), nan=-np.inf).max(axis=-1)
        leave = np.nan_to_num(np.maximum(one, two), nan=np.inf).min(axis=-1)
        return np.asarray(
            np.maximum(np.minimum(leave, 1.0) - np.maximum(enter, 0.0), 0.0) * np.linalg.norm(way, axis=-1)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class XRayCamera:
    """X-ray source and intensifier."""

    angle: float = 0.0  # 0: detector above, looking down; pi/2: detector at +x [rad]
    isocentre: tuple[float, float, float] = (0.0, 0.07, 0.012)  # where the arm looks [m]
    to_isocentre: float = 0.62  # from the source [m]
    to_detector: float = 0.98  # from the source [m]
    pitch: float = 0.0004  # height of a pixel on the detector [m]
    rows: int = 480
    columns: int = 720
    aspect: float = 10.0 / 11.0
    error: tuple[float, float, float] = (8e-5, -0.0079, 0.0)
    """a [1/px], b, c [px] of the radial error y = a r^2 + b r + c over the true radius r."""
    swirl: float = 0.0  # turn over the true radius squared [rad/px^2]
    centre: tuple[float, float] = (327.0, 240.0)  # of the distortion, in square pixels
    photons: float = 900.0  # that a pixel counts where nothing is in the way
    blur: float = 0.7  # standard deviation [px]
    shading: float = 0.25
    tilt: float = 0.0

    @cached_property
    def _axes(self) -> tuple[Array, Array, Array, Array, Array]:
        """Source, middle of the detector, and directions of columns, rows and rays."""
        a = self.angle
        ray = np.array([math.sin(a), 0.0, math.cos(a)])
        across, down = np.array([0.0, 1.0, 0.0]), np.array([-math.cos(a), 0.0, math.sin(a)])
        c, s = math.cos(self.tilt), math.sin(self.tilt)
        across, down = c * across + s * down, c * down - s * across
        source = np.asarray(self.isocentre) - self.to_isocentre * ray
        return source, source + self.to_detector * ray, across, down, ray

    @property
    def source(self) -> Array:
        """Place of the source [m]."""
        return self._axes[0]

    def _ideal(self, points: Array) -> Array:
        """Return true places on the detector, from its middle, in square pixels."""
        source, middle, across, down, ray = self._axes
        way = np.asarray(points, float).reshape(-1, 3) - source
        on = source + way * ((middle - source) @ ray / (way @ ray))[:, None] - middle
        return np.stack([on @ across, on @ down], axis=1) / self.pitch

    @property
    def _middle(self) -> Array:
        return np.array([(self.columns - 1) * self.aspect, self.rows - 1.0]) / 2.0

    def distort(self, square: Array) -> Array:
        """Return where true places, in square pixels of the image, are seen."""
        q = square - self.centre
        r, turn = np.hypot(q[:, 0], q[:, 1]), np.arctan2(q[:, 1], q[:, 0])
        a, b, c = self.error
        seen, turn = r + a * r**2 + b * r + c, turn + self.swirl * r**2
        return np.asarray(self.centre) + np.stack([seen * np.cos(turn), seen * np.sin(turn)], axis=1)

    def seen(self, points: Array) -> Array:
        """Return the pixels at which points in space are seen, shape (n, 2)."""
        return self.distort(self._ideal(points) + self._middle) / (self.aspect, 1.0)

    def _true(self, pixels: Array) -> Array:
        """Return the true places, from the detector's middle in square pixels, that pixels (n, 2) show."""
        q = pixels * (self.aspect, 1.0) - self.centre
        seen, turn = np.hypot(q[:, 0], q[:, 1]), np.arctan2(q[:, 1], q[:, 0])
        r = np.interp(seen, *self._radii)
        turn = turn - self.swirl * r**2
        return np.asarray(self.centre) + np.stack([r * np.cos(turn), r * np.sin(turn)], axis=1) - self._middle

    @cached_property
    def _radii(self) -> tuple[Array, Array]:
        """Seen radii and the true ones that belong to them [px]."""
        a, b, c = self.error
        true = np.linspace(0.0, 2.0 * math.hypot(self.rows, self.columns), 40001)
        return true + a * true**2 + b * true + c, true

    def true_places(self, pixels: Array) -> Array:
        """Return the true places, in square pixels of an undistorted image, that pixels (n, 2) show."""
        return self._true(pixels) + self._middle

    def _on_detector(self, true: Array) -> Array:
        _, middle, across, down, _ = self._axes
        return middle + self.pitch * (true[..., :1] * across + true[..., 1:] * down)

    @cached_property
    def _fine(self) -> Array:
        """True places of the rays of every pixel, shape (rows, columns, 9, 2) [square px]."""
        return self._fine_of((0, 0), (self.rows, self.columns))

    def _fine_of(self, low: tuple[int, int], high: tuple[int, int]) -> Array:
        step = (np.arange(_FINE) - (_FINE - 1) / 2.0) / _FINE
        v, u = np.mgrid[low[0] : high[0], low[1] : high[1]].astype(float)
        dv, du = np.meshgrid(step, step, indexing="ij")
        pixels = np.stack([u[..., None] + du.ravel(), v[..., None] + dv.ravel()], axis=-1)
        return self._true(pixels.reshape(-1, 2)).reshape(*pixels.shape)

    def prepare(self) -> None:
        """Compute the rays of all pixels once: worth it before many images."""
        _ = self._fine

    def rays(self, low: tuple[int, int], high: tuple[int, int]) -> Array:
        """Return the ends on the detector of the fine rays of a window of rows and columns."""
        known = "_fine" in self.__dict__
        fine = self._fine[low[0] : high[0], low[1] : high[1]] if known else self._fine_of(low, high)
        return self._on_detector(fine)

    @cached_property
    def _shade(self) -> Array:
        v, u = np.mgrid[: self.rows, : self.columns]
        r = np.hypot((u - self.columns / 2) / self.columns, (v - self.rows / 2) / self.rows)
        return np.asarray(1.0 - self.shading * (2.0 * r**2))

    @cached_property
    def _kept(self) -> dict[Box, Array]:
        return {}

    def light(self, beads: Array, radius: float, boxes: tuple[Box, ...] = (), still: tuple[Box, ...] = ()) -> Array:
        """Return the share of the light that reaches each pixel, without blur and noise."""
        depth = np.zeros((self.rows, self.columns))
        for box in still:
            if box not in self._kept:
                v, u = np.mgrid[: self.rows, : self.columns].astype(float)
                true = self._true(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(self.rows, self.columns, 2)
                self._kept[box] = box.attenuation * box.path(self.source, self._on_detector(true))
            depth += self._kept[box]
        for box in boxes:
            corners = np.array(list(itertools.product(*zip(box.low, box.high, strict=True))))
            low, high = self._window(self.seen(corners), 3)
            if high[0] > low[0] and high[1] > low[1]:
                path = box.path(self.source, self.rays(low, high)).mean(axis=-1)
                depth[low[0] : high[0], low[1] : high[1]] += box.attenuation * path
        share = np.exp(-depth)
        if len(beads):
            size = math.ceil(self.to_detector / self.to_isocentre * radius / self.pitch * 1.6) + 2
            for bead, pixel in zip(beads, self.seen(beads), strict=True):
                low, high = self._window(pixel[None], size)
                if high[0] > low[0] and high[1] > low[1]:
                    way = self.rays(low, high) - self.source
                    way /= np.linalg.norm(way, axis=-1, keepdims=True)
                    to = bead - self.source
                    off = to @ to - (way @ to) ** 2
                    chord = 2.0 * np.sqrt(np.maximum(radius**2 - off, 0.0))
                    share[low[0] : high[0], low[1] : high[1]] *= np.exp(-STEEL * chord).mean(axis=-1)
        return share

    def _window(self, pixels: Array, more: int) -> tuple[tuple[int, int], tuple[int, int]]:
        low = np.floor(pixels.min(axis=0)).astype(int) - more
        high = np.ceil(pixels.max(axis=0)).astype(int) + more + 1
        low, high = np.maximum(low, 0), np.minimum(high, (self.columns, self.rows))
        return (int(low[1]), int(low[0])), (int(high[1]), int(high[0]))

    def expose(self, share: Array, rng: np.random.Generator | None, gain: float = 210.0) -> NDArray[np.uint8]:
        """Return the image of 8 bits, with the grey value that full light has; without `rng` there is no noise."""
        counted = self.photons * gaussian_filter(share * self._shade, self.blur)
        if rng is not None:
            counted = rng.poisson(np.maximum(counted, 0.0)).astype(float)
        return np.clip(np.rint(counted * (gain / self.photons)), 0, 255).astype(np.uint8)

    def plate(
        self,
        spacing: float,
        hole: float,
        rng: np.random.Generator | None,
        *,
        distance: float = 0.0,
        missing: float = 0.0,
        turn: float = 0.0,
        plate: float = 1.6,
    ) -> NDArray[np.uint8]:
        """Return the image of a grid plate parallel to the detector, ``distance`` from it [m].

        Holes are of a diameter ``hole``, ``spacing`` apart [m], and a share ``missing``; ``plate`` is attenuation times
        thickness.
        """
        scale = self.pitch * (self.to_detector - distance) / self.to_detector
        c, s = math.cos(turn), math.sin(turn)
        on = self._fine @ np.array([[c, -s], [s, c]]) * (scale / spacing) + 0.31
        cell = np.round(on)
        inside = np.hypot(*np.moveaxis(on - cell, -1, 0)) < 0.5 * hole / spacing
        if missing and rng is not None:
            gone = rng.random((401, 401)) < missing
            inside &= ~gone[cell[..., 0].astype(int) % 401, cell[..., 1].astype(int) % 401]
        return self.expose(np.where(inside, 1.0, math.exp(-plate)).mean(axis=-1), rng)


def interlaced(earlier: NDArray[np.uint8], later: NDArray[np.uint8], first: str) -> NDArray[np.uint8]:
    """Return a frame whose lines are those of two images in turn."""
    frame = later.copy()
    frame[0 if first == "top" else 1 :: 2] = earlier[0 if first == "top" else 1 :: 2]
    return frame
