"""Frames of a video with their times, and clear errors for files that are none, or are damaged."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

av = pytest.importorskip("av", reason="av is an extra: pip install 'cutenv[vision]'")

from cutenv.vision.film_source import video_facts, video_frames  # noqa: E402

N, RATE = 25, 12


@pytest.fixture(scope="module", params=["mp4", "mkv"])
def video(request, tmp_path_factory):
    """Grey frames, each brighter than the last."""
    path = tmp_path_factory.mktemp("video") / f"film.{request.param}"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(RATE), options={"crf": "8"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k in range(N):
            image = np.full((48, 64), 8 * k + 20, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")))
        container.mux(stream.encode(None))
    return path


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
