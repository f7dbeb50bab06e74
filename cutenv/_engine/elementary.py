"""Elementary functions in plain float64 arithmetic.

Every machine computes the same bits.

The exponential, logarithm and tangent of a machine's own library differ from machine to machine in the last places,
and so would every specimen sampled with them.  Here they consist of additions, multiplications, divisions and shifts
in a fixed order, which IEEE 754 rounds alike everywhere; Numba without fast-math neither reorders nor fuses them.
They have no branches, so that loops over many numbers become vector instructions.

Kernels, and the lines that a task draws, call these instead of those in ``math`` and ``numpy``.  ``sqrt``, ``floor``
and ``copysign`` are exact in any library and are used as they are, as is ``x**2``, which Numba multiplies.  Errors are
measured against 50-digit numbers in ``tests/_engine/test_elementary.py``;
``scripts/validation/physics/same_bits.py`` compares whole cuts.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from cutenv._base.arrays import Array
from cutenv._engine.intrinsics import bits_of, float_of
from cutenv._engine.jit import njit_inline

Angle = TypeVar("Angle", float, Array)
# ln 2 in two parts: multiples of the first, up to 2^20, are exact.
_LN2_HIGH, _LN2_LOW = float.fromhex("0x1.62e42feep-1"), float.fromhex("0x1.a39ef35793c76p-33")
_PER_LN2 = float.fromhex("0x1.71547652b82fep+0")
_ROUNDING = 1.5 * 2.0**52  # added to a number below 2^51, it rounds it to an integer
_ROUNDING_BITS = 0x4338000000000000
_ONE_BITS = 0x3FF0000000000000
_ROOT_HALF_BITS = 0x3FE6A09E667F3BCD  # of sqrt(1/2)
_MIN_EXPONENT, _MAX_EXPONENT = -746.0, 710.0  # beyond these the exponential is 0 and infinite
_SUBNORMAL = 2.0**-1022
_MAX_FLOAT = float.fromhex("0x1.fffffffffffffp+1023")
_E2, _E3, _E4, _E5, _E6, _E7, _E8, _E9, _E10, _E11, _E12, _E13 = (1.0 / math.factorial(n) for n in range(2, 14))
_L3, _L5, _L7, _L9, _L11, _L13, _L15, _L17, _L19, _L21 = (2.0 / n for n in range(3, 22, 2))


@njit_inline
def _reduced(x: float) -> tuple[float, int]:
    """Return E, n with exp(x) = 2^n (1 + E).

    |E| is below 0.42, for ``x`` between -746 and 710.  Taylor series up to half of ln 2, where the omitted terms are
    below 4e-18.
    """
    rounded = x * _PER_LN2 + _ROUNDING
    n = bits_of(rounded) - _ROUNDING_BITS
    whole = rounded - _ROUNDING
    high, low = x - whole * _LN2_HIGH, whole * _LN2_LOW
    r = high - low
    further = _E8 + r * (_E9 + r * (_E10 + r * (_E11 + r * (_E12 + r * _E13))))
    beyond = r * r * (_E2 + r * (_E3 + r * (_E4 + r * (_E5 + r * (_E6 + r * (_E7 + r * further))))))
    return high - (low - beyond), n


@njit_inline
def exp(x: float) -> float:
    """Compute exp(x) within 1 ulp; infinite above 709.78, 0 below -745.13."""
    within = x if x < _MAX_EXPONENT else _MAX_EXPONENT
    within = within if within > _MIN_EXPONENT else _MIN_EXPONENT
    excess, n = _reduced(within)
    half = n >> 1  # two factors, because 2^1024 and 2^-1075 are not floats themselves
    value = (1.0 + excess) * float_of(_ONE_BITS + (half << 52)) * float_of(_ONE_BITS + ((n - half) << 52))
    return value if x == x else x


@njit_inline
def log(x: float) -> float:
    """Compute the natural logarithm, within 1 unit in the last place.

    Minus infinity at 0, NaN below.

    x = 2^n (1 + f) with f between -0.3 and 0.42; ln(1 + f) is twice the inverse hyperbolic tangent of f / (2 + f), by
    its Taylor series, whose omitted terms are below 1e-18 of it.  The parts are added in the order of K. C. Ng's
    logarithm (fdlibm, 1993), the largest last.
    """
    small = x < _SUBNORMAL
    bits = bits_of(x * 2.0**54 if small else x)
    shifts = (bits - _ROOT_HALF_BITS) >> 52
    f = float_of(bits - (shifts << 52)) - 1.0
    n = float(shifts) - (54.0 if small else 0.0)
    s = f / (2.0 + f)
    z = s * s
    further = _L13 + z * (_L15 + z * (_L17 + z * (_L19 + z * _L21)))
    series = z * (_L3 + z * (_L5 + z * (_L7 + z * (_L9 + z * (_L11 + z * further)))))
    half = 0.5 * f * f
    value = n * _LN2_HIGH - ((half - (s * (half + series) + n * _LN2_LOW)) - f)
    value = value if x <= _MAX_FLOAT else x  # infinity, or NaN
    value = value if x != 0.0 else -math.inf
    return math.nan if x < 0.0 else value


@njit_inline
def tanh(x: float) -> float:
    """Compute the hyperbolic tangent, within 3 units in the last place."""
    twice = 2.0 * abs(x)
    excess, n = _reduced(twice if twice < 44.0 else 44.0)  # from there on tanh is 1 to the last digit
    scale = float_of(_ONE_BITS + (n << 52))
    grown = scale * excess + (scale - 1.0)  # exp(2 |x|) - 1
    value = math.copysign(grown / (grown + 2.0), x)
    return value if x == x else x


_QUARTER, _HALF = 0.25 * math.pi, 0.5 * math.pi
_REST = 6.123233995736766e-17  # remainder of pi/2 beyond its float
_S3, _S5, _S7, _S9, _S11, _S13, _S15 = ((-1.0) ** (n // 2) / math.factorial(n) for n in range(3, 16, 2))
_C4, _C6, _C8, _C10, _C12, _C14, _C16 = ((-1.0) ** (n // 2) / math.factorial(n) for n in range(4, 17, 2))


@njit_inline
def _sine_and_cosine_near_0(v: Angle) -> tuple[Angle, Angle]:
    """Compute Taylor sine and cosine up to 45 degrees, within 1e-16."""
    z = v * v
    s = v + v * z * (_S3 + z * (_S5 + z * (_S7 + z * (_S9 + z * (_S11 + z * (_S13 + z * _S15))))))
    c = 1.0 - 0.5 * z + z * z * (_C4 + z * (_C6 + z * (_C8 + z * (_C10 + z * (_C12 + z * (_C14 + z * _C16))))))
    return s, c


@njit_inline
def cotangent(angle: float) -> float:
    """Compute the cotangent [rad], -45 to 225 degrees, within 3 ulp."""
    from_upright = (_HALF - angle) + _REST
    beyond = from_upright < 0.0
    from_flat = (2.0 * _HALF - angle) + 2.0 * _REST if beyond else angle
    flat = from_flat < _QUARTER
    s, c = _sine_and_cosine_near_0(from_flat if flat else abs(from_upright))
    ratio = (c if flat else s) / (s if flat else c)
    return -ratio if beyond else ratio


# pi/2 in two parts: multiples of the first, up to 2^20, are exact.
_HALF_HIGH, _HALF_LOW = float.fromhex("0x1.921fb544p+0"), float.fromhex("0x1.0b4611a626331p-34")


def sine_and_cosine(angle: Angle) -> tuple[Angle, Angle]:
    """Compute sine and cosine [rad], within 3e-16 up to 1000.

    NumPy, too, rounds sums and products alike everywhere; its own sine it does not.
    """
    quarters = (angle * (0.5 / _QUARTER) + _ROUNDING) - _ROUNDING
    s, c = _sine_and_cosine_near_0((angle - quarters * _HALF_HIGH) - quarters * _HALF_LOW)
    over = quarters - 4.0 * ((0.25 * quarters + _ROUNDING) - _ROUNDING)  # -2 to 2
    of_cosine, of_sine = 1.0 - abs(over), over * (2.0 - abs(over))  # of as many quarter turns: -1, 0 or 1
    return s * of_cosine + c * of_sine, c * of_cosine - s * of_sine


def arctangent(tangent: Array) -> Array:
    """Compute the arctangent [rad], within 4e-16.

    Halved twice it is below 23 degrees, where five terms of its Taylor series are right within 1e-5; one step of
    Halley's method corrects them.
    """
    half = tangent / (1.0 + np.sqrt(1.0 + tangent * tangent))
    w = half / (1.0 + np.sqrt(1.0 + half * half))
    z = w * w
    near = 4.0 * w * (1.0 - z * (1.0 / 3.0 - z * (0.2 - z * (1.0 / 7.0 - z * (1.0 / 9.0)))))
    s, c = sine_and_cosine(near)
    miss = (tangent * c - s) / (c + tangent * s)
    found: Array = near + (miss - miss * miss * miss / 3.0)
    return found
