"""Counter-based random numbers: Philox-4x32-10 as published; normal, and independent by key."""

from __future__ import annotations

import itertools
import math

import mpmath
import numba
import numpy as np
import pytest

from cutenv._engine import randomness
from cutenv._engine.randomness import generator, normal_at, philox

# Known answers of the Random123 library, file kat_vectors: counter, key, result.
ONES = 0xFFFFFFFF
KNOWN = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((ONES, ONES, ONES, ONES), (ONES, ONES), (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]
N = 100_000


@numba.njit
def normals(seed: int, episode: int, stream: int, count: int) -> np.ndarray:
    out = np.empty(count)
    for i in range(count):
        out[i] = normal_at(seed, episode, stream, i)
    return out


@numba.njit
def philox_in_a_kernel(k0, k1, c0, c1, c2, c3):
    return philox(k0, k1, c0, c1, c2, c3)


@pytest.mark.parametrize("rounds", [philox, philox_in_a_kernel])
@pytest.mark.parametrize(("counter", "key", "words"), KNOWN)
def test_philox_gives_the_published_answers(counter, key, words, rounds):
    assert tuple(int(w) for w in rounds(*(np.uint64(v) for v in (*key, *counter)))) == words


@pytest.mark.parametrize("place", range(6))
def test_every_bit_of_key_and_counter_matters(place):
    words = [np.uint64(v) for v in (1, 2, 3, 4, 5, 6)]
    before = philox(*words)
    words[place] ^= np.uint64(1 << 31)
    flipped = sum(int(a ^ b).bit_count() for a, b in zip(before, philox(*words), strict=True))
    assert 64 - 4 * math.sqrt(32) < flipped < 64 + 4 * math.sqrt(32)


def check_normal(z: np.ndarray) -> None:
    """Moments, tails and the distribution function within 4 standard errors."""
    n = len(z)
    for power, moment, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        assert np.mean(z**power) == pytest.approx(moment, abs=4.0 * math.sqrt(variance / n))
    for quantile in (-2.0, -1.0, 0.0, 0.5, 3.0):
        p = 0.5 * (1.0 + math.erf(quantile / math.sqrt(2.0)))
        assert np.mean(z < quantile) == pytest.approx(p, abs=4.0 * math.sqrt(p * (1.0 - p) / n))


def test_layers_of_the_ziggurat_are_of_equal_area():
    """The lowest with the tail beyond R, the topmost up to the curve's peak."""
    r = mpmath.mpf(randomness._R)
    tail = mpmath.sqrt(mpmath.pi / 2) * mpmath.erfc(r / mpmath.sqrt(2))
    assert randomness._AREA == pytest.approx(float(r * mpmath.exp(-r * r / 2) + tail), rel=1e-15)
    areas = randomness.WIDTHS[1:-1] * np.diff(randomness._HEIGHTS)[1:]
    assert areas == pytest.approx(randomness._AREA, rel=1e-12)
    assert (randomness.WIDTHS[-1], randomness._HEIGHTS[-1]) == (0.0, 1.0)


def test_numbers_are_standard_normal():
    check_normal(normals(1, 2, 3, N))


def test_other_distributions_fail_the_check():
    rng = np.random.default_rng(0)
    for broken in (
        rng.uniform(-math.sqrt(3), math.sqrt(3), N),
        1.02 * rng.standard_normal(N),
        rng.standard_t(8, N),
    ):
        with pytest.raises(AssertionError):
            check_normal(broken)


def test_neighbours_in_counter_stream_episode_and_seed_are_independent():
    z = normals(1, 2, 3, N)
    others = [
        normals(2, 2, 3, N),
        normals(1, 3, 3, N),
        normals(1, 2, 4, N),
        normals(2, 1, 3, N),
        np.roll(z, 1),
    ]
    for one, two in itertools.combinations([z, *others], 2):
        assert abs(np.mean(one * two)) < 4.0 / math.sqrt(N)
        assert abs(np.mean(one**2 * two**2) - 1.0) < 4.0 * math.sqrt(8.0 / N)


def test_a_number_is_a_pure_function_of_its_key():
    z = normals(5, 6, 7, 100)
    assert [normal_at(5, 6, 7, i) for i in (99, 3, 3, 50)] == z[[99, 3, 3, 50]].tolist()


def test_seed_and_episode_count_to_their_64th_bit():
    high = 1 << 63
    values = {normal_at(np.uint64(s), np.uint64(e), 0, 0) for s in (1, 1 + high) for e in (1, 1 + high, 1 + (1 << 32))}
    assert len(values) == 6


def test_generators_are_keyed_and_not_sequenced():
    first = generator(3, 4).standard_normal(5)
    generator(3, 5).standard_normal(100)
    assert np.array_equal(generator(3, 4).standard_normal(5), first)
    assert len({generator(s, e).random() for s in range(20) for e in range(20)}) == 400


@pytest.mark.parametrize(("seed", "episode", "named"), [(-1, 0, "seed"), (0, -1, "episode"), (2**64, 0, "seed")])
def test_seeds_out_of_range_are_refused_by_name(seed, episode, named):
    with pytest.raises(ValueError, match=rf"{named} = -?\d+ is outside"):
        generator(seed, episode)
