"""A lens that is not the measurement's: the division model of distortion, about a centre of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class RenderedCamera:
    """Camera at ``place`` [m]; rows of ``axes``, shape (3, 3), are its right, its down and its forward direction.

    A point at distance r_u from the axis is seen at r_d, with r_u = r_d / (1 + bend r_d²) (division model); distances
    count from ``centre`` [px] over the focal length.
    """

    width: int
    height: int
    focal: float
    centre: tuple[float, float]
    bend: float
    place: Array
    axes: Array

    def rays(self, u: Array, v: Array) -> Array:
        """Return the directions, shape (..., 3), in which the pixels u, v look; not of length 1."""
        x, y = (u - self.centre[0]) / self.focal, (v - self.centre[1]) / self.focal
        shrunk = 1.0 / (1.0 + self.bend * (x * x + y * y))
        return np.stack([x * shrunk, y * shrunk, np.ones_like(x)], axis=-1) @ self.axes

    def project(self, points: Array) -> Array:
        """Return the pixels, shape (..., 2), at which points, shape (..., 3) [m], are seen."""
        x, y, z = np.moveaxis((points - self.place) @ self.axes.T, -1, 0)
        x, y = x / z, y / z
        r = np.maximum(np.hypot(x, y), 1e-9)
        # bend r_u r_d² - r_d + r_u = 0; the root that goes to r_u as the bend goes to 0
        seen = 2.0 * r / (1.0 + np.sqrt(np.maximum(1.0 - 4.0 * self.bend * r * r, 0.0)))
        return np.stack([self.focal * x * seen / r + self.centre[0], self.focal * y * seen / r + self.centre[1]], -1)

    @property
    def subpixels(self) -> tuple[Array, Array]:
        """Three by three points in every pixel, shape (height, width, 3, 3) each; a pixel's centre is whole."""
        v, u, j, i = np.ogrid[: self.height, : self.width, -1:2, -1:2]
        shape = (self.height, self.width, 3, 3)
        return np.broadcast_to(u + i / 3.0, shape), np.broadcast_to(v + j / 3.0, shape)


def draw_pair(
    rng: np.random.Generator, target: Array, *, width: int = 512, height: int = 384, field: float = 0.17
) -> list[RenderedCamera]:
    """Draw two cameras side by side that look at ``target`` [m] from +x and above; ``field`` [m] is in the image."""
    elevation, azimuth, roll = np.radians([rng.uniform(22, 38), rng.uniform(-8, 8), rng.uniform(-2, 2)])
    distance, baseline, toe = rng.uniform(0.30, 0.37), rng.uniform(0.05, 0.09), rng.uniform(0.8, 1.0)
    back = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    middle = target + distance * back
    right = np.cross(-back, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    cameras = []
    for side in (-0.5, 0.5):
        place = middle + side * baseline * right + rng.normal(0.0, 1e-3, 3)
        aimed = toe * target + (1.0 - toe) * (target + side * baseline * right) + rng.normal(0.0, 1e-3, 3)
        forward = (aimed - place) / np.linalg.norm(aimed - place)
        across = np.cross(forward, [0.0, 0.0, 1.0])
        across /= np.linalg.norm(across)
        down = np.cross(forward, across)
        turned = roll + np.radians(rng.normal(0.0, 0.3))
        axes = np.stack([
            np.cos(turned) * across + np.sin(turned) * down, np.cos(turned) * down - np.sin(turned) * across, forward
        ])  # fmt: skip
        cameras.append(
            RenderedCamera(
                width=width, height=height, focal=rng.uniform(0.97, 1.03) * width * distance / field,
                centre=(0.5 * width + rng.normal(0.0, 5.0), 0.5 * height + rng.normal(0.0, 5.0)),
                bend=rng.uniform(-0.4, 0.4), place=place, axes=axes,
            )
        )  # fmt: skip
    return cameras
