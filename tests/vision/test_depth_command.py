"""``cutenv depth``: video, calibration and record become a record with depth; bad input is told in one line."""

from __future__ import annotations

import csv

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="cv2 is an extra: pip install 'cutenv[vision]'")

from cutenv.commands.cli import main  # noqa: E402
from cutenv.display.report.film_pages import FRAME_COLUMNS  # noqa: E402
from cutenv.records import load_one, save  # noqa: E402
from cutenv.vision.cameras import CalibratedCameras  # noqa: E402


def depth(filmed, tmp_path, *more, video="left.mp4", calibration="one.json", record="cut.csv"):
    files = [filmed.folder / video, "--calibration", filmed.folder / calibration, "--record", filmed.folder / record]
    return main(["depth", *map(str, files), "--out", str(tmp_path), *more])


def test_a_film_becomes_a_record_with_depth_a_table_and_a_page(filmed, tmp_path, capsys):
    assert depth(filmed, tmp_path) == 0
    trace = load_one(tmp_path / "cut_depth.csv")
    assert 0.004 < trace.depth.min() < trace.depth.max() < 0.015
    assert 0.0 < trace.metadata["depth_sd_m"] < 5e-4
    with (tmp_path / "cut_depth_frames.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == FRAME_COLUMNS
    assert len(rows) == len(filmed.frames)
    for row in rows:
        assert bool(row["left_out"]) != bool(row["vertical_mm"])
    page = (tmp_path / "cut_depth.html").read_text(encoding="utf-8")
    assert "Depth of cut: cut" in page
    assert page.count("<img") == 2
    told = capsys.readouterr().out
    assert "left out:" in told
    assert " seen; sudden drops of the force: 0\n" in told


def test_boards_become_a_calibration(filmed, tmp_path, capsys):
    for name, image in filmed.boards:
        cv2.imwrite(str(tmp_path / name), image)
    boards = sorted(map(str, tmp_path.glob("*.png")))
    out = tmp_path / "cam.json"
    given = ["--board", "10x7", "--spacing", "5.3mm", "--stereo", "--out", str(out)]
    assert main(["depth", "--calibrate", *boards, *given]) == 0
    assert "pair: residual 0." in capsys.readouterr().out
    assert np.allclose(CalibratedCameras.load(out).cameras[0].matrix, filmed.pair.cameras[0].matrix, rtol=1e-6)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["film.mp4"], "--calibration is missing"),
        (["--calibrate", "a.png", "--spacing", "5mm"], "--board is missing; with --calibrate"),
        (["film.mp4", "--calibration", "a.json", "--record", "b.csv", "--board", "9x6"], "--board has no use"),
        (["film.mp4", "--calibration", "a.json", "--record", "b.csv"], "no such file: film.mp4"),
    ],
)
def test_options_that_do_not_fit_are_one_line(given, told, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["depth", *given]) == 2
    shown = capsys.readouterr().err
    assert told in shown
    assert shown.count("\n") == 1


def test_a_calibration_of_another_camera_is_one_line(filmed, tmp_path, capsys):
    assert depth(filmed, tmp_path, calibration="pair.json") == 2
    assert "frames of 320 x 240 px, but the calibration is for 640 x 240" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_record_with_two_cuts_is_refused(filmed, tmp_path, capsys):
    save([filmed.trace, filmed.trace], filmed.folder / "two.csv")
    assert depth(filmed, tmp_path, record="two.csv") == 2
    assert "holds 2 cuts" in capsys.readouterr().err


def test_a_video_that_ends_early_leaves_nothing_behind(filmed, tmp_path, capsys):
    whole = (filmed.folder / "left.mp4").read_bytes()
    (filmed.folder / "short.mp4").write_bytes(whole[: len(whole) // 2])
    assert depth(filmed, tmp_path, video="short.mp4") == 2
    assert "short.mp4" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
