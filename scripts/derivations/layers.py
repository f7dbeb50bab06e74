"""Fit how far the layers below a blade's lower end reach into its stiffness, and show the error on other slabs.

    python -m scripts.derivations.layers            some minutes: 26 slabs of bricks

The slab of ``scripts/derivations/partial_depth.py`` is solved anew with layers of other moduli.  One number, the reach
of :func:`cutenv.sim.tissue.layers.layered_depth`, is fitted by least squares to some of them; the others are held out.
The exit status is 1 if the reach in use is not the fitted one.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from tqdm import tqdm

from cutenv.sim.tissue import Layers
from cutenv.sim.tissue.layers import LAYER_REACH, layered_depth_by
from cutenv.sim.tissue.slab import ROWS, THICKNESS
from scripts.derivations.partial_depth import LAYERS, stiffness_by_depth
from scripts.tables import markdown_table

Array = NDArray[np.float64]

FITTED = (  # slabs to which the reach is fitted
    Layers(capsule_thickness=0.5e-3, capsule_modulus=3.0),
    Layers(capsule_thickness=1e-3, capsule_modulus=10.0),
    Layers(capsule_thickness=2e-3, capsule_modulus=3.0),
    Layers(boundary=0.005, deep_modulus=0.3),
    Layers(boundary=0.008, deep_modulus=5.0),
    Layers(boundary=0.0125, deep_modulus=2.0),
    Layers(boundary=0.015, deep_modulus=0.3),
    Layers(boundary=0.019, deep_modulus=5.0),
)
HELD_OUT = tuple(  # slabs that the fit has not seen
    layers
    for layers in (
        *(Layers(capsule_thickness=t, capsule_modulus=m) for t, m in itertools.product((0.5e-3, 1e-3, 2e-3), (3, 10))),
        *(
            Layers(boundary=z, deep_modulus=m)
            for z, m in itertools.product((0.003, 0.005, 0.008, 0.0125, 0.015, 0.019), (0.3, 2, 5))
        ),
        Layers(capsule_thickness=0.5e-3, capsule_modulus=5.0, boundary=0.01, deep_modulus=3.0),
        Layers(capsule_thickness=1e-3, capsule_modulus=3.0, boundary=0.006, deep_modulus=0.5),
    )
    if layers not in FITTED
)
_SHALLOWEST = 2  # index of the first border from which depths are compared, 1 mm
_ROUNDED = 1e-4  # the reach in use is the fitted one to this [m]


class SlabsOfBricks:
    """Stiffness of slabs in layers over that of a uniform one, by bricks, at 15 tips and 17 depths from 1 mm on.

    ``effective``, shape (15, 17), is the effective depth T g of the uniform slab [m].
    """

    def __init__(self) -> None:
        self._uniform = stiffness_by_depth(LAYERS, np.ones(ROWS))
        self.effective = (THICKNESS * self._uniform / self._uniform[:, -1:])[:, _SHALLOWEST:]

    def ratio(self, layers: Layers) -> Array:
        """Return K by bricks of a slab in layers over that of the uniform one, shape (15, 17)."""
        centres = 0.5 * (LAYERS[1:] + LAYERS[:-1])
        moduli = np.where(centres < layers.capsule_thickness, layers.capsule_modulus, 1.0)
        moduli = np.where(centres > layers.boundary, layers.deep_modulus, moduli)
        layered = stiffness_by_depth(LAYERS, np.ones(ROWS), layer_modulus=moduli)
        return np.asarray((layered / self._uniform)[:, _SHALLOWEST:])

    def errors(self, layers: Layers, ratio: Array, reach: float) -> Array:
        """Return the error of K by a ``reach`` [m] beside the bricks' ``ratio``, shape (15, 17) [1]."""
        return ratio_by(layers, self.effective, reach) / ratio - 1.0


def ratio_by(layers: Layers, effective: Array, reach: float) -> Array:
    """Return K of a slab in layers over that of the uniform one, shape (15, 17), from its effective depths [m]."""
    depths = LAYERS[_SHALLOWEST:]
    return np.array(
        [[layered_depth_by(layers, D, T, reach) / T for D, T in zip(depths, row, strict=True)] for row in effective]
    )


def fitted_reach(effective: Array, ratios: Sequence[tuple[Layers, Array]]) -> float:
    """Return the reach [m] that fits K of slabs to their ``ratios`` by least squares of the relative error."""

    def errors(reach: Array) -> Array:
        each = [ratio_by(layers, effective, abs(float(reach[0]))) / ratio - 1.0 for layers, ratio in ratios]
        return np.concatenate([error.ravel() for error in each])

    return abs(float(least_squares(errors, [0.002], x_scale=1e-3).x[0]))


def slab_name(layers: Layers) -> str:
    """Return the layers of a slab in words."""
    parts = []
    if layers.capsule_modulus != 1.0:
        parts.append(f"a capsule of {1e3 * layers.capsule_thickness:g} mm, {layers.capsule_modulus:g} times as stiff")
    if layers.deep_modulus != 1.0:
        parts.append(f"tissue {layers.deep_modulus:g} times as stiff from {1e3 * layers.boundary:g} mm down")
    return ", and ".join(parts)


def size_of(errors: Array) -> str:
    """Return RMS and largest size of relative errors as text."""
    return f"{100 * np.sqrt(np.mean(errors**2)):.1f} % RMS, {100 * np.abs(errors).max():.0f} % at most"


def table() -> tuple[list[tuple[str, str, str]], float]:
    """Return the rows of the table: slab, its part, and the error by the reach in use; and the fitted reach [m]."""
    bricks = SlabsOfBricks()
    ratios = {layers: bricks.ratio(layers) for layers in tqdm((*FITTED, *HELD_OUT), desc="slabs of bricks")}
    reach = fitted_reach(bricks.effective, [(layers, ratios[layers]) for layers in FITTED])

    def rows() -> Iterator[tuple[str, str, str]]:
        for part, slabs in (("fitted", FITTED), ("held out", HELD_OUT)):
            errors = [bricks.errors(layers, ratios[layers], LAYER_REACH) for layers in slabs]
            for layers, each in zip(slabs, errors, strict=True):
                yield slab_name(layers), part, size_of(each)
            yield f"all {len(slabs)}", part, size_of(np.array(errors))

    return list(rows()), reach


def markdown() -> str:
    """Return the table as Markdown, with the fitted reach."""
    rows, reach = table()
    return f"{markdown_table(('slab', 'used', 'error of K'), rows)}\n\n{_sentence(reach)}"


def _sentence(reach: float) -> str:
    return f"Fitted reach: {1e3 * reach:.2f} mm; in use: {1e3 * LAYER_REACH:.2f} mm."


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args()
    rows, reach = table()
    for name, part, error in rows:
        print(f"{name:88s}{part:10s}{error}")
    print(_sentence(reach))
    sys.exit(int(abs(reach - LAYER_REACH) > _ROUNDED))
