"""Beads of a rendered cut are found, matched between the views and followed; what cannot be is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cutenv.vision.bead_correspondence import linked, pairs_by_epipolar, places_from_sweep
from cutenv.vision.bead_tracks import BeadTracks, SpecimenFrame, clock_lag
from cutenv.vision.beads import find_beads, track_beads
from cutenv.vision.fluoroscopy import deinterlaced
from cutenv.vision.projection import project
from scripts.validation.vision import carm_measurement
from scripts.validation.vision.rendering.xray_session import CutHistory, Session

SPEED = 0.003  # m/s
STRIDE = 6  # frames of the video between those that are used


def ramps():
    """A cut in ramps and runs: the blade moves steadily, the tip in jumps."""
    time = np.arange(0.0, 7.0, 1e-3)
    blade = SPEED * np.maximum(time - 1.0, 0.0)
    tip = np.maximum(np.floor(blade / 0.0015) * 0.0015 - 0.0008, 0.0)
    return CutHistory(time=time, blade=blade, tip=tip, lead=blade - tip, force=400.0 * (blade - tip))


@pytest.fixture(scope="module")
def session():
    return Session.drawn(5, size=(240, 400), beads=(4, 6), divisions=(4, 8, 1), cut=ramps())


@pytest.fixture(scope="module")
def calibration(session):
    return carm_measurement.calibrated(session, np.random.default_rng(0))


@pytest.fixture(scope="module")
def rest(session, calibration):
    return carm_measurement.swept(session, calibration.views[0], np.random.default_rng(1), count=7)


@pytest.fixture(scope="module")
def film(session, calibration):
    """Times and frames of the whole cut."""
    time = 0.9 + np.arange(26) * STRIDE / calibration.frame_rate
    return time, list(session.frames(time))


def owners(session, rest):
    return cKDTree(session.rest).query(np.nan_to_num(rest, nan=9.0))[1]


def test_a_rotation_gives_every_bead_its_place(session, rest):
    place, covariance = rest
    away, owner = cKDTree(session.rest).query(place)
    assert sorted(owner) == list(range(len(session.rest)))
    assert 1e3 * np.sqrt((away**2).mean()) < 0.15
    assert np.isfinite(covariance).all()


def test_beads_are_followed_through_the_cut(session, calibration, rest, film):
    time, frames = film
    predicted = carm_measurement.predicted_by(session)
    tracks = track_beads(frames, time, calibration, rest, diameter=3.5, displacement=predicted)
    owner = owners(session, rest[0])
    off = np.array([
        place - session.places(now)[owner[bead]]
        for bead, now, place in zip(tracks.bead, tracks.time, tracks.place, strict=True)
    ])  # fmt: skip
    assert len(tracks.bead) > 0.93 * len(time) * len(owner)
    assert 1e3 * np.sqrt((off**2).sum(axis=1).mean()) < 0.1
    pull = np.einsum("ni,nij,nj->n", off, np.linalg.inv(tracks.covariance), off) / 3.0
    assert 0.3 < np.median(pull) < 2.0
    nearest = [cKDTree(session.places(now)).query(p)[1] for now, p in zip(tracks.time, tracks.place, strict=True)]
    assert np.array_equal(nearest, owner[tracks.bead])  # no identity is swapped
    hidden = tracks.metadata["hidden_share"]["side"]
    assert 0.0 < max(hidden.values()) < 0.5  # the blade passes


def test_a_frame_that_is_spoilt_and_an_early_end_are_told(calibration, rest, film):
    time, frames = film
    frames = [
        frame if number != 3 else [np.zeros_like(image) for image in frame] for number, frame in enumerate(frames)
    ]
    tracks = track_beads(frames[:6], time[:8], calibration, rest, diameter=3.5)
    left_out = tracks.metadata["left_out"]
    assert "is 0 everywhere" in left_out[f"{time[3]:.4f} s"]
    assert "after 6 of 8 frames" in left_out["end"]
    assert len(np.unique(tracks.time)) == 5


@pytest.mark.parametrize("turned", [lambda image: image[:, ::-1], lambda image: image[::-1, ::-1]])
def test_a_mirrored_or_turned_view_is_refused(calibration, rest, film, turned):
    time, frames = film
    with pytest.raises(ValueError, match=r"view '(top|side)' shows \d+ of 24 beads where the calibration"):
        track_beads([[turned(image) for image in frame] for frame in frames[:2]], time, calibration, rest, diameter=3.5)


def test_no_beads_another_camera_and_another_rate_are_refused(calibration, rest, film):
    time, frames = film
    place, covariance = rest
    with pytest.raises(ValueError, match="there are no beads"):
        track_beads(frames, time, calibration, (np.full_like(place, np.nan), covariance), diameter=3.5)
    with pytest.raises(ValueError, match="it is of another camera"):
        track_beads([[image[:-2] for image in frames[0]]], time, calibration, rest, diameter=3.5)
    with pytest.raises(ValueError, match="Which rate is wrong"):
        track_beads(frames, np.arange(26) / 25.0, calibration, rest, diameter=3.5)
    noise = np.random.default_rng(0).normal(100.0, 3.0, frames[0][0].shape)
    with pytest.raises(ValueError, match="shows no bead"):
        find_beads(noise, calibration.views[0], 3.5)
    with pytest.raises(ValueError, match="there are no frames"):
        track_beads([], time, calibration, rest, diameter=3.5)


def test_a_sweep_that_shows_other_beads_is_refused(session, calibration):
    rng = np.random.default_rng(0)
    images = [rng.uniform(20.0, 220.0, (24, 2)) for _ in range(7)]
    matrix = calibration.projections[0]
    turned = [matrix @ np.diag([1.0, 1.0, 1.0, 1.0]) + 1e-3 * n for n in range(7)]
    with pytest.raises(ValueError, match="the sweep shows"):
        places_from_sweep(turned, images, carm_measurement.REGION, tolerance=0.3)
    with pytest.raises(ValueError, match="five or more"):
        places_from_sweep(turned[:3], images[:3], carm_measurement.REGION)


def test_views_are_paired_by_epipolar_lines_and_motion(session, calibration, film):
    time, _ = film
    rng = np.random.default_rng(0)
    spots = [
        [project(p, session.places(now)) + 0.05 * rng.normal(size=(len(session.rest), 2)) for now in time]
        for p in calibration.projections
    ]
    tracks = [linked(each, 4.0) for each in spots]
    pairs, _ = pairs_by_epipolar(*calibration.projections, *tracks, tolerance=0.4)
    assert len(pairs) > 0.6 * len(session.rest)
    for a, b in pairs:
        owner = [  # whose image the middle of the track is
            np.bincount(
                [cKDTree(each).query(p)[1] for each, p in zip(s, t.T, strict=True) if np.isfinite(p).all()]
            ).argmax()
            for s, t in ((spots[0], tracks[0][:, a].T), (spots[1], tracks[1][:, b].T))
        ]
        assert owner[0] == owner[1]


def test_tracks_are_turned_into_the_specimens_frame():
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    shift = np.array([0.1, -0.2, 0.3])

    def seen(points):
        return np.asarray(points) @ turn.T + shift

    frame = SpecimenFrame.of_marks(
        seen([[-0.03, 0, 0], [0.03, 0, 0]]), seen([[0, 0.02, 0.02], [0, 0.1, 0.02]]), turn @ [0, 0.1, 1]
    )
    place = np.array([[0.01, 0.05, 0.004]])
    tracks = BeadTracks(
        bead=np.array([3]),
        time=np.array([0.0]),
        place=seen(place),
        covariance=(turn @ np.diag([1, 2, 3.0]) @ turn.T)[None],
    )
    found = frame.register(tracks)
    assert found.place == pytest.approx(place)
    assert found.covariance[0] == pytest.approx(np.diag([1, 2, 3.0]), abs=1e-12)
    with pytest.raises(ValueError, match="20 degrees"):
        SpecimenFrame.of_marks([[0, 0, 0], [0, 0.05, 0]], [[0, 0, 0], [0, 0.1, 0]], [0, 0, 1])


def test_the_lag_of_the_force_record_is_found_or_refused():
    cut = ramps()
    time = np.arange(0.0, 6.0, 1 / 29.97)
    motion = np.interp(time + 0.37, cut.time, cut.blade - cut.tip)
    noisy = motion + 1e-5 * np.random.default_rng(0).normal(size=len(time))
    lag, agreement = clock_lag(time, noisy, cut.time, cut.force, largest=1.0)
    assert lag == pytest.approx(0.37, abs=0.01)
    assert agreement > 0.9
    with pytest.raises(ValueError, match="the record of another cut"):
        clock_lag(time, np.random.default_rng(1).normal(size=len(time)), cut.time, cut.force)


def test_a_view_that_is_left_out_makes_a_place_less_certain(session, calibration, rest, film):
    time, frames = film
    still = [frames[0]] * 7
    blind = [[top, np.full_like(side, 110) + (np.arange(side.shape[1]) % 2).astype(np.uint8)] for top, side in still]
    both = track_beads(still, time[:7], calibration, rest, diameter=3.5)
    one = track_beads([*still[:2], *blind[2:]], time[:7], replace(calibration), rest, diameter=3.5)
    spread = [np.trace(t.of(0).covariance[-1]) for t in (both, one)]
    assert spread[1] > 2.0 * spread[0]


def test_a_bead_that_was_hidden_is_found_where_its_neighbours_have_gone(session, calibration, rest):
    """All beads drift by a pixel a frame; one is not there for six frames, and seven pixels farther when it is back."""
    rng, lost = np.random.default_rng(0), 9
    frames = []
    for number in range(12):
        moved = session.rest + np.array([0.0, 3e-4 * number, 0.0])
        shown = np.arange(len(moved)) != lost if 3 <= number < 9 else slice(None)
        still = replace(session, rest=moved[shown])
        frames.append([still.image(name, 0.0, rng) for name in session.cameras])
    time = np.arange(12) / calibration.frame_rate
    tracks = track_beads(frames, time, calibration, rest, diameter=3.5)
    own = tracks.of(int(np.argmax(owners(session, rest[0]) == lost)))
    assert own.time[-1] == time[-1]
    assert own.place[-1] == pytest.approx(moved[lost], abs=2e-4)


def test_the_covariance_in_a_field_is_at_least_twice_that_in_a_frame(session, calibration, rest):
    """A field has half the lines; those in between are interpolated and tell nothing new."""
    place, _ = rest
    far = np.broadcast_to(1e-6 * np.eye(3), (len(place), 3, 3))  # hardly anything is known beforehand
    frame = [session.image(name, 0.0, np.random.default_rng(0)) for name in session.cameras]
    time, spread = np.arange(2) / calibration.frame_rate, {}
    for first in (None, "bottom"):
        image = frame if first is None else [deinterlaced(each, first)[0] for each in frame]
        tracks = track_beads([image] * 2, time, replace(calibration, interlaced=first), (place, far), diameter=3.5)
        covariance = tracks.covariance[tracks.time == 0.0]
        spread[first] = float(np.median(np.trace(covariance, axis1=1, axis2=2)))
    assert 2.0 < spread["bottom"] / spread[None] < 3.0


def shown(session, places, number):
    """Return a frame of both views with beads at these places."""
    still, rng = replace(session, rest=places), np.random.default_rng(number)
    return [still.image(name, 0.0, rng) for name in session.cameras]


def errors_of(tracks, owner, places):
    """Return what the tracks are off [m], by the true places of each time."""
    return np.array([
        place - places[now][owner[bead]]
        for bead, now, place in zip(tracks.bead, tracks.time, tracks.place, strict=True)
    ])  # fmt: skip


def honest(tracks, off):
    """Return the squared error over its covariance for each place, per axis."""
    return np.einsum("ni,nij,nj->n", off, np.linalg.inv(tracks.covariance), off) / 3.0


def test_a_jump_of_the_whole_slab_swaps_no_beads(session, calibration, rest):
    """The slab tilts between two frames: it rises by 1 to 2 mm, as much as the beads of a row differ in height."""
    tilt = np.array([0.0, 0.0, 0.02]) * session.rest[:, 1:2] + np.array([0.0, 3e-4, 1e-3])
    time = np.arange(8) / calibration.frame_rate
    places = {now: session.rest + (tilt if number >= 3 else 0.0) for number, now in enumerate(time)}
    frames = [shown(session, places[now], number) for number, now in enumerate(time)]
    tracks = track_beads(frames, time, calibration, rest, diameter=3.5)
    off = errors_of(tracks, owners(session, rest[0]), places)
    assert len(tracks.bead) > 0.95 * len(time) * len(session.rest)
    assert np.abs(off).max() < 5e-4
    assert honest(tracks, off).max() < 9.0


def test_a_bead_that_is_gone_gets_no_other_beads_place(session, calibration, rest):
    """It is not there any more, and its neighbours drift; where it seems to be is unknown, and said to be."""
    owner, lost = owners(session, rest[0]), 9
    time = np.arange(40) / calibration.frame_rate
    places = {now: session.rest + np.array([0.0, 1e-4 * number, 0.0]) for number, now in enumerate(time)}
    frames = [
        shown(session, places[now] if number < 3 else np.delete(places[now], lost, axis=0), number)
        for number, now in enumerate(time)
    ]
    tracks = track_beads(frames, time, calibration, rest, diameter=3.5)
    number = int(np.argmax(owner == lost))
    assert tracks.of(number).time[-1] < time[6]
    without = tracks.metadata["frames_without_place"]
    assert sum(counts.get(str(number), 0) for counts in without.values()) > 33
    off = errors_of(tracks, owner, places)
    assert np.abs(off).max() < 5e-4


def test_a_bead_hidden_while_the_tissue_springs_back_is_not_said_to_be_known(session, calibration, rest):
    """The model moves it by 5 mm within a frame, 20 % too little; one view alone shows it."""
    owner, lost = owners(session, rest[0]), 9
    time = np.arange(8) / calibration.frame_rate
    jump = np.array([0.0, 0.0, 5e-3])

    def predicted(resting, now):
        return np.where(now < time[3], 0.0, 0.8 * jump) * np.ones_like(resting)

    places = {now: session.rest + (0.0 if number < 3 else jump) for number, now in enumerate(time)}
    frames = [shown(session, places[now], number) for number, now in enumerate(time)]
    for number in range(3, 8):  # the side view does not show it
        frames[number][1] = shown(session, np.delete(places[time[number]], lost, axis=0), number)[1]
    tracks = track_beads(frames, time, calibration, rest, diameter=3.5, displacement=predicted)
    off = errors_of(tracks, owner, places)
    assert honest(tracks, off).max() < 9.0
