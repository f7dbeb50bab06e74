"""Wear of the blade: what is put in comes out with an interval that holds it, and off is off to the last bit."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import cutenv  # noqa: F401  registers the environments
from cutenv.records.measurement import blade_wear, estimate_fracture_resistance, fit_wear, measure_cut
from cutenv.records.measurement.wear import BLADE_KEY, USED_KEY, used_before
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import CutModel, Specimen
from cutenv.sim.tissue.specimen import BladeWear
from cutenv.sim.trace import Trace

MANY = np.linspace(0.04, 2.0, 25)


def made_up(wear: float, spread: float, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal(len(MANY))
    return 200.0 * (1.0 + wear * MANY) * np.exp(spread * noise)


@pytest.mark.parametrize("wear", [0.0, 0.1, 0.5, 2.0])
def test_without_spread_the_fit_is_exact(wear: float):
    found = fit_wear(made_up(wear, 0.0), MANY)
    assert found.wear == pytest.approx(wear, abs=1e-8)
    assert found.fresh == pytest.approx(200.0)


def check_held(wear: float, claimed: float) -> None:
    """In at least 90 of 100 series the 95 % interval holds the wear."""
    fits = [fit_wear(made_up(wear, 0.2, seed), MANY) for seed in range(100)]
    assert sum(fit.low <= claimed <= fit.high for fit in fits) >= 90


@pytest.mark.parametrize("wear", [0.0, 0.3])
def test_the_interval_holds_what_was_put_in(wear: float):
    check_held(wear, wear)


def test_another_wear_is_not_held():
    with pytest.raises(AssertionError):
        check_held(0.3, 0.0)


def test_specimens_of_other_levels_do_not_hide_the_wear():
    pieces = [str(k % 5) for k in range(len(MANY))]
    levels = np.array([100.0, 400.0, 150.0, 300.0, 200.0])[[int(piece) for piece in pieces]]
    resistance = made_up(0.3, 0.02) / 200.0 * levels
    own, one = fit_wear(resistance, MANY, pieces), fit_wear(resistance, MANY)
    assert own.low <= 0.3 <= own.high
    assert own.high - own.low < 0.2 * (one.high - one.low)
    assert own.specimens == 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([200.0] * 3, [0.1, 0.2, 0.3]), "3 cuts of 1 specimens are too few"),
        (([200.0] * 5, [0.1, 0.2, 0.3, 0.4, 0.5], list("abcde")), "5 cuts of 5 specimens are too few"),
        (([200.0] * 5, [0.1] * 5), "all cuts were made at one age of the blade, 0.1 m"),
        (([200.0] * 4 + [-2.0], [0.1, 0.2, 0.3, 0.4, 0.5]), "resistance = -2 J/m2 is outside"),
        (([200.0] * 5, [0.1, 0.2, 0.3, 0.4]), "5 resistances, 4 lengths"),
    ],
)
def test_a_series_that_cannot_tell_is_refused(arguments, message: str):
    with pytest.raises(ValueError, match=message):
        fit_wear(*arguments)


def test_resistance_rises_along_the_cut_and_with_the_length_cut_before():
    specimen = Specimen.drawn(0, 0, specimen_class="uniform")
    worn = BladeWear(blade_wear=0.5, blade_used=2.0).of(specimen)
    ratio = worn.fracture_resistance / specimen.fracture_resistance
    assert ratio[0] == pytest.approx(2.0)
    assert ratio[-1] == pytest.approx(2.0 + 0.5 * 0.15)
    assert np.array_equal(worn.modulus, specimen.modulus)


def test_a_blade_without_wear_changes_nothing():
    specimen = Specimen.drawn(0, 0)
    assert BladeWear(blade_used=5.0).of(specimen) is specimen
    assert np.all(BladeWear(blade_used=5.0).factors() == 1.0)


def ran(count: int | None, **keywords: float) -> np.ndarray:
    name, action = "cutenv/GentleCut-v1", np.array([0.6, 1.0], np.float32)
    if count is None:
        env = gymnasium.make(name, **keywords)
        env.reset(seed=3)
        return np.array([env.step(action)[0] for _ in range(120)])
    envs = gymnasium.make_vec(name, num_envs=count, vectorization_mode="vector_entry_point", **keywords)
    envs.reset(seed=[3] * count)
    return np.array([envs.step(np.tile(action, (count, 1)))[0][0] for _ in range(120)])


def test_a_worn_blade_is_the_same_in_one_environment_and_in_many_and_feels_more_force():
    worn = {"blade_wear": 0.5, "blade_used": 2.0, "force_noise": 0.0}
    single, fresh = ran(None, **worn), ran(None, force_noise=0.0)
    assert np.array_equal(single, ran(2, **worn))
    assert single[:, 3].max() > 1.2 * fresh[:, 3].max()


def series(wear: float, told: bool) -> list[Trace]:
    traces, used = [], 0.0
    for cut in range(6):
        blade = BladeWear(blade_wear=wear, blade_used=used)
        plant = SimulatedPlant(blade.of(Specimen.drawn(1, cut, specimen_class="uniform")), seed=1, episode=cut)
        legs = [Leg(position=place, speed=0.0127, angle=np.pi / 2, dwell=0.2) for place in (0.06, 0.0)]
        metadata = {USED_KEY: used} if told else {}
        traces.append(to_trace(plant, run(plant, legs), **metadata))
        used += estimate_fracture_resistance(traces[-1]).cut_length + (0.3 if told else 0.0)
    return traces


@pytest.mark.parametrize("told", [True, False])
def test_wear_comes_out_of_records_of_a_series(told: bool):
    found = blade_wear([measure_cut(trace, CutModel()) for trace in series(0.5, told)])
    assert found.seen
    assert found.wear == pytest.approx(0.5, rel=0.06)
    assert f"rise of R per metre cut         {found.wear:5.3f}" in "\n".join(found.lines)


def test_lengths_add_up_for_each_blade():
    trace = series(0.0, told=False)[0]
    named = [trace.with_metadata({BLADE_KEY: blade}) for blade in "aabab"]
    assert used_before(named, [0.1, 0.2, 0.3, 0.4, 0.5]) == pytest.approx([0.0, 0.1, 0.0, 0.3, 0.3])


def test_records_that_tell_it_in_part_are_refused():
    trace = series(0.0, told=False)[0]
    with pytest.raises(ValueError, match=f'1 of 2 records lack metadata\\["{USED_KEY}"\\]'):
        used_before([trace, trace.with_metadata({USED_KEY: 0.1})], [0.1, 0.1])
    with pytest.raises(ValueError, match="is no length in metres"):
        used_before([trace.with_metadata({USED_KEY: "a lot"})], [0.1])
