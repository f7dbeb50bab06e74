"""Camera beside a rig: a process of its own, whose depth goes into the record, and whose death is noted there."""

from __future__ import annotations

import dataclasses
import io
import json
import shutil
import sys
import threading
import time

import numpy as np
import pytest

pytest.importorskip("cv2", reason="cv2 is an extra: pip install 'cutenv[vision]'")
pytest.importorskip("av", reason="av is an extra: pip install 'cutenv[vision]'")

from cutenv.envs.camera_process import _tell
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.records import load_one
from cutenv.rig.config.settings import CameraSettings
from cutenv.rig.devices.camera import CAMERA_NOTE, RigCamera
from cutenv.rig.operation.preflight import inspect_camera
from cutenv.vision import film_source
from cutenv.vision.film_source import newest_frames

pytestmark = pytest.mark.real_time


class Camera:
    """Emulated camera that sends numbered frames, then hangs or ends."""

    def __init__(self, frames, hangs=False, shape=(24, 32)):
        self.images = [np.full(shape, k, np.uint8) for k in range(frames)]
        self.hangs = hangs

    def read(self):
        if not self.images:
            time.sleep(1.0 if self.hangs else 0.0)
            return None
        time.sleep(0.01)
        return time.monotonic(), self.images.pop(0)


def until(condition, limit=40.0):
    deadline = time.monotonic() + limit
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert condition()


@pytest.fixture
def settings(filmed):
    """A film in place of the camera."""
    return CameraSettings(source=str(filmed.folder / "left.mp4"), calibration=str(filmed.folder / "one.json"))


def test_frames_that_come_while_one_is_measured_are_lost_and_the_end_is_told():
    seen = []

    def measure_slowly():
        for frame in newest_frames(Camera(40), (32, 24)):
            time.sleep(0.05)
            seen.append(int(frame.image[0, 0]))

    with pytest.raises(OSError, match="sends no more frames"):
        measure_slowly()
    assert seen == sorted(set(seen))
    assert 5 <= len(seen) < 20


def test_a_camera_that_hangs_is_dead(monkeypatch):
    monkeypatch.setattr(film_source, "_PATIENCE", 0.2)
    with pytest.raises(OSError, match=r"has sent no frame for 0\.2 s"):
        list(newest_frames(Camera(3, hangs=True), (32, 24)))


def test_images_of_another_size_are_refused():
    with pytest.raises(OSError, match="sends 32 x 24 px, its calibration is for 320 x 240"):
        list(newest_frames(Camera(3), (320, 240)))


def test_the_depth_goes_into_the_record_and_the_end_of_the_camera_is_noted(filmed, settings, tmp_path):
    record = shutil.copy(filmed.folder / "cut.csv", tmp_path / "cut.csv")
    camera = RigCamera(settings)
    try:
        until(lambda: camera.ended)
        assert len(camera.moments) > 20
        camera.put_depth(record)
    finally:
        camera.close()
    trace = load_one(record)
    note = trace.metadata[CAMERA_NOTE]
    assert "of them used: the depth is the camera's; the camera has ended" in note
    assert 0.0 < trace.metadata["depth_sd_m"] < 5e-4
    truth = np.interp(trace.time, filmed.film.time + filmed.film.lag, filmed.film.vertical)
    assert np.abs(trace.depth - truth).max() < 2e-3


def test_a_camera_that_is_not_there_leaves_the_record_its_depth(filmed, settings, tmp_path):
    record = shutil.copy(filmed.folder / "cut.csv", tmp_path / "cut.csv")
    camera = RigCamera(dataclasses.replace(settings, source="97"))
    try:
        until(lambda: camera.ended)
        assert camera.ended == "camera 97 does not answer"
        camera.put_depth(record)
    finally:
        camera.close()
    trace = load_one(record)
    assert trace.depth is None
    assert "the depth is the profile's" in trace.metadata[CAMERA_NOTE]
    camera.put_depth(record)  # its process is gone: nothing happens
    assert load_one(record) == trace


def test_the_check_tells_the_rate(settings):
    found = inspect_camera(settings)
    assert 5.0 < found.devices["camera"]["measured_rate_Hz"] < 11.0
    assert "frames a second are measured, 14 needed" in found.checks[0].found
    assert not found.passed


def test_a_cut_asks_the_camera_at_its_beginning_and_its_end(tmp_path):
    asked = []

    class Asked:
        def begin(self):
            asked.append("begin")

        def put_depth(self, record):
            asked.append(record)

        def close(self):
            asked.append("close")

    env = RigCutEnv(rig="fake", records=tmp_path)
    env._source._camera = Asked()
    env.reset(seed=1)
    env.step(np.array([0.5, 0.0], np.float32))
    env.close()
    assert asked == ["begin", *env.records, "close"]
    assert "did not answer" in load_one(env.records[0]).metadata[CAMERA_NOTE]


def test_frames_and_answers_do_not_break_each_others_lines(monkeypatch):
    """Both are told at the same time by two threads; the rig's program reads lines."""

    class SlowPipe(io.StringIO):
        def write(self, text):
            time.sleep(1e-3)
            return super().write(text)

    pipe = SlowPipe()
    monkeypatch.setattr(sys, "stdout", pipe)
    threads = [threading.Thread(target=lambda: [_tell({"frame": k}) for k in range(20)]) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    told = [json.loads(line)["frame"] for line in pipe.getvalue().splitlines()]
    assert sorted(told) == sorted(3 * list(range(20)))
