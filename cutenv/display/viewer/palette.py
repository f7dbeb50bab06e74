"""Colours of the picture.

Hues after Okabe and Ito, which can be distinguished with any colour vision; none has a meaning without a word or a
shape.
"""

from __future__ import annotations

import numpy as np

Colour = tuple[int, int, int]

PAPER = (255, 255, 255)
PANEL = (246, 247, 249)
RULE = (222, 225, 230)
INK = (20, 24, 30)
QUIET = (88, 96, 106)

HEADER_COLOUR = (52, 60, 70)
SUCCESS = (0, 114, 178)
FAILURE = (178, 74, 0)

TARGET = (0, 114, 178)
FORCE = (20, 24, 30)
LIMIT = (213, 94, 0)
COST_COLOUR = (230, 159, 0)
GAIN = (0, 114, 178)
LOSS = (213, 94, 0)

GAP = (66, 18, 24)
CUT_FACE = (196, 138, 122)
LAYER_BELOW = (150, 72, 60)
STEEL = (188, 198, 208)
STEEL_LIGHT = (222, 228, 234)
TIP = (255, 255, 255)
MESH = (176, 134, 116)
TISSUE_EDGE = (120, 78, 64)
_ENERGY_STOPS = ((246, 232, 222), (247, 190, 110), (226, 110, 74), (158, 44, 96), (66, 10, 84))


def _shades(pale: Colour, deep: Colour) -> list[Colour]:
    return [(red, green, blue) for red, green, blue in np.linspace(pale, deep, 64).round().astype(int).tolist()]


TISSUE = _shades((245, 226, 214), (176, 96, 78))
"""Colours of the tissue, from rest to the largest displacement; darker is more."""
ENERGY = [
    (red, green, blue)
    for red, green, blue in np.stack(
        [np.interp(np.linspace(0, 4, 64), range(5), stops) for stops in zip(*_ENERGY_STOPS, strict=True)], axis=-1
    )
    .round()
    .astype(int)
    .tolist()
]
"""Colours of the tissue by strain energy density, from none to the greatest; darker is more."""
ARROW = (213, 94, 0)
HAND = (0, 158, 115)

LIGHT: dict[str, Colour] = {
    "ink": INK,
    "paper": PAPER,
    "edge": INK,
    "quiet": QUIET,
    "rule": RULE,
    "panel": PANEL,
    "target": TARGET,
    "limit": LIMIT,
    "costs": COST_COLOUR,
    "hand": HAND,
    "handle": HEADER_COLOUR,
    "layer": LAYER_BELOW,
    "steel": STEEL,
    "light steel": STEEL_LIGHT,
    "gap": GAP,
    "cut face": CUT_FACE,
    "tip": TIP,
    "mesh": MESH,
    "tissue": TISSUE[0],
    "tissue edge": TISSUE_EDGE,
}
"""Colour of each role in the scene, on a light ground."""
DARK_TISSUE = _shades((168, 128, 112), (120, 44, 34))
"""Colours of the tissue on a dark ground, from rest to the largest displacement."""
DARK: dict[str, Colour] = LIGHT | {
    "ink": (230, 233, 237),
    "quiet": (163, 173, 184),
    "rule": (52, 60, 70),
    "panel": (27, 33, 40),
    "target": (86, 180, 233),
    "limit": (240, 145, 74),
    "steel": (143, 154, 166),
    "light steel": (176, 186, 196),
    "handle": (96, 108, 122),
    "cut face": (140, 92, 80),
    "mesh": (124, 90, 76),
    "tissue": (111, 82, 69),
    "tissue edge": (192, 154, 136),
}
"""Colour of each role in the scene, on a dark ground."""
