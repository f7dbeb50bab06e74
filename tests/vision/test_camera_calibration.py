"""Calibration from images of a board: what is rendered is found, what does not fit is refused, files survive damage."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="cv2 is an extra: pip install 'cutenv[vision]'")

from cutenv.vision.cameras import (  # noqa: E402
    CalibratedCameras,
    CalibrationBoard,
    calibrate_cameras,
    halves,
    read_image,
)
from scripts.validation.vision.rendering.board_images import held_boards  # noqa: E402

TAGS = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
PHOTOGRAPH = Path(__file__).parent / "data" / "chessboard.jpg"


def test_cameras_of_another_family_of_distortion_are_found(filmed):
    for found, true in zip(filmed.pair.cameras, filmed.film.cameras, strict=True):
        assert found.residual < 0.2
        assert found.matrix[0, 0] == pytest.approx(true.focal, rel=0.02)
    left, right = (camera.place for camera in filmed.film.cameras)
    assert np.linalg.norm(filmed.pair.second.translation) == pytest.approx(np.linalg.norm(right - left), rel=0.01)


def test_a_file_gives_back_what_was_saved(filmed, tmp_path):
    filmed.pair.save(tmp_path / "cam.json")
    again = CalibratedCameras.load(tmp_path / "cam.json")
    assert np.array_equal(again.cameras[1].matrix, filmed.pair.cameras[1].matrix)
    assert np.array_equal(again.second.rotation, filmed.pair.second.rotation)
    assert again.about == filmed.pair.about


def test_pixels_and_directions_are_inverse(filmed):
    camera = filmed.one.cameras[0]
    pixels = np.random.default_rng(1).uniform((0, 0), (320, 240), (50, 2))
    ideal = np.column_stack([camera.ideal(pixels), np.ones(50)])
    assert np.abs(camera.pixels(0.3 * ideal) - pixels).max() < 0.01
    theirs, _ = cv2.projectPoints(ideal, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    assert np.allclose(theirs.reshape(-1, 2), camera.pixels(ideal), atol=1e-9)


def test_too_few_boards_are_refused_and_the_missed_are_named(filmed):
    blank = ("blank.png", np.full((240, 320), 90, np.uint8))
    with pytest.raises(ValueError, match=r"is found in 7 images; 8 or more .* not seen whole in blank.png"):
        calibrate_cameras([*filmed.lefts[:7], blank], filmed.board, plane=filmed.lefts[0])


def test_an_image_that_does_not_fit_is_named_with_its_residual(filmed):
    name, image = filmed.lefts[4]
    v, u = np.mgrid[:240, :320].astype(np.float32)
    bent = cv2.remap(image, u + 3.0 * np.sin(v / 25.0), v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    images = [(n, bent if n == name else i) for n, i in filmed.lefts]
    with pytest.raises(ValueError, match=rf"{name}: its board lies \d\.\d\d px from where the camera should see it"):
        calibrate_cameras(images, filmed.board, plane=filmed.lefts[0])


def test_boards_all_alike_of_two_sizes_or_without_a_plane_are_refused(filmed):
    alike = [(str(k), filmed.lefts[0][1]) for k in range(9)]
    smaller = [filmed.lefts[0], ("small", filmed.lefts[1][1][::2, ::2])]
    for images, plane, said in (
        (alike, filmed.lefts[0], "differ by a tilt of 0 degrees"),
        (smaller, None, r"small is 160 x 120 px, the images before \(320, 240\)"),
        (filmed.lefts, None, "one camera needs the plane of the cut"),
    ):
        with pytest.raises(ValueError, match=said):
            calibrate_cameras(images, filmed.board, plane=plane)


def test_corners_in_a_photograph_are_where_scikit_image_finds_them():
    feature = pytest.importorskip(
        "skimage.feature", reason="scikit-image is for development: pip install 'cutenv[dev]'"
    )
    image = read_image(PHOTOGRAPH)
    ours = CalibrationBoard(columns=36, rows=25, spacing=0.005).find(image)
    assert ours is not None
    ours = ours.pixels
    theirs = feature.corner_subpix(image, np.rint(ours[:, ::-1]).astype(int), window_size=9)[:, ::-1]
    apart = np.hypot(*(ours - theirs).T)
    assert np.median(apart) < 0.2
    assert np.percentile(apart, 95) < 0.4


def test_circles_are_found_as_well(filmed):
    board = CalibrationBoard.parse("5x4", 0.01, "circles")
    image = np.full((240, 320), 230, np.uint8)
    for row in range(4):
        for column in range(5):
            cv2.circle(image, (60 + 45 * column, 50 + 45 * row), 12, 20, -1, cv2.LINE_AA)
    found = board.find(image)
    assert found is not None
    found = found.pixels
    by_row = found[np.lexsort((found[:, 0], np.rint(found[:, 1] / 20)))]
    assert np.abs(by_row[0] - (60, 50)).max() < 0.2


def test_a_charuco_board_may_be_seen_in_part(filmed):
    tags = np.stack([cv2.aruco.generateImageMarker(TAGS, k, 6) for k in range(15)])
    square, film = 0.011, filmed.film
    held = held_boards(film.cameras, film.target, 9, np.random.default_rng(5), square=square, corners=(5, 4), tags=tags)
    board = CalibrationBoard.parse("5x4", square, "charuco", 0.7 * square)
    seen = [board.find(halves(image)[0]) for image in held]
    assert any(points is not None and len(points.number) < 20 for points in seen)
    found = calibrate_cameras([(str(k), image) for k, image in enumerate(held)], board, stereo=True)
    for camera, true in zip(found.cameras, film.cameras, strict=True):
        assert camera.residual < 0.3
        assert camera.matrix[0, 0] == pytest.approx(true.focal, rel=0.02)
    left, right = (camera.place for camera in film.cameras)
    assert np.linalg.norm(found.second.translation) == pytest.approx(np.linalg.norm(right - left), rel=0.01)


@pytest.mark.parametrize("tag", [None, 0.002, 0.02])
def test_a_charuco_board_without_tags_that_fit_is_refused(tag):
    with pytest.raises(ValueError, match=r"side of a ChArUco board's tags|side of the board's tags"):
        CalibrationBoard.parse("9x6", 0.01, "charuco", tag)


@pytest.mark.parametrize("text", ["9by6", "", "2x6", "9x6x3"])
def test_a_board_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match=r"--board|columns of the board"):
        CalibrationBoard.parse(text, 0.01)


def test_a_thousand_damaged_files_are_clear_errors_or_sound(filmed, tmp_path):
    text = (filmed.folder / "pair.json").read_bytes()
    rng, path = np.random.default_rng(3), tmp_path / "cam.json"
    refused = 0
    for _ in range(1000):
        damaged = bytearray(text)
        kind = rng.integers(3)
        if kind == 0:
            damaged = damaged[: rng.integers(len(text))]
        for _ in range(rng.integers(1, 6) if kind else 0):
            damaged[rng.integers(len(damaged))] = rng.integers(256) if kind == 1 else rng.choice(list(b'0e-",[{n'))
        path.write_bytes(damaged)
        try:
            CalibratedCameras.load(path)
        except ValueError as error:
            refused += 1
            assert str(error).startswith(f"{path} is no calibration")  # noqa: PT017
    assert refused > 500


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda c: c.pop("plane"), "'plane' is missing"),
        (lambda c: c["cameras"][0].update(width="640"), "width = '640' is no size"),
        (lambda c: c["cameras"][0].update(matrix=[[1, 2], [3, 4]]), r"matrix has shape \(2, 2\)"),
        (lambda c: c["second"].update(rotation=[[1, 0, 0], [0, 1, 0], [0, 0.5, 1]]), "no rotation"),
        (lambda c: c.update(second=None), "two with the pose of the second"),
        (lambda c: c["second"].update(translation=[0, 0, 0]), "less than 1 mm"),
        (lambda c: c.update(schema="other/1"), "its schema is not"),
    ],
)
def test_a_wrong_field_is_named(change, told, filmed, tmp_path):
    content = json.loads((filmed.folder / "pair.json").read_text())
    change(content)
    (tmp_path / "cam.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=told):
        CalibratedCameras.load(tmp_path / "cam.json")


def test_a_file_that_is_no_image_is_a_clear_error(tmp_path):
    (tmp_path / "a.png").write_bytes(b"no image")
    with pytest.raises(ValueError, match=r"a.png is no image"):
        read_image(tmp_path / "a.png")
