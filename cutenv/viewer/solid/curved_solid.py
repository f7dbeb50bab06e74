"""Slab with cuts along any curve as a solid: the elements of its model, displaced, and extruded to the depth of cut."""

from __future__ import annotations

from collections import Counter
from functools import cached_property

import numpy as np

from cutenv._base.arrays import Array
from cutenv.tissue.lines import WIDTH
from cutenv.viewer import palette
from cutenv.viewer.solid.curved_cut import CurvedCut
from cutenv.viewer.solid.solids import Surface

_ABOVE = 2.5e-4  # the upper face, at which lines are drawn [m]


class CurvedSolid:
    """Slab that was cut along any curve, as surfaces and lines.

    Parameters
    ----------
    cut : CurvedCut

    Attributes
    ----------
    depth : float
        Mean depth of cut, to which the slab is drawn [m].
    """

    width = WIDTH

    def __init__(self, cut: CurvedCut) -> None:
        self.depth = cut.depth
        self._rest = [_seen(outline) for outline in cut.rest]
        self._moved = [_seen(outline) for outline in cut.moved]
        self._line = None if cut.line is None else _seen(cut.line)

    @cached_property
    def skins(self) -> dict[str, Surface]:
        """Surfaces by name: top, bottom, rim, and the faces of the cuts."""
        edges: dict[str, list[Array]] = {"rim": [], "faces": []}
        shared = Counter(key for outline in self._rest for key in _edges(outline))
        joined = Counter(key for outline in self._moved for key in _edges(outline))
        for rest, moved in zip(self._rest, self._moved, strict=True):
            ends = zip(moved, np.roll(moved, -1, axis=0), strict=True)
            for own, drawn, (one, other) in zip(_edges(rest), _edges(moved), ends, strict=True):
                if joined[drawn] == 1:
                    edges["rim" if shared[own] == 1 else "faces"].append(np.stack((one, other)))
        skins = {name: self._walls(np.array(found).reshape(-1, 2, 2)) for name, found in edges.items()}
        return skins | {"top": self._level(self.depth), "bottom": self._level(0.0)}

    @cached_property
    def lines(self) -> Array:
        """Ends of the edges of the elements in the upper face, shape (2 n, 3) [m]."""
        ends = np.concatenate([np.stack((m, np.roll(m, -1, axis=0)), axis=1).reshape(-1, 2) for m in self._moved])
        return self._above(ends)

    @cached_property
    def wanted(self) -> Array | None:
        """Ends of the pieces of the line that was to be cut, over the upper face, shape (2 n, 3) [m]; None without."""
        if self._line is None:
            return None
        return self._above(np.stack((self._line[:-1], self._line[1:]), axis=1).reshape(-1, 2))

    def colours(self, surface: Surface) -> Array:
        """Return the colour of each vertex by the displacement of its place, shape (n, 3), 0 to 1."""
        amounts = np.hypot(*(np.concatenate(self._moved) - np.concatenate(self._rest)).T)
        known: dict[tuple[float, ...], float] = {}
        for place, amount in zip(np.concatenate(self._moved), amounts, strict=True):
            known.setdefault(_key(place), float(amount))
        shade = np.array([known[_key(vertex[:2])] for vertex in surface.vertices]) / max(float(amounts.max()), 1e-9)
        table = np.array(palette.TISSUE) / 255.0
        colours: Array = table[np.rint(shade * (len(table) - 1)).astype(int)]
        return colours

    def _above(self, places: Array) -> Array:
        return np.column_stack((places, np.full(len(places), self.depth + _ABOVE)))

    def _level(self, height: float) -> Surface:
        parts = []
        for outline in self._moved:
            fan = [[0, k, k + 1] for k in range(1, len(outline) - 1)]
            vertices = np.column_stack((outline, np.full(len(outline), height)))
            parts.append(Surface(vertices=vertices, faces=np.array(fan)))
        return Surface.joined(*parts)

    def _walls(self, edges: Array) -> Surface:
        heights = np.array([0.0, 0.0, self.depth, self.depth])
        corners = edges[:, [0, 1, 1, 0]]
        vertices = np.concatenate((corners, np.broadcast_to(heights[:, np.newaxis], (len(edges), 4, 1))), axis=2)
        faces = 4 * np.arange(len(edges))[:, np.newaxis, np.newaxis] + np.array([[0, 1, 2], [0, 2, 3]])
        return Surface(vertices=vertices.reshape(-1, 3), faces=faces.reshape(-1, 3))


def _seen(outline: Array) -> Array:
    """Return places (along, left) as (across to the right, along)."""
    return np.column_stack((-outline[:, 1], outline[:, 0]))


def _key(place: Array) -> tuple[float, ...]:
    return tuple(np.round(place, 9) + 0.0)


def _edges(outline: Array) -> list[frozenset[tuple[float, ...]]]:
    """Return the edges of an element as pairs of places."""
    keys = [_key(place) for place in outline]
    return [frozenset((keys[k], keys[(k + 1) % len(keys)])) for k in range(len(keys))]
