"""A dot pattern and a correction that others have published: the second opinion on grids and distortions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cutenv.vision.fluoroscopy import calibrate_view

cv2 = pytest.importorskip("cv2", reason="OpenCV is an extra: pip install 'cutenv[vision]'")

IMAGE = Path(__file__).parent / "images" / "dot_pattern_05.jpg"
CENTRE = np.array([588.692801577, 462.092631791])
FACTORS = (1.00227490554, -2.99523692178e-05, 8.99519088e-08, -1.57066461911e-10, 8.08880211618e-14)
"""discorpy's centre [px] and factors: a true place q about the centre is seen at q times their polynomial in |q|."""


def corrected_by_discorpy(points):
    """Invert discorpy's mapping by iteration."""
    seen = points - CENTRE
    true = seen.copy()
    for _ in range(60):
        r = np.hypot(*true.T)
        true = seen / sum(k * r**n for n, k in enumerate(FACTORS))[:, None]
    return true + CENTRE


def off_affine(points, target):
    """RMS distance from the best affine image of a target."""
    matrix = np.column_stack([target, np.ones(len(target))])
    left = points - matrix @ np.linalg.lstsq(matrix, points, rcond=None)[0]
    return float(np.sqrt((left**2).sum(axis=1).mean()))


def test_the_correction_of_a_published_image_agrees_with_the_published_one():
    image = cv2.imread(str(IMAGE), cv2.IMREAD_GRAYSCALE)
    view, fitted, holes = calibrate_view(image, 7.0, name="published", aspect=1.0, dark=True)
    assert len(holes) > 4300
    raw = off_affine(holes.place, holes.index)
    ours = view.undistort(holes.place)
    theirs = corrected_by_discorpy(holes.place)
    assert raw > 1.0
    assert off_affine(theirs, holes.index) < 0.15  # their centre and factors, our holes
    assert off_affine(ours, holes.index) < 0.1
    assert off_affine(ours, theirs) < 0.2
    assert fitted.cross_validated[fitted.distortion.model] == min(fitted.cross_validated.values())
