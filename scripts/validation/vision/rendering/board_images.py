"""Images of a chessboard or ChArUco board, held at random before cameras, or standing in the plane of the cut."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from scripts.validation.vision.rendering.lens import Array, RenderedCamera

CORNERS = (10, 7)  # inner corners of a board, across and down


def board_image(
    camera: RenderedCamera, origin: Array, along: Array, down: Array, *, corners: tuple[int, int], square: float,
    rng: np.random.Generator, tags: NDArray[np.uint8] | None = None,
) -> NDArray[np.uint8]:  # fmt: skip
    """Render a chessboard with its first inner corner at ``origin``; ``along`` and ``down`` have length 1.

    With ``tags``, shape (n, 6, 6), 0 for black, it is a ChArUco board: they stand in its bright squares, row by row.
    """
    rays = camera.rays(*camera.subpixels)
    normal = np.cross(along, down)
    reach = ((origin - camera.place) @ normal) / (rays @ normal)
    across = camera.place - origin + reach[..., None] * rays
    u, v = (across @ along) / square, (across @ down) / square
    columns, rows = corners
    inside = (u > -1) & (u < columns) & (v > -1) & (v < rows)
    card = (u > -1.6) & (u < columns + 0.6) & (v > -1.6) & (v < rows + 0.6)
    dark = ((np.floor(u) + np.floor(v)) % 2 == 0) & inside
    if tags is not None:
        dark |= inside & _inked(u, v, columns + 1, tags)
    shade = 1.0 + 0.1 * (u / columns - 0.5) * rng.normal()
    values = np.where(card, np.where(dark, 35.0, 205.0) * shade, 90.0)
    blurred = gaussian_filter(values.mean(axis=(2, 3)), rng.uniform(0.5, 0.8))
    return np.clip(np.rint(blurred + rng.normal(0.0, 2.0, blurred.shape)), 0, 255).astype(np.uint8)


def _inked(u: Array, v: Array, columns: int, tags: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return where a tag, 0.7 of a square wide, is black."""
    column, row = np.floor(u).astype(int) + 1, np.floor(v).astype(int) + 1
    x, y = ((each % 1.0 - 0.15) / 0.7 * tags.shape[1] for each in (u, v))
    on = ((row + column) % 2 == 1) & (x >= 0) & (y >= 0) & (x < tags.shape[2]) & (y < tags.shape[1])
    number = np.where(on, (row * columns + column) // 2, 0)
    cell = np.where(on, y, 0).astype(int), np.where(on, x, 0).astype(int)
    return np.asarray(on & (tags[np.clip(number, 0, len(tags) - 1), *cell] == 0))


def held_boards(
    cameras: list[RenderedCamera], target: Array, count: int, rng: np.random.Generator, *,
    square: float, corners: tuple[int, int] = CORNERS, tags: NDArray[np.uint8] | None = None,
) -> list[NDArray[np.uint8]]:  # fmt: skip
    """Render a board held ``count`` times about ``target`` [m]; the images of the cameras stand side by side.

    A ChArUco board may be cut off by an image's border.
    """
    first, made = cameras[0], []
    beyond = 0.0 if tags is None else 0.15 * first.width
    extent = square * (np.array(corners) - 1)
    while len(made) < count:
        turn = np.radians(rng.uniform(-40, 40, 3) * (1.0, 1.0, 0.4))
        c, s = np.cos(turn), np.sin(turn)
        tilt = np.array([[1, 0, 0], [0, c[0], s[0]], [0, -s[0], c[0]]])
        swing = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
        roll = np.array([[c[2], s[2], 0], [-s[2], c[2], 0], [0, 0, 1]])
        along, down, _ = roll @ swing @ tilt @ first.axes
        middle = target + 4.4 * square * rng.uniform(-1, 1, 3) @ first.axes
        origin = middle - 0.5 * (extent[0] * along + extent[1] * down)
        outline = origin + np.array([
            i * along * (extent[0] + 2 * square) + j * down * (extent[1] + 2 * square) - square * (along + down)
            for i in (0, 1) for j in (0, 1)
        ])  # fmt: skip
        seen = [camera.project(outline) for camera in cameras]
        if all(((p > -beyond) & (p - beyond < (c.width, c.height))).all() for p, c in zip(seen, cameras, strict=True)):
            made.append(_side_by_side(cameras, origin, along, down, corners, square, rng, tags))
    return made


def standing_board(
    cameras: list[RenderedCamera], target: Array, rng: np.random.Generator, *, square: float
) -> NDArray[np.uint8]:
    """Render a board that stands in the plane of the cut, to some tenths of a millimetre, about ``target`` [m]."""
    turn = np.radians(rng.uniform(-3, 3))
    along, down = np.array([0.0, np.cos(turn), np.sin(turn)]), np.array([0.0, np.sin(turn), -np.cos(turn)])
    middle = target * (0.0, 1.0, 1.0) + (rng.normal(0.0, 2e-4), 0.0, 0.0)
    origin = middle - 0.5 * square * ((CORNERS[0] - 1) * along + (CORNERS[1] - 1) * down)
    return _side_by_side(cameras, origin, along, down, CORNERS, square, rng)


def _side_by_side(
    cameras: list[RenderedCamera], origin: Array, along: Array, down: Array, corners: tuple[int, int], square: float,
    rng: np.random.Generator, tags: NDArray[np.uint8] | None = None,
) -> NDArray[np.uint8]:  # fmt: skip
    board = {"corners": corners, "square": square, "rng": rng, "tags": tags}
    return np.hstack([board_image(each, origin, along, down, **board) for each in cameras])
