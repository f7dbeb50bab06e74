"""Frames of a video with their times, and clear errors for files that are none, or are damaged."""

from __future__ import annotations

import struct

import numpy as np
import pytest

av = pytest.importorskip("av", reason="av is an extra: pip install 'cutenv[vision]'")

from cutenv.vision.film_source import video_facts, video_frames  # noqa: E402

N, RATE = 25, 12


def _written(path, image=None, *, frames=N, turn=None, options=None, codec=(("bf", "0"), ("g", "6"))):
    """Write frames with FFmpeg's own writer: a picture again and again, or grey ones, each brighter than the last."""
    with av.open(str(path), "w", options=options or {}) as container:
        stream = container.add_stream("libx264", rate=RATE, options={"crf": "8", **dict(codec)})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        if turn is not None:
            stream.set_display_rotation(*turn)
        for k in range(frames):
            shown = np.full((48, 64), 8 * k + 20, np.uint8) if image is None else image
            container.mux(stream.encode(av.VideoFrame.from_ndarray(shown, format="gray").reformat(format="yuv420p")))
        container.mux(stream.encode(None))
    return path


@pytest.fixture(scope="module", params=["mp4", "mkv"])
def video(request, tmp_path_factory):
    return _written(tmp_path_factory.mktemp("video") / f"film.{request.param}", codec=())


def test_frames_come_in_order_with_their_times(video):
    frames = list(video_frames(video, size=(64, 48)))
    assert [frame.number for frame in frames] == list(range(N))
    assert np.allclose([frame.time for frame in frames], np.arange(N) / RATE, atol=2e-3)
    means = [float(frame.image.mean()) for frame in frames]
    assert np.all(np.diff(means) > 4.0)
    assert frames[0].image.shape == (48, 64)
    assert video_facts(video).rate == pytest.approx(RATE, rel=0.01)


def test_a_given_rate_replaces_the_times(video):
    assert [frame.time for frame in video_frames(video, rate=50.0)][:3] == [0.0, 0.02, 0.04]


def test_another_size_is_refused(video):
    with pytest.raises(ValueError, match=r"frames of 64 x 48 px, but the calibration is for 640 x 480"):
        next(video_frames(video, size=(640, 480)))


def test_a_file_that_ends_early_is_refused(video, tmp_path):
    path = tmp_path / video.name
    path.write_bytes(video.read_bytes()[: int(0.6 * video.stat().st_size)])
    with pytest.raises(ValueError, match=r"ends early|damaged|beginning or end is missing"):
        list(video_frames(path))


def _trimmed(path, start, frames):
    """Show `frames` frames from `start` on by the edit list alone, as gallery programs trim (ISO 14496-12, 8.6.6)."""
    content = bytearray(path.read_bytes())
    ticks = struct.unpack(">I", content[(place := content.index(b"mvhd") + 16) : place + 4])[0]
    scale = struct.unpack(">I", content[(place := content.index(b"mdhd") + 16) : place + 4])[0]
    place = content.index(b"elst")
    assert struct.unpack(">II", content[place + 4 : place + 12]) == (0, 1), "one edit, of 32 bits"
    edit = struct.pack(">Ii", frames * ticks // RATE, start * scale // RATE)
    content[place + 12 : place + 20] = edit
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("start", [0, 6, 8])  # 8: between two key frames
def test_a_trimmed_video_is_read_by_the_frames_that_it_shows(tmp_path, start):
    path = _trimmed(_written(tmp_path / "trimmed.mp4"), start, 12)
    frames = list(video_frames(path))
    assert len(frames) == video_facts(path).frames == 12
    assert [round((float(frame.image.mean()) - 20.0) / 8.0) for frame in frames] == list(range(start, start + 12))
    assert frames[0].time == pytest.approx(0.0, abs=1e-6)


def test_a_trimmed_video_that_lost_its_end_is_refused(tmp_path):
    path = _trimmed(_written(tmp_path / "trimmed.mp4", options={"movflags": "faststart"}), 2, 20)
    path.write_bytes(path.read_bytes()[:-900])
    with pytest.raises(ValueError, match=r"ends early, after \d+ of 20 frames|damaged"):
        list(video_frames(path))


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
@pytest.mark.parametrize("degrees", [0, 90, -90, 180])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_turned_video_is_turned(tmp_path, suffix, degrees, mirrored):
    image = np.full((48, 64), 30, np.uint8)
    image[:16, :20], image[:16, 40:] = 220, 120
    path = _written(tmp_path / f"film.{suffix}", image, frames=3, turn=(degrees, mirrored, False))
    expected = np.rot90(image, degrees // 90)  # counter-clockwise, both
    expected = expected[:, ::-1] if mirrored else expected
    (height, width), frames = expected.shape, list(video_frames(path))
    assert [next(video_frames(path, size=(width, height))).image.shape] == [(height, width)]
    assert len(frames) == 3
    assert np.abs(frames[1].image.astype(float) - expected).mean() < 6.0


def test_what_is_no_video_is_refused(tmp_path):
    path = tmp_path / "film.mp4"
    path.write_bytes(b"not a video at all" * 40)
    with pytest.raises(ValueError, match="is no video"):
        video_facts(path)
    with pytest.raises(FileNotFoundError, match="no such file"):
        video_facts(tmp_path / "missing.mp4")


def test_damaged_files_give_frames_or_a_clear_error(video, tmp_path):
    whole, rng = video.read_bytes(), np.random.default_rng(5)
    path, refused = tmp_path / video.name, 0
    for _ in range(100):
        damaged = bytearray(whole)
        for _ in range(rng.integers(1, 20)):
            damaged[rng.integers(len(whole))] = rng.integers(256)
        path.write_bytes(damaged[: rng.integers(len(whole) // 2, len(whole) + 1)])
        try:
            assert all(frame.image.ndim == 2 for frame in video_frames(path))
        except ValueError as error:
            refused += 1
            assert str(path) in str(error)  # noqa: PT017
    assert refused > 20
