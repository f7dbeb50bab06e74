"""The blade's edge: how far it leans, and what turning it upright cuts."""

from __future__ import annotations

import math

from cutenv.compiled import inlined

_QUARTER, _HALF = 0.25 * math.pi, 0.5 * math.pi
_REST = 6.123233995736766e-17  # of pi/2, which a float does not hold
_S3, _S5, _S7, _S9, _S11, _S13, _S15 = ((-1.0) ** (n // 2) / math.factorial(n) for n in range(3, 16, 2))
_C4, _C6, _C8, _C10, _C12, _C14, _C16 = ((-1.0) ** (n // 2) / math.factorial(n) for n in range(4, 17, 2))


@inlined
def cotangent(angle: float) -> float:
    """The cotangent of ``angle`` [rad], -45 to 225 degrees, within 3 units in the last place.

    By Taylor's series of sine and cosine, up to 45 degrees, where the terms left out are below 1e-16: nothing but
    arithmetic, so that a row of blades turns in vector instructions, and alike on every machine.  A library's tangent
    is called for one after the other.
    """
    from_upright = (_HALF - angle) + _REST
    beyond = from_upright < 0.0
    from_flat = (2.0 * _HALF - angle) + 2.0 * _REST if beyond else angle
    flat = from_flat < _QUARTER
    v = from_flat if flat else abs(from_upright)
    z = v * v
    s = v + v * z * (_S3 + z * (_S5 + z * (_S7 + z * (_S9 + z * (_S11 + z * (_S13 + z * _S15))))))
    c = 1.0 - 0.5 * z + z * z * (_C4 + z * (_C6 + z * (_C8 + z * (_C10 + z * (_C12 + z * (_C14 + z * _C16))))))
    ratio = (c if flat else s) / (s if flat else c)
    return -ratio if beyond else ratio


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
