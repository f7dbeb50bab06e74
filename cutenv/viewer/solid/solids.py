"""Surfaces made of triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array, Indices


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """Triangles between vertices [m]: shapes (n_vertices, 3) and (n_faces, 3)."""

    vertices: Array
    faces: Indices

    @classmethod
    def joined(cls, *surfaces: Surface) -> Surface:
        """Join several surfaces into one."""
        starts = np.cumsum([0, *(len(part.vertices) for part in surfaces)])
        return cls(
            vertices=np.concatenate([part.vertices for part in surfaces]),
            faces=np.concatenate([part.faces + start for part, start in zip(surfaces, starts, strict=False)]),
        )


def grid_faces(rows: int, columns: int) -> Indices:
    """Return the triangles of a grid of vertices numbered row by row, shape (2 (rows - 1) (columns - 1), 3)."""
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(-1, 3)


def swept(sections: Array) -> Surface:
    """Return a closed skin around successive sections, with flat ends; each quadrangle has its own vertices.

    Parameters
    ----------
    sections : ndarray of shape (n_sections, n_points, 3)
        Points [m] around each section.
    """
    around = np.concatenate([sections, sections[:, :1]], axis=1)
    quads = np.stack([around[:-1, :-1], around[1:, :-1], around[1:, 1:], around[:-1, 1:]], axis=-2).reshape(-1, 4, 3)
    parts = [_quads(quads)]
    for end in (sections[0], sections[-1]):
        fan = [[0, k, k + 1] for k in range(1, len(end) - 1)]
        parts.append(Surface(vertices=end, faces=np.array(fan)))
    return Surface.joined(*parts)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Surface:
    """Return a box between two corners [m]."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    outline = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return swept(np.array([[(x, y, z) for x, y in outline] for z in (z0, z1)]))


def _quads(quads: Array) -> Surface:
    first = 4 * np.arange(len(quads))[:, None]
    faces = np.concatenate([first + np.array(corners) for corners in ([0, 1, 2], [0, 2, 3])])
    return Surface(vertices=quads.reshape(-1, 3), faces=faces)
