"""C-arm images are corrected, or refused with a picture; a calibration survives its file, and damage to it is told."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cutenv.vision.fluoroscopy import (
    DISTORTION_MODELS,
    THESIS_ERROR,
    CArmCalibration,
    CArmView,
    Distortion,
    calibrate_view,
    deinterlaced,
    fit_distortion,
)
from cutenv.vision.projection import CArm
from cutenv.vision.spots import CalibrationRefusedError, locate_grid
from scripts.validation.vision.rendering.xray import XRayCamera

SIZE = {"rows": 240, "columns": 360, "centre": (160.0, 124.0)}
STRONG = (9e-4, -0.05, 0.0)


def plate(seed=0, missing=0.05, **camera):
    rng = np.random.default_rng(seed)
    shown = XRayCamera(**SIZE, **camera)
    return shown, shown.plate(0.007, 0.0022, rng, missing=missing, turn=0.03)


@pytest.fixture(scope="module")
def swirled():
    return plate(error=STRONG, swirl=4e-7)


def test_a_grid_with_s_shape_and_missing_holes_is_straightened(swirled):
    camera, image = swirled
    view, fitted, holes = calibrate_view(image, 4.5, name="top")
    assert fitted.distortion.model == "radial_swirl"
    assert fitted.rms < 0.1
    assert len(holes) > 150
    u, v = np.meshgrid(np.linspace(15, 345, 15), np.linspace(10, 230, 12))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    found, true = view.undistort(pixels), camera.true_places(pixels)
    z, w = ((p - p.mean(axis=0)) @ (1, 1j) for p in (found, true))
    left = z - w * np.vdot(w, z) / np.vdot(w, w)  # a grid tells no scale and no turn
    assert np.sqrt((np.abs(left) ** 2).mean()) < 0.15
    assert view.seen(found) == pytest.approx(pixels, abs=0.02)


@pytest.mark.parametrize("name", ["radial_quadratic", "radial_quadratic_printed"])
@pytest.mark.parametrize("view", THESIS_ERROR)
def test_the_thesiss_errors_are_recovered(name, view):
    a, b, c = THESIS_ERROR[view]
    c *= name.endswith("printed")
    cells = np.array([(i, j) for i in range(-12, 13) for j in range(-8, 9)])
    true = cells * 24.0
    r = np.maximum(np.hypot(*true.T), 1e-9)
    seen = true * ((r + a * r**2 + b * r + c) / r)[:, None] + (330.0, 240.0)
    kept = r > 1.0  # as printed, the centre itself has no direction
    fitted = fit_distortion(seen[kept], cells[kept], name)
    assert fitted.rms < 1e-4
    # The linear term and the size of the grid are one number: compared at the grid's true size.
    scale = 24.0 / fitted.spacing
    x = np.linspace(20.0, 280.0, 30)
    assert x / scale + fitted.distortion.error(x / scale) == pytest.approx(x + a * x**2 + b * x + c, abs=0.02)


def test_the_aspect_of_the_pixels_matters(swirled):
    with pytest.raises(CalibrationRefusedError, match=r"pixels' aspect 1\.200") as refused:
        calibrate_view(swirled[1], 4.5, name="top", aspect=1.2, largest_residual=0.3, model="radial_swirl")
    picture = refused.value.picture
    assert picture.shape == (240, 360, 3)
    assert (picture == (255, 220, 0)).all(axis=2).sum() > 100  # residuals are drawn


def test_too_few_holes_are_refused_with_a_picture():
    _, image = plate()
    image = image[:120, :150]
    with pytest.raises(CalibrationRefusedError, match=r"lie on a square grid; 60 are needed") as refused:
        locate_grid(image, 4.5)
    assert refused.value.picture.shape == (120, 150, 3)
    with pytest.raises(CalibrationRefusedError, match="0 spots"):
        locate_grid(np.random.default_rng(0).normal(100.0, 3.0, (200, 200)), 4.5)


def test_a_corner_of_holes_is_refused():
    image = np.random.default_rng(0).normal(100.0, 1.0, (480, 720))
    y, x = np.mgrid[:480, :720]
    image[:180, :260] += 80.0 * (np.hypot((x + 8) % 16 - 8, (y + 8) % 16 - 8) < 3)[:180, :260]
    with pytest.raises(CalibrationRefusedError, match=r"covers 1[0-9]%"):
        locate_grid(image, 6.0, dark=False)


def test_fields_of_a_frame_at_rest_are_the_frame():
    y, x = np.mgrid[:60, :80]
    whole = 100.0 + 40.0 * np.sin(0.25 * y) * np.cos(0.2 * x)
    for first in ("top", "bottom"):
        for field in deinterlaced(whole, first):
            assert np.abs(field - whole)[4:-4].max() < 0.5
    combed = np.where(y % 2 == 0, 50.0, 90.0) + x
    earlier, later = deinterlaced(combed, "bottom")
    assert (earlier[5:-5].mean(), later[5:-5].mean()) == (90.0 + 39.5, 50.0 + 39.5)


ARM = CArm(
    isocentre=(0, 0.07, 0.01), source_to_isocentre=0.6, source_to_detector=1.0, pixel=4e-4, principal_point=(330, 240)
)


def a_view(name, angle):
    bent = Distortion(model="radial_quadratic", centre=(330.0, 240.0), scale=1.0, coefficients=(8e-5, -0.008, 0.0))
    return CArmView(name=name, shape=(480, 720), aspect=10 / 11, distortion=bent, projection=ARM.projection(angle))


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("calibration") / "carm.json"
    CArmCalibration(views=[a_view("top", 0.0), a_view("side", 1.4)], interlaced="bottom").save(path)
    return path


def test_a_calibration_survives_its_file(file):
    again = CArmCalibration.load(file)
    points = np.random.default_rng(0).uniform(20.0, 460.0, (30, 2))
    for old, new in zip([a_view("top", 0.0), a_view("side", 1.4)], again.views, strict=True):
        assert np.array_equal(old.undistort(points), new.undistort(points))
        assert np.array_equal(old.projection, new.projection)
    assert (again.interlaced, round(again.frame_rate, 2)) == ("bottom", 29.97)


def test_a_thousand_damaged_calibrations_are_read_or_refused(file, tmp_path):
    whole, told = file.read_bytes(), json.loads(file.read_text())
    rng = np.random.default_rng(0)
    path = tmp_path / "damaged.json"
    refused = 0
    for number in range(1000):
        if number % 2:
            data = bytearray(whole)
            for place in rng.integers(0, len(data), 2):
                data[place] = rng.integers(0, 256)
            damaged = bytes(data)[: rng.integers(1, len(data) + 1) if number % 4 == 1 else len(data)]
        else:
            damaged = json.dumps(spoilt(told, rng)).encode()
        path.write_bytes(damaged)
        refused += told_of(str(path), CArmCalibration.load, path)
    assert refused > 700
    assert file.read_bytes() == whole


def told_of(expected, call, *arguments):
    """Return True for a call that is refused with the expected words; any other error is one of the test."""
    try:
        call(*arguments)
    except ValueError as error:
        told = str(error)
    else:
        return False
    assert expected in told
    return True


def spoilt(value, rng):
    """The same structure with one part of it replaced by nonsense."""
    nonsense = [None, "x", -1, 1e400, [], {}, True, [[1.0]]]
    copy = json.loads(json.dumps(value))
    node = copy
    while True:
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        key = keys[rng.integers(len(keys))]
        if isinstance(node[key], (dict, list)) and node[key] and rng.random() < 0.8:
            node = node[key]
            continue
        node[key] = nonsense[rng.integers(len(nonsense))]
        return copy


def test_a_frame_of_another_camera_is_refused():
    with pytest.raises(ValueError, match=r"576 x 720 pixels, its calibration 480 x 720: it is of another camera"):
        a_view("top", 0.0).checked(np.random.default_rng(0).normal(size=(576, 720)))


def test_a_calibration_needs_two_views_with_a_geometry():
    with pytest.raises(ValueError, match="two views or more of different names"):
        CArmCalibration(views=[a_view("top", 0.0), a_view("top", 1.0)])
    flat = CArmView(name="side", shape=(480, 720), aspect=1.0, distortion=a_view("side", 1.0).distortion)
    with pytest.raises(ValueError, match="image a phantom"):
        CArmCalibration(views=[a_view("top", 0.0), flat])


def test_models_with_other_coefficients_are_refused():
    for model in DISTORTION_MODELS:
        with pytest.raises(ValueError, match="coefficients"):
            Distortion(model=model, centre=(0.0, 0.0), scale=1.0, coefficients=(1.0,))
