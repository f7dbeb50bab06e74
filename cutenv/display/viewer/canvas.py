"""Smooth lines, areas and text, the only drawing with pygame."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv.display.viewer.palette import Colour

Points = NDArray[np.float64]

_HATCH = 7  # [px] between the lines of a hatch
_FINER = 3  # [1] factor by which areas and letters are drawn larger before they are smoothed


def import_pygame() -> ModuleType:
    """Return pygame."""
    try:
        import pygame
    except ImportError as error:
        raise ImportError('Drawing needs pygame-ce. Install it with: pip install "cutenv[view]"') from error
    return pygame


class Canvas:
    """Picture in memory of a size [px]; needs no display."""

    def __init__(self, width: int, height: int, background: Colour) -> None:
        self._pygame: Any = import_pygame()
        self._pygame.font.init()
        self.surface = self._pygame.Surface((width, height), 0, 32)
        self.surface.fill(background)
        # Numbers change with every picture; text that stays is rendered once.
        self._lettering = lru_cache(maxsize=256)(self._letter)
        self._font = lru_cache(maxsize=16)(lambda size: self._pygame.font.Font(None, size))

    def picture(self) -> NDArray[np.uint8]:
        """Return a copy as an array, shape (height, width, 3)."""
        width, height = self.surface.get_size()
        colours = self._pygame.image.tobytes(self.surface, "RGB")
        return np.frombuffer(colours, np.uint8).reshape(height, width, 3).copy()

    def paste(self, other: Canvas, left: float = 0.0, top: float = 0.0) -> None:
        """Copy another canvas onto this one."""
        self.surface.blit(other.surface, (left, top))

    def clip(self, left: float, top: float, right: float, bottom: float) -> None:
        """Restrict drawing to a rectangle until `unclip`."""
        self.surface.set_clip(self._pygame.Rect(left, top, right - left, bottom - top))

    def unclip(self) -> None:
        """Allow drawing everywhere again."""
        self.surface.set_clip(None)

    def area(self, outline: Points, colour: Colour, border: Colour | None = None, opacity: float = 1.0) -> None:
        """Fill a polygon, shape (n, 2), smoothly; ``opacity`` below 1 blends."""
        low = np.floor(outline.min(axis=0))
        size = (np.ceil(outline.max(axis=0)) - low + 1.0).astype(int)
        fine = self._pygame.Surface((_FINER * size).tolist(), self._pygame.SRCALPHA, 32)
        fine.fill((*colour, 0))
        self._pygame.draw.polygon(fine, (*colour, round(255 * opacity)), (_FINER * (outline - low)).tolist())
        self.surface.blit(self._pygame.transform.smoothscale(fine, size.tolist()), low.tolist())
        if border is not None:
            self._pygame.draw.aalines(self.surface, border, True, outline.tolist())

    def cells(self, outlines: Points, colours: Iterable[Colour]) -> None:
        """Fill many adjacent quadrilaterals, shape (n, 4, 2)."""
        draw, surface = self._pygame.draw.polygon, self.surface
        # One list at a time: thousands alive at once trigger Python's garbage collection in every picture.
        for outline, colour in zip(outlines, colours, strict=True):
            draw(surface, colour, outline.tolist())

    def line(self, points: Points, colour: Colour, width: float = 1.0) -> None:
        """Draw a smooth line through ``points``, shape (n, 2)."""
        if width <= 1.0:
            self._pygame.draw.aalines(self.surface, colour, False, points.tolist())
            return
        along = np.gradient(points, axis=0)
        along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
        side = 0.5 * width * np.stack([-along[:, 1], along[:, 0]], axis=-1)
        self.area(np.concatenate([points + side, (points - side)[::-1]]), colour)

    def dashes(self, points: Points, colour: Colour, dash: float = 6.0, width: float = 1.0) -> None:
        """Draw a dashed line through ``points``, shape (n, 2); ``dash`` in px."""
        steps = np.hypot(*np.diff(points, axis=0).T)
        run = np.concatenate([[0.0], np.cumsum(steps)])
        for start in np.arange(0.0, run[-1], 2.0 * dash):
            stations = np.array([start, min(start + dash, run[-1])])
            ends = np.stack([np.interp(stations, run, points[:, k]) for k in (0, 1)], axis=-1)
            self.line(ends, colour, width)

    def hatch(self, left: float, top: float, right: float, bottom: float, colour: Colour) -> None:
        """Fill a rectangle with slanted lines and frame it."""
        self.clip(left, top, right, bottom)
        for start in np.arange(left - (bottom - top), right, _HATCH):
            self.line(np.array([[start, bottom], [start + bottom - top, top]]), colour)
        self.unclip()
        self.line(np.array([[left, top], [right, top], [right, bottom], [left, bottom], [left, top]]), colour)

    def bar(self, left: float, top: float, right: float, bottom: float, colour: Colour) -> None:
        """Fill a rectangle."""
        box = self._pygame.Rect(round(left), round(top), round(right - left), round(bottom - top))
        self.surface.fill(colour, box)

    def disc(self, centre: Points, radius: float, colour: Colour) -> None:
        """Fill a circle."""
        t = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        self.area(centre + radius * np.stack([np.cos(t), np.sin(t)], axis=-1), colour)

    def text(
        self,
        words: str,
        at: tuple[float, float],
        *,
        size: int = 15,
        colour: Colour = (0, 0, 0),
        anchor: str = "midleft",
        upwards: bool = False,
        ground: Colour | None = None,
    ) -> None:
        """Draw ``words``; ``anchor`` names the point of their box at ``at``."""
        lettering = self._lettering(words, size, colour, upwards)
        box = lettering.get_rect(**{anchor: (round(at[0]), round(at[1]))})
        if ground is not None:
            self._pygame.draw.rect(self.surface, ground, box.inflate(8, 4), border_radius=3)
        self.surface.blit(lettering, box)

    def _letter(self, words: str, size: int, colour: Colour, upwards: bool) -> Any:
        fine = self._font(_FINER * size).render(words, True, colour)
        width, height = fine.get_size()
        lettering = self._pygame.transform.smoothscale(fine, (round(width / _FINER), round(height / _FINER)))
        return self._pygame.transform.rotate(lettering, 90) if upwards else lettering
