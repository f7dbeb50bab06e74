"""R of single units from probes; the record reduced to hilltops and valleys; ramps that tell a wrong slope."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from cutenv._engine.randomness import generator
from cutenv.records.measurement import Segment, UnitResistances, estimate_unit_resistances, filtered, loading_segments
from cutenv.records.measurement.modulus import telling
from cutenv.sim.plant.protocol import to_trace
from cutenv.sim.plant.simulator import SimulatedPlant
from cutenv.sim.tissue import Specimen, measured_liver
from cutenv.sim.tissue.specimen import N_POINTS, SPACING
from cutenv.sim.trace import Trace

UPRIGHT = math.pi / 2
TOUGHNESS = (120.0, 200.0, 160.0, 300.0, 180.0)
"""Of the units, friction left out [J/m2]."""


class Probed(NamedTuple):
    """A record with a probe after every unit, and the resistance of each, friction's share included."""

    trace: Trace
    resistance: np.ndarray


def blade_on_a_spring(
    probe: float = 1.0, *, friction: float = 40.0, noise: float = 0.0, way_back: bool = False, eta: float = 0.3
) -> Probed:
    """F = K (x - a) + friction in a slab 2 cm deep; at (1 + eta) R B the tip jumps as far as the stored energy reaches.

    Half of K (lag^2 - next lag^2) = R B (lag - next lag) gives the lag after the jump. A probe goes back by ``probe``
    times that.
    """
    K, B, speed, dt = 900.0, 0.02, 0.004, 1e-3
    x, a = 0.0, 0.0
    path: list[tuple[np.ndarray, float, float]] = []  # places, tip, direction

    def travel(to: float) -> None:
        nonlocal x
        n = max(1, math.ceil(abs(to - x) / (speed * dt)))
        path.append((np.linspace(x, to, n + 1)[1:], a, math.copysign(1.0, to - x)))
        x = to

    for R in TOUGHNESS:
        travel(a + (1.0 + eta) * R * B / K)
        a = x - (1.0 - eta) * R * B / K
        turn = x
        travel(x - probe * (x - a))
        travel(turn)
    if way_back:
        travel(0.0)
    position = np.concatenate([[0.0], *(places for places, _, _ in path)])
    tips, signs = (np.concatenate([[0.0], *(np.full(len(p[0]), p[i]) for p in path)]) for i in (1, 2))
    force = K * np.maximum(position - tips, 0.0) + friction * B * signs
    force = force + noise * np.random.default_rng(1).standard_normal(len(force))
    columns: dict[str, Any] = {"position": position, "depth": np.full(len(force), B)}
    trace = Trace(time=np.arange(len(force)) * dt, force=force, **columns)
    return Probed(trace, np.array(TOUGHNESS) + friction)


def check_units(found: UnitResistances, resistance: np.ndarray, tolerance: float) -> None:
    assert len(found) == len(resistance)
    assert found.resistance == pytest.approx(resistance, rel=tolerance)


@pytest.mark.parametrize("probe", [0.7, 1.0, 1.5])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_every_unit_tells_its_own_resistance_whether_the_probe_passes_the_tip_or_not(
    probe: float, noise: float
) -> None:
    cut = blade_on_a_spring(probe, noise=noise)
    found = estimate_unit_resistances(cut.trace)
    check_units(found, cut.resistance, 0.03 if noise else 0.01)
    assert found.friction_per_depth == pytest.approx(40.0, rel=0.02)


def test_friction_left_in_is_noticed() -> None:
    cut = blade_on_a_spring()
    with pytest.raises(AssertionError):
        check_units(estimate_unit_resistances(cut.trace, friction_per_depth=0.0), cut.resistance, 0.05)


def test_the_return_stroke_after_the_last_probe_cuts_nothing() -> None:
    cut = blade_on_a_spring(way_back=True)
    check_units(estimate_unit_resistances(cut.trace), cut.resistance, 0.01)


def test_a_cut_without_probes_has_no_units() -> None:
    trace = blade_on_a_spring().trace
    assert len(estimate_unit_resistances(trace.select(trace.position >= np.maximum.accumulate(trace.position)))) == 0


@pytest.mark.parametrize("missing", ["position", "depth"])
def test_a_missing_field_is_named(missing: str) -> None:
    trace = dataclasses.replace(blade_on_a_spring().trace, **{missing: None})
    with pytest.raises(ValueError, match=f"estimate_unit_resistances needs {missing}"):
        estimate_unit_resistances(trace)


def probed_liver(seed: int, *, speed: float = 0.001, length: float = 0.04) -> tuple[Trace, Specimen, np.ndarray]:
    """A drawn liver, probed 4 mm back after every run of the crack; the record, and the tips at the probes."""
    specimen = Specimen.draw(generator(seed), specimen_class="liver", tissue=measured_liver())
    plant = SimulatedPlant(specimen, seed=seed)
    parts, tips = [plant.advance(0.0, UPRIGHT, 200).copy()], []

    def drive(to: float, velocity: float) -> None:
        while math.copysign(1.0, velocity) * (to - parts[-1]["position"][-1]) > 0.0:
            parts.append(plant.advance(velocity, UPRIGHT, 20).copy())

    while parts[-1]["position"][-1] < length:
        parts.append(plant.advance(speed, UPRIGHT, 20).copy())
        if parts[-1]["jump"].max() > 1e-3:
            tips.append(float(parts[-1]["tip"][-1]))
            turn = float(parts[-1]["position"][-1])
            drive(max(turn - 0.004, 0.5e-3), -0.004)
            drive(turn, 0.004)
    return to_trace(plant, np.concatenate(parts)), specimen, np.array(tips)


