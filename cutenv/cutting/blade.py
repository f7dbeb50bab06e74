"""The blade's edge: how far it leans, and what turning it upright cuts."""

from __future__ import annotations

from cutenv.compiled import inlined
from cutenv.elementary import cotangent


@inlined
def leaning(angle: float) -> tuple[float, float]:
    """Lean (cotangent) and sin^2 of a blade at ``angle`` [rad]."""
    lean = cotangent(angle)
    return lean, 1.0 / (1.0 + lean**2)


@inlined
def sweeping(lean: float, next_lean: float, toughness: float, depth: float) -> float:
    """Energy [J] that turning a blade takes, from one lean to the next, in tissue of R B ``toughness`` [N].

    Toward upright, its leaning edge sweeps B^2 |d cot(theta)| / 2 and pays R for it.
    """
    return 0.5 * toughness * depth * max(lean - next_lean, 0.0)
