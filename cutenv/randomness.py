"""Counter-based random numbers: the value at (seed, stream, counter) is a pure function of the three.

Sequential generators make a batch depend on the order in which its members are drawn.  Philox-4x32-10 (Salmon,
Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011) has no state to share, so batched and
single draws agree, and it runs on any device.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cutenv.compiled import compiled

_WORD = np.uint64(0xFFFFFFFF)
_SHIFT = np.uint64(32)
_MULTIPLIER_0, _MULTIPLIER_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL_0, _WEYL_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_ROUNDS = 10


@compiled
def philox(
    key_0: np.uint64, key_1: np.uint64, c0: np.uint64, c1: np.uint64, c2: np.uint64, c3: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Philox-4x32-10: four 32-bit words (held in uint64) from a 2-word key and a 4-word counter."""
    for _ in range(_ROUNDS):
        p0 = _MULTIPLIER_0 * c0
        p1 = _MULTIPLIER_1 * c2
        c0, c1, c2, c3 = (p1 >> _SHIFT) ^ c1 ^ key_0, p1 & _WORD, (p0 >> _SHIFT) ^ c3 ^ key_1, p0 & _WORD
        key_0 = (key_0 + _WEYL_0) & _WORD
        key_1 = (key_1 + _WEYL_1) & _WORD
    return c0, c1, c2, c3


@compiled
def normal_at(seed: int, episode: int, stream: int, counter: int) -> float:
    """One standard normal number for (seed, episode, stream, counter), by the Box-Muller transform."""
    s = np.uint64(seed)
    e = np.uint64(episode)
    w0, w1, w2, w3 = philox(
        s & _WORD, s >> _SHIFT, np.uint64(counter) & _WORD, e & _WORD, e >> _SHIFT, np.uint64(stream) & _WORD
    )
    # 53 bits each; the first lies in (0, 1] so that the logarithm is finite.
    u = (float((w0 << np.uint64(21)) | (w1 >> np.uint64(11))) + 1.0) * 2.0**-53
    phase = float((w2 << np.uint64(21)) | (w3 >> np.uint64(11))) * 2.0**-53
    return math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * phase)


def generator(seed: int, episode: int = 0) -> np.random.Generator:
    """A NumPy generator for one episode, keyed (not sequenced) by ``seed`` and ``episode``.

    Parameters
    ----------
    seed, episode : int
        Non-negative, below 2**64.

    Raises
    ------
    ValueError
        If either is negative or too large.
    """
    for name, value in (("seed", seed), ("episode", episode)):
        if not 0 <= int(value) < 2**64:
            raise ValueError(f"{name} = {value} is outside 0 to 2**64 - 1. Give a non-negative integer.")
    key: NDArray[np.uint64] = np.array([seed, episode], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key))
