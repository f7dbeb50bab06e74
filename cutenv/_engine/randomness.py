"""Counter-based random numbers.

The value at (seed, stream, counter) is a pure function of the three.

Sequential generators make a batch depend on the order in which its members are drawn.  Philox-4x32-10 (Salmon,
Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011) has no state to share, so batched and
single draws agree, and it runs on any device.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cutenv._engine.elementary import exp, log
from cutenv._engine.jit import njit, njit_inline, njit_internal

Integer: TypeAlias = int | np.integer[Any]
Key: TypeAlias = tuple[Integer, Integer]  # random key of a cut: seed and episode

# Streams: one for each use; numbers of different streams are independent.
# NumPy integers, because Numba would compile every function anew for each value of a plain Python number.
(
    SENSOR_NOISE, SENSOR_DRIFT, TASK, CUT, MODULUS_FIELD, RESISTANCE_FIELD, VESSELS, DEPTH_ERROR, VERTICAL_NOISE,
    SURFACE, LATERAL_NOISE,
) = (np.uint64(stream) for stream in range(1, 12))  # fmt: skip
CLASS_DRAW, LENGTH_DRAW, WANTED_DRAW, LINE_DRAW = np.int64(0), np.int64(1), np.int64(2), np.int64(16)
"""Counters within stream TASK: tissue class, target length, the first of those of the wanted depth, and of the line."""

_WORD = np.uint64(0xFFFFFFFF)
_SHIFT = np.uint64(32)
_MULTIPLIER_0, _MULTIPLIER_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL_0, _WEYL_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_ROUNDS = 10


@njit_inline
def philox(
    key_0: np.uint64, key_1: np.uint64, c0: np.uint64, c1: np.uint64, c2: np.uint64, c3: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Compute Philox-4x32-10: four 32-bit words (in uint64) from key and counter."""
    for _ in range(_ROUNDS):
        p0 = _MULTIPLIER_0 * c0
        p1 = _MULTIPLIER_1 * c2
        c0, c1, c2, c3 = (p1 >> _SHIFT) ^ c1 ^ key_0, p1 & _WORD, (p0 >> _SHIFT) ^ c3 ^ key_1, p0 & _WORD
        key_0 = (key_0 + _WEYL_0) & _WORD
        key_1 = (key_1 + _WEYL_1) & _WORD
    return c0, c1, c2, c3


