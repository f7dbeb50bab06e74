"""The blade's edge: its inclination, and the energy that turning it upright takes."""

from __future__ import annotations

from cutenv._engine.elementary import cotangent
from cutenv._engine.jit import njit_inline


@njit_inline
def leaning(angle: float) -> tuple[float, float]:
    """Return cotangent and sin^2 of the ``angle`` [rad] of a blade."""
    lean = cotangent(angle)
    return lean, 1.0 / (1.0 + lean**2)


@njit_inline
def sweeping(lean: float, next_lean: float, toughness: float, depth: float) -> float:
    """Return the energy [J] of turning a blade from one cotangent to the next in tissue of R B ``toughness`` [N].

    Toward upright, its inclined edge sweeps B^2 |d cot(theta)| / 2 and pays R for it.
    """
    return 0.5 * toughness * depth * max(lean - next_lean, 0.0)
