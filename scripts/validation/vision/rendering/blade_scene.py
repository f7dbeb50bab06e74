"""A blade with a black strip that stands in a bulged, textured, wet slab, seen by cameras: a small ray caster.

Places are in the specimen's frame [m]: x across the cut line, y along it from the clamp, z up from the plate. The slab
without the blade is cast once for every camera; a frame casts the surroundings of the blade again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from scripts.validation.vision.rendering.lens import Array, RenderedCamera

TIMES = (np.array([[3, 8, 1], [2, 4, 6], [7, 0, 5]]) - 4.0) / 9.0
"""Instant of each of a pixel's points within the exposure; a magic square, so that time and place do not correlate."""
_HALF_WIDTH, _START, _END = 0.04, -0.03, 0.16  # of the slab [m]
_TEXEL = 0.25e-3  # [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Slab:
    """Tissue whose top on the cut line is at ``height`` [m] over ``place`` [m], lower at the sides by ``fall``."""

    place: Array
    height: Array
    fall: float
    texture: Array
    gloss: float
    shade: float

    def top(self, x: Array, y: Array) -> Array:
        """Return the height of its top [m]."""
        return np.asarray(np.interp(y, self.place, self.height) * (1.0 - self.fall * (x / _HALF_WIDTH) ** 2))

    def grain(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return the texture there and its slopes across and along."""
        at = np.stack([(x + 0.08) / _TEXEL, (y + 0.08) / _TEXEL])
        return tuple(map_coordinates(each, at, order=1, mode="wrap") for each in self.texture)  # type: ignore[return-value]


@dataclass(frozen=True, kw_only=True, eq=False)
class Blade:
    """Flat blade in the plane of the cut; it ends ``total`` below the strip's centre, all lengths in metres.

    ``angle`` is that against the surface [rad]; it leans toward the clamp with its holder for ``lean`` 1. ``yaw`` turns
    its plane out of the cut's [rad].
    """

    total: float
    strip: float
    width: float
    angle: float
    lean: float
    yaw: float
    grain: Array
    steel: float
    tag: NDArray[np.uint8] | None = None
    """Cells of a tag, 0 for black, that is stuck on in place of the strip: its side is ``strip``."""

    @property
    def down(self) -> Array:
        """Direction from the strip to its end."""
        flat = np.array([np.sin(self.yaw), np.cos(self.yaw), 0.0])
        return self.lean * np.cos(self.angle) * flat + np.array([0.0, 0.0, -np.sin(self.angle)])

    @property
    def across(self) -> Array:
        """Direction across its face, at right angles to :attr:`down`."""
        flat = np.array([np.sin(self.yaw), np.cos(self.yaw), 0.0])
        return np.sin(self.angle) * flat + self.lean * np.cos(self.angle) * np.array([0.0, 0.0, 1.0])

    def colour(self, s: Array, t: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the brightness of its face at s below the strip's centre and t across, and where there is a face."""
        brushed = np.interp(t, np.linspace(-1, 1, len(self.grain)) * self.width, self.grain)
        steel = self.steel * (1.0 + 0.06 * brushed + 3.0 * s + 8.0 * t)
        black = 0.06 * (1.0 + 0.3 * brushed)
        on = np.abs(s) <= 0.5 * self.strip
        if self.tag is not None:
            on &= np.abs(t) <= 0.5 * self.strip
            cells = len(self.tag)
            row, column = (np.clip((each / self.strip + 0.5) * cells, 0, cells - 1).astype(int) for each in (s, t))
            black = np.where(self.tag[row, column] == 0, black, 0.75)
        value = np.where(on, black, steel)
        holder = s < -0.013
        half = np.where(holder, 1.0, 0.5) * self.width
        return np.where(holder, 0.3, value), (np.abs(t) <= half) & (s <= self.total) & (s > -0.05)


class FilmedScene:
    """Slab and blade before one camera: static rays are cast once, then :meth:`frame` for every place of the blade."""

    def __init__(self, camera: RenderedCamera, slab: Slab, blade: Blade, light: Array, blur: float) -> None:
        self.camera, self.slab, self.blade, self.blur = camera, slab, blade, blur
        self.light = light / np.linalg.norm(light)
        self._rays = camera.rays(*camera.subpixels)
        self._rays /= np.linalg.norm(self._rays, axis=-1, keepdims=True)
        self._cast()

    def _cast(self) -> None:
        """Find where the rays meet the slab, and its brightness without the blade."""
        place, rays, slab = self.camera.place, self._rays, self.slab
        level = float(slab.height.mean())
        reach = (level - place[2]) / np.minimum(rays[..., 2], -1e-3)
        for _ in range(8):
            top = slab.top(place[0] + reach * rays[..., 0], place[1] + reach * rays[..., 1])
            reach = (top - place[2]) / np.minimum(rays[..., 2], -1e-3)
        self._reach = reach
        hit = place + reach[..., None] * rays
        x, y = hit[..., 0], hit[..., 1]
        h = 1e-4
        slope_x, slope_y = (
            (slab.top(x + h, y) - slab.top(x - h, y)) / (2 * h),
            (slab.top(x, y + h) - slab.top(x, y - h)) / (2 * h),
        )
        grain, bump_x, bump_y = slab.grain(x, y)
        self._normal = _unit(np.stack([-slope_x, -slope_y, np.ones_like(x)], -1))
        rough = _unit(np.stack([-slope_x + bump_x, -slope_y + bump_y, np.ones_like(x)], -1))
        lit = np.clip(rough @ self.light, 0.0, 1.0)
        half = _unit(self.light - rays)
        shine = slab.gloss * np.clip((rough * half).sum(-1), 0.0, 1.0) ** 120
        value = slab.shade * (1.0 + 0.25 * grain) * (0.35 + 0.65 * lit) + shine
        value = np.where((np.abs(x) < 0.35e-3 + 0.15e-3 * grain) & (y > 0), 0.6 * value, value)  # the line of the cut
        on = (np.abs(x) <= _HALF_WIDTH) & (y >= _START) & (y <= _END)
        behind = 0.42 + 0.03 * np.sin(40.0 * rays[..., 1]) + 0.05 * rays[..., 2]
        self._still = np.where(on, value, np.where(x > _HALF_WIDTH, 0.12, behind))
        self._on = on
        self._background = self._still.mean(axis=(2, 3))

    def frame(
        self, end: Array, velocity: Array, exposure: float, to_rest: Callable[[Array, Array], Array] | None = None
    ) -> Array:
        """Return the picture, shape (height, width), 1 for white; the blade's end is at ``end`` [m] in its middle.

        ``to_rest`` returns the shift, shape (2, ...) [m], that takes the tissue at some places back to where it rested.
        """
        blade, camera = self.blade, self.camera
        strip = end - blade.total * blade.down
        line = camera.project(np.array([strip - 0.05 * blade.down, end + 0.02 * blade.down]))
        to, from_ = line[1] - line[0], np.moveaxis(np.mgrid[: camera.height, : camera.width][::-1], 0, -1) - line[0]
        aside = np.abs(to[0] * from_[..., 1] - to[1] * from_[..., 0]) / np.hypot(*to)
        near = aside < np.hypot(*to) / (blade.total + 0.07) * 1.2 * blade.width + 4.0
        near &= (from_ @ to > -10.0 * np.hypot(*to)) & (from_ @ to < to @ to)
        picture = self._background.copy() if to_rest is None else self._moved(to_rest)
        still = self._still[near] if to_rest is None else picture[near][:, None, None]
        picture[near] = self._patch(near, strip, velocity * exposure, still).mean(axis=(1, 2))
        return np.asarray(gaussian_filter(picture, self.blur))

    def _moved(self, to_rest: Callable[[Array, Array], Array]) -> Array:
        """Return the picture without the blade, of tissue that was moved; its height stays."""
        on = self._on[:, :, 1, 1]
        at = self.camera.place + self._reach[on][:, 1, 1, None] * self._rays[on][:, 1, 1]
        at[:, :2] += to_rest(at[:, 0], at[:, 1]).T
        at[:, 2] = self.slab.top(at[:, 0], at[:, 1])
        picture = self._background.copy()
        picture[on] = map_coordinates(self._background, self.camera.project(at).T[::-1], order=3, mode="nearest")
        return picture

    def _patch(self, window: NDArray[np.bool_], strip: Array, moved: Array, still: Array) -> Array:
        """Return the brightness of the points of some pixels, shape (n, 3, 3); ``still`` is that of tissue there."""
        blade, rays = self.blade, self._rays[window]
        late = TIMES[..., None] * moved
        face = np.cross(blade.down, blade.across)
        start = self.camera.place - strip - late
        s, t, reach = _on_face(start, rays, face, blade)
        colour, there = blade.colour(s, t)
        hit = self.camera.place + self._reach[window][..., None] * rays
        seen = there & (reach < self._reach[window]) & (reach > 0)
        normal = self._normal[window]
        mirrored = rays - 2.0 * (rays * normal).sum(-1, keepdims=True) * normal
        s, t, reach = _on_face(hit - strip - late, mirrored, face, blade)
        wet, image = blade.colour(s, t)
        image &= (reach > 0) & self._on[window]
        steep = np.clip(-(rays * normal).sum(-1), 0.0, 1.0)
        share = 0.04 + 0.96 * (1.0 - steep) ** 5
        near = np.exp(-np.abs(reach) / 2e-3)
        still = still * np.where(self._on[window] & image, 1.0 - 0.25 * near, 1.0)
        return np.where(seen, colour, still + np.where(image, 0.7 * share * wet, 0.0))

    def embedded(self, end: Array) -> float:
        """Return the length of the blade's middle that lies below the surface [m], to 1 um: the truth."""
        blade = self.blade
        low, high = 0.0, blade.total
        for _ in range(30):
            middle = 0.5 * (low + high)
            x, y, z = end - middle * blade.down
            low, high = (middle, high) if z < self.slab.top(np.array(x), np.array(y)) else (low, middle)
        return 0.5 * (low + high)


def draw_slab(rng: np.random.Generator, place: Array, height: Array) -> Slab:
    """Draw the look of a slab with its top at ``height`` [m] over ``place`` [m]."""
    n = 1024
    noise = sum(
        a * gaussian_filter(rng.normal(size=(n, n)), size / _TEXEL, mode="wrap") * size / _TEXEL
        for a, size in ((1.0, 0.6e-3), (1.0, 2e-3), (0.8, 6e-3))
    )
    noise = np.asarray(noise / np.std(noise))
    fine = gaussian_filter(rng.normal(size=(n, n)), 3.0, mode="wrap")
    slopes = np.gradient(fine / np.std(fine) * rng.uniform(0.05, 0.15))
    return Slab(
        place=place, height=height, fall=rng.uniform(0.02, 0.12), texture=np.stack([noise, *slopes]),
        gloss=rng.uniform(0.2, 0.9), shade=rng.uniform(0.22, 0.36),
    )  # fmt: skip


def draw_blade(
    rng: np.random.Generator, *, angle: float, total: float, strip: float, width: float,
    tag: NDArray[np.uint8] | None = None,
) -> Blade:  # fmt: skip
    """Draw the look and the mounting of a blade of known size [m]."""
    return Blade(
        total=total, strip=strip, width=width, angle=angle, lean=float(rng.choice([-1.0, 1.0])),
        yaw=np.radians(rng.normal(0.0, 0.5)), grain=gaussian_filter(rng.normal(size=200), 2.0) * 3.0,
        steel=rng.uniform(0.62, 0.8), tag=tag,
    )  # fmt: skip


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _on_face(start: Array, rays: Array, face: Array, blade: Blade) -> tuple[Array, Array, Array]:
    """Return where rays meet the blade's plane: along and across it from the strip's centre, and their length [m]."""
    facing = rays @ face
    reach = -(start @ face) / np.where(np.abs(facing) < 1e-9, 1e-9, facing)
    at = start + reach[..., None] * rays
    return at @ blade.down, at @ blade.across, reach