@njit_inline
def words_at(
    seed: Integer, episode: Integer, stream: Integer, counter: Integer
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Return four 32-bit random words for (seed, episode, stream, counter)."""
    s = np.uint64(seed)
    e = np.uint64(episode)
    return philox(s & _WORD, s >> _SHIFT, np.uint64(counter) & _WORD, e & _WORD, e >> _SHIFT, np.uint64(stream) & _WORD)


@njit_internal
def uniform_at(seed: Integer, episode: Integer, stream: Integer, counter: Integer) -> float:
    """Return a uniform number in [0, 1) with 53 bits."""
    high, low, _, _ = words_at(seed, episode, stream, counter)
    return float((high << np.uint64(21)) | (low >> np.uint64(11))) * 2.0**-53


@njit_internal
def three_normals_at(seed: Integer, episode: Integer, stream: Integer, number: int) -> tuple[float, float, float]:
    """Return :func:`normal_at` of counters 4 ``number`` to 4 ``number`` + 2."""
    words, counter = words_at(seed, episode, stream, number), 4 * number
    return (
        _normal(words[0], seed, episode, stream, counter), _normal(words[1], seed, episode, stream, counter + 1),
        _normal(words[2], seed, episode, stream, counter + 2),
    )  # fmt: skip


@njit
def normal_at(seed: Integer, episode: Integer, stream: Integer, counter: Integer) -> float:
    """Return one standard normal number for (seed, episode, stream, counter)."""
    words = words_at(seed, episode, stream, counter // 4)
    return _normal(words[int(counter % 4)], seed, episode, stream, counter)


def _ziggurat() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute 256 equal-area ziggurat layers: widths, (257,), and heights.

    They are under exp(-x^2/2).  The lowest layer includes the tail beyond R; its width is that of a rectangle of the
    same area.
    """
    widths = np.zeros(_LAYERS + 1)
    widths[0], widths[1] = _AREA / exp(-0.5 * _R * _R), _R
    for i in range(1, _LAYERS - 1):
        x = float(widths[i])
        widths[i + 1] = math.sqrt(-2.0 * log(_AREA / x + exp(-0.5 * x * x)))
    return widths, np.array([exp(-0.5 * x * x) for x in widths.tolist()])


_LAYERS = 256
_R = 3.6541528853610088  # where the tail begins, such that the topmost layer closes at x = 0
_AREA = 0.004928673233974655  # of every layer: R exp(-R^2/2) and the tail, sqrt(pi/2) erfc(R/sqrt(2))
WIDTHS, _HEIGHTS = _ziggurat()
_FURTHER_WORDS = np.uint64(
    1 << 16
)  # added to a stream: further words for the few numbers that one word does not decide


@njit_internal
def _normal(word: np.uint64, seed: Integer, episode: Integer, stream: Integer, counter: Integer) -> float:
    """Turn a 32-bit word into a ziggurat standard normal number.

    8 bits are its layer, 1 its sign, 23 its position.  Marsaglia and Tsang, "The ziggurat method for generating random
    variables", J. Stat.  Softw.  5(8), 2000; with separate bits for layer and position, as Doornik (2005) recommends.
    One word decides 98.8 % of the numbers.
    """
    layer, sign, across = in_layer(word)
    x = across * float(WIDTHS[layer])
    if x < WIDTHS[layer + 1]:
        return sign * x
    return sign * normal_at_the_rim(layer, x, seed, episode, stream, counter)


@njit_inline
def in_layer(word: np.uint64) -> tuple[Integer, float, float]:
    """Split a word into layer, sign and position, 0 to 1.

    Position times width of the layer is the magnitude; it is accepted at once if below the width of the next layer.
    """
    layer = np.int64(word & np.uint64(255))
    sign = 1.0 - 2.0 * float((word >> np.uint64(8)) & np.uint64(1))
    return layer, sign, (float(word >> np.uint64(9)) + 0.5) * 2.0**-23


@njit_internal
def normal_at_the_rim(
    layer: Integer, x: float, seed: Integer, episode: Integer, stream: Integer, counter: Integer
) -> float:
    """Return the magnitude in a layer's rim by rejection sampling."""
    attempt = 0
    while True:
        w0, w1, w2, w3 = words_at(seed, episode, stream + _FURTHER_WORDS, 64 * counter + attempt)
        u = (float((w0 << np.uint64(21)) | (w1 >> np.uint64(11))) + 1.0) * 2.0**-53
        if layer == 0:  # the tail, from R on
            begins, x, height = _R, -log(u) / _R, (float(w2) + 1.0) * 2.0**-32
        else:
            begins, height = 0.0, _HEIGHTS[layer] + u * (_HEIGHTS[layer + 1] - _HEIGHTS[layer])
        if height < exp(-0.5 * x**2):
            return begins + x
        if layer != 0:
            layer = np.int64(w2 & np.uint64(255))
            x = (float(w3 >> np.uint64(9)) + 0.5) * 2.0**-23 * WIDTHS[layer]
            if x < WIDTHS[layer + 1]:
                return x
        attempt += 1


def generator(seed: int, episode: int = 0) -> np.random.Generator:
    """Return a NumPy generator keyed by ``seed`` and ``episode``, 0 to 2**64 - 1."""
    check_key(seed, episode)
    key: NDArray[np.uint64] = np.array([seed, episode], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key))


def check_key(seed: int, episode: int) -> None:
    """Raise ValueError unless ``seed`` and ``episode`` are 0 to 2**64 - 1."""
    for name, value in (("seed", seed), ("episode", episode)):
        if not 0 <= int(value) < 2**64:
            raise ValueError(f"{name} = {value} is outside 0 to 2**64 - 1. Give a non-negative integer.")
