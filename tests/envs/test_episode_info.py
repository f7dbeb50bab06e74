"""What an episode tells besides the reward: success, when a cut counts as finished, energy, truth and flags."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from whole_cut import FASTEST, INCLINED, UPRIGHT, Script, cut, legs, make, steady

from cutenv.agents.policy import ConstantFeed, RandomAction
from cutenv.sim.tissue import Specimen
from cutenv.sim.tissue.specimen import CLASSES

QUIET = {"specimen_class": "uniform", "force_noise": 0.0, "force_resolution": 0.0}
CUT_AND_STOP = legs((3.2, 0.02, UPRIGHT), (3.0, -0.01, UPRIGHT))  # 3 cm back unloads any tissue


def stopping_at(degrees: float) -> Script:
    """Cut upright, unload, turn to an angle, rest."""
    return legs((3.2, 0.02, UPRIGHT), (3.0, -0.01, math.radians(degrees)))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("error", "success"), [(-2.9e-3, True), (2.9e-3, True), (-3.1e-3, False), (3.1e-3, False)])
def test_a_success_ends_within_three_millimetres_of_the_target(seed, error, success):
    tip = cut(make(specimen_class="liver"), CUT_AND_STOP, seed).readings["tip"][-1]
    record = cut(make(specimen_class="liver"), CUT_AND_STOP, seed, target_length=tip + error)
    assert record.end == "finished"
    assert record.infos[-1]["is_success"] == success


@pytest.mark.parametrize(("degrees", "success"), [(90.0, True), (80.1, True), (79.9, False), (45.0, False)])
def test_a_success_ends_with_the_blade_within_ten_degrees_of_upright(degrees, success):
    tip = cut(make(**QUIET), stopping_at(degrees)).readings["tip"][-1]
    record = cut(make(**QUIET), stopping_at(degrees), target_length=tip)
    assert record.end == "finished"
    assert math.degrees(record.readings["angle"][-1]) == pytest.approx(degrees, abs=0.01)
    assert record.infos[-1]["is_success"] == success


@pytest.mark.parametrize(
    ("end", "keywords"), [("force_limit", {"force_limit_per_depth": 250.0}), ("deadline", {"deadline_s": 5.0})]
)
def test_no_other_end_is_a_success_however_near_the_tip(end, keywords):
    even = Specimen.homogeneous(modulus=48e3, fracture_resistance=200.0, depth=0.02)
    tougher = dataclasses.replace(even, fracture_resistance=np.linspace(50.0, 650.0, 301))
    options = {"specimen": tougher, "target_length": 0.1}
    tip = cut(make(**keywords), steady(0.015), **options).readings["tip"][-1]
    record = cut(make(**keywords), steady(0.015), **options | {"target_length": tip})
    assert record.end == end
    assert record.infos[-1]["is_success"] is False
    assert record.totals["accuracy"] > 0.2 * 2 / 3, "the tip is near"


def rested_before_the_end(readings: np.ndarray, friction: float) -> int:
    """Readings in a row before the end that were at rest and unloaded."""
    quiet = (np.abs(readings["speed"]) < 0.5e-3) & (readings["force"] < friction + 0.1)
    return len(quiet) - 1 - int(np.flatnonzero(~quiet)[-1])


def test_a_cut_is_finished_by_300_ms_of_rest_and_not_before():
    env = make(control_hz=1000, **QUIET)
    record = cut(env, ConstantFeed(speed=0.0127))
    specimen = env.unwrapped.specimen
    friction = specimen.friction_per_depth * specimen.depth[0]
    assert record.end == "finished"
    assert rested_before_the_end(record.readings, friction) == 300
    with pytest.raises(AssertionError):
        assert rested_before_the_end(record.readings[:-1], friction) == 300


@pytest.mark.parametrize(
    ("parts", "end"),
    [
        ([(0.86, 0.011, UPRIGHT), (1.0, -0.011, UPRIGHT)], "deadline"),  # 9.5 mm is too far from the target at 20 mm
        ([(1.00, 0.011, UPRIGHT), (1.1, -0.011, UPRIGHT)], "finished"),  # 11 mm is not
        ([(1.80, 0.011, UPRIGHT)], "deadline"),  # at rest, but loaded
        ([(1.80, 0.011, UPRIGHT), (1.5, -0.011, UPRIGHT), (9.0, -0.0006, UPRIGHT)], "deadline"),  # unloaded, creeping
        ([(1.80, 0.011, UPRIGHT), (1.5, -0.011, UPRIGHT), (9.0, -0.0004, UPRIGHT)], "finished"),
    ],
)
def test_a_cut_is_finished_only_near_the_target_at_rest_and_unloaded(parts, end):
    assert cut(make(deadline_s=7.0, target_length=0.02, **QUIET), legs(*parts)).end == end


KEYS = {"work", "stored", "fracture", "friction", "loss", "ledger", "residual"}


def check_energy(energies: list[dict[str, float]]) -> None:
    """Work is stored, fracture, friction, loss and ledger, at every decision."""
    for energy in energies:
        assert set(energy) == KEYS
        parts = sum(energy[name] for name in KEYS - {"work", "residual"})
        tolerance = 1e-9 * max(energy["work"], 1e-3)
        assert abs(energy["residual"]) <= tolerance
        assert abs(energy["work"] - parts) <= tolerance


@pytest.mark.parametrize("drive", ["rig", "hand"])
@pytest.mark.parametrize("specimen_class", CLASSES)
def test_the_energy_account_closes_at_every_decision_of_any_policy(specimen_class, drive):
    env = make(specimen_class=specimen_class, drive=drive, deadline_s=8.0, force_limit_per_depth=1e5)
    for policy in (RandomAction(), ConstantFeed(speed=0.02, angle=INCLINED), CUT_AND_STOP):
        record = cut(env, policy, seed=7)
        check_energy([info["energy"] for info in record.infos])
        assert record.infos[-1]["energy"]["work"] > 1e-3
        losses = [info["energy"]["loss"] for info in record.infos]
        assert (np.diff(losses) >= 0.0).all()


def test_the_energy_account_starts_at_zero_and_a_missing_friction_would_be_noticed():
    env = make()
    assert set(env.reset(seed=0)[1]["energy"].values()) == {0.0}
    energy = dict(cut(env, ConstantFeed(speed=0.02)).infos[-1]["energy"])
    check_energy([energy])
    with pytest.raises(AssertionError):
        check_energy([energy | {"friction": 0.999 * energy["friction"]}])


def test_the_truth_is_the_hidden_state_where_the_readings_end():
    env = make(specimen_class="vascular")
    record = cut(env, steady(0.01), seed=1, target_length=0.09)
    last, specimen = record.readings[-1], env.unwrapped.specimen
    truth = record.infos[-1]["truth"]
    place = round(last["tip"] / 0.0005)
    assert truth == {
        "tip_m": last["tip"],
        "blade_m": last["position"],
        "fracture_resistance_J_m2": specimen.fracture_resistance[place],
        "modulus_Pa": specimen.modulus[place],
        "initiation_excess": pytest.approx(specimen.tissue.eta90),
        "units": np.count_nonzero(np.diff((record.readings["jump"] > 0.0).astype(int), prepend=0) == 1),
        "uncontrolled_m": pytest.approx(record.readings["jump"].sum()),
        "specimen_class": "vascular",
        "target_length_m": 0.09,
    }


@pytest.mark.parametrize(
    ("drive", "speed", "flagged"),
    [
        ("rig", 0.0009, True),
        ("rig", 0.0011, False),
        ("rig", 0.0253, False),
        ("rig", -0.0009, True),
        ("rig", 0.0, False),
    ],
)
def test_a_speed_outside_the_measured_range_is_flagged(drive, speed, flagged):
    record = cut(
        make(drive=drive, deadline_s=3.0, force_limit_per_depth=1e5), legs((1.0, 0.003, UPRIGHT), (2.0, speed, UPRIGHT))
    )
    assert record.infos[-1]["speed_out_of_range"] is flagged


def test_a_speed_outside_the_measured_range_is_flagged_between_decisions_too():
    lurching = make(drive="hand", control_hz=5)
    record = cut(lurching, steady(FASTEST), seed=1)
    speed = np.abs(record.readings["speed"])
    outside = (speed > FASTEST) | ((speed > 0.0) & (speed < 0.001))
    decisions = np.array_split(outside, np.arange(200, len(outside), 200))
    assert [info["speed_out_of_range"] for info in record.infos] == [bool(some.any()) for some in decisions]
    assert any(not some.any() for some in decisions)


def test_nothing_happens_after_the_end():
    coarse = make(control_hz=2, **QUIET)
    record = cut(coarse, steady(FASTEST))
    assert record.end == "overshoot"
    assert record.infos[-1]["truth"]["tip_m"] == coarse.unwrapped.cutting.tip


def test_success_and_wedge_are_judged_at_the_same_instant():
    slow = {"control_hz": 1, "rotation_rate": math.radians(40.0), **QUIET}
    parts = [(3.0, 0.02, UPRIGHT), (2.0, -0.01, INCLINED), (4.0, 0.0, UPRIGHT)]
    turning_at_rest = legs(*parts, control_hz=1)
    tip = cut(make(**slow), turning_at_rest).readings["tip"][-1]
    record = cut(make(**slow), turning_at_rest, target_length=tip)
    assert record.end == "finished"
    upright = -record.totals["wedge"] / 0.2 <= math.tan(math.radians(10.0))
    assert record.infos[-1]["is_success"] == upright
