"""Colours of the picture.

Hues after Okabe and Ito, which can be distinguished with any colour vision; none has a meaning without a word or a
shape.
"""

from __future__ import annotations

import numpy as np

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
STEEL = (188, 198, 208)
STEEL_LIGHT = (222, 228, 234)
TIP = (255, 255, 255)
MESH = (176, 134, 116)
TISSUE_EDGE = (120, 78, 64)
_ENERGY_STOPS = ((246, 232, 222), (247, 190, 110), (226, 110, 74), (158, 44, 96), (66, 10, 84))
TISSUE = [
    (red, green, blue)
    for red, green, blue in np.linspace((245, 226, 214), (176, 96, 78), 64).round().astype(int).tolist()
]
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
