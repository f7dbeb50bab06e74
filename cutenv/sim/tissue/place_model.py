"""Stiffness of a crack off its drawn line, by tip place.

The stiffness of a slab with a cut depends on the place (x, y) of the tip, and hardly on how the cut came there.  In the
axes of the slab, along and across it, and with u = |y| over half its width, it is

    M = kappa(x) R(phi) diag(P1, P2) R(phi)^T,    tan phi = c1 y / (x + c2) (1 + c3 u^2),
    P1 = 1 - c4 u^2 / (c5 + u),    P2 = S(x) (1 + (c6 + c7 x / 0.1 m) u^2),

kappa and kappa S along and across a straight cut as long.  ``scripts/derivations/lines.py --fit`` fits the seven
numbers to the stored lines.  A tip that stands d to the left of a line, whose own stiffness K is solved, has

    K_tip = L K L^T,    L = chol(M(tip)) chol(M(foot))^-1,

in the axes of the line at its foot: symmetric, positive, and K itself on the line.  L is linear in d within the few
millimetres by which tips leave their line, so that the law keeps its three rates along each line.
"""

from __future__ import annotations

import json
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cutenv._base import resources
from cutenv._base.arrays import Array
from cutenv._engine.elementary import sine_and_cosine
from cutenv._engine.jit import njit_inline
from cutenv.sim.tissue.grid import N_POINTS, SPACING
from cutenv.sim.tissue.lines import WIDTH, CutLine
from cutenv.sim.tissue.tables import FOLDER

MAX_TIP_DISTANCE = (
    0.006  # distance of a tip from its line [m] up to which its stiffness changes; farther away it is kept
)
_RISE = 0.1  # length to which c7 refers [m]
_PROBE = 0.003  # distance on both sides of a line at which its rates are taken [m]
_FILE = "place_model.json"


class TipStiffness(NamedTuple):
    """Stiffness matrices [N/m], or [1], at n tip places, shape (n,)."""

    along: Array
    coupled: Array  # force along the line per displacement to its left
    across: Array


def over_straight(found: TipStiffness, base: TipStiffness) -> TipStiffness:
    """Return a line's stiffness over ``base`` of a straight one [1]."""
    return TipStiffness(*(part / base.along for part in found))


def along_whole_line(tips: Array, stiffness: Array) -> TipStiffness:
    """Interpolate the tips' stiffness, (n_tips, 2, 2), over a whole line."""
    from scipy.interpolate import PchipInterpolator

    places = np.clip(np.arange(N_POINTS) * SPACING, tips[0], tips[-1])
    between = PchipInterpolator(tips, stiffness)(places)
    return TipStiffness(between[:, 0, 0], between[:, 0, 1], between[:, 1, 1])


class OffLine(NamedTuple):
    """Rates dL/dd of lower triangular L, each shape (301,) [1/m]."""

    along: Array
    coupled: Array
    across: Array


@lru_cache(maxsize=1)
def fitted_numbers() -> tuple[float, ...]:
    """Return c1 to c7; c2 in metres."""
    return tuple(json.loads(resources.path(f"{FOLDER}/{_FILE}").read_text())["numbers"])


def store_numbers(numbers: Array) -> None:
    """Write c1 to c7 for :func:`fitted_numbers`, with six digits."""
    content = {
        "source": "least squares on the stiffness of all stored lines (assets/derived/lines.json)",
        "script": "scripts/derivations/lines.py --fit",
        "numbers": [float(f"{number:.6g}") for number in numbers],
    }
    resources.path(FOLDER).joinpath(_FILE).write_text(json.dumps(content) + "\n")


def stiffness_by_place(numbers: tuple[float, ...] | Array, x: Array, y: Array, straight: TipStiffness) -> TipStiffness:
    """Return M in the slab's axes, in the unit of ``straight``.

    ``numbers`` are c1 to c7, ``x`` and ``y`` places of the tip along and across the slab, (n,) [m], and ``straight``
    the stiffness along a straight cut, (301,).
    """
    c1, c2, c3, c4, c5, c6, c7 = numbers
    grid = np.arange(N_POINTS) * SPACING
    kappa, kappa_S = np.interp(x, grid, straight.along), np.interp(x, grid, straight.across)
    y = np.clip(y, -0.5 * WIDTH, 0.5 * WIDTH)  # beyond its end a line may leave the slab
    u = abs(y) / (0.5 * WIDTH)
    tangent = c1 * y / (x + c2) * (1.0 + c3 * u * u)
    first = kappa * (1.0 - c4 * u * u / (c5 + u))
    second = kappa_S * (1.0 + (c6 + c7 * x / _RISE) * u * u)
    return _turned(TipStiffness(first, np.zeros_like(first), second), 1.0, tangent)


def off_line(line: CutLine, straight: TipStiffness) -> OffLine:
    """Return the rates of L for :func:`stiffness_off_line`."""
    sine, cosine = sine_and_cosine(line.angle)

    def root(aside: float) -> tuple[Array, Array, Array]:
        x, y = np.maximum(line.x - aside * sine, 0.0), line.y + aside * cosine
        along, coupled, across = _turned(stiffness_by_place(fitted_numbers(), x, y, straight), cosine, -sine)
        first = np.sqrt(along)
        below = coupled / first
        return first, below, np.sqrt(across - below * below)

    first, below, second = root(0.0)
    (left_first, left_below, left_second), (right_first, right_below, right_second) = root(_PROBE), root(-_PROBE)
    along, across = (left_first - right_first) / first, (left_second - right_second) / second
    coupled = (left_below - right_below - across * below) / first
    return OffLine(*(rate / (2.0 * _PROBE) for rate in (along, coupled, across)))


@njit_inline
def stiffness_off_line(
    stiffness: tuple[float, float, float], rates: tuple[float, float, float], aside: float
) -> tuple[float, float, float]:
    """Return along, coupled, across stiffness of a tip ``aside`` [m] left.

    ``stiffness`` is that of a crack on the line, which it stays for a tip there, to the last bit.
    """
    along, coupled, across = stiffness
    d = min(max(aside, -MAX_TIP_DISTANCE), MAX_TIP_DISTANCE)
    first, below, second = 1.0 + d * rates[0], d * rates[1], 1.0 + d * rates[2]
    pulled = below * along + second * coupled
    return first * first * along, first * pulled, below * (pulled + second * coupled) + second * second * across


def _turned(stiffness: TipStiffness, cosine: Array | float, sine: Array | float) -> TipStiffness:
    """Return R K R^T of a rotation (cosine, sine), unnormalised."""
    along, coupled, across = stiffness
    square, both, other = cosine * cosine, cosine * sine, sine * sine
    length = square + other
    return TipStiffness(
        (along * square - 2.0 * coupled * both + across * other) / length,
        ((along - across) * both + coupled * (square - other)) / length,
        (along * other + 2.0 * coupled * both + across * square) / length,
    )
