"""Solve the model along every line that a task draws, and fit the stiffness by the place of the tip to it.

python -m scripts.derivations.lines            prints the range of bends, places and stiffness of each kind, and the fit
python -m scripts.derivations.lines --write    solves first, half a minute, and writes assets/derived/lines.json
python -m scripts.derivations.lines --fit      fits first, a second, and writes assets/derived/place_model.json
"""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from cutenv.sim.tissue import place_model
from cutenv.sim.tissue.drawn_lines import (
    KINDS,
    LEAST_LENGTH,
    MIXED_KINDS,
    OF_A_KIND,
    STORED,
    drawn_lines,
    first_of_pair,
    kind_of,
    solved_stiffness,
    store,
    stored_stiffness,
)
from cutenv.sim.tissue.grid import N_POINTS, SPACING
from cutenv.sim.tissue.lines import length_within
from cutenv.sim.tissue.place_model import TipStiffness, along_whole_line, stiffness_by_place

START = (1.8, 0.07, 0.3, 0.7, 1.0, -0.2, 0.2)  # numbers of the place model from which the fit starts


def show() -> None:
    """Print what the lines of each kind are."""
    lines, records = drawn_lines(*STORED.values())
    print("| kind | lines | least radius | farthest from the axis | steepest | stiffness along | across |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    cut = slice(0, 201)  # the longest cut that is drawn
    for kind in KINDS:
        own = [n for n in range(len(lines)) if kind_of(n) == kind]
        bends = [max(abs(lines[n].curvature[cut]).max(), 1e-9) for n in own]
        radius = [1e3 / bend for bend in bends]
        shown = "-" if kind == KINDS[0] else f"{min(radius):.0f} to {max(radius):.0f} mm"
        aside = max(1e3 * abs(lines[n].y[cut]).max() for n in own)
        steep = max(np.degrees(abs(lines[n].angle[cut]).max()) for n in own)
        along, across = (np.array([records[name][n][cut] for n in own]) for name in ("along", "across"))
        assert all(length_within(lines[n]) > 0.1 for n in own)
        print(
            f"| {kind} | {len(own)} | {shown} | {aside:.0f} mm | {steep:.0f} deg "
            f"| {along.min():.2f} to {along.max():.2f} | {across.min():.2f} to {across.max():.2f} |"
        )
    print(f"\n{OF_A_KIND} lines of each kind within the longest cut, 100 mm; stiffness over that along a straight one.")


class Tips(NamedTuple):
    """Tips of all stored lines within the length that each has in the slab."""

    x: Any  # place along the slab [m], shape (n,)
    y: Any  # place across the slab [m], shape (n,)
    kappa: Any  # stiffness along a straight cut as long as the tip is far from the clamp [1], shape (n,)
    parts: Any  # stiffness along the slab, coupled and across [1], shape (3, n)


def stored_tips() -> tuple[Tips, TipStiffness]:
    """Return every stored tip with its stiffness in the axes of the slab, and the stiffness along a straight line."""
    stored, grid = stored_stiffness(), np.arange(N_POINTS) * SPACING
    straight, tips = along_whole_line(*stored[0, 0]), []
    for (kind, number), (lengths, stiffness) in stored.items():
        if 0 < kind < len(MIXED_KINDS):  # to which the numbers were fitted
            line = first_of_pair(kind, number)
            x, y, angle = (np.interp(lengths, grid, each) for each in (line.x, line.y, line.angle))
            frames = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), -1, 0)
            turned = frames @ stiffness @ frames.swapaxes(1, 2)
            parts = np.column_stack((x, y, turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 1]))
            tips.append(parts[lengths <= LEAST_LENGTH])
    x, y, *parts = np.concatenate(tips).T
    return Tips(x, y, np.interp(x, grid, straight.along), np.array(parts)), straight


def residuals(numbers: Any, tips: Tips, straight: TipStiffness) -> Any:
    """Return by how much the place model misses each stored tip, over kappa there [1], shape (3, n)."""
    return (np.array(stiffness_by_place(numbers, tips.x, tips.y, straight)) - tips.parts) / tips.kappa


def fitted() -> Any:
    """Return the numbers that fit the stored tips best, shape (7,)."""
    tips, straight = stored_tips()
    return least_squares(lambda numbers: residuals(numbers, tips, straight).ravel(), START).x


def show_fit() -> None:
    """Print how closely the place model fits the stored tips."""
    tips, straight = stored_tips()
    misses = residuals(place_model.fitted_numbers(), tips, straight)
    root_mean_square = ", ".join(f"{100 * each:.2f} %" for each in np.sqrt((misses**2).mean(axis=1)))
    print(f"\nc1 to c7 of the place model: {', '.join(f'{each:.4g}' for each in place_model.fitted_numbers())}")
    print(f"It misses {tips.x.size} stored tips, along, coupled, across, by {root_mean_square} of kappa (rms).")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write assets/derived/lines.json")
    parser.add_argument("--fit", action="store_true", help="write assets/derived/place_model.json")
    arguments = parser.parse_args()
    if arguments.write:
        store(solved_stiffness())
    if arguments.fit:
        place_model.store_numbers(fitted())
    show()
    show_fit()
