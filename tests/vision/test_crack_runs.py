"""Runs of the crack seen in a film: found when the tissue springs back, and matched with the drops of the force."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

pytest.importorskip("cv2", reason="cv2 is an extra: pip install 'cutenv[vision]'")
pytest.importorskip("av", reason="av is an extra: pip install 'cutenv[vision]'")

from cutenv.sim.tissue import CutModel
from cutenv.vision.blade_mark import MarkedBlade
from cutenv.vision.depth_record import SeenRun, filmed_depth, runs_and_drops, seen_runs
from cutenv.vision.film_source import VideoFrame
from cutenv.vision.marked_blade import BladeCameras
from scripts.validation.vision.rendering.moved_tissue import MovedTissue

RUNS = np.array([1.1, 1.3, 1.5])
"""Times at which the crack runs, 5 mm each [s]; the blade stands from 1.7 s on."""
END = 2.0
"""End of the record [s]."""


@pytest.fixture(scope="module")
def cut(filmed):
    """Record of a cut whose crack runs three times, its tissue, and the blade's lead."""
    trace = filmed.trace.select(slice(int(1e3 * END)))
    tip = 0.008 + 0.005 * np.searchsorted(RUNS, trace.time, side="right")
    lead = np.maximum(trace.position - tip, 0.0)
    force = 300.0 * lead + np.random.default_rng(1).normal(0.0, 0.02, len(lead))
    tissue = MovedTissue(model=CutModel(), time=trace.time, tip=tip, lead=lead)
    return dataclasses.replace(trace, force=force), tissue


def runs_of(filmed, trace, film, images):
    times = film.time[film.time + film.lag < END]
    frames = [VideoFrame(k, time, image) for k, (time, image) in enumerate(zip(times, images, strict=False))]
    depth = filmed_depth(list(BladeCameras(filmed.one, MarkedBlade()).measure_all(frames)), trace, MarkedBlade())
    return seen_runs(frames, depth, trace, filmed.one.frame_size[0])


def test_a_run_is_seen_when_it_happens_and_is_a_drop_of_the_force(filmed, cut):
    trace, tissue = cut
    film = filmed.render(rate=16.0, spoilt=0.0, tissue=tissue)
    film = dataclasses.replace(film, cameras=film.cameras[:1], scenes=film.scenes[:1])
    found = runs_and_drops(runs_of(filmed, trace, film, film.frames()), trace)
    assert [run.time for run in found.runs] == pytest.approx(RUNS, abs=0.04)
    assert found.drops == pytest.approx(RUNS, abs=0.01)
    assert found.pairs == ((0, 0), (1, 1), (2, 2))
    assert found.f1 == 1.0
    assert all(0.4e-3 < run.step_back < 5e-3 for run in found.runs)


def test_tissue_that_stands_still_shows_no_run(filmed, cut):
    trace, _ = cut
    found = runs_and_drops(runs_of(filmed, trace, filmed.film, [image[:, :320] for image in filmed.frames]), trace)
    assert found.runs == ()
    assert found.f1 == 0.0


def test_a_drop_belongs_to_one_run_the_nearest(cut):
    trace, _ = cut
    runs = tuple(SeenRun(time, 0.05, 1e-3) for time in (1.08, 1.11, 1.39))
    found = runs_and_drops(runs, trace)
    assert found.pairs == ((1, 0),)
    assert found.f1 == pytest.approx(2 / 6)


def test_neither_runs_nor_drops_are_no_number(cut):
    trace, _ = cut
    assert math.isnan(runs_and_drops((), dataclasses.replace(trace, force=np.zeros(len(trace)))).f1)
