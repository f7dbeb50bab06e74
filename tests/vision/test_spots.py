"""Spots are found and placed as well as their noise admits."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.vision.spots import checked_image, locate_spots

NOISE = 6.0


def field_of(snr, seed=0, size=1.4):
    """An image of 88 dark spots on a slope, and their places."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:300, :400].astype(float)
    true = np.array([(30 + 33 * i, 30 + 33 * j) for i in range(11) for j in range(8)]) + rng.uniform(-3, 3, (88, 2))
    image = 140.0 + 0.05 * x
    for u, v in true:
        image -= snr * NOISE * np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2.0 * size**2))
    return np.clip(np.round(image + NOISE * rng.normal(size=image.shape)), 0, 255).astype(np.uint8), true


def matched(spots, true):
    away = np.hypot(*(spots.place[None] - true[:, None]).transpose(2, 0, 1))
    near = away.argmin(axis=1)
    return near[away.min(axis=1) < 1.5], away.min(axis=1) < 1.5


@pytest.mark.parametrize("snr", [5.0, 10.0, 20.0])
def test_every_spot_is_found_and_its_error_is_near_the_bound_and_known(snr):
    image, true = field_of(snr)
    spots = locate_spots(image, 3.5, least_snr=3.0)
    which, found = matched(spots, true)
    assert found.all()
    assert len(spots) == len(true)
    error = spots.place[which] - true
    bound = np.sqrt(2.0 / np.pi) / snr
    assert np.sqrt((error**2).mean()) < 1.35 * bound
    pull = np.einsum("ni,nij,nj->n", error, np.linalg.inv(spots.covariance[which]), error)
    assert 1.3 < pull.mean() < 3.0  # two degrees of freedom
    assert np.median(spots.scatter) == pytest.approx(NOISE, rel=0.1)


def test_bright_spots_are_those_of_the_negative():
    image, _ = field_of(10.0)
    dark = locate_spots(image, 3.5)
    bright = locate_spots(255.0 - image, 3.5, dark=False)
    assert bright.place == pytest.approx(dark.place)
    assert bright.amplitude == pytest.approx(-dark.amplitude)


def test_noise_shows_no_spot():
    image = np.random.default_rng(0).normal(100.0, NOISE, (300, 400))
    assert len(locate_spots(image, 3.5)) == 0


def test_an_edge_is_no_spot():
    image = np.full((100, 100), 50.0)
    image[:, 40:] = 150.0
    image += np.random.default_rng(0).normal(0.0, 2.0, image.shape)
    assert len(locate_spots(image, 3.5)) + len(locate_spots(image, 3.5, dark=False)) == 0


def test_trackpy_finds_the_same_spots():
    trackpy = pytest.importorskip(
        "trackpy", reason="trackpy has no wheel, and set-up installs wheels alone: pip install trackpy"
    )
    image, true = field_of(15.0)
    theirs = trackpy.locate(255 - image, 7, minmass=200, engine="python")[["x", "y"]].to_numpy()
    ours = locate_spots(image, 3.5)
    away = np.hypot(*(theirs[None] - ours.place[:, None]).transpose(2, 0, 1)).min(axis=1)
    assert (away < 0.5).mean() > 0.97
    near = np.hypot(*(theirs[None] - true[:, None]).transpose(2, 0, 1)).min(axis=1)
    which, _ = matched(ours, true)
    assert np.sqrt(((ours.place[which] - true) ** 2).sum(axis=1).mean()) < 1.1 * np.sqrt((near[near < 1.5] ** 2).mean())


@pytest.mark.parametrize(
    ("image", "told"),
    [
        (np.zeros((4, 4)), "16 pixels or more"),
        (np.zeros((30, 30, 3)), "one grey image"),
        (np.full((30, 30), 7), "is 7 everywhere"),
        (np.full((30, 30), np.nan), "not finite"),
        (np.full((30, 30), "a"), "not numbers"),
    ],
)
def test_what_is_no_image_is_refused(image, told):
    with pytest.raises(ValueError, match=told):
        checked_image(image)
