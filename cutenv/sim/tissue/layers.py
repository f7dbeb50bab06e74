"""Layers of a slab: a capsule, the measured tissue, another tissue below."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cutenv._base.arrays import Struct
from cutenv._base.validation import check_parameters, in_range, parameter
from cutenv._engine.jit import njit_inline


@dataclass(frozen=True, kw_only=True)
class Layers:
    """Toughness and modulus of layers relative to measured tissue (assumed).

    The default is one tissue throughout.  Published resistances to a blade, in J/m2: liver 187 to 225, lamina propria
    169 to 451, aorta 290, muscle 550 to 8000, chicken skin 2800, porcine skin 1136 to 20400: a layer's toughness is not
    known to a factor of ten, so sweep it.
    """

    capsule_thickness: float = parameter(
        0.0, unit="m", low=0.0, high=0.005, provenance="assumed", source="off; a liver's capsule is 0.1 mm thick",
        sensitivity=(0.0, 0.5e-3),
    )  # fmt: skip
    capsule_toughness: float = parameter(
        1.0, unit="1", low=0.01, high=100.0, provenance="assumed", source="of a membrane, over that of the tissue",
        sensitivity=(1.0, 20.0),
    )  # fmt: skip
    capsule_modulus: float = parameter(
        1.0, unit="1", low=0.01, high=100.0, provenance="assumed", source="of a membrane, over that of the tissue",
        sensitivity=(1.0, 20.0),
    )  # fmt: skip
    boundary: float = parameter(
        0.1, unit="m", low=0.0, high=0.1, provenance="assumed", source="depth of the layer below; off: below any slab",
        sensitivity=(0.005, 0.02),
    )  # fmt: skip
    deep_toughness: float = parameter(
        1.0, unit="1", low=0.01, high=100.0, provenance="assumed", source="of the layer below, over that of the tissue",
        sensitivity=(0.3, 10.0),
    )  # fmt: skip
    deep_modulus: float = parameter(
        1.0, unit="1", low=0.01, high=100.0, provenance="assumed", source="of the layer below, over that of the tissue",
        sensitivity=(0.3, 10.0),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("boundary", self.boundary, self.capsule_thickness, 0.1, "m", "Give a depth below the capsule.")


LAYER_REACH = 0.0011
"""Length below a blade's lower end over which its surroundings lose influence [m] (``scripts/derivations/layers.py``).
"""


@njit_inline
def toughness_within(layers: Struct, depth: float) -> float:
    """Return the relative toughness [1] at ``depth`` [m] below the surface."""
    if depth < layers.capsule_thickness:
        return layers.capsule_toughness  # type: ignore[no-any-return]
    if depth > layers.boundary:
        return layers.deep_toughness  # type: ignore[no-any-return]
    return 1.0


@njit_inline
def summed_toughness(layers: Struct, depth: float) -> float:
    """Return relative toughness integrated from the surface to ``depth`` [m], exact in like layers."""
    capsule, deep = min(depth, layers.capsule_thickness), max(depth - layers.boundary, 0.0)
    total: float = depth + ((layers.capsule_toughness - 1.0) * capsule + (layers.deep_toughness - 1.0) * deep)
    return total


@njit_inline
def layered_depth(layers: Struct, depth: float, effective: float) -> float:
    """Return a layered slab's effective depth [m], from a uniform one's.

    That is T g [m].  The blade engages each layer down to ``depth`` [m] in proportion to its modulus.  The rest, T g -
    D, is what the tissue at and below its lower end adds.  Its modulus is a mean of the layers there: each weighs as it
    is near, by the function 1/(1 + z/r) of the length z below the blade, and the mean is that of the fourth roots, as
    stiff tissue behind soft tissue adds less than in proportion.  It is exactly ``effective`` where the layers are
    alike.
    """
    return layered_depth_by(layers, depth, effective, LAYER_REACH)


@njit_inline
def layered_depth_by(layers: Struct, depth: float, effective: float, reach: float) -> float:
    """Return :func:`layered_depth` with another ``reach`` r [m]."""
    capsule, deep = layers.capsule_modulus, layers.deep_modulus
    if capsule == 1.0 and deep == 1.0:
        return effective
    over = max(layers.capsule_thickness - depth, 0.0)  # length to the end of the capsule
    above = layers.boundary - depth  # length to the layer below
    engaged = depth + (capsule - 1.0) * min(depth, layers.capsule_thickness) + (deep - 1.0) * max(-above, 0.0)
    root = 1.0
    if capsule != 1.0:
        root += (_fourth_root(capsule) - 1.0) * (over / (over + reach))
    if deep != 1.0:
        root += (_fourth_root(deep) - 1.0) * (reach / (max(above, 0.0) + reach))
    square = root * root
    return engaged + (effective - depth) * (square * square)  # type: ignore[no-any-return]


@njit_inline
def _fourth_root(value: float) -> float:
    return math.sqrt(math.sqrt(value))
