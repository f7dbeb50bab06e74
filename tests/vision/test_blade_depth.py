"""Depth of cut on a rendered film: close to the truth, spoilt frames left out, what does not belong refused."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

pytest.importorskip("cv2", reason="cv2 is an extra: pip install 'cutenv[vision]'")
pytest.importorskip("av", reason="av is an extra: pip install 'cutenv[vision]'")

import cv2

from cutenv.records.measurement import estimate_fracture_resistance
from cutenv.records.measurement.depth import depth_sd
from cutenv.records.scoring import score
from cutenv.vision.blade_mark import MarkedBlade, UnusableFrame
from cutenv.vision.depth_record import filmed_depth
from cutenv.vision.film_source import VideoFrame
from cutenv.vision.marked_blade import BladeCameras

BLADE = MarkedBlade()


def frames_of(filmed, cameras, change=lambda image: image):
    width = cameras.frame_size[0]
    images = (change(image[:, :width]) for image in filmed.frames)
    return [VideoFrame(k, t, image) for k, (t, image) in enumerate(zip(filmed.film.time, images, strict=True))]


@pytest.fixture(scope="module")
def measured(filmed):
    """The film, measured with two cameras and with one."""
    return {
        name: list(BladeCameras(cameras, BLADE).measure_all(frames_of(filmed, cameras)))
        for name, cameras in (("pair", filmed.pair), ("one", filmed.one))
    }


@pytest.mark.parametrize(("name", "rms", "bias"), [("pair", 0.3, 0.1), ("one", 0.4, 0.3)])
def test_depth_and_time_are_those_of_the_film(filmed, measured, name, rms, bias):
    depth = filmed_depth(measured[name], filmed.trace, BLADE)
    used = [frame.number for frame in depth.frames if frame.blade is not None]
    error = 1e3 * (depth.vertical - filmed.film.vertical[used])
    assert np.sqrt(np.mean(error**2)) < rms
    assert abs(error.mean()) < bias
    assert abs(depth.alignment.lag - filmed.film.lag) < 0.01
    assert np.allclose(depth.along * math.sin(math.pi / 4), depth.vertical)
    assert depth.alignment.angle == pytest.approx(math.pi / 4, abs=math.radians(1.0))
    assert len(used) > 0.7 * (len(filmed.film.spoilt) - sum(map(bool, filmed.film.spoilt)))


def test_spoilt_frames_are_left_out_with_a_reason(filmed, measured):
    spoilt = [k for k, kind in enumerate(filmed.film.spoilt) if kind]
    assert spoilt
    depth = filmed_depth(measured["pair"], filmed.trace, BLADE)
    for k in spoilt:
        assert depth.frames[k].blade is None
        assert depth.frames[k].reason
    assert sum(depth.left_out.values()) == len(filmed.frames) - len(depth.time)


def test_the_record_gets_depth_and_standard_deviation_which_are_used(filmed, measured):
    depth = filmed_depth(measured["pair"], filmed.trace, BLADE)
    trace = depth.onto(filmed.trace)
    assert trace.metadata["name"] == "cut"
    assert depth_sd(trace) == depth.sd
    inside = (trace.time > depth.time[0]) & (trace.time < depth.time[-1])
    truth = np.interp(trace.time, filmed.film.time + filmed.film.lag, filmed.film.vertical)
    assert np.abs(trace.depth - truth)[inside].max() < 1.5e-3
    wider = dataclasses.replace(trace, metadata={**trace.metadata, "depth_sd_m": 2.0 * depth.sd})
    errors = [estimate_fracture_resistance(each).depth_error for each in (trace, wider)]
    assert errors[1] == pytest.approx(2.0 * errors[0])
    assert estimate_fracture_resistance(dataclasses.replace(trace, metadata={})).depth_error is None
    assert any("depth of cut measured to" in note for note in score(trace).notes)


def test_a_standard_deviation_that_is_none_is_refused(filmed):
    bad = filmed.trace.with_metadata({"depth_sd_m": 0.3})
    with pytest.raises(ValueError, match=r"depth_sd_m = 0.3 m is outside 0 to 0.02 m"):
        depth_sd(bad)


@pytest.mark.parametrize("rows", [1, -1])
def test_images_that_are_mirrored_or_turned_are_refused(rows, filmed):
    changed = frames_of(filmed, filmed.one, lambda image: np.ascontiguousarray(image[::rows, ::-1]))
    frames = list(BladeCameras(filmed.one, BLADE).measure_all(changed))
    with pytest.raises(ValueError, match=r"mirrored or turned|points down in the image"):
        filmed_depth(frames, filmed.trace, BLADE)


def test_a_camera_on_the_other_side_is_said_by_travel(filmed, measured):
    with pytest.raises(ValueError, match=r"goes to the right in the images when it cuts, not to the left"):
        filmed_depth(measured["pair"], filmed.trace, BLADE, travel="left")


def test_halves_that_are_exchanged_lie_behind_the_cameras(filmed):
    image = np.hstack([filmed.frames[8][:, 320:], filmed.frames[8][:, :320]])
    with pytest.raises(UnusableFrame, match=r"behind the cameras|do not see the same|seems"):
        BladeCameras(filmed.pair, BLADE).measure(image)


def test_another_calibration_is_told_by_the_strip(filmed):
    far = dataclasses.replace(filmed.pair.second, translation=1.5 * filmed.pair.second.translation)
    other = dataclasses.replace(filmed.pair, second=far)
    frames = list(BladeCameras(other, BLADE).measure_all(frames_of(filmed, filmed.pair)[:12]))
    with pytest.raises(ValueError, match=r"the strip seems 6\.\d mm long and not 4"):
        filmed_depth(frames, filmed.trace, BLADE)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda trace: {"position": 0.02 * np.sin(trace.time) ** 2}, "motion in the film is not that of the record"),
        (
            lambda trace: {"angle": np.full(len(trace), math.radians(60.0))},
            r"stands at 4\d\.\d degrees in the film and 60.0 in the record",
        ),
        (lambda trace: {"position": None}, "depth needs position"),
    ],
)
def test_the_record_of_another_cut_or_without_position_is_refused(filmed, measured, change, said):
    with pytest.raises(ValueError, match=said):
        filmed_depth(measured["pair"], dataclasses.replace(filmed.trace, **change(filmed.trace)), BLADE)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda frames: [frame._replace(time=2.0 * frame.time) for frame in frames], "its rate is wrong"),
        (lambda frames: frames[:14], r"no frame is usable from \d+ to \d+ mm|motion in the film"),
    ],
)
def test_a_film_at_a_wrong_rate_or_of_half_of_the_cut_is_refused(filmed, measured, change, said):
    with pytest.raises(ValueError, match=said):
        filmed_depth(change(measured["pair"]), filmed.trace, BLADE)


@pytest.fixture(scope="module")
def tagged(filmed):
    """Film of a blade with tag 7 in place of the strip, and its frames."""
    tag = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 7, 6)
    film = filmed.render(rate=2.0, spoilt=0.0, strip=0.006, tag=tag)
    return film, list(film.frames())


def test_a_tag_does_what_a_strip_does(filmed, tagged):
    film, frames = tagged
    measure = BladeCameras(filmed.pair, MarkedBlade(strip=0.006, tag=7)).measure
    error = 1e3 * (0.0425 - np.array([measure(image).exposed for image in frames]) - film.along)
    assert np.sqrt(np.mean(error**2)) < 0.3
    assert abs(error.mean()) < 0.1


def test_another_tag_and_two_alike_are_told(filmed, tagged):
    frames, cameras = tagged[1], filmed.pair
    with pytest.raises(UnusableFrame, match="the tag is not seen"):
        BladeCameras(cameras, MarkedBlade(strip=0.006, tag=8)).measure(frames[4])
    blade = MarkedBlade(strip=0.006, tag=7)
    u, v = np.rint(BladeCameras(cameras, blade).measure(frames[4]).view.strip).astype(int)
    doubled, size, to = frames[4].copy(), 14, 60 if u > 160 else 250
    doubled[60 - size : 60 + size, to - size : to + size] = frames[4][v - size : v + size, u - size : u + size]
    with pytest.raises(UnusableFrame, match="two tags are seen"):
        BladeCameras(cameras, blade).measure(doubled)


@pytest.mark.parametrize("given", [{"tag": 50}, {"tag": 3, "strip": 0.008}])
def test_a_tag_that_does_not_fit_is_refused(given):
    with pytest.raises(ValueError, match=r"tag = 50 is outside 0 to 49|is the side of a tag on a blade 0.008 m wide"):
        MarkedBlade(**given)


def test_two_strips_are_not_told_apart_by_guessing(filmed):
    sound = next(k for k, kind in enumerate(filmed.film.spoilt) if not kind)
    image = filmed.frames[sound][:, :320]
    view = BladeCameras(filmed.one, BLADE).measure(image).view
    u, v = np.rint(view.strip).astype(int)
    doubled, size = image.copy(), 16
    to = 60 if u > 160 else 250
    doubled[v - size : v + size, to - size : to + size] = image[v - size : v + size, u - size : u + size]
    with pytest.raises(UnusableFrame, match="two strips are seen"):
        BladeCameras(filmed.one, BLADE).measure(doubled)


def test_noise_alone_shows_no_blade(filmed):
    image = np.random.default_rng(1).integers(0, 256, (240, 320)).astype(np.uint8)
    with pytest.raises(UnusableFrame):
        BladeCameras(filmed.one, BLADE).measure(image)