def true_unit_resistances(specimen: Specimen, tips: np.ndarray) -> np.ndarray:
    """R [J/m2] that the law was given between one tip and the next, friction's share included."""
    places = np.arange(N_POINTS) * SPACING
    share = specimen.tissue.friction_share
    truth = []
    for first, last in itertools.pairwise(tips):
        at = np.linspace(first, last, 200)
        fracture = np.interp(at, places, (1.0 - share) * specimen.fracture_resistance)
        truth.append(float(np.average(fracture, weights=np.interp(at, places, specimen.depth))))
    return np.array(truth) + specimen.friction_per_depth


def check_units_of_the_law(found: UnitResistances, specimen: Specimen, resistance: np.ndarray) -> None:
    truth = true_unit_resistances(specimen, np.append(found.start[:1], found.end))
    assert np.abs(resistance / truth - 1.0) == pytest.approx(0.0, abs=0.05)


def test_units_of_a_drawn_liver_come_out_within_5_percent() -> None:
    trace, specimen, tips = probed_liver(0)
    found = estimate_unit_resistances(trace)
    assert len(found) >= 8
    check_units_of_the_law(found, specimen, found.resistance)
    nearest = tips[np.argmin(np.abs(tips[:, None] - found.end), axis=0)]
    assert found.end == pytest.approx(nearest, abs=0.2e-3)
    with pytest.raises(AssertionError):
        check_units_of_the_law(found, specimen, np.full(len(found), found.resistance.mean()))


@pytest.fixture
def sawtooth():
    time = np.arange(6000) / 1000.0
    position = 0.02 + 0.01 * time
    clean = 2.0 + 0.8 * (time % 1.0)
    noisy = clean + np.random.default_rng(0).normal(0.0, 0.02, len(time))
    return clean, Trace(time=time, position=position, force=noisy)


def test_noise_goes_and_hilltops_and_valleys_stay(sawtooth):
    clean, trace = sawtooth
    found = filtered(trace)
    away_from_drops = np.abs((trace.time % 1.0) - 0.5) < 0.45
    inside = away_from_drops & (trace.time > 0.1) & (trace.time < 5.9)
    assert np.abs(found.force - clean)[inside].max() < 0.03
    assert np.abs(trace.force - clean)[inside].max() > 0.06
    falling = found.time[1:][np.diff(found.force) < -0.005]
    assert np.unique(np.round(falling[falling > 0.1])).tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_the_filtered_record_has_the_same_segments(sawtooth):
    _, trace = sawtooth
    before, after = loading_segments(trace), loading_segments(filtered(trace))
    assert len(before) == len(after) == 6
    assert [s.slope for s in after] == pytest.approx([s.slope for s in before], rel=0.05)


def test_a_stroke_back_stays_as_recorded(sawtooth):
    _, trace = sawtooth
    back = Trace(time=trace.time, position=trace.position[::-1], force=trace.force)
    assert np.array_equal(filtered(back).force, back.force)


def test_a_drop_below_the_noise_is_refused(sawtooth):
    with pytest.raises(ValueError, match="smallest_drop"):
        filtered(sawtooth[1], smallest_drop=-1.0)


NOISE = 0.025  # [N]
SPEED = 0.0127  # [m/s]


def saw(kink: float = 0.0, *, rate: float = 1000.0, noise: float = NOISE, repeated: int = 1) -> list[Segment]:
    """Three ramps of 0.4 s from 1 N to 3 N; from the middle on the last one rises by ``kink`` less [N/s].

    ``repeated`` readings share their noise, as an interpolated record's do.
    """
    time = np.arange(round(1.3 * rate)) / rate
    force = 1.0 + 5.0 * (time % 0.4)
    force -= np.where((time > 1.0) & (time < 1.2), kink * (time - 1.0), 0.0)
    rng = np.random.default_rng(1)
    disturbed = np.repeat(rng.normal(0.0, noise, len(time) // repeated + 1), repeated)[: len(time)]
    return loading_segments(Trace(time=time, force=force + disturbed, position=SPEED * time, angle=None))


def test_straight_ramps_are_restless_by_one_at_any_noise() -> None:
    for noise in (0.01, 0.025, 0.05):
        assert [ramp.restlessness for ramp in saw(noise=noise)[:3]] == pytest.approx([1.0] * 3, abs=0.2)


def test_a_bent_ramp_is_restless_and_tells_nothing() -> None:
    straight, bent = (saw(kink)[:3] for kink in (0.0, 4.0))
    assert [ramp.start for ramp in bent] == [ramp.start for ramp in straight]
    assert [ramp.is_steady for ramp in bent] == [ramp.is_steady for ramp in straight] == [False, True, True]
    assert [ramp.restlessness > 1.3 for ramp in bent] == [False, False, True]
    assert telling(straight) == straight[1:]
    assert telling(bent) == bent[1:2]


def test_a_bent_ramp_tells_nothing_though_it_is_the_only_one() -> None:
    """Beside itself it is as restless as usual."""
    assert telling(saw(4.0)[2:3]) == []
    assert telling(saw()[2:3]) == saw()[2:3]


def test_noise_that_lasts_is_no_bend() -> None:
    assert max(ramp.restlessness for ramp in saw(rate=10_000.0, repeated=10)[:3]) < 1.3


def test_a_ramp_without_noise_may_bend_with_the_depth() -> None:
    time = np.arange(1300) / 1000.0
    part = time % 0.4
    trace = Trace(time=time, force=1.0 + 4.0 * part + 3.0 * part**2, position=SPEED * time)
    ramps = [ramp for ramp in loading_segments(trace) if ramp.is_steady]
    assert all(ramp.restlessness > 1.3 for ramp in ramps)
    assert telling(ramps) == ramps != []
